//! Gaussians that straddle two objects, and how they are cut in two.

use cosplat_scene::assets::Gaussians;
use glam::{DMat3, DQuat, DVec3, Vec2};

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
    /// Unit normal of the cut in its local axes, each over its standard deviation; towards the object of most weight.
    pub normal: DVec3,
    /// Share of it on that side, 0.2..=0.8.
    pub share: f32,
}

/// Evidence of where one straddler's object of most weight lies in it, against the rest.
#[derive(Clone, Debug)]
pub(super) struct Side {
    pub gaussian: usize,
    pub object: usize,
    share: f32,
    /// Sums over views, by weight: `A^T A` and `A^T d` of the standard deviations along its local axes on the screen, the
    /// columns of `A`, and the offset `d` between both [pixel].
    square: DMat3,
    product: DVec3,
}

impl Side {
    /// Nothing known yet of a straddler with these weights of the objects.
    pub fn new(gaussian: usize, of: &[f32]) -> Self {
        let object = (0..of.len()).fold(0, |a, b| if of[b] > of[a] { b } else { a });
        Self {
            gaussian,
            object,
            share: (of[object] / of.iter().sum::<f32>()).clamp(1.0 - SHARE, SHARE),
            square: DMat3::ZERO,
            product: DVec3::ZERO,
        }
    }

    /// Adds a view: `offset` [pixel] from the rest's middle to the object's, `weight` of the lesser, and what a standard
    /// deviation along each local axis is on the screen [pixel].
    pub fn add(&mut self, offset: Vec2, weight: f32, axes: [Vec2; 3]) {
        let (offset, axes, weight) = (
            offset.as_dvec2(),
            axes.map(Vec2::as_dvec2),
            f64::from(weight),
        );
        self.product += weight * DVec3::from_array(axes.map(|axis| offset.dot(axis)));
        let column = |k: usize| DVec3::from_array(axes.map(|axis| axis.dot(axes[k])));
        self.square += DMat3::from_cols(column(0), column(1), column(2)) * weight;
    }

    /// The cut that explains most of the offsets: least squares, drawn to none along axes that no view shows.
    pub fn cut(&self) -> Cut {
        let diagonal = self.square.x_axis.x + self.square.y_axis.y + self.square.z_axis.z;
        let least = (0.01 * diagonal).max(f64::MIN_POSITIVE);
        let found = (self.square + DMat3::from_diagonal(DVec3::splat(least))).inverse();
        Cut {
            gaussian: self.gaussian,
            normal: (found * self.product).try_normalize().unwrap_or(DVec3::X),
            share: self.share,
        }
    }
}

/// Axes of a symmetric matrix and its values along them: Jacobi's rotations.
fn axes(mut m: DMat3) -> (DMat3, DVec3) {
    let mut turn = DMat3::IDENTITY;
    // Each sweep squares what is left off the diagonal; six are more than enough for 64 bits.
    for (p, q) in [(0, 1), (0, 2), (1, 2)].repeat(6) {
        let off = m.col(q)[p];
        if off == 0.0 {
            continue;
        }
        let half = (m.col(q)[q] - m.col(p)[p]) / (2.0 * off);
        let tangent = half.signum() / (half.abs() + half.hypot(1.0));
        let cosine = 1.0 / tangent.hypot(1.0);
        let sine = tangent * cosine;
        let mut step = DMat3::IDENTITY;
        (step.col_mut(p)[p], step.col_mut(q)[q]) = (cosine, cosine);
        (step.col_mut(q)[p], step.col_mut(p)[q]) = (sine, -sine);
        m = step.transpose() * m * step;
        turn *= step;
    }
    (turn, DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z))
}

/// Where the standard normal distribution has `share` above it; error below 5e-4 (Abramowitz and Stegun 26.2.23).
fn quantile(share: f32) -> f32 {
    let t = (-2.0 * share.min(1.0 - share).ln()).sqrt();
    let x = t
        - (2.515_517 + t * (0.802_853 + t * 0.010_328))
            / (1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308)));
    if share < 0.5 { x } else { -x }
}

