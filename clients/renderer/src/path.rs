//! A camera that goes from key to key: checked, and passed through smoothly.

use cosplat_ipc::schema::FrameHeader;
use glam::{DMat3, DVec3};
use serde::Deserialize;

use crate::camera::Camera;

/// Vertical field of view where a key names none [degrees], as of other cameras here.
const FIELD: f64 = 40.0;
/// Smallest and largest vertical field of view [degrees].
const FIELDS: [f64; 2] = [1.0, 150.0];
/// Shortest distance of the eye from what it looks at, in a key [m].
const NEAREST: f64 = 1e-6;
/// Sine of the smallest angle between the view and up, in a key: a twentieth of a degree.
const SLANT: f64 = 1e-3;

/// A camera path, checked: at least one key, in ascending order.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    clock: Clock,
    keys: Vec<Key>,
}

/// What keys are counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Clock {
    /// Simulated seconds.
    Time,
    Step,
}

/// Where the camera is at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    /// Simulated time [s] or step.
    at: f64,
    /// Centre of projection [m].
    eye: DVec3,
    /// Point in the middle of the picture [m].
    target: DVec3,
    /// What is up in the picture, of length 1; `None` for the axis against gravity.
    up: Option<DVec3>,
    /// Vertical field of view [degrees].
    field: f64,
}

/// Why a path cannot be used. Keys are counted from 1.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// There is no key.
    #[error("the camera path has no keys, expected at least one [[keys]]")]
    Empty,
    /// A key has no moment, two, or one of another kind than the first.
    #[error("key {key} of the camera path: expected either time or step, and the same in all keys")]
    Moment {
        /// Which.
        key: usize,
    },
    /// A key is not later than the one before.
    #[error(
        "key {key} of the camera path is at {found}, expected more than {before}, where the key before it is"
    )]
    Order {
        /// Which.
        key: usize,
        /// Its moment.
        found: f64,
        /// That of the key before.
        before: f64,
    },
    /// A number is not finite, or out of its range.
    #[error("key {key} of the camera path: {what} is {found}, expected {expected}")]
    Range {
        /// Which.
        key: usize,
        /// Name of the value.
        what: &'static str,
        /// The value.
        found: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// The eye is where it looks.
    #[error("key {key} of the camera path looks at the place where it is, {at:?}")]
    Nowhere {
        /// Which.
        key: usize,
        /// The place [m].
        at: [f64; 3],
    },
    /// The view goes along up.
    #[error("key {key} of the camera path looks along its up axis {up:?}: give the key another up")]
    Along {
        /// Which.
        key: usize,
        /// The axis.
        up: [f64; 3],
    },
}

/// A key as a person writes it, unchecked.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrittenKey {
    /// Simulated time [s], from 0; either this or `step`.
    pub time: Option<f64>,
    /// Number of the step.
    pub step: Option<u64>,
    /// Centre of projection [m].
    pub eye: [f64; 3],
    /// Point in the middle of the picture [m], elsewhere.
    pub look_at: [f64; 3],
    /// What is up in the picture, of any length; without it the axis against gravity.
    pub up: Option<[f64; 3]>,
    /// Vertical field of view [degrees], 1 to 150.
    #[serde(default = "usual_field")]
    pub fov_deg: f64,
}

fn usual_field() -> f64 {
    FIELD
}

impl CameraPath {
    /// A path through keys, see `docs/export.md`.
    ///
    /// # Errors
    /// [`PathError`] says what is wrong with which of them.
    pub fn new(written: &[WrittenKey]) -> Result<Self, PathError> {
        let first = written.first().ok_or(PathError::Empty)?;
        let clock = match first.step {
            Some(_) => Clock::Step,
            None => Clock::Time,
        };
        let mut keys: Vec<Key> = Vec::with_capacity(written.len());
        for (key, number) in written.iter().zip(1..) {
            let key = key.checked(number, clock)?;
            if let Some(former) = keys.last().filter(|former| former.at >= key.at) {
                return Err(PathError::Order {
                    key: number,
                    found: key.at,
                    before: former.at,
                });
            }
            keys.push(key);
        }
        Ok(Self { clock, keys })
    }

