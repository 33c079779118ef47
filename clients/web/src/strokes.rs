//! The page on which a person parts a splat by strokes: what it shows, what it asks, and what is refused.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use bytes::Bytes;
use cosplat_ipc::schema::GaussianState;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::feed::{Shared, padded_harmonics};
use crate::http::{Site, serve};
use crate::latest::Parts;
use crate::{Door, WebError};

/// Most characters of a name.
pub const NAME: usize = 64;
/// Largest side of a picture [pixel].
pub const SIDE: u32 = 8192;
/// Longest line of a stroke [pixel].
pub const LENGTH: f32 = 100_000.0;
/// Largest deviation of a camera's axes from unit vectors at right angles.
const SKEW: f32 = 1e-3;

/// A splat as the page shows it.
pub struct Shown {
    /// What the page calls it.
    pub name: String,
    /// Signed axis that points up in pictures.
    pub up: [f32; 3],
    /// Smallest and largest corner of what the first picture shows.
    pub bounds: [[f32; 3]; 2],
    /// Its Gaussians.
    pub gaussians: Vec<GaussianState>,
    /// Degree of the harmonics.
    pub sh_degree: u32,
    /// Harmonics `[gaussian][coefficient][rgb]`; not read for degree 0.
    pub sh: Vec<f32>,
}

/// What a page asks: the objects of these strokes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Asked {
    /// Strokes that are there, in their order.
    #[serde(default)]
    pub strokes: Vec<Stroke>,
    /// One more, as it was drawn.
    pub line: Option<Line>,
    /// Whether the objects are written to the file.
    #[serde(default)]
    pub save: bool,
}

/// A stroke by what lies under it.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stroke {
    /// Name of the object.
    pub name: String,
    /// Gaussians under it.
    pub gaussians: Vec<u32>,
}

/// A stroke as it was drawn over a picture.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Name of the object.
    pub name: String,
    /// Centre of projection.
    pub position: [f32; 3],
    /// Unit axes of the camera: right, down, forward.
    pub axes: [[f32; 3]; 3],
    /// Focal length [pixel].
    pub focal: f32,
    /// Columns and rows of the picture.
    pub size: [u32; 2],
    /// What is nearer is not drawn.
    pub near: f32,
    /// Points of the line [pixel].
    pub points: Vec<[f32; 2]>,
}

/// What a page is told.
pub struct Told {
    /// Objects: name, colour 0..=1, number of Gaussians.
    pub objects: Vec<(String, [f32; 3], usize)>,
    /// Object of each Gaussian.
    pub label: Vec<i32>,
    /// Gaussians under the line.
    pub line: Vec<u32>,
    /// The file that was written.
    pub saved: Option<PathBuf>,
}

/// What makes objects of strokes, whoever knows how; the error is a sentence.
pub type Picker = Box<dyn Fn(Asked) -> Result<Told, String> + Send + Sync>;

/// Why a page's question makes no sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StrokeError {
    /// A name that no command line could say.
    #[error("the name is {name:?}, expected 1 to {NAME} characters without a colon and @")]
    Name {
        /// The name.
        name: String,
    },
    /// No such Gaussian.
    #[error("a stroke has Gaussian {gaussian}, expected 0 to {}", .count - 1)]
    Gaussian {
        /// Its number.
        gaussian: u32,
        /// How many there are.
        count: usize,
    },
    /// A stroke that marks nothing.
    #[error("a stroke has no Gaussians, expected at least one")]
    Empty,
    /// A picture of no use.
    #[error("the picture has {} x {} pixels, expected 1 to {SIDE}", .size[0], .size[1])]
    Size {
        /// Columns and rows.
        size: [u32; 2],
    },
    /// Numbers that are no camera.
    #[error("{what} of the camera is {found}, expected {expected}")]
    Camera {
        /// Which number.
        what: &'static str,
        /// What it is.
        found: f32,
        /// What it has to be.
        expected: &'static str,
    },
    /// A line that leaves the picture.
    #[error("a point of the line is [{}, {}], expected 0 to [{}, {}]", .point[0], .point[1], .size[0], .size[1])]
    Point {
        /// The point.
        point: [f32; 2],
        /// Columns and rows.
        size: [u32; 2],
    },
    /// A line without a point, or one that goes to and fro without end.
    #[error(
        "the line has {points} points and {length} pixels, expected 1 or more and at most {LENGTH}"
    )]
    Length {
        /// Points.
        points: usize,
        /// From the first to the last along the line [pixel].
        length: f32,
    },
}

