//! Axes and scales of Gaussians, followed from step to step.
//!
//! A frame has covariances; splat files have axes and scales. Eigenvectors are those, but in any order and with any sign, so a
//! film that blends between files would tumble. Hence Jacobi's method (Golub and Van Loan, Matrix Computations, 8.5) begins
//! with the axes of the step before, turned as the Gaussian turned since: it changes them no more than it must.

use cosplat_ipc::schema::{GaussianRest, GaussianState};
use glam::{DMat3, DQuat, DVec3, Quat};
use rayon::prelude::*;

/// Rotations that Jacobi's method takes at most; it converges quadratically, and three per sweep are needed.
const ROTATIONS: usize = 30;
/// What is left beside the diagonal, over it: a hundredth of the rounding of a covariance's f32.
const DIAGONAL: f64 = 1e-9;
/// Difference of variances that is rounding of f32, over the largest: sums of three products, turned forth and back.
const ROUNDING: f64 = 4e-6;

/// Axes of one Gaussian.
#[derive(Clone, Copy)]
struct Axes {
    /// World from axes.
    axes: DQuat,
    /// World from asset, when they were found; `None` before.
    rotation: Option<DQuat>,
}

/// Axes of all Gaussians at the newest step.
pub struct Shapes {
    rest: Vec<GaussianRest>,
    axes: Vec<Axes>,
}

impl Shapes {
    /// Begins with the Gaussians at rest.
    pub fn new(rest: &[GaussianRest]) -> Self {
        let axes = rest.iter().map(|g| Axes {
            axes: unit(g.rotation),
            rotation: None,
        });
        Self {
            axes: axes.collect(),
            rest: rest.to_vec(),
        }
    }

    /// The Gaussians of a step with axes and scales, in the order of the scene. Those of which the step says nothing are as
    /// they were at rest, and transparent. Scales of what has only been turned are those at rest, to the bit. `index` of
    /// every Gaussian must be one of the scene's.
    pub fn at(&mut self, gaussians: &[GaussianState]) -> Vec<GaussianRest> {
        let mut of: Vec<Option<&GaussianState>> = vec![None; self.rest.len()];
        for gaussian in gaussians {
            of[gaussian.index as usize] = Some(gaussian);
        }
        let all = self.rest.par_iter().zip(&mut self.axes).zip(of);
        all.map(|((rest, axes), state)| match state {
            Some(state) => follow(axes, rest, state),
            None => GaussianRest {
                opacity: 0.0,
                ..*rest
            },
        })
        .collect()
    }
}

/// A rotation of the wire; an unset one means "not turned".
pub(crate) fn unit(rotation: [f32; 4]) -> DQuat {
    let rotation = Quat::from_array(rotation).as_dquat();
    let length = rotation.length();
    if length.is_finite() && length > 1e-6 {
        rotation / length
    } else {
        DQuat::IDENTITY
    }
}

/// Axes and scales of one Gaussian; `axes` are those of the step before, and become those of this one.
fn follow(axes: &mut Axes, rest: &GaussianRest, state: &GaussianState) -> GaussianRest {
    let rotation = unit(state.rotation);
    let since = axes
        .rotation
        .map_or(DQuat::IDENTITY, |b| rotation * b.inverse());
    let (found, variances) = diagonal(state.covariance, since * axes.axes);
    *axes = Axes {
        axes: found,
        rotation: Some(rotation),
    };
    let at_rest = DVec3::from(rest.scale.map(f64::from));
    let largest = variances.max_element().max(f64::MIN_POSITIVE);
    let is_at_rest = ((variances - at_rest * at_rest) / largest)
        .abs()
        .max_element()
        < ROUNDING;
    // The alpha of a frame has 8 bits.
    let is_as_opaque = (rest.opacity * 255.0).round() == f32::from(state.color[3]);
    GaussianRest {
        position: state.position,
        opacity: match is_as_opaque {
            true => rest.opacity,
            false => f32::from(state.color[3]) / 255.0,
        },
        scale: match is_at_rest {
            true => rest.scale,
            false => variances
                .max(DVec3::ZERO)
                .map(f64::sqrt)
                .to_array()
                .map(|s| s as f32),
        },
        object: rest.object,
        rotation: found.as_quat().to_array(),
    }
}