    /// The camera for a frame, for pictures of so many pixels: between keys on a cubic that passes through them, before the
    /// first and behind the last where that key is. `up` is the axis against gravity, and `target` what is looked at in place
    /// of what keys say.
    pub fn camera(
        &self,
        header: &FrameHeader,
        up: glam::Vec3,
        target: Option<glam::Vec3>,
        [width, height]: [u32; 2],
    ) -> Camera {
        let at = match self.clock {
            Clock::Time => header.sim_time,
            Clock::Step => header.step as f64,
        };
        let up = up.as_dvec3();
        let pose = self.pose(at, up);
        let target = target.map_or(pose.target, glam::Vec3::as_dvec3);
        let axes = axes(target - pose.eye, pose.up, up);
        let tangent = (0.5 * pose.field.to_radians()).tan();
        let distance = (target - pose.eye).length();
        Camera {
            position: pose.eye.as_vec3(),
            world_from_camera: axes.as_mat3(),
            focal: [(0.5 * f64::from(height) / tangent) as f32; 2],
            center: [0.5 * width as f32, 0.5 * height as f32],
            width,
            height,
            near: (0.01 * distance as f32).max(f32::MIN_POSITIVE),
        }
    }

    fn pose(&self, at: f64, up: DVec3) -> Pose {
        let after = self.keys.partition_point(|key| key.at <= at);
        let (Some(left), Some(right)) = (after.checked_sub(1), self.keys.get(after)) else {
            return self.keys[after.saturating_sub(1)].pose(up);
        };
        let length = right.at - self.keys[left].at;
        let part = (at - self.keys[left].at) / length;
        // The cubic of these values and slopes.
        let (p2, p3) = (part * part, part * part * part);
        let mixed = Pose::sum([
            (2.0 * p3 - 3.0 * p2 + 1.0, self.keys[left].pose(up)),
            (3.0 * p2 - 2.0 * p3, right.pose(up)),
            (length * (p3 - 2.0 * p2 + part), self.slope(left, up)),
            (length * (p3 - p2), self.slope(after, up)),
        ]);
        Pose {
            field: mixed.field.clamp(FIELDS[0], FIELDS[1]),
            ..mixed
        }
    }

    /// How fast all changes at a key: as the parabola through it and its neighbours does there, at an end as the one through
    /// the three keys there. Of two keys it is a line.
    fn slope(&self, key: usize, up: DVec3) -> Pose {
        let last = self.keys.len() - 1;
        let middle = key.clamp(1, (last - 1).max(1));
        let near = &self.keys[middle - 1..=(middle + 1).min(last)];
        let at = self.keys[key].at;
        Pose::sum((0..near.len()).map(|n| (derivative(near, n, at), near[n].pose(up))))
    }
}

/// Derivative at a moment of the polynomial that is 1 at key `n` of these and 0 at the others.
fn derivative(keys: &[Key], n: usize, at: f64) -> f64 {
    let others = |but: usize| (0..keys.len()).filter(move |m| *m != n && *m != but);
    let factor = |m: usize| (at - keys[m].at) / (keys[n].at - keys[m].at);
    let terms = others(n).map(|m| {
        let rest: f64 = others(m).map(factor).product();
        rest / (keys[n].at - keys[m].at)
    });
    terms.sum()
}

/// A camera between keys, or how fast it changes.
#[derive(Clone, Copy, Debug, Default)]
struct Pose {
    eye: DVec3,
    target: DVec3,
    up: DVec3,
    field: f64,
}

impl Pose {
    fn sum(parts: impl IntoIterator<Item = (f64, Pose)>) -> Pose {
        let add = |sum: Pose, (weight, pose): (f64, Pose)| Pose {
            eye: sum.eye + weight * pose.eye,
            target: sum.target + weight * pose.target,
            up: sum.up + weight * pose.up,
            field: sum.field + weight * pose.field,
        };
        parts.into_iter().fold(Pose::default(), add)
    }
}

impl Key {
    fn pose(&self, up: DVec3) -> Pose {
        Pose {
            eye: self.eye,
            target: self.target,
            up: self.up.unwrap_or(up),
            field: self.field,
        }
    }
}

