//! Free fall: Galileo.

use super::{distance, number, simulate, vector};

const SCENE: &str = r#"
version = 1
gravity = [0.5, -9.81, 0.0]
dx = 0.1
frame_rate = 50

[[objects]]
name = "box"
shape = { kind = "box", size = [0.6, 0.4, 0.5] }
translation = [1.0, 2.0, 3.0]
material = { youngs_modulus_pa = 1e6, poisson_ratio = 0.3, density_kg_m3 = 1000, law = "LAW" }
linear_velocity = [2.0, 5.0, -1.0]

[domain]
min = [-20, -20, -20]
max = [20, 20, 20]
"#;

#[test]
fn a_thrown_box_follows_the_parabola() {
    let laws = ["fixed_corotated", "neo_hookean"];
    for (law, solver) in laws.into_iter().flat_map(|law| {
        let solvers = ["spatial", "lagrangian"];
        solvers.map(|solver| (law, solver))
    }) {
        let stated = format!("objects.0.solver={solver}");
        let run = simulate(&SCENE.replace("LAW", law), 1.0, &["--set", &stated]);
        assert_eq!(run.frames.len(), 50);
        let gravity = [0.5, -9.81, 0.0];
        let frame_dt = 0.02;
        let first = run.first();
        let start_v = [2.0, 5.0, -1.0];
        let time = frame_dt * run.frames.len() as f64;
        // Velocities are those of half a substep before, those of solids of now.
        let before = match solver {
            "spatial" => 0.5 * frame_dt / number(&run.last()["substeps"]),
            _ => 0.0,
        };
        let v: [f64; 3] = std::array::from_fn(|i| start_v[i] + gravity[i] * (time - before));
        let x: [f64; 3] =
            std::array::from_fn(|i| start_v[i] * time + 0.5 * gravity[i] * time * time);
        // The first line is one frame in; what happened before it is checked by what it reports itself.
        let start: [f64; 3] = std::array::from_fn(|i| {
            vector(&first["objects"][0]["com"])[i]
                - start_v[i] * frame_dt
                - 0.5 * gravity[i] * frame_dt * frame_dt
        });
        // Particles are scattered a little off their lattice: the mean is near the centre, not on it.
        assert!(distance(start, [1.0, 2.0, 3.0]) < 0.005, "{start:?}");
        let end: [f64; 3] = std::array::from_fn(|i| start[i] + x[i]);
        let last = &run.last()["objects"][0];
        // 1e-6 of the 4.9 m fallen, and of the speed gained. Measured: 2.6e-7 and 1.7e-7.
        let error = distance(vector(&last["com"]), end);
        assert!(error < 4.9e-6, "{law}, {solver}: off by {error:e} m");
        let error = distance(vector(&last["linear_velocity"]), v);
        assert!(error < 9.81e-6, "{law}, {solver}: off by {error:e} m/s");
        // Nothing else happened to it: no spin, no strain beyond round-off of 1e-6.
        assert!(distance(vector(&last["angular_velocity"]), [0.0; 3]) < 1e-4);
        assert!(number(&last["elastic_energy"]) < 0.12 * 1e6 * 1e-12);
    }
}