/// Axes in which a covariance xx xy xz yy yz zz is diagonal, next to `axes`, and the variances along them.
fn diagonal(covariance: [f32; 6], mut axes: DQuat) -> (DQuat, DVec3) {
    let [xx, xy, xz, yy, yz, zz] = covariance.map(f64::from);
    let world = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
    if !world.is_finite() {
        return (axes, DVec3::ZERO);
    }
    let turned = |axes: DQuat| {
        let basis = DMat3::from_quat(axes);
        basis.transpose() * world * basis
    };
    let mut own = turned(axes);
    for _ in 0..ROTATIONS {
        // The largest element beside the diagonal, and the axis about which it is turned away.
        let beside = [own.z_axis.y, own.x_axis.z, own.y_axis.x];
        let about = (0..3).fold(0, |most, k| {
            if beside[k].abs() > beside[most].abs() {
                k
            } else {
                most
            }
        });
        let (p, q) = ((about + 1) % 3, (about + 2) % 3);
        let off = beside[about];
        let (vp, vq) = (own.col(p)[p], own.col(q)[q]);
        if off.abs() <= DIAGONAL * (vp * vq).abs().sqrt().max(f64::MIN_POSITIVE) {
            break;
        }
        // The smaller of the angles: at most an eighth of a turn.
        let angle = 0.5 * (2.0 * off).atan2(vp - vq);
        let angle = match angle.abs() > std::f64::consts::FRAC_PI_4 {
            true => angle - std::f64::consts::FRAC_PI_2.copysign(angle),
            false => angle,
        };
        axes = (axes * DQuat::from_axis_angle(DVec3::AXES[about], angle)).normalize();
        own = turned(axes);
    }
    (axes, DVec3::new(own.x_axis.x, own.y_axis.y, own.z_axis.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(scale: DVec3, axes: DQuat, rotation: DQuat) -> GaussianState {
        let basis = DMat3::from_quat(axes);
        let world = basis * DMat3::from_diagonal(scale * scale) * basis.transpose();
        let c = world.to_cols_array().map(|value| value as f32);
        GaussianState {
            color: [0, 0, 0, 128],
            covariance: [c[0], c[1], c[2], c[4], c[5], c[8]],
            rotation: rotation.as_quat().to_array(),
            ..Default::default()
        }
    }

    fn rest(scale: DVec3, axes: DQuat) -> GaussianRest {
        GaussianRest {
            opacity: 0.502,
            scale: scale.to_array().map(|s| s as f32),
            rotation: axes.as_quat().to_array(),
            ..Default::default()
        }
    }

    #[test]
    fn what_turns_keeps_its_scales_and_its_axes_turn_with_it() {
        let scale = DVec3::new(0.01, 0.2, 0.03);
        let axes = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.2, -0.4);
        let rest = [rest(scale, axes)];
        let mut shapes = Shapes::new(&rest);
        let spin = DVec3::new(1.0, 2.0, -0.5).normalize();
        for step in 0..40 {
            // Half a turn and more: eigenvectors alone would have lost their order and signs.
            let turn = DQuat::from_axis_angle(spin, 0.2 * f64::from(step));
            let at = shapes.at(&[state(scale, turn * axes, turn)])[0];
            assert_eq!((at.scale, at.opacity), (rest[0].scale, 0.502));
            let found = unit(at.rotation);
            let apart = found.angle_between(turn * axes);
            // Rounding of the covariance: 6e-8 over the difference of variances, relative to the largest.
            assert!(apart < 1e-5, "step {step}: {apart}");
        }
    }

    #[test]
    fn what_is_stretched_has_the_covariance_of_the_frame() {
        let scale = DVec3::new(0.01, 0.01, 0.02);
        let rest = [rest(scale, DQuat::IDENTITY)];
        let mut shapes = Shapes::new(&rest);
        for step in 0..30 {
            let stretch = 1.0 + 0.1 * f64::from(step);
            let axes = DQuat::from_rotation_y(0.3 * f64::from(step));
            let given = state(scale * DVec3::new(stretch, 1.0, 1.0 / stretch), axes, axes);
            let at = shapes.at(&[given])[0];
            let again = state(
                DVec3::from(at.scale.map(f64::from)),
                unit(at.rotation),
                DQuat::IDENTITY,
            );
            let largest = given.covariance.iter().fold(0.0f32, |a, b| a.max(b.abs()));
            for (a, b) in given.covariance.iter().zip(again.covariance) {
                // Squares of f32 scales and products of f32 rotations.
                assert!((a - b).abs() < 1e-6 * largest, "step {step}: {a} {b}");
            }
        }
    }

    #[test]
    fn covariances_that_are_none_give_finite_shapes() {
        let rest = [rest(DVec3::ONE, DQuat::IDENTITY)];
        for covariance in [[0.0; 6], [1.0, 5.0, 0.0, 1.0, 0.0, 1.0], [f32::NAN; 6]] {
            let given = GaussianState {
                covariance,
                ..Default::default()
            };
            let at = Shapes::new(&rest).at(&[given])[0];
            assert!(
                at.scale.iter().chain(&at.rotation).all(|x| x.is_finite()),
                "{at:?}"
            );
        }
        assert_eq!(Shapes::new(&rest).at(&[])[0].opacity, 0.0);
    }
}