/// Right, down and forward of a view. Where it goes nowhere, or along up, another axis helps out: between keys, for a moment.
fn axes(forward: DVec3, up: DVec3, usual: DVec3) -> DMat3 {
    let forward = forward
        .try_normalize()
        .unwrap_or_else(|| usual.any_orthonormal_vector());
    let right = forward.cross(up).try_normalize();
    let right = right.unwrap_or_else(|| forward.any_orthonormal_vector());
    DMat3::from_cols(right, forward.cross(right), forward)
}

impl WrittenKey {
    fn checked(&self, key: usize, clock: Clock) -> Result<Key, PathError> {
        let at = match (clock, self.time, self.step) {
            (Clock::Time, Some(time), None) => time,
            (Clock::Step, None, Some(step)) => step as f64,
            _ => return Err(PathError::Moment { key }),
        };
        let range = |what, found: f64, is_right: bool, expected| match is_right {
            true => Ok(()),
            false => Err(PathError::Range {
                key,
                what,
                found,
                expected,
            }),
        };
        range("time", at, at.is_finite() && at >= 0.0, "0 or more")?;
        for (what, values) in [
            ("eye", Some(self.eye)),
            ("look_at", Some(self.look_at)),
            ("up", self.up),
        ] {
            for value in values.into_iter().flatten() {
                // Larger ones have no place in `f32`, which pictures are made with.
                let is_right = value.abs() <= 1e9;
                range(what, value, is_right, "numbers from -1e9 to 1e9")?;
            }
        }
        let is_field = self.fov_deg >= FIELDS[0] && self.fov_deg <= FIELDS[1];
        range("fov_deg", self.fov_deg, is_field, "1 to 150")?;
        let [eye, target] = [self.eye, self.look_at].map(DVec3::from);
        let forward = target - eye;
        if forward.length() < NEAREST {
            return Err(PathError::Nowhere { key, at: self.eye });
        }
        let along = |up: [f64; 3]| PathError::Along { key, up };
        let up = match self.up {
            None => None,
            Some(up) => Some(DVec3::from(up).try_normalize().ok_or_else(|| along(up))?),
        };
        if let (Some(axis), Some(given)) = (up, self.up)
            && forward.normalize().cross(axis).length() < SLANT
        {
            return Err(along(given));
        }
        Ok(Key {
            at,
            eye,
            target,
            up,
            field: self.fov_deg,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn key(time: f64, eye: [f64; 3]) -> WrittenKey {
        WrittenKey {
            time: Some(time),
            step: None,
            eye,
            look_at: [0.0; 3],
            up: None,
            fov_deg: 40.0,
        }
    }

    /// Keys at these moments; the eye's x is as said.
    fn line(moments: &[f64], x: impl Fn(f64) -> f64) -> CameraPath {
        let keys: Vec<_> = moments.iter().map(|t| key(*t, [x(*t), 5.0, 0.0])).collect();
        CameraPath::new(&keys).expect("a path")
    }

    fn x_at(path: &CameraPath, at: f64) -> f64 {
        path.pose(at, DVec3::Z).eye.x
    }

    #[test]
    fn a_path_passes_its_keys_and_is_straight_where_they_are() {
        let moments = [0.0, 0.5, 2.0, 2.25, 4.0];
        let straight = line(&moments, |t| 3.0 * t - 1.0);
        let bent = line(&moments, |t| t * t - t);
        for n in 0..=400 {
            let t = f64::from(n) * 0.01;
            // Both are what slopes by parabolas reproduce, whatever the distances: round-off of numbers up to 12 is left.
            assert!((x_at(&straight, t) - (3.0 * t - 1.0)).abs() < 1e-12, "{t}");
            assert!((x_at(&bent, t) - (t * t - t)).abs() < 1e-12, "{t}");
        }
        let two = line(&[1.0, 3.0], |t| 2.0 * t);
        assert!((x_at(&two, 1.5) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_path_has_no_kink_and_stays_at_its_ends() {
        let path = line(&[0.0, 1.0, 1.5, 4.0], |t| (5.0 * t).sin());
        for key in [1.0, 1.5] {
            let h = 1e-6;
            let before = (x_at(&path, key) - x_at(&path, key - h)) / h;
            let behind = (x_at(&path, key + h) - x_at(&path, key)) / h;
            // Second derivatives of some tens, times 1e-6.
            assert!((before - behind).abs() < 1e-3, "{before} {behind}");
        }
        assert_eq!(x_at(&path, -1.0), 0.0);
        assert_eq!(x_at(&path, 9.0), (20.0f64).sin());
    }

    #[test]
    fn a_camera_has_its_target_in_the_middle_and_up_above() {
        let keys = [
            (10, [0.0, 1.0, 4.0], None, 90.0),
            (20, [4.0, 1.0, 0.0], Some([0.0, 0.0, -2.0]), 60.0),
        ];
        let keys = keys.map(|(step, eye, up, fov_deg)| WrittenKey {
            time: None,
            step: Some(step),
            look_at: [0.0, 1.0, 0.0],
            up,
            fov_deg,
            ..key(0.0, eye)
        });
        let path = CameraPath::new(&keys).expect("a path");
        let at = |step| {
            let header = FrameHeader {
                step,
                ..FrameHeader::default()
            };
            path.camera(&header, Vec3::Y, None, [200, 100])
        };
        let close = |found: (f32, f32, f32), x: f32, y: f32| {
            // Thousandths of a pixel, for numbers of `f32` up to 200.
            assert!(
                (found.0 - x).abs() < 1e-3 && (found.1 - y).abs() < 1e-3,
                "{found:?}"
            );
        };
        for step in [0, 10] {
            close(at(step).project(Vec3::Y), 100.0, 50.0);
            // At 45 degrees above the axis is the upper edge of 90 degrees.
            close(at(step).project(Vec3::new(0.0, 5.0, 0.0)), 100.0, 0.0);
            close(at(step).project(Vec3::new(4.0, 1.0, 0.0)), 150.0, 50.0);
        }
        close(at(20).project(Vec3::Y), 100.0, 50.0);
        let edge = 4.0 * 30f32.to_radians().tan();
        close(at(25).project(Vec3::new(0.0, 1.0, -edge)), 100.0, 0.0);
        close(at(15).project(Vec3::Y), 100.0, 50.0);
        let turned = at(15).world_from_camera;
        // Products of unit vectors in `f32`.
        assert!((turned.determinant() - 1.0).abs() < 1e-5);
        let followed = path.camera(&FrameHeader::default(), Vec3::Y, Some(Vec3::X), [200, 100]);
        close(followed.project(Vec3::X), 100.0, 50.0);
    }

    #[test]
    fn a_path_that_leads_nowhere_is_refused_in_a_sentence() {
        let good = key(1.0, [1.0, 0.0, 0.0]);
        let with = |change: fn(&mut WrittenKey)| {
            let mut key = good.clone();
            change(&mut key);
            vec![key]
        };
        let later = |change| [vec![good.clone()], with(change)].concat();
        let either = "expected either time or step";
        let cases = [
            (Vec::new(), "has no keys"),
            (with(|key| key.time = None), either),
            (with(|key| key.step = Some(1)), either),
            (
                later(|key| (key.time, key.step) = (None, Some(2))),
                "key 2 of the camera path: expected either",
            ),
            (
                later(|_| {}),
                "key 2 of the camera path is at 1, expected more than 1",
            ),
            (
                with(|key| key.time = Some(-1.0)),
                "time is -1, expected 0 or more",
            ),
            (with(|key| key.eye[1] = f64::NAN), "eye is NaN"),
            (
                with(|key| key.look_at[2] = 1e12),
                "look_at is 1000000000000",
            ),
            (
                with(|key| key.fov_deg = 180.0),
                "fov_deg is 180, expected 1 to 150",
            ),
            (
                with(|key| key.eye = [0.0; 3]),
                "looks at the place where it is",
            ),
            (
                with(|key| key.up = Some([2.0, 0.0, 0.0])),
                "looks along its up axis [2.0, 0.0, 0.0]",
            ),
            (
                with(|key| key.up = Some([0.0; 3])),
                "give the key another up",
            ),
        ];
        for (keys, expected) in cases {
            let error = CameraPath::new(&keys).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