impl Asked {
    /// Whether it makes sense for a splat with so many Gaussians.
    ///
    /// # Errors
    /// The first thing that does not.
    pub fn check(&self, count: usize) -> Result<(), StrokeError> {
        for stroke in &self.strokes {
            check_name(&stroke.name)?;
            let none = stroke.gaussians.iter().find(|g| **g as usize >= count);
            if let Some(&gaussian) = none {
                return Err(StrokeError::Gaussian { gaussian, count });
            }
            if stroke.gaussians.is_empty() {
                return Err(StrokeError::Empty);
            }
        }
        self.line.as_ref().map_or(Ok(()), Line::check)
    }
}

fn check_name(name: &str) -> Result<(), StrokeError> {
    let length = name.trim().chars().count();
    let is_sayable = !name.contains(|c: char| c == ':' || c == '@' || c.is_control());
    match (1..=NAME).contains(&length) && is_sayable {
        true => Ok(()),
        false => Err(StrokeError::Name { name: name.into() }),
    }
}

impl Line {
    fn check(&self) -> Result<(), StrokeError> {
        check_name(&self.name)?;
        let size = self.size;
        if size.iter().any(|side| !(1..=SIDE).contains(side)) {
            return Err(StrokeError::Size { size });
        }
        let camera = |what, found: f32, expected| StrokeError::Camera {
            what,
            found,
            expected,
        };
        for (what, found) in [("focal length", self.focal), ("near plane", self.near)] {
            if !(found.is_finite() && found > 0.0) {
                return Err(camera(what, found, "a finite number above 0"));
            }
        }
        if let Some(found) = self.position.iter().find(|x| !x.is_finite()) {
            return Err(camera("place", *found, "finite"));
        }
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        for one in 0..3 {
            for other in one..3 {
                let found = dot(self.axes[one], self.axes[other]);
                let (expected, said) = match one == other {
                    true => (1.0, "unit length, squared"),
                    false => (0.0, "a right angle: no common part"),
                };
                // What is no number is not near either.
                if found.is_nan() || (found - expected).abs() > SKEW {
                    return Err(camera("an axis", found, said));
                }
            }
        }
        let is_outside = |point: &&[f32; 2]| {
            !(0..2).all(|axis| (0.0..=size[axis] as f32).contains(&point[axis]))
        };
        if let Some(&point) = self.points.iter().find(is_outside) {
            return Err(StrokeError::Point { point, size });
        }
        let steps = self.points.windows(2);
        let length: f32 = steps
            .map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1]))
            .sum();
        match self.points.is_empty() || length > LENGTH {
            true => Err(StrokeError::Length {
                points: self.points.len(),
                length,
            }),
            false => Ok(()),
        }
    }
}

/// Answers the questions of pages, one at a time.
pub struct Board {
    picker: Mutex<Picker>,
    count: usize,
}

impl Board {
    /// The answer: bytes of the text, the text, the object of each Gaussian; a refusal is a sentence.
    pub fn answer(&self, asked: Asked) -> Result<Parts, String> {
        asked.check(self.count).map_err(|error| error.to_string())?;
        // One that panicked left nothing half done but its own answer.
        let picker = self.picker.lock().unwrap_or_else(PoisonError::into_inner);
        let told = picker(asked)?;
        let objects = told.objects.iter();
        let objects = objects.map(|(name, color, gaussians)| {
            json!({ "name": name, "color": color, "gaussians": gaussians })
        });
        let mut text = json!({
            "objects": objects.collect::<Vec<_>>(), "line": told.line, "saved": told.saved,
        })
        .to_string();
        text.extend(std::iter::repeat_n(
            ' ',
            text.len().next_multiple_of(4) - text.len(),
        ));
        let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
        bytes.extend_from_slice(text.as_bytes());
        bytes.extend(told.label.iter().flat_map(|label| label.to_le_bytes()));
        Ok(Parts([Bytes::from(bytes)].into()))
    }
}

/// The page of strokes, waiting for browsers.
pub struct Server {
    door: Door,
    shown: Shown,
    board: Board,
}

impl Server {
    /// Listens.
    ///
    /// # Errors
    /// When the address cannot be had.
    pub fn bind(
        address: std::net::SocketAddr,
        shown: Shown,
        picker: Picker,
    ) -> Result<Server, WebError> {
        Ok(Server {
            door: Door::open(address)?,
            board: Board {
                picker: Mutex::new(picker),
                count: shown.gaussians.len(),
            },
            shown,
        })
    }

    /// Where it listens.
    pub fn door(&self) -> &Door {
        &self.door
    }