/// Cuts Gaussians in two: each part has the mean, covariance and mass of its side of the cut, but is `sharp` times as thick across
/// it. What is below comes in the place of the whole, what is above after all.
pub(super) fn split(g: &mut Gaussians, cuts: &[Cut], sharp: f64) {
    let (sh, feature) = (g.sh_stride(), g.feature_dim as usize);
    for &Cut {
        gaussian: n,
        normal,
        share,
    } in cuts
    {
        let at = quantile(share);
        let density = (-0.5 * at * at).exp() / std::f32::consts::TAU.sqrt();
        let (above, below) = (density / share, density / (1.0 - share));
        let opacity = g.opacity[n];
        let turn = DMat3::from_quat(DQuat::from_array(g.rotation[n].map(f64::from)));
        let scale = DMat3::from_diagonal(DVec3::from_array(g.scale[n].map(f64::from)));
        let position = DVec3::from_array(g.position[n].map(f64::from));
        let part = |mean: f32, share: f32| {
            // Moments of a normal distribution on one side of `at`.
            let variance = f64::from((1.0 + at * mean - mean * mean).max(0.01)) * sharp * sharp;
            let along = turn * (scale * normal);
            let flat = DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
            let inner = DMat3::IDENTITY - flat * (1.0 - variance);
            let (axes, square) = axes(scale * inner * scale);
            let opacity = f64::from(opacity * share) / variance.sqrt();
            let turned = DQuat::from_mat3(&(turn * axes));
            (
                (position + along * f64::from(mean)).as_vec3().to_array(),
                square
                    .max(DVec3::splat(1e-24))
                    .map(f64::sqrt)
                    .as_vec3()
                    .to_array(),
                turned.normalize().to_array().map(|x| x as f32),
                (opacity as f32).min(0.99),
            )
        };
        let second = part(above, share);
        (g.position[n], g.scale[n], g.rotation[n], g.opacity[n]) = part(-below, 1.0 - share);
        g.position.push(second.0);
        g.scale.push(second.1);
        g.rotation.push(second.2);
        g.opacity.push(second.3);
        g.sh.extend_from_within(n * sh..(n + 1) * sh);
        g.feature.extend_from_within(n * feature..(n + 1) * feature);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Covariance of a Gaussian.
    fn covariance(g: &Gaussians, n: usize) -> DMat3 {
        let turn = DMat3::from_quat(DQuat::from_array(g.rotation[n].map(f64::from)));
        let half = turn * DMat3::from_diagonal(DVec3::from_array(g.scale[n].map(f64::from)));
        half * half.transpose()
    }

    #[test]
    fn parts_have_the_middle_covariance_and_mass_of_the_whole() {
        for (share, normal) in [
            (0.2, DVec3::Y),
            (0.5, DVec3::new(0.6, 0.8, 0.0)),
            (0.7, DVec3::new(-2.0, 1.0, 2.0) / 3.0),
        ] {
            let middle = DVec3::new(1.0, 2.0, 3.0);
            let whole = Gaussians {
                position: vec![[1.0, 2.0, 3.0]],
                scale: vec![[0.1, 0.5, 0.2]],
                rotation: vec![glam::Quat::from_rotation_z(0.4).to_array()],
                opacity: vec![0.4],
                sh: vec![0.1, 0.2, 0.3],
                ..Gaussians::default()
            };
            let mut g = whole.clone();
            let cut = Cut {
                gaussian: 0,
                normal,
                share,
            };
            split(&mut g, &[cut], 1.0);
            assert_eq!((g.len(), g.sh.len()), (2, 6));
            let shares = [1.0 - f64::from(share), f64::from(share)];
            let off = [0, 1].map(|n| DVec3::from_array(g.position[n].map(f64::from)) - middle);
            let mean = shares[0] * off[0] + shares[1] * off[1];
            // What the quantile is off by.
            assert!(mean.length() < 1e-3, "{mean}");
            let square = |n: usize| {
                let of = DMat3::from_cols(off[n] * off[n].x, off[n] * off[n].y, off[n] * off[n].z);
                (covariance(&g, n) + of) * shares[n]
            };
            let apart = square(0) + square(1) - covariance(&whole, 0);
            let apart = apart.to_cols_array().map(f64::abs);
            assert!(apart.iter().all(|x| *x < 1e-3), "{apart:?}");
            let mass = |g: &Gaussians, n: usize| {
                let volume = covariance(g, n).determinant().sqrt();
                f64::from(g.opacity[n]) * volume
            };
            let kept = (mass(&g, 0) + mass(&g, 1)) / mass(&whole, 0);
            assert!((kept - 1.0).abs() < 1e-3, "{kept}");
        }
    }

    #[test]
    fn a_cut_is_across_what_separates_the_objects() {
        let axes = [
            Vec2::new(5.0, 0.0),
            Vec2::new(0.0, 2.0),
            Vec2::new(0.5, 0.5),
        ];
        let mut side = Side::new(7, &[1.0, 3.0]);
        side.add(Vec2::new(0.1, -3.0), 2.0, axes);
        let cut = side.cut();
        assert_eq!((cut.gaussian, cut.share), (7, 0.75));
        assert!(cut.normal.y < -0.9, "{}", cut.normal);
        // Between two axes: as many standard deviations along each.
        let mut side = Side::new(0, &[1.0, 1.0]);
        side.add(Vec2::new(5.0, 2.0), 1.0, axes);
        let normal = side.cut().normal;
        // What the draw to none takes.
        assert!(
            (normal.x - normal.y).abs() < 0.2 && normal.x > 0.6,
            "{normal}"
        );
    }

    #[test]
    fn axes_of_a_matrix_put_it_together_again() {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.2, 2.0));
        let m = turn * DMat3::from_diagonal(DVec3::new(4.0, 1e-6, 0.5)) * turn.transpose();
        let (found, values) = axes(m);
        let again = found * DMat3::from_diagonal(values) * found.transpose();
        let apart = (again - m).to_cols_array().map(f64::abs);
        // Rounding of 64 bits.
        assert!(apart.iter().all(|x| *x < 1e-14), "{apart:?}");
        assert!((found.determinant() - 1.0).abs() < 1e-14);
    }

    #[test]
    fn straddlers_are_seen_and_have_no_large_share() {
        let sums = [9.0, 1.0, 5.0, 4.0, 0.5, 0.4, 0.0, 0.0];
        assert_eq!(straddlers(&sums, 2), [1]);
    }
}
