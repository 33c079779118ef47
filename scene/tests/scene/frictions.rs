//! Friction between objects and colliders: one rule, whoever states it.

use cosplat_sim_core::World;

use crate::world;

fn stated(friction: Option<f64>) -> String {
    friction.map_or(String::new(), |friction| {
        format!("friction = {friction:?}\n")
    })
}

/// Blocks side by side, each with what its surface states, that hit a floor on their way along it.
fn sliding(
    contact: &str,
    material: &str,
    floor: &str,
    collider: Option<f64>,
    objects: &[Option<f64>],
) -> World {
    let mut text = format!("version = 1\ndx = 0.1\ncontact = \"{contact}\"\n");
    for (n, object) in objects.iter().enumerate() {
        text += &format!(
            "[[objects]]\nname = \"{n}\"\nshape = {{ kind = \"box\", size = [0.4, 0.4, 0.4], gaussian_spacing = 0.2 }}\n\
             translation = [0.03, 0.21, {}]\nmaterial = \"{material}\"\nlinear_velocity = [1, -0.5, 0]\n{}",
            2 * n,
            stated(*object)
        );
    }
    text += &format!(
        "[[colliders]]\nname = \"floor\"\n{floor}\n{}",
        stated(collider)
    );
    let mut world = world(&text);
    for _ in 0..6 {
        world.step(1.0 / 60.0, &[]);
    }
    world
}

#[test]
fn friction_of_a_collider_and_an_object_is_their_mean() {
    // A plane along the grid, one across it, a thick box, a wall that acts on particles, and one that gives back.
    let floors = [
        "normal = [0, 1, 0]",
        "normal = [0.1, 1, 0]",
        "shape = \"box\"\nsize = [8, 1, 8]\ntranslation = [0, -0.5, 0]",
        "shape = \"box\"\nsize = [8, 0.02, 8]\ntranslation = [0, -0.01, 0]",
        "normal = [0, 1, 0]\nrestitution = 0.5",
    ];
    for contact in ["two_scale", "single_field"] {
        for floor in floors {
            for material in ["jelly", "rigid"] {
                let hash = |collider, object| {
                    let world = sliding(contact, material, floor, collider, &[object]);
                    world.report().state_hash
                };
                let what = format!("{contact}, {material}, {floor}");
                let half = hash(Some(0.5), None);
                // sqrt(0.25 x 1) is 0.5 to the last bit.
                assert_eq!(hash(Some(0.25), Some(1.0)), half, "both: {what}");
                assert_eq!(hash(None, Some(0.5)), half, "the object alone: {what}");
                let none = hash(None, None);
                assert_ne!(none, half, "nobody: {what}");
                assert_eq!(
                    hash(Some(0.0), Some(1.0)),
                    none,
                    "a smooth collider: {what}"
                );
            }
        }
    }
}

#[test]
fn every_object_rubs_by_its_own_friction() {
    let speeds = |contact, material| {
        let floor = "normal = [0, 1, 0]";
        let world = sliding(contact, material, floor, None, &[Some(0.5), None]);
        let objects = &world.report().objects;
        [0, 1].map(|n| objects[n].linear_velocity[0])
    };
    for material in ["jelly", "rigid"] {
        // Stopping the fall alone, 0.5 m/s and more, takes half of that off the one.
        let [rough, smooth] = speeds("two_scale", material);
        assert!(rough < 0.8, "{material}: {rough} m/s");
        assert!((smooth - 1.0).abs() < 1e-3, "{material}: {smooth} m/s");
    }
    // On a grid that they share nodes do not know whose they are: where objects differ the collider's own counts.
    for speed in speeds("single_field", "jelly") {
        assert!((speed - 1.0).abs() < 1e-3, "{speed} m/s");
    }
}