    /// Serves until `stop`.
    pub fn run(self, stop: &AtomicBool) {
        let shared = Shared::new();
        show(&shared, &self.shown);
        let Door {
            runtime,
            listener,
            guard,
            ..
        } = self.door;
        let site = Arc::new(Site {
            shared,
            orders: None,
            presets: Value::Null,
            guard,
            board: Some(Arc::new(self.board)),
        });
        runtime.block_on(serve(listener, site, stop));
        runtime.shutdown_background();
    }
}

/// A scene of one object: the splat.
fn show(shared: &Shared, shown: &Shown) {
    let count = shown.gaussians.len();
    let about = json!({
        "session": shown.name,
        "gaussians": count,
        "gravity": shown.up.map(|x| -x),
        "low": shown.bounds[0],
        "high": shown.bounds[1],
        "sh_degree": shown.sh_degree,
        "objects": [{ "id": 0, "name": shown.name, "first": 0, "count": count }],
    });
    let harmonics = padded_harmonics(shown.sh_degree, &shown.sh);
    let mut latest = shared.latest();
    latest.begin(about, harmonics, &[(0, 0, count as u32)]);
    let _ = latest.set(0, &shown.gaussians, None);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> Line {
        Line {
            name: "pot".into(),
            position: [0.0; 3],
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            focal: 500.0,
            size: [640, 480],
            near: 0.01,
            points: vec![[320.0, 240.0], [330.0, 240.0]],
        }
    }

    fn found(change: impl FnOnce(&mut Line)) -> Result<(), StrokeError> {
        let mut line = line();
        change(&mut line);
        let line = Some(line);
        Asked {
            strokes: Vec::new(),
            line,
            save: false,
        }
        .check(10)
    }

    #[test]
    fn a_line_over_a_picture_is_taken() {
        assert_eq!(found(|_| {}), Ok(()));
        assert_eq!(found(|line| line.points.truncate(1)), Ok(()));
    }

    #[test]
    fn a_line_that_is_none_is_refused_with_its_numbers() {
        let camera = |what, found, expected| {
            Err(StrokeError::Camera {
                what,
                found,
                expected,
            })
        };
        let positive = "a finite number above 0";
        assert_eq!(
            found(|l| l.focal = 0.0),
            camera("focal length", 0.0, positive)
        );
        assert_eq!(
            found(|l| l.near = -1.0),
            camera("near plane", -1.0, positive)
        );
        let infinite = f32::INFINITY;
        assert_eq!(
            found(|l| l.position[1] = infinite),
            camera("place", infinite, "finite")
        );
        assert!(matches!(
            found(|l| l.axes[1][1] = f32::NAN),
            Err(StrokeError::Camera { .. })
        ));
        let right = "a right angle: no common part";
        assert_eq!(
            found(|l| l.axes[1] = l.axes[0]),
            camera("an axis", 1.0, right)
        );
        let size = [640, 0];
        assert_eq!(found(|l| l.size = size), Err(StrokeError::Size { size }));
        let (point, size) = ([640.5, 0.0], [640, 480]);
        let outside = Err(StrokeError::Point { point, size });
        assert_eq!(found(|l| l.points[1] = point), outside);
        assert!(matches!(
            found(|l| l.points[0][0] = f32::NAN),
            Err(StrokeError::Point { .. })
        ));
        let (points, length) = (0, 0.0);
        assert_eq!(
            found(|l| l.points.clear()),
            Err(StrokeError::Length { points, length })
        );
        let far = |l: &mut Line| l.points = [[0.0, 0.0], [640.0, 0.0]].repeat(100);
        assert!(matches!(
            found(far),
            Err(StrokeError::Length { points: 200, .. })
        ));
        for name in ["", " ", "a:b", "a@b", "a\nb", &"a".repeat(65)] {
            let refused = Err(StrokeError::Name { name: name.into() });
            assert_eq!(found(|l| l.name = name.into()), refused);
        }
    }

    #[test]
    fn a_stroke_has_gaussians_that_there_are() {
        let of = |gaussians: &[u32]| {
            let (name, gaussians) = ("pot".into(), gaussians.to_vec());
            let strokes = vec![Stroke { name, gaussians }];
            Asked {
                strokes,
                line: None,
                save: false,
            }
            .check(10)
        };
        assert_eq!(of(&[0, 9]), Ok(()));
        assert_eq!(of(&[]), Err(StrokeError::Empty));
        let refused = Err(StrokeError::Gaussian {
            gaussian: 10,
            count: 10,
        });
        assert_eq!(of(&[3, 10]), refused);
    }
}
