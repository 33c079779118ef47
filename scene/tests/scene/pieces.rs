//! What is said of objects that the grid tears.

use cosplat_sim_core::{World, notices::Notices};

use crate::world;

/// A bar of 8 x 2 x 2 cells between two grips that part, its free part from 0.3 m on at 1 m/s.
fn drawn(material: &str, particles_per_cell: u32) -> World {
    world(&format!(
        r#"version = 1
dx = 0.05
gravity = [0, 0, 0]
particles_per_cell = {particles_per_cell}
[[objects]]
name = "bar"
shape = {{ kind = "box", size = [0.4, 0.1, 0.1], gaussian_spacing = 0.1 }}
material = {{ {material}, density_kg_m3 = 1000 }}
solver = "spatial"
[[prescribed]]
box = {{ min = [-1, -1, -1], max = [-0.15, 1, 1] }}
linear_velocity = [-0.5, 0, 0]
[[prescribed]]
box = {{ min = [0.15, -1, -1], max = [1, 1, 1] }}
linear_velocity = [0.5, 0, 0]
"#
    ))
}

const ELASTIC: &str = r#"law = "neo_hookean", youngs_modulus_pa = 1e5, poisson_ratio = 0.3"#;

/// Mean stretch at which each of some frames found it torn, and all that was said.
fn tears(world: &mut World, frames: u32) -> (Vec<f64>, Vec<String>) {
    let mut notices = Notices::new(world.scene());
    let (mut at, mut said) = (Vec::new(), Vec::new());
    for _ in 0..frames {
        let report = world.step(1.0 / 60.0, &[]);
        if let [torn] = report.torn.as_slice() {
            assert!(torn.object == 0 && torn.pieces >= 2, "{torn:?}");
            assert!(torn.apart > 0.0 && torn.apart < 1.0, "{torn:?}");
            at.push(1.0 + report.sim_time / 0.3);
        }
        said.extend(notices.of(world.scene(), &report));
    }
    (at, said)
}

#[test]
fn a_bar_that_is_drawn_out_too_far_is_said_to_be_torn() {
    // Eight particles per cell bear a stretch of 1.67 (the fit of `bridged_stretch`), an empty cell needs more than 2.
    let mut world = drawn(ELASTIC, 8);
    let (at, said) = tears(&mut world, 48);
    assert!(
        at.first().is_some_and(|s| (1.67..3.2).contains(s)),
        "{at:?}"
    );
    let [sentence] = said.as_slice() else {
        panic!("said once: {said:?}")
    };
    for words in ["`bar` is torn", " pieces, ", "8 particles per cell"] {
        assert!(sentence.contains(words), "{words:?} not in {sentence:?}");
    }
}

#[test]
fn what_holds_together_is_not_said_to_be_torn() {
    let mut world = drawn(ELASTIC, 27);
    let (at, said) = tears(&mut world, 12);
    assert!(at.is_empty() && said.is_empty(), "{at:?}, {said:?}");
}

#[test]
fn what_may_come_apart_is_not_said_to_be_torn() {
    let mut world = drawn(r#"preset = "dry_sand""#, 8);
    let (at, said) = tears(&mut world, 48);
    assert!(at.is_empty() && said.is_empty(), "{at:?}, {said:?}");
}

#[test]
fn a_checkpoint_of_a_torn_bar_is_torn() {
    let mut world = drawn(ELASTIC, 8);
    let (at, _) = tears(&mut world, 48);
    assert!(!at.is_empty());
    let bytes = world.checkpoint();
    let mut other = drawn(ELASTIC, 8);
    other.restore(&bytes).expect("of the same scene");
    assert_eq!(other.report().torn, world.report().torn);
}
