//! Moments of bodies with known mass, inertia, spin and energy.

use super::*;
use crate::materials::Law;

const DX: f64 = 0.1;

/// A body sampled on a lattice, moving rigidly.
struct Body {
    volume: Vec<f64>,
    position: Vec<[f64; 3]>,
    velocity: Vec<[f64; 3]>,
    affine: Vec<[[f64; 3]; 3]>,
    deformation: Vec<[[f64; 3]; 3]>,
    memory: Vec<f64>,
}

impl Body {
    /// Points of a lattice of spacing `h` centred on `centre` that lie `inside`, moving with `v + omega x r`.
    fn rigid(
        centre: [f64; 3],
        h: f64,
        cells: i32,
        inside: impl Fn([f64; 3]) -> bool,
        v: [f64; 3],
        omega: [f64; 3],
    ) -> Self {
        let [a, b, c] = omega;
        let spin = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]];
        let mut body = Self {
            volume: vec![],
            position: vec![],
            velocity: vec![],
            affine: vec![],
            deformation: vec![],
            memory: vec![],
        };
        let offsets = || (-cells..cells).map(|i| (f64::from(i) + 0.5) * h);
        for x in offsets() {
            for y in offsets() {
                for r in offsets().map(|z| [x, y, z]).filter(|&r| inside(r)) {
                    let orbital = cross(omega, r);
                    body.volume.push(h * h * h);
                    body.position.push(array::from_fn(|i| centre[i] + r[i]));
                    body.velocity.push(array::from_fn(|i| v[i] + orbital[i]));
                    body.affine.push(spin);
                    body.deformation.push(Mat3::identity().0);
                    body.memory.push(0.0);
                }
            }
        }
        body
    }

    fn arrays(&self) -> ParticleArrays<'_, f64> {
        ParticleArrays {
            volume: &self.volume,
            position: &self.position,
            velocity: &self.velocity,
            affine: &self.affine,
            deformation: &self.deformation,
            elastic: &self.deformation,
            memory: &self.memory,
        }
    }

    fn state(&self, density: f64) -> ObjectState {
        let body = super::Body {
            particles: 0..self.volume.len(),
            density,
            material: &rubber(),
        };
        object_moments(&self.arrays(), &[body], DX)
    }
}

fn rubber() -> Material {
    Material {
        name: "rubber".into(),
        law: Law::FixedCorotated,
        youngs_modulus: 1e6,
        poisson_ratio: 0.3,
        density: 1000.0,
        loss: 0.0,
    }
}

fn assert_close(got: &[f64], want: &[f64], tolerance: f64) {
    let scale = want.iter().fold(1e-300, |m: f64, w| m.max(w.abs()));
    for (g, w) in zip(got, want) {
        assert!((g - w).abs() <= tolerance * scale, "{got:?} != {want:?}");
    }
}

#[test]
fn solid_box_has_the_lattice_form_of_its_textbook_inertia() {
    let sides = [2.0, 1.0, 0.5];
    let h = 0.05;
    let inside = |r: [f64; 3]| (0..3).all(|i| r[i].abs() < 0.5 * sides[i]);
    let state =
        Body::rigid([30.0, -7.0, 2.0], h, 20, inside, [1.0, 2.0, 3.0], [0.0; 3]).state(500.0);
    assert_close(&[state.mass], &[500.0], 1e-12);
    assert_close(&state.com, &[30.0, -7.0, 2.0], 1e-12);
    assert_close(&state.linear_velocity, &[1.0, 2.0, 3.0], 1e-12);
    // A lattice of n cells along side a has mean square a^2/12 (1 - 1/n^2), n = a/h.
    let [x, y, z] = sides.map(|a| 500.0 / 12.0 * (a * a - h * h));
    assert_close(
        &state.inertia,
        &[y + z, 0.0, 0.0, x + z, 0.0, x + y],
        // The point that sums are taken about is 1.1 m away: a few hundred roundings.
        1e-12,
    );
    assert!(state.angular_momentum.iter().all(|l| l.abs() < 1e-8));
    assert_close(&[state.kinetic_energy], &[0.5 * 500.0 * 14.0], 1e-12);
    assert_eq!(state.rotation, [0.0, 0.0, 0.0, 1.0]);
    assert!(state.elastic_energy.abs() < 1e-12);
}

#[test]
fn solid_ball_has_its_radius_as_effective_radius() {
    let inside = |r: [f64; 3]| r[0] * r[0] + r[1] * r[1] + r[2] * r[2] < 1.0;
    let state = Body::rigid([0.0; 3], 0.05, 21, inside, [0.0; 3], [0.0; 3]).state(1.0);
    // Sampling a sphere by cells of h/R = 1/20: error of order (h/R)^2.
    assert_close(&[state.radius], &[1.0], 2.5e-3);
    let i = 0.4 * state.mass;
    assert_close(&state.inertia, &[i, 0.0, 0.0, i, 0.0, i], 5e-3);
    assert_close(&[state.mass], &[4.0 / 3.0 * std::f64::consts::PI], 2.5e-3);
}

