//! Formulas in scene files: what they do to matter, in both solvers, and how mistakes in them are reported.

use cosplat_reference::ReferenceWorld;
use cosplat_sim_core::{
    Scene, World,
    probe::{Measured, Probes},
};

use super::{SceneFile, build};

const BOX: &str = "version = 1\ndx = 0.1\ngravity = [0, 0, 0]\nframe_rate = 10\njitter = 0\n\
    [[objects]]\nname = \"box\"\nshape = { kind = \"box\", size = [0.4, 0.4, 0.4] }\n\
    translation = [0.25, 0, 0]\nsolver = \"spatial\"\n\
    material = { law = \"neo_hookean\", youngs_modulus_pa = 1e4, poisson_ratio = 0.3, density_kg_m3 = 1000 }\n";

fn scene(more: &str) -> Result<Scene, String> {
    let file = SceneFile::parse(&format!("{BOX}{more}")).map_err(|e| e.to_string())?;
    let load = &mut |_: &str| Err("there is no asset".into());
    let (scene, _) = build(&file, load).map_err(|e| e.to_string())?;
    Ok(scene)
}

#[test]
fn a_body_force_moves_matter_as_its_formula_says() {
    // x'' = 2 t makes x = t^3 / 3.
    let force = "body_force = [\"2*t\", 0, \"-1\"]\n\
        [[probes]]\nname = \"off\"\nkind = \"deviation\"\nobject = \"box\"\n\
        position = [\"X + t^3/3\", \"Y\", \"Z - t^2/2\"]\n";
    let scene = scene(force).expect("valid");
    let mut fast = World::new(scene.clone()).expect("valid");
    let mut slow = ReferenceWorld::new(&scene);
    let probes = Probes::new(&scene);
    let mut dt = 0.0_f64;
    for _ in 0..10 {
        dt = dt.max(fast.step(0.1, &[]).dt);
        slow.step(0.1, &[]);
    }
    for measured in [
        probes.measure(&fast.arrays(), 1.0),
        probes.measure(&slow.particles.arrays(), 1.0),
    ] {
        let Some(Measured::Deviation {
            largest, particles, ..
        }) = measured[0].1
        else {
            panic!("{measured:?}")
        };
        assert_eq!(particles, 512);
        // Of second order: with a force 2 t, n even substeps give dt^3 (n^3 - n) / 3 for t^3 / 3; and single precision.
        assert!(
            largest < 0.34 * dt * dt + 1e-6,
            "{largest} m off with substeps of {dt} s"
        );
    }
}

/// As one that does.
#[test]
fn a_formula_that_names_no_place_gives_the_same_bits() {
    let mut worlds = ["", " + 0*X"].map(|place| {
        let force = format!("body_force = [\"2*sin(3*t){place}\", \"-1\", \"exp(-t)/7{place}\"]\n");
        World::new(scene(&force).expect("valid")).expect("valid")
    });
    for _ in 0..5 {
        let [one, other] = worlds
            .each_mut()
            .map(|world| world.step(0.1, &[]).state_hash);
        assert_eq!(one, other);
    }
}

#[test]
fn an_initial_velocity_follows_its_formula() {
    let scene =
        scene("linear_velocity = [0, 1, 0]\nvelocity = [\"0.1*X\", \"Z^2\", 0]\n").expect("valid");
    let fast = World::new(scene.clone()).expect("valid");
    let mut slow = ReferenceWorld::new(&scene);
    slow.step(0.0, &[]);
    for (p, x) in scene.particles.position.iter().enumerate() {
        let [v, c] = [slow.particles.velocity[p], slow.particles.affine[p][1]];
        let expected = [0.1 * x[0], 1.0 + x[2] * x[2], 0.0];
        // Both are polynomials of degree two, which central differences are exact for.
        assert!(
            (0..3).all(|a| (v[a] - expected[a]).abs() < 1e-12),
            "{v:?} at {x:?}"
        );
        assert!(
            (c[2] - 2.0 * x[2]).abs() < 1e-9 && (slow.particles.affine[p][0][0] - 0.1).abs() < 1e-9
        );
    }
    let momentum = fast.report().linear_momentum;
    let other = slow.objects()[0];
    for a in 0..3 {
        assert!(
            (momentum[a] - other.mass * other.linear_velocity[a]).abs() < 1e-5,
            "{momentum:?}"
        );
    }
}

#[test]
fn mistakes_in_formulas_are_errors_with_a_place() {
    for (more, expected) in [
        (
            "velocity = [\"sin(X\", 0, 0]\n",
            "line 12, column 13: objects[0].velocity[0]: ",
        ),
        ("velocity = [\"2*x\", 0, 0]\n", "found `x`"),
        ("velocity = [0, 0]\n", "has 2 elements, expected 3"),
        ("velocity = [0, true, 0]\n", "expected a string"),
        (
            "velocity = [0, \"1/(X - X)\", 0]\n",
            "velocity is [0.0, inf, 0.0]",
        ),
        (
            "body_force = [0, \"sqrt(X - 1)\", 0]\n",
            "body_force is [0.0, NaN, 0.0]",
        ),
        (
            "fidelity = \"rigid\"\nvelocity = [0, 1, 0]\n",
            "cannot be had by one body",
        ),
        (
            "fidelity = \"static\"\nbody_force = [0, 1, 0]\n",
            "no effect",
        ),
    ] {
        let error = scene(more).expect_err(more);
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_body_force_keeps_matter_awake_and_moves_bodies() {
    let force = "body_force = [0, \"3\", 0]\nfidelity = \"rigid\"\n";
    let mut world = World::new(scene(force).expect("valid")).expect("valid");
    for _ in 0..10 {
        world.step(0.1, &[]);
    }
    // Constant forces are exact for bodies.
    assert!(
        (world.report().objects[0].com[1] - 1.5).abs() < 1e-9,
        "{:?}",
        world.report().objects[0].com
    );
    let balanced = "body_force = [0, \"0\", 0]\nfidelity = \"auto\"\n";
    let mut world = World::new(scene(balanced).expect("valid")).expect("valid");
    for _ in 0..10 {
        let report = world.step(0.1, &[]);
        assert!(report.particle_updates == report.particle_updates_full);
    }
}
