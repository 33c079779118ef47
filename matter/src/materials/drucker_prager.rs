//! Sand: Hencky elasticity with Drucker-Prager yield and volume correction (Klar et al. 2016, ACM Trans. Graph.
//! 35, 103; volume correction after Tampubolon et al. 2017, ACM Trans. Graph. 36, 105).
//!
//! The cone goes through the Mohr-Coulomb points of triaxial compression:
//! `|dev tau| <= sqrt(2/3) 6 sin(phi) / (3 - sin(phi)) (p + cohesion / tan(phi))` with the pressure
//! `p = -tr(tau) / 3`. Flow is isochoric. Beyond the tip grains part: no stress, and the volume that they gain is
//! kept in the memory, as `ln` of a ratio. It has to be given back before the sand carries load again: without,
//! every splash leaves it larger.
//!
//! Cohesion (wet sand) moves the tip into tension. Once parted, nothing pulls the grains together; when the gap has
//! closed they stick again.

use super::{
    Coefficients,
    strain::{Flow, Strain, bulk_modulus},
    von_mises::EQUIVALENT,
};
use crate::num::Real;

/// Largest volume gain that is remembered, as `ln` of a ratio: grains further apart have lost their neighbours.
pub const GAIN_MAX: f64 = 1.0;

/// `[slope of the cone, tr eps at its tip, 0, 0]`, the slope as `|dev eps|` per `-tr eps`.
pub(super) fn parameters(friction_angle_deg: f64, cohesion: f64, lambda: f64, mu: f64) -> [f64; 4] {
    let angle = friction_angle_deg.to_radians();
    let bulk = lambda + 2.0 / 3.0 * mu;
    let cone = EQUIVALENT * 6.0 * angle.sin() / (3.0 - angle.sin());
    let slope = cone * bulk / (2.0 * mu);
    [slope, cohesion / (angle.tan() * bulk), 0.0, 0.0]
}

/// The flow of sand.
#[inline(always)]
pub(super) fn flow<R: Real>(strain: &Strain<R>, k: &Coefficients<R>) -> Flow<R> {
    let zero = R::splat(0.0);
    let [slope, tip, ..] = k.parameters;
    let open = zero.lt(strain.memory);
    let trace = strain.trace + strain.memory;
    let parts = R::select(open, zero, tip).lt(trace);
    let limit = (slope * (tip - trace)).max(zero);
    let slides = limit.lt(strain.deviator);
    let deviator = R::select(slides, limit, strain.deviator);
    let trace_after = R::select(parts, zero, trace);
    Flow {
        trace: trace_after,
        deviator: R::select(parts, zero, deviator),
        memory: R::select(parts, trace.min(R::splat(GAIN_MAX)), zero),
        mean: bulk_modulus(k) * trace_after,
        flows: parts | slides | open,
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        mat3::Mat3,
        materials::{
            Law,
            testing::{prepared, trial},
        },
    };

    #[test]
    fn triaxial_compression_fails_where_mohr_and_coulomb_say() {
        for (angle, cohesion) in [(20.0_f64, 0.0), (35.0, 0.0), (35.0, 500.0), (50.0, 2e3)] {
            let law = Law::DruckerPrager {
                friction_angle: angle,
                cohesion,
            };
            let k = prepared(law, 1e7, 0.3);
            // Squeezed along z, and let give way sideways until it slides.
            let f = Mat3::diagonal([1.012, 1.012, 0.95]);
            let tau = law.respond(&trial(&f, 0.0, 1e-4), &k).tau;
            let (side, axial) = (-tau[0], -tau[5]);
            let sine = angle.to_radians().sin();
            let ratio = (1.0 + sine) / (1.0 - sine);
            let expected = ratio * side + 2.0 * cohesion * ratio.sqrt();
            assert!((axial / expected - 1.0).abs() < 1e-9, "{axial} {expected}");
        }
    }

    #[test]
    fn sand_that_parted_carries_load_only_when_its_volume_is_back() {
        let law = Law::DruckerPrager {
            friction_angle: 30.0,
            cohesion: 0.0,
        };
        let k = prepared(law, 1e7, 0.3);
        let step = |from: Mat3<f64>, memory: f64, volume: f64| {
            let s = volume.cbrt();
            law.respond(&trial(&Mat3::diagonal([s; 3]).mul(&from), memory, 1e-4), &k)
        };
        let apart = step(Mat3::identity(), 0.0, 1.1);
        assert!(apart.tau.iter().all(|t| *t == 0.0));
        assert!((apart.memory - 1.1_f64.ln()).abs() < 1e-14);
        let closer = step(apart.f, apart.memory, 1.05 / 1.1);
        assert!(closer.tau.iter().all(|t| t.abs() < 1e-9));
        let back = step(closer.f, closer.memory, 0.99 / 1.05);
        let never_parted = step(Mat3::identity(), 0.0, 0.99);
        assert_eq!(back.memory, 0.0);
        assert!((back.tau[0] / never_parted.tau[0] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn wet_sand_holds_tension_up_to_its_tip_and_none_across_a_gap() {
        let (angle, cohesion) = (35.0_f64, 1e3);
        let law = Law::DruckerPrager {
            friction_angle: angle,
            cohesion,
        };
        let k = prepared(law, 1e7, 0.3);
        let tip = cohesion / angle.to_radians().tan();
        let bulk = k.lambda + 2.0 / 3.0 * k.mu;
        let at = |mean: f64, memory: f64| {
            let s = (mean / (3.0 * bulk)).exp();
            law.respond(&trial(&Mat3::diagonal([s; 3]), memory, 1e-4), &k)
        };
        let holds = at(0.99 * tip, 0.0);
        assert!((holds.tau[0] / (0.99 * tip) - 1.0).abs() < 1e-9);
        let tears = at(1.01 * tip, 0.0);
        assert!(tears.tau[0] == 0.0 && tears.memory > 0.0);
        let gap = at(0.5 * tip, tears.memory);
        assert!(gap.tau[0] == 0.0 && gap.memory > tears.memory);
        // Closed again, it sticks.
        let closed = at(-1.2 * tip, tears.memory);
        assert!(closed.tau[0] < 0.0 && closed.memory == 0.0);
    }
}
