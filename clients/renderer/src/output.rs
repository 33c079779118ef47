//! Which frames pictures are made of, and where these go: a numbered sequence of PNG files, and a video that keeps simulated
//! time.

use std::path::PathBuf;

use crate::Image;
use crate::client::RenderError;
use crate::drawing::Look;
use crate::mp4::Mp4Writer;
use crate::png::write_png;

/// Longest still in a video [s]: a longer pause of the simulated clock is cut, not shown.
const LONGEST_STILL: f64 = 10.0;

/// Which video frame shows which simulated time.
#[derive(Debug)]
pub(crate) struct TimeLine {
    fps: f64,
    /// Simulated time of video frame 0 [s]; moves when the simulation starts over.
    origin: Option<f64>,
    newest: f64,
    next: u64,
}

impl TimeLine {
    pub(crate) fn new(fps: f64) -> Self {
        Self {
            fps,
            origin: None,
            newest: f64::NEG_INFINITY,
            next: 0,
        }
    }

    /// How many video frames must show the picture before, when the one of `sim_time` follows; `None` when that one is
    /// not needed, as the video has a picture of this time already.
    pub(crate) fn stills_before(&mut self, sim_time: f64, new_run: bool) -> Option<u64> {
        if !sim_time.is_finite() {
            return None;
        }
        let here = sim_time - self.next as f64 / self.fps;
        let went_back = sim_time < self.newest || new_run;
        let origin = match self.origin {
            Some(origin) if !went_back => origin,
            _ => here,
        };
        self.newest = sim_time;
        // A millionth of a frame for the rounding of the clocks.
        let place = ((sim_time - origin) * self.fps + 1e-6).floor();
        let stills = place - self.next as f64;
        if stills > LONGEST_STILL * self.fps {
            self.origin = Some(here);
            return Some(0);
        }
        self.origin = Some(origin);
        (stills >= 0.0).then_some(stills as u64)
    }

    /// Notes that `count` frames were added.
    pub(crate) fn advance(&mut self, count: u64) {
        self.next += count;
    }
}

/// What one frame is needed for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wanted {
    picture: bool,
    stills: Option<u64>,
    /// Whether it is needed however little time there is: a later one will not do.
    pub is_chosen: bool,
}

impl Wanted {
    pub(crate) fn anything(self) -> bool {
        self.picture || self.stills.is_some()
    }
}

/// Which frames are drawn.
pub(crate) struct Plan {
    /// Steps between pictures, and the newest picture's step over that; 0 = whatever there is time for.
    pictures: Option<(u64, Option<u64>)>,
    video: Option<TimeLine>,
}

impl Plan {
    pub(crate) fn new(look: &Look) -> Self {
        Self {
            pictures: look.png.is_some().then_some((look.every, None)),
            video: look.mp4.is_some().then(|| TimeLine::new(look.fps)),
        }
    }

    /// What the frame of `step` is needed for; `last` frames are always wanted as a picture.
    pub(crate) fn wants(&mut self, step: u64, sim_time: f64, new_run: bool, last: bool) -> Wanted {
        let picture = self.pictures.is_some_and(|(every, newest)| {
            last || new_run || every == 0 || newest != Some(step / every)
        });
        let is_chosen = picture && (last || self.chooses_steps());
        let times = self.video.as_mut();
        let stills = times.and_then(|times| times.stills_before(sim_time, new_run));
        Wanted {
            picture,
            stills,
            is_chosen,
        }
    }

    /// Whether pictures are of certain steps.
    pub(crate) fn chooses_steps(&self) -> bool {
        self.pictures.is_some_and(|(every, _)| every > 0)
    }

    /// Notes that no other picture is wanted for `step`.
    pub(crate) fn pass(&mut self, step: u64) {
        if let Some((every, newest)) = &mut self.pictures {
            *newest = step.checked_div(*every);
        }
    }

    /// Notes that the frame of `step` will be drawn for what it is wanted for.
    pub(crate) fn commit(&mut self, wanted: Wanted, step: u64) {
        if wanted.picture {
            self.pass(step);
        }
        if let (Some(stills), Some(times)) = (wanted.stills, &mut self.video) {
            times.advance(stills + 1);
        }
    }
}

