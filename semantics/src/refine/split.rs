//! Gaussians that straddle two objects, and how they are cut in two.

use cosplat_scene::assets::Gaussians;
use glam::{Mat3, Quat, Vec2, Vec3};

use super::Straddling;

/// A Gaussian whose largest share of an object is below this straddles.
const SHARE: f32 = 0.8;
/// Less weight than this in all views says nothing about a Gaussian [pixel].
const SEEN: f32 = 1.0;
/// Which Gaussians straddle, from sums of weight per object, `[gaussians][objects]` [pixel].
pub(super) fn straddlers(sums: &[f32], objects: usize) -> Vec<usize> {
    let straddles = |of: &[f32]| {
        let (sum, most) = of
            .iter()
            .fold((0.0f32, 0.0f32), |(s, m), w| (s + w, m.max(*w)));
        sum > SEEN && most < SHARE * sum
    };
    let rows = sums.chunks(objects.max(1)).enumerate();
    rows.filter(|(_, of)| straddles(of))
        .map(|(n, _)| n)
        .collect()
}

/// How many straddle, and how much matter that is.
pub(super) fn straddling(g: &Gaussians, sums: &[f32], objects: usize) -> Straddling {
    let mut found = Straddling::default();
    for n in straddlers(sums, objects) {
        let mut scale = g.scale[n].map(f64::from);
        scale.sort_unstable_by(f64::total_cmp);
        found.count += 1;
        found.opacity += f64::from(g.opacity[n]);
        found.mass += f64::from(g.opacity[n]) * scale[1] * scale[2];
    }
    found
}

/// Where a Gaussian is cut in two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cut {
    /// Its row.
    pub gaussian: usize,
    /// Its local axis that the cut is across.
    pub axis: usize,
    /// Share of it on the positive side of that axis, 0.2..=0.8.
    pub share: f32,
}

/// Evidence of where one straddler's object of most weight lies in it, against the rest.
#[derive(Clone, Debug)]
pub(super) struct Side {
    pub gaussian: usize,
    pub object: usize,
    share: f32,
    /// Of each local axis, sums over views: of the offset between both in pixels times that of one standard deviation, and of
    /// the square of the latter.
    along: [[f32; 2]; 3],
}

impl Side {
    /// Nothing known yet of a straddler with these weights of the objects.
    pub fn new(gaussian: usize, of: &[f32]) -> Self {
        let object = (0..of.len()).fold(0, |a, b| if of[b] > of[a] { b } else { a });
        Self {
            gaussian,
            object,
            share: (of[object] / of.iter().sum::<f32>()).clamp(1.0 - SHARE, SHARE),
            along: [[0.0; 2]; 3],
        }
    }

    /// Adds a view: `offset` [pixel] from the rest's middle to the object's, `weight` of the lesser, and what a standard
    /// deviation along each local axis is on the screen [pixel].
    pub fn add(&mut self, offset: Vec2, weight: f32, axes: [Vec2; 3]) {
        for (along, axis) in self.along.iter_mut().zip(axes) {
            along[0] += weight * offset.dot(axis);
            along[1] += weight * axis.length_squared();
        }
    }

    /// The cut across the axis that explains most of the offsets.
    pub fn cut(&self) -> Cut {
        let explained = |k: usize| {
            let [product, square] = self.along[k];
            if square > 0.0 {
                product * product / square
            } else {
                0.0
            }
        };
        let axis = (0..3).fold(0, |a, b| if explained(b) > explained(a) { b } else { a });
        let is_above = self.along[axis][0] > 0.0;
        Cut {
            gaussian: self.gaussian,
            axis,
            share: if is_above {
                self.share
            } else {
                1.0 - self.share
            },
        }
    }
}

/// Where the standard normal distribution has `share` above it; error below 5e-4 (Abramowitz and Stegun 26.2.23).
fn quantile(share: f32) -> f32 {
    let t = (-2.0 * share.min(1.0 - share).ln()).sqrt();
    let x = t
        - (2.515_517 + t * (0.802_853 + t * 0.010_328))
            / (1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308)));
    if share < 0.5 { x } else { -x }
}

