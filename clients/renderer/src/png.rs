//! Pictures as PNG files.

use std::io;
use std::path::{Path, PathBuf};

use crate::Image;

/// Why a PNG file was not written.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    /// The operating system refused.
    #[error("cannot write {path}: {cause}")]
    Write {
        /// File in question.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// The picture cannot be stored as PNG.
    #[error("cannot encode {path} ({width} x {height} pixels): {cause}")]
    Encode {
        /// File in question.
        path: PathBuf,
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
        /// The encoder's reason.
        cause: png::EncodingError,
    },
}

/// Writes `image` to `path`, tagged sRGB. A reader never sees half a file: it appears under its name when complete.
///
/// # Errors
/// When the file cannot be created, or the picture has no pixels.
pub fn write_png(path: &Path, image: &Image) -> Result<(), PngError> {
    let write = |cause| PngError::Write {
        path: path.to_owned(),
        cause,
    };
    let encode = |cause| PngError::Encode {
        path: path.to_owned(),
        width: image.width,
        height: image.height,
        cause,
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width, image.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_compression(png::Compression::Fast);
    encoder
        .write_header()
        .and_then(|mut writer| {
            writer.write_image_data(&image.rgb)?;
            writer.finish()
        })
        .map_err(encode)?;
    cosplat_files::write(path, bytes).map_err(write)
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    #[test]
    fn a_picture_comes_back_from_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let image = Image {
            width: 5,
            height: 3,
            rgb: (0..45).map(|k| k * 5).collect(),
        };
        write_png(&path, &image).unwrap();
        let decoder = png::Decoder::new(io::BufReader::new(File::open(&path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (5, 3));
        assert_eq!(pixels, image.rgb);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn failures_name_the_file() {
        let image = Image {
            width: 1,
            height: 1,
            rgb: vec![0; 3],
        };
        let error = write_png(Path::new("/nonexistent/picture.png"), &image).unwrap_err();
        assert!(error.to_string().contains("/nonexistent/picture.png"));
        let folder = tempfile::tempdir().unwrap();
        let empty = Image {
            width: 0,
            height: 0,
            rgb: Vec::new(),
        };
        let error = write_png(&folder.path().join("empty.png"), &empty).unwrap_err();
        assert!(error.to_string().contains("0 x 0 pixels"), "{error}");
    }
}