/// What was written.
#[derive(Clone, Debug, Default)]
pub(crate) struct Written {
    pub pictures: u64,
    pub last_picture: Option<PathBuf>,
    pub video: Option<PathBuf>,
    pub video_frames: u64,
}

/// The files of one run.
pub(crate) struct Outputs {
    folder: Option<PathBuf>,
    video: Option<(PathBuf, Mp4Writer)>,
    written: Written,
}

impl Outputs {
    /// Makes the folders and opens the video, so that a bad path shows at once.
    pub(crate) fn open(look: &Look) -> Result<Self, RenderError> {
        let folder = |path: PathBuf| match std::fs::create_dir_all(&path) {
            Ok(()) => Ok(path),
            Err(cause) => Err(RenderError::Folder { path, cause }),
        };
        let video = match &look.mp4 {
            Some(path) => {
                if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
                    folder(parent.to_owned())?;
                }
                let writer = Mp4Writer::create(path, look.width, look.height, look.fps)?;
                Some((path.clone(), writer))
            }
            None => None,
        };
        Ok(Self {
            folder: look.png.clone().map(folder).transpose()?,
            video,
            written: Written::default(),
        })
    }

    /// Writes `image`, the picture of `step`.
    pub(crate) fn write(
        &mut self,
        wanted: Wanted,
        step: u64,
        image: Image,
    ) -> Result<(), RenderError> {
        if let (true, Some(folder)) = (wanted.picture, &self.folder) {
            let path = folder.join(format!("frame_{step:08}.png"));
            write_png(&path, &image)?;
            self.written.pictures += 1;
            self.written.last_picture = Some(path);
        }
        if let (Some(stills), Some((_, writer))) = (wanted.stills, &mut self.video) {
            for _ in 0..stills {
                writer.repeat()?;
            }
            writer.add(&image)?;
        }
        Ok(())
    }

    /// Closes the files.
    pub(crate) fn finish(mut self) -> Result<Written, RenderError> {
        if let Some((path, writer)) = self.video {
            self.written.video_frames = writer.finish()?;
            self.written.video = (self.written.video_frames > 0).then_some(path);
        }
        Ok(self.written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Video frames that steps at the given times make.
    fn frames(line: &mut TimeLine, times: impl IntoIterator<Item = f64>) -> Vec<Option<u64>> {
        times
            .into_iter()
            .map(|time| {
                let stills = line.stills_before(time, false);
                line.advance(stills.map_or(0, |s| s + 1));
                stills
            })
            .collect()
    }

    #[test]
    fn a_slower_video_takes_every_second_frame() {
        let mut line = TimeLine::new(30.0);
        let taken = frames(&mut line, (0..120).map(|k| 1.0 + f64::from(k) / 60.0));
        assert_eq!(line.next, 60);
        for (k, stills) in taken.iter().enumerate() {
            assert_eq!(*stills, (k % 2 == 0).then_some(0), "frame {k}");
        }
    }

    #[test]
    fn missed_frames_become_stills() {
        let mut line = TimeLine::new(60.0);
        let taken = frames(&mut line, [0.0, 1.0 / 60.0, 5.0 / 60.0, 6.0 / 60.0]);
        assert_eq!(taken, [Some(0), Some(0), Some(3), Some(0)]);
        assert_eq!(line.next, 7);
    }

    #[test]
    fn a_faster_video_holds_every_picture() {
        let mut line = TimeLine::new(60.0);
        let taken = frames(&mut line, (0..4).map(|k| f64::from(k) / 20.0));
        assert_eq!(taken, [Some(0), Some(2), Some(2), Some(2)]);
    }

    #[test]
    fn the_video_goes_on_when_the_simulation_starts_over() {
        let mut line = TimeLine::new(10.0);
        frames(&mut line, [5.0, 5.1, 5.2]);
        assert_eq!(frames(&mut line, [0.0, 0.1]), [Some(0), Some(0)]);
        // Another server under the same name that is further on, and a clock that jumped.
        assert_eq!(line.stills_before(9.0, true), Some(0));
        line.advance(1);
        assert_eq!(
            frames(&mut line, [9.1, 1e9, 1e9 + 0.1]),
            [Some(0), Some(0), Some(0)]
        );
        assert_eq!(frames(&mut line, [f64::NAN, f64::INFINITY]), [None, None]);
        assert_eq!(line.next, 9);
    }
}