/// Cuts Gaussians in two: each part has the mean, extent and mass of its side of the cut. What is below comes in the place of
/// the whole, what is above after all.
pub(super) fn split(g: &mut Gaussians, cuts: &[Cut]) {
    let (sh, feature) = (g.sh_stride(), g.feature_dim as usize);
    for &Cut {
        gaussian: n,
        axis,
        share,
    } in cuts
    {
        let at = quantile(share);
        let density = (-0.5 * at * at).exp() / std::f32::consts::TAU.sqrt();
        let (above, below) = (density / share, density / (1.0 - share));
        // Moments of a normal distribution on either side of `at`.
        let extent = |mean: f32| (1.0 + at * mean - mean * mean).max(0.01).sqrt();
        let (scale, opacity) = (g.scale[n][axis], g.opacity[n]);
        let along = Mat3::from_quat(Quat::from_array(g.rotation[n])).col(axis) * scale;
        let position = Vec3::from_array(g.position[n]);
        let part = |mean: f32, share: f32| {
            let extent = extent(mean);
            let opacity = (opacity * share / extent).min(0.99);
            (
                (position + along * mean).to_array(),
                scale * extent,
                opacity,
            )
        };
        let second = part(above, share);
        (g.position[n], g.scale[n][axis], g.opacity[n]) = part(-below, 1.0 - share);
        let mut scale = g.scale[n];
        scale[axis] = second.1;
        g.position.push(second.0);
        g.scale.push(scale);
        g.rotation.push(g.rotation[n]);
        g.opacity.push(second.2);
        g.sh.extend_from_within(n * sh..(n + 1) * sh);
        g.feature.extend_from_within(n * feature..(n + 1) * feature);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_the_middle_extent_and_mass_of_the_whole() {
        for share in [0.2, 0.5, 0.7] {
            let mut g = Gaussians {
                position: vec![[1.0, 2.0, 3.0]],
                scale: vec![[0.1, 0.5, 0.2]],
                rotation: vec![Quat::from_rotation_z(0.4).to_array()],
                opacity: vec![0.4],
                sh: vec![0.1, 0.2, 0.3],
                ..Gaussians::default()
            };
            let cut = Cut {
                gaussian: 0,
                axis: 1,
                share,
            };
            split(&mut g, &[cut]);
            assert_eq!((g.len(), g.sh.len()), (2, 6));
            let axis = Mat3::from_rotation_z(0.4) * Vec3::Y;
            let off = [0, 1]
                .map(|n| (Vec3::from_array(g.position[n]) - Vec3::new(1.0, 2.0, 3.0)).dot(axis));
            let shares = [1.0 - share, share];
            let mean = shares[0] * off[0] + shares[1] * off[1];
            let square = |n: usize| shares[n] * (off[n].powi(2) + g.scale[n][1].powi(2));
            let mass = |n: usize| g.opacity[n] * g.scale[n][1];
            // What the quantile is off by.
            assert!(off[1] > off[0] && mean.abs() < 1e-3, "{mean}");
            assert!((square(0) + square(1) - 0.25).abs() < 1e-3);
            assert!((mass(0) + mass(1) - 0.2).abs() < 1e-3);
        }
    }

    #[test]
    fn a_cut_is_across_the_axis_that_separates_the_objects() {
        let mut side = Side::new(7, &[1.0, 3.0]);
        let axes = [
            Vec2::new(5.0, 0.0),
            Vec2::new(0.0, 2.0),
            Vec2::new(0.5, 0.5),
        ];
        side.add(Vec2::new(0.1, -3.0), 2.0, axes);
        let cut = side.cut();
        assert_eq!((cut.gaussian, cut.axis, cut.share), (7, 1, 0.25));
    }

    #[test]
    fn straddlers_are_seen_and_have_no_large_share() {
        let sums = [9.0, 1.0, 5.0, 4.0, 0.5, 0.4, 0.0, 0.0];
        assert_eq!(straddlers(&sums, 2), [1]);
    }
}
