//! How the deformation gradient follows the velocity gradient.

use crate::{mat3::Mat3, num::Real};

/// `F <- (I + A) F` with `A = dt C`: the gradient of the map `x <- x + dt v` by which particles move.
///
/// Only this keeps deformation and positions together. A spin by the angle `theta` per step widens circles by
/// `1 + theta^2 / 2`; `F` sees that, and elasticity undoes it in both. An update of `F` that is truer to the flow,
/// such as `I + A + A^2 / 2`, does not see it: the body then grows by `omega^2 dt / 2` per second without any
/// stress (a decision records the measurement).
#[inline(always)]
pub fn advance_deformation<R: Real>(f: &Mat3<R>, a: &Mat3<R>) -> Mat3<R> {
    let [x, y, z] = f.0;
    let mut out = f.0;
    for i in 0..3 {
        for j in 0..3 {
            let [p, q, r] = a.0[i];
            out[i][j] = p.mul_add(x[j], q.mul_add(y[j], r.mul_add(z[j], f.0[i][j])));
        }
    }
    Mat3(out)
}

/// `det(I + A) - 1`: how the volume of particles changes that move by the velocity gradient `A = dt C`.
#[inline(always)]
pub fn volume_growth<R: Real>(a: &Mat3<R>) -> R {
    let [x, y, z] = a.0;
    let trace = x[0] + (y[1] + z[2]);
    let second = x[0].mul_add(y[1], -(x[1] * y[0]))
        + (x[0].mul_add(z[2], -(x[2] * z[0])) + y[1].mul_add(z[2], -(y[2] * z[1])));
    trace + (second + a.det())
}

/// How long forces act in a substep of `dt` [s], and how far velocities are behind positions after it [s]; before it
/// they are by `lag`.
///
/// Positions belong to the ends of substeps and velocities to their middles (the leapfrog of Verlet 1967, of second order
/// in time): forces, worked out where the substep begins, take velocities from one middle to the next. At time 0 there is
/// no lag: the first kick is half a substep long. Where the substep changes, the kick is the mean of two substeps.
///
/// Where the substep falls suddenly, because matter stiffened, that could be unstable: a kick of `k` and a drift of `d` are
/// stable for `k d <= t^2` under elasticity and for `k <= t` under viscosity, `t` the largest stable substep. As `d` is at
/// most `cfl t`, both hold up to `d / cfl`; the rest is made up for in the next substeps.
pub fn kick(lag: f64, dt: f64, cfl: f64) -> [f64; 2] {
    let kick = (lag + 0.5 * dt).min(dt * cfl.recip().max(1.0));
    [kick, lag + dt - kick]
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Mat3<f64> = Mat3([[0.1, -0.3, 0.05], [0.2, -0.15, 0.1], [-0.05, 0.25, 0.08]]);

    #[test]
    fn deformation_is_the_gradient_of_the_way_of_the_particles() {
        let f = Mat3([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.3], [0.2, 0.0, 1.2]]);
        let moved = advance_deformation(&f, &A);
        // The end of a material line moves like any other point: x + A x.
        for line in [[1.0, 0.0, 0.0], [0.3, -0.4, 0.5]] {
            let x = f.mul_vec(line);
            let way = A.mul_vec(x);
            let expected: [f64; 3] = std::array::from_fn(|i| x[i] + way[i]);
            let found = moved.mul_vec(line);
            for i in 0..3 {
                assert!(
                    (found[i] - expected[i]).abs() < 1e-15,
                    "{found:?} {expected:?}"
                );
            }
        }
    }

    /// None is longer than the stability limit.
    #[test]
    fn kicks_go_from_middle_to_middle_and_stay_stable() {
        for cfl in [0.3, 0.5, 0.8, 1.0, 1.5] {
            // Even, falling, growing, and a fall to a hundredth.
            let substeps = [1.0, 1.0, 0.9, 0.7, 0.8, 1.2, 0.012, 0.012, 0.013].map(|dt| 1e-3 * dt);
            let (mut time, mut kicked, mut lag) = (0.0, 0.0, 0.0);
            for (n, &dt) in substeps.iter().enumerate() {
                let [length, after] = kick(lag, dt, cfl);
                let whole = match n {
                    0 => 0.5 * dt,
                    _ => 0.5 * (substeps[n - 1] + dt),
                };
                let most = dt / f64::min(cfl, 1.0);
                // A bound leaves nothing to the next substeps before the fall, where none is reached.
                if n < 6 && cfl < 0.8 {
                    assert!((length - whole).abs() < 1e-18, "{length} for {whole}");
                }
                assert!(length > 0.0 && length <= most, "{length} at cfl {cfl}");
                (time, kicked, lag) = (time + dt, kicked + length, after);
                assert!((time - kicked - lag).abs() < 1e-17, "time is lost");
            }
            // What the fall left over is made up for, if substeps leave room.
            for _ in 0..400 {
                let [length, after] = kick(lag, 1e-5, cfl);
                assert!(length >= 1e-5 * (1.0 - 1e-9), "{length} at cfl {cfl}");
                lag = after;
            }
            assert!(cfl >= 1.0 || (lag - 0.5e-5).abs() < 1e-18, "{lag} s behind");
        }
    }

    #[test]
    fn volume_growth_is_that_of_the_deformation() {
        let expected = advance_deformation(&Mat3::identity(), &A).det() - 1.0;
        assert!((volume_growth(&A) - expected).abs() < 1e-15);
        // A spin widens: theta^2, not 0.
        let theta = 1e-3;
        let spin = Mat3([[0.0, -theta, 0.0], [theta, 0.0, 0.0], [0.0; 3]]);
        assert!((volume_growth(&spin) - theta * theta).abs() < 1e-18);
    }
}