/// From those of its flight.
#[test]
fn a_flying_disc_keeps_its_spin_energy_and_momentum_apart() {
    let omega = [0.0, 3.0, 0.0];
    let inside = |r: [f64; 3]| r[0] * r[0] + r[2] * r[2] < 1.0 && r[1].abs() < 0.1;
    let v = [5.0, 0.0, -1.0];
    let com = [10.0, 20.0, 30.0];
    let state = Body::rigid(com, 0.05, 21, inside, v, omega).state(100.0);
    assert_close(&state.angular_velocity, &omega, 1e-12);
    let effective = state.inertia[3] + 0.5 * DX * DX * state.mass;
    assert_close(&state.angular_momentum, &[0.0, 3.0 * effective, 0.0], 1e-11);
    let kinetic = 0.5 * state.mass * 26.0 + 0.5 * effective * 9.0;
    assert_close(&[state.kinetic_energy], &[kinetic], 1e-12);

    let (linear, angular) = total_momentum(&[state, state]);
    assert_close(&linear, &v.map(|v| 2.0 * v * state.mass), 1e-12);
    let orbital = cross(com, v);
    let expected =
        array::from_fn::<_, 3, _>(|i| 2.0 * (state.mass * orbital[i] + state.angular_momentum[i]));
    assert_close(&angular, &expected, 1e-12);
}

#[test]
fn mean_rotation_and_elastic_energy_come_from_the_deformation() {
    let mut body = Body::rigid([0.0; 3], 0.1, 5, |_| true, [0.0; 3], [0.0; 3]);
    let (sin, cos) = 2.5_f64.sin_cos();
    let turn = Mat3([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]);
    let stretch = 1.25;
    body.deformation
        .fill(turn.mul(&Mat3::diagonal([stretch; 3])).0);
    let state = body.state(1000.0);
    let half = 1.25_f64;
    assert_close(&state.rotation, &[0.0, 0.0, half.sin(), half.cos()], 1e-12);
    let (lambda, mu) = (rubber().lambda(), rubber().mu());
    let j = stretch.powi(3);
    let density = mu * 3.0 * (stretch - 1.0_f64).powi(2) + 0.5 * lambda * (j - 1.0) * (j - 1.0);
    assert_close(&[state.elastic_energy], &[density], 1e-12);
}

#[test]
fn every_rotation_round_trips_through_its_quaternion() {
    for step in 0..1000 {
        let angle = f64::from(step) * 0.1;
        let q: [f64; 4] = [
            (angle).sin(),
            (1.7 * angle).sin(),
            (2.3 * angle).cos(),
            (0.3 * angle).sin(),
        ];
        let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt().copysign(q[3]);
        let q = q.map(|c| c / norm);
        let glam = glam::DMat3::from_quat(glam::DQuat::from_array(q)).transpose();
        let back = quaternion(&Mat3(glam.to_cols_array_2d()));
        assert_close(&back, &q, 1e-12);
    }
}

#[test]
fn removed_particles_do_not_count_even_when_their_state_is_nan() {
    let body = Body::rigid([0.0; 3], 0.1, 5, |_| true, [1.0, 0.0, 0.0], [0.0; 3]);
    let whole = body.state(10.0);
    let mut broken = Body::rigid([0.0; 3], 0.1, 5, |_| true, [1.0, 0.0, 0.0], [0.0; 3]);
    broken.volume.insert(0, 0.0);
    broken.position.insert(0, [f64::NAN; 3]);
    broken.velocity.insert(0, [f64::NAN; 3]);
    broken.affine.insert(0, [[f64::NAN; 3]; 3]);
    broken.deformation.insert(0, [[f64::NAN; 3]; 3]);
    broken.memory.insert(0, f64::NAN);
    let partial = broken.state(10.0);
    assert_close(&[partial.mass], &[whole.mass], 1e-12);
    assert_close(&partial.inertia, &whole.inertia, 1e-12);
    broken.volume.fill(0.0);
    assert_eq!(broken.state(10.0), ObjectState::default());
}

#[test]
fn thread_count_does_not_change_a_bit() {
    let body = Body::rigid(
        [1.0; 3],
        0.02,
        15,
        |_| true,
        [1.0, 2.0, 3.0],
        [4.0, 5.0, 6.0],
    );
    assert!(body.volume.len() > 5 * CHUNK);
    let run = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads start")
            .install(|| body.state(700.0))
    };
    assert_eq!(run(1), run(3));
}
