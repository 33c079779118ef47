//! The yardstick computes what the solvers compute.

use cosplat_reference::ReferenceWorld;

use super::scene::{Layout, MATERIALS, material, scene, yardstick_of};

/// Largest differences to the double-precision reference after `substeps`, in cells and in cells/s.
fn difference(name: &str, dt: f64, substeps: u32) -> [f64; 2] {
    let material = material(name).expect("known");
    let mut scene = scene(material, &Layout::new(1 << 9, 8), false);
    // In flight, squeezed by the velocity that it starts with: at the floor the solvers stop matter where it touches,
    // the yardstick at the node below.
    scene.objects[0].linear_velocity[2] = 0.5;
    for a in 0..3 {
        scene.objects[0].velocity_gradient[a][a] += [-20.0, 5.0, -40.0][a];
    }
    let mut yardstick = yardstick_of(&scene).expect("the yardstick has every measured law");
    let mut reference = ReferenceWorld::new(&scene);
    reference.step_with(&vec![dt; substeps as usize], &[]);
    yardstick.advance(dt, substeps);
    let state = &reference.particles;
    assert_eq!(yardstick.len(), state.position.len());
    let mut worst = [0.0_f64; 2];
    for p in 0..yardstick.len() {
        let motion = yardstick.motion(p);
        for (n, exact) in [&state.position[p], &state.velocity[p]]
            .into_iter()
            .enumerate()
        {
            for a in 0..3 {
                let difference = f64::from(motion[n][a]) - exact[a] / scene.dx;
                worst[n] = worst[n].max(difference.abs());
            }
        }
    }
    let elastic = matches!(name, "fixed_corotated" | "neo_hookean");
    let remembered = state.memory.iter().any(|memory| memory.abs() > 1e-3);
    assert!(
        remembered != elastic,
        "{name}: plastic laws yield, fluids change volume"
    );
    worst
}

/// The block flies and is squeezed: 160 substeps of 0.2 ms. Rounding of absolute positions of up to 16 cells
/// is 1e-6 cells per substep; its random walk reaches 1e-5 cells, and a strain of that over a cell changes
/// velocities by about the wave speed of 1,700 cells/s times it, 0.02 cells/s of 130. Measured at 4,096 particles:
/// 1e-5 to 3e-5 cells and 3e-4 to 6e-3 cells/s.
#[test]
fn the_yardstick_follows_the_reference_solver() {
    for name in MATERIALS {
        let [position, velocity] = difference(name, 2e-4, 160);
        assert!(position < 1e-4, "{name}: {position:e} cells");
        assert!(velocity < 0.02, "{name}: {velocity:e} cells/s");
    }
}
