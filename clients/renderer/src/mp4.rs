//! Pictures as an H.264 video in an MP4 file.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use cosplat_files::{Existing, NewFile};
use muxide::api::{Muxer, MuxerBuilder, MuxerError, VideoCodec};
use openh264::encoder::{
    ColorPrimaries, Complexity, Encoder, EncoderConfig, FrameRate, FrameType, IntraFramePeriod,
    RateControlMode, TransferCharacteristics, VuiConfig,
};
use openh264::formats::{RgbSliceU8, YUVBuffer};
use openh264::{OpenH264API, Timestamp};

use crate::Image;

/// A player can start at every such many seconds.
const KEY_FRAME_SECONDS: f64 = 2.0;

/// Why a video was not written.
#[derive(Debug, thiserror::Error)]
pub enum Mp4Error {
    /// Size or rate outside what H.264 level 5.2 takes.
    #[error(
        "a video needs 16..=3840 x 16..=2160 pixels (or upright) and 1..=1000 frames/s; {width} x {height} at {fps} is \
         not possible"
    )]
    Unsupported {
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
        /// Frames per second.
        fps: f64,
    },
    /// A later picture differs in size from the first.
    #[error("a video of {} x {} pixels cannot take a picture of {} x {}", expected.0, expected.1, actual.0, actual.1)]
    Size {
        /// Size of the video.
        expected: (u32, u32),
        /// Size of the picture.
        actual: (u32, u32),
    },
    /// The operating system refused.
    #[error("cannot write {path}: {cause}")]
    Write {
        /// File in question.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// The encoder failed.
    #[error("cannot encode {path}: {cause}")]
    Encode {
        /// File in question.
        path: PathBuf,
        /// The encoder's reason.
        cause: openh264::Error,
    },
    /// The container cannot hold the video.
    #[error("cannot pack {path}: {cause}")]
    Pack {
        /// File in question.
        path: PathBuf,
        /// The muxer's reason.
        cause: MuxerError,
    },
}

/// An MP4 file in the making. The coded video is kept in memory and written by [`finish`](Self::finish); a writer that is
/// dropped without it leaves no file under the name asked for.
pub struct Mp4Writer {
    path: PathBuf,
    new: NewFile,
    size: (u32, u32),
    fps: f64,
    encoder: Encoder,
    muxer: Muxer<File>,
    frames: u64,
    /// The latest picture as the encoder takes it.
    newest: Option<YUVBuffer>,
    coded: Vec<u8>,
}

impl Mp4Writer {
    /// Video at `path` of pictures of `width` x `height` pixels (odd sizes lose their last row or column, for H.264
    /// shares colour between 2 x 2 pixels) at `fps` frames per second.
    ///
    /// # Errors
    /// When size or rate is not possible, or the file cannot be created.
    pub fn create(path: &Path, width: u32, height: u32, fps: f64) -> Result<Self, Mp4Error> {
        let size = (width & !1, height & !1);
        let (long, short) = (size.0.max(size.1), size.0.min(size.1));
        if !((16..=2160).contains(&short) && long <= 3840 && (1.0..=1000.0).contains(&fps)) {
            return Err(Mp4Error::Unsupported { width, height, fps });
        }
        // The conversion to YUV uses the BT.601 matrix; primaries and transfer are those of sRGB pictures.
        let color = VuiConfig::bt601()
            .color_primaries(ColorPrimaries::Bt709)
            .transfer_characteristics(TransferCharacteristics::Bt709);
        let config = EncoderConfig::new()
            // A file has no line to fit: the same quality for every frame, whatever it takes.
            .rate_control_mode(RateControlMode::Off)
            .max_frame_rate(FrameRate::from_hz(fps as f32))
            .intra_frame_period(IntraFramePeriod::from_num_frames(
                (fps * KEY_FRAME_SECONDS).ceil() as u32,
            ))
            .skip_frames(false)
            // Whoever simulates needs the processor more than a video needs its last few bytes.
            .complexity(Complexity::Low)
            .scene_change_detect(false)
            .adaptive_quantization(false)
            .background_detection(false)
            .num_threads(1)
            .vui(color);
        let encoder =
            Encoder::with_api_config(OpenH264API::from_source(), config).map_err(|cause| {
                Mp4Error::Encode {
                    path: path.to_owned(),
                    cause,
                }
            })?;
        let write = |cause| Mp4Error::Write {
            path: path.to_owned(),
            cause,
        };
        let new = NewFile::create(path, Existing::IsReplaced).map_err(write)?;
        let file = new.file().try_clone().map_err(write)?;
        let muxer = MuxerBuilder::new(file)
            .video(VideoCodec::H264, size.0, size.1, fps)
            .build()
            .map_err(|cause| Mp4Error::Pack {
                path: path.to_owned(),
                cause,
            })?;
        Ok(Self {
            path: path.to_owned(),
            new,
            size,
            fps,
            encoder,
            muxer,
            frames: 0,
            newest: None,
            coded: Vec::new(),
        })
    }

    /// Frames added so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Appends `image` as the next frame.
    ///
    /// # Errors
    /// When its size is not that of the video, or encoding fails.
    pub fn add(&mut self, image: &Image) -> Result<(), Mp4Error> {
        let (width, height) = self.size;
        if (image.width & !1, image.height & !1) != self.size {
            return Err(Mp4Error::Size {
                expected: self.size,
                actual: (image.width, image.height),
            });
        }
        let (row, used) = (3 * image.width as usize, 3 * width as usize);
        let even: Vec<u8> = image
            .rgb
            .chunks_exact(row)
            .take(height as usize)
            .flat_map(|line| &line[..used])
            .copied()
            .collect();
        let pixels = RgbSliceU8::new(&even, (width as usize, height as usize));
        self.newest = Some(YUVBuffer::from_rgb8_source(pixels));
        self.repeat()
    }

    /// Appends the latest picture once more; nothing before there is one.
    ///
    /// # Errors
    /// When encoding fails.
    pub fn repeat(&mut self) -> Result<(), Mp4Error> {
        let Some(picture) = &self.newest else {
            return Ok(());
        };
        let seconds = self.frames as f64 / self.fps;
        let encode = |cause| Mp4Error::Encode {
            path: self.path.clone(),
            cause,
        };
        let time = Timestamp::from_millis((seconds * 1e3) as u64);
        let stream = self.encoder.encode_at(picture, time).map_err(encode)?;
        let is_key = matches!(stream.frame_type(), FrameType::IDR);
        self.coded.clear();
        stream.write_vec(&mut self.coded);
        self.muxer
            .write_video(seconds, &self.coded, is_key)
            .map_err(|cause| Mp4Error::Pack {
                path: self.path.clone(),
                cause,
            })?;
        self.frames += 1;
        Ok(())
    }

    /// Writes the file; returns its number of frames. Without any frame there is no file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(mut self) -> Result<u64, Mp4Error> {
        if self.frames == 0 {
            return Ok(0);
        }
        self.muxer
            .finish_in_place()
            .map_err(|cause| Mp4Error::Pack {
                path: self.path.clone(),
                cause,
            })?;
        let path = self.path;
        let named = self.new.finish();
        named.map_err(|cause| Mp4Error::Write { path, cause })?;
        Ok(self.frames)
    }
}

#[cfg(test)]
mod tests;
