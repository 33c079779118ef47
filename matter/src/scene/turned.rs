//! A box that need not lie along the axes.

use super::{Aabb, Pose};
use crate::rotation::{conjugate, rotate};

/// Box turned about its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnedBox {
    /// The box before it is turned [m].
    pub bounds: Aabb,
    /// Rotation about its middle, unit quaternion xyzw.
    pub rotation: [f64; 4],
}

impl From<Aabb> for TurnedBox {
    fn from(bounds: Aabb) -> Self {
        Self {
            bounds,
            rotation: Pose::IDENTITY.rotation,
        }
    }
}

impl TurnedBox {
    /// Whether it lies along other axes than those of the world.
    pub fn is_turned(&self) -> bool {
        self.rotation[..3] != [0.0; 3]
    }

    /// The box with all faces moved outwards [m].
    pub fn grown(&self, by: f64) -> Self {
        Self {
            bounds: Aabb {
                min: self.bounds.min.map(|x| x - by),
                max: self.bounds.max.map(|x| x + by),
            },
            ..*self
        }
    }

    /// Whether a point is inside, faces included; NaN is not.
    pub fn contains(&self, x: [f64; 3]) -> bool {
        self.bounds.contains(self.turned_back(x))
    }

    /// From where to where the way between two points is inside, as shares of it; the second is smaller than the first if it
    /// nowhere is.
    pub fn clip(&self, ends: [[f64; 3]; 2]) -> [f64; 2] {
        let [from, to] = ends.map(|x| self.turned_back(x));
        let Aabb { min, max } = self.bounds;
        let mut inside = [0.0_f64, 1.0];
        for a in 0..3 {
            let way = to[a] - from[a];
            if way == 0.0 {
                if !(min[a]..=max[a]).contains(&from[a]) {
                    return [1.0, 0.0];
                }
                continue;
            }
            let [x, y] = [min, max].map(|face| (face[a] - from[a]) / way);
            inside = [inside[0].max(x.min(y)), inside[1].min(x.max(y))];
        }
        inside
    }

    /// Where a point is as seen from the box before it was turned.
    fn turned_back(&self, x: [f64; 3]) -> [f64; 3] {
        if !self.is_turned() {
            return x;
        }
        let middle = self.middle();
        let arm = std::array::from_fn(|a| x[a] - middle[a]);
        let back = rotate(conjugate(self.rotation), arm);
        std::array::from_fn(|a| middle[a] + back[a])
    }

    /// The smallest box along the axes that holds it.
    pub fn around(&self) -> Aabb {
        if !self.is_turned() {
            return self.bounds;
        }
        let (middle, Aabb { min, max }) = (self.middle(), self.bounds);
        let edges = [0, 1, 2].map(|a| {
            let mut half = [0.0; 3];
            half[a] = 0.5 * (max[a] - min[a]);
            rotate(self.rotation, half)
        });
        let reach: [f64; 3] = std::array::from_fn(|a| edges.iter().map(|e| e[a].abs()).sum());
        Aabb {
            min: std::array::from_fn(|a| middle[a] - reach[a]),
            max: std::array::from_fn(|a| middle[a] + reach[a]),
        }
    }

    /// Where `bounds` are turned to.
    pub fn pose(&self) -> Pose {
        let middle = self.middle();
        let turned = rotate(self.rotation, middle);
        Pose {
            translation: std::array::from_fn(|a| middle[a] - turned[a]),
            rotation: self.rotation,
        }
    }

    fn middle(&self) -> [f64; 3] {
        let Aabb { min, max } = self.bounds;
        std::array::from_fn(|a| 0.5 * (min[a] + max[a]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_box_holds_what_its_middle_turned() {
        let half = std::f64::consts::FRAC_PI_8.sin();
        let bounds = Aabb {
            min: [1.0, 0.0, -1.0],
            max: [3.0, 0.2, 1.0],
        };
        // 45 degrees about z, about (2, 0.1, 0).
        let turned = TurnedBox {
            bounds,
            rotation: [0.0, 0.0, half, (1.0 - half * half).sqrt()],
        };
        let along = |s: f64| [2.0 + s * 0.5f64.sqrt(), 0.1 + s * 0.5f64.sqrt(), 0.0];
        assert!(turned.contains(along(0.99)) && turned.contains(along(-0.99)));
        assert!(!turned.contains(along(1.01)));
        assert!(bounds.contains([2.9, 0.1, 0.0]) && !turned.contains([2.9, 0.1, 0.0]));
        assert!(!turned.contains([f64::NAN, 0.1, 0.0]));
        // Half edges 1 and 0.1 along the turned axes.
        let reach = 1.1 * 0.5f64.sqrt();
        let around = turned.around();
        for (found, expected) in [
            (around.min[0], 2.0 - reach),
            (around.max[1], 0.1 + reach),
            (around.max[2], 1.0),
            (turned.pose().point([3.0, 0.1, 0.0])[0], along(1.0)[0]),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        let clipped = turned.clip([along(-3.0), along(2.0)]);
        for (found, expected) in clipped.iter().zip([0.4, 0.8]) {
            assert!((found - expected).abs() < 1e-12, "{clipped:?}");
        }
        let [first, last] = turned.clip([along(1.1), along(2.0)]);
        assert!(last < first);
        let plain = TurnedBox::from(bounds);
        assert_eq!(plain.around(), bounds);
        assert!(plain.contains(bounds.min) && plain.contains(bounds.max));
    }
}
