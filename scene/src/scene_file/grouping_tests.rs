//! Stories about splats in scene files: placing them and cutting them into objects.

use cosplat_sim_core::scene::Scene;
use glam::{DQuat, DVec3};

use super::*;
use crate::assets::{
    Gaussians, ReadReport, generate,
    objects::{Labels, Objects},
};

/// Two vases of a hundred small Gaussians each, at x = 0 (id 3) and x = 10 (id 8), and a floater (id 1).
fn pair() -> Gaussians {
    let mut g = Gaussians {
        feature_dim: 1,
        ..Gaussians::default()
    };
    let mut push = |position: [f32; 3], id: f32| {
        g.position.push(position);
        g.scale.push([0.1, 0.2, 0.3]);
        g.rotation.push([0.0, 0.0, 0.0, 1.0]);
        g.opacity.push(0.9);
        g.sh.extend([1.0, 0.0, 0.0]);
        g.feature.push(id);
    };
    for (x, id, count) in [(0.0, 3.0, 100), (10.0, 8.0, 120)] {
        for i in 0..count {
            let (column, row) = (i % 10, i / 10);
            push([x + 0.1 * column as f32, 0.1 * row as f32, 0.0], id);
        }
    }
    push([5.0, 20.0, 0.0], 1.0);
    g
}

fn with(asset: Gaussians, text: &str) -> Result<(Scene, BuildReport), SceneErrors> {
    let file = SceneFile::parse(text)?;
    build(&file, &mut |_| Ok((asset.clone(), ReadReport::default())))
}

/// A scene of static objects cut from the pair; `objects` are lines of their tables.
fn cut(objects: &[&str]) -> Result<(Scene, BuildReport), SceneErrors> {
    let mut text = "version = 1\n[[assets]]\nname = \"pair\"\npath = \"pair.ply\"\n".to_owned();
    for (i, lines) in objects.iter().enumerate() {
        text += &format!(
            "[[objects]]\nname = \"part {i}\"\nasset = \"pair\"\nfidelity = \"static\"\n{lines}\n"
        );
    }
    with(pair(), &text)
}

/// A scene of objects cut from the pair, whose file has a row before it that cannot be read and a file of objects:
/// `left`, its part `rim` and `right`; the floater belongs to none.
fn cut_by_file(lines: &str) -> Result<(Scene, BuildReport), SceneErrors> {
    let text = format!(
        "version = 1\ndx = 1\n[[assets]]\nname = \"pair\"\npath = \"pair.ply\"\nobjects = \"pair.objects\"\n\
         [[objects]]\nname = \"part\"\nasset = \"pair\"\n{lines}\n"
    );
    let mut object = vec![0; 222];
    object[91..101].fill(1);
    object[101..221].fill(2);
    object[221] = -1;
    let objects = Objects {
        names: ["left", "rim", "right"].map(str::to_owned).to_vec(),
        parent: vec![-1, 0, -1],
        labels: Labels {
            confidence: vec![1.0; object.len()],
            object,
        },
        ..Objects::default()
    };
    let report = ReadReport {
        count: 222,
        left_out: vec![0],
        ..ReadReport::default()
    };
    build_with_files(
        &SceneFile::parse(&text)?,
        &mut |_| Ok((pair(), report.clone())),
        &mut |_| Err("no meshes".into()),
        &mut |file, asset, rows| {
            assert_eq!((file, asset, rows), ("pair.objects", "pair.ply", 222));
            Ok(objects.clone())
        },
    )
}

fn counts(built: &Result<(Scene, BuildReport), SceneErrors>) -> Vec<usize> {
    let (scene, _) = built.as_ref().unwrap_or_else(|e| panic!("{e}"));
    scene.objects.iter().map(|o| o.gaussians.len()).collect()
}

#[test]
fn an_asset_is_cut_by_index_id_box_and_connection() {
    for (select, count) in [
        ("ranges = [[0, 10], [100, 105]]", 15),
        ("ids = [8]", 120),
        ("boxes = [{ min = [-1, -1, -1], max = [2, 2, 1] }]", 100),
        ("component = 0, link_distance = 0.2", 120),
        ("component = 1, link_distance = 0.2", 100),
        ("component = 2, link_distance = 0.2, min_gaussians = 1", 1),
    ] {
        let select = format!("select = {{ {select} }}");
        assert_eq!(counts(&cut(&[&select])), [count], "{select}");
    }
}

#[test]
fn the_rest_is_what_nobody_else_selects() {
    let built = cut(&["select = { ids = [3] }", "select = { rest = true }"]);
    assert_eq!(counts(&built), [100, 121]);
    let (_, report) = built.expect("built");
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
}

#[test]
fn gaussians_without_an_object_and_with_two_are_counted() {
    let (_, report) = cut(&["select = { ranges = [[0, 50]] }", "select = { ids = [3] }"])
        .unwrap_or_else(|e| panic!("{e}"));
    let all: Vec<String> = report.warnings.iter().map(ToString::to_string).collect();
    assert!(
        all[0].contains("121 of 221 Gaussians belong to no object"),
        "{all:?}"
    );
    assert!(
        all[1].contains("50 of 221 Gaussians are selected by more"),
        "{all:?}"
    );
}

#[test]
fn splitting_names_the_parts_largest_first() {
    let split = "split = { by = \"components\", link_distance = 0.2 }";
    let built = cut(&[split]);
    assert_eq!(counts(&built), [120, 100]);
    let (scene, _) = built.expect("built");
    assert_eq!(scene.objects[1].name, "part 0_1");
    assert_eq!(counts(&cut(&["split = \"ids\""])), [1, 100, 120]);
}

#[test]
fn a_floater_far_away_changes_no_component() {
    let lines = "version = 1\n[[assets]]\nname = \"pair\"\npath = \"pair.ply\"\n[[objects]]\nname = \"part\"\n\
                 asset = \"pair\"\nfidelity = \"static\"\n";
    let with_floater = |at: Option<[f32; 3]>, text: &str| {
        let mut asset = pair();
        asset.position[220] = at.unwrap_or(asset.position[0]);
        counts(&with(asset, &format!("{lines}{text}\n")))
    };
    // A twin of the first Gaussian, a floater in sight, and one that makes a fiftieth of the splat span both vases.
    for (floater, first) in [
        (None, 101),
        (Some([5.0, 20.0, 0.0]), 100),
        (Some([5.0, 9e3, 0.0]), 100),
    ] {
        assert_eq!(
            with_floater(floater, "split = \"components\""),
            [120, first]
        );
        assert_eq!(with_floater(floater, "select = { component = 1 }"), [first]);
    }
}

#[test]
fn an_asset_is_cut_by_the_names_of_its_file_of_objects() {
    for (select, count) in [
        ("names = [\"left\"]", 100),
        ("names = [\"rim\"]", 10),
        ("names = [\"rim\", \"right\"]", 130),
    ] {
        let built = cut_by_file(&format!("fidelity = \"static\"\nselect = {{ {select} }}"));
        assert_eq!(counts(&built), [count], "{select}");
        let (scene, _) = built.expect("built");
        // The row that cannot be read moves nothing.
        let last = scene.gaussians.position[count - 1][0];
        assert_eq!(last > 5.0, select.contains("right"), "{last}");
    }
    let error = cut_by_file("fidelity = \"static\"\nselect = { names = [\"rigth\"] }");
    let error = error.expect_err("no such name").to_string();
    assert!(
        error.contains("names `rigth`") && error.contains("`right`"),
        "{error}"
    );
    let error = cut(&["split = \"objects\""])
        .expect_err("no file")
        .to_string();
    assert!(
        error.contains("needs an asset with a file of objects"),
        "{error}"
    );
}

#[test]
fn splitting_by_objects_names_them_and_keeps_parts_whole() {
    let built = cut_by_file("fidelity = \"static\"\nsplit = \"objects\"");
    assert_eq!(counts(&built), [100, 120]);
    let (scene, report) = built.expect("built");
    let names: Vec<&str> = scene.objects.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["part_left", "part_right"]);
    let warnings: Vec<String> = report.warnings.iter().map(ToString::to_string).collect();
    assert!(
        warnings[0].contains("1 of 221 Gaussians belong to no object"),
        "{warnings:?}"
    );
    let contact = "\n[[contact_pairs]]\nobjects = [\"part_left\", \"part_right\"]\nfriction = 0.2";
    let built = cut_by_file(&format!(
        "fidelity = \"static\"\nsplit = \"objects\"{contact}"
    ));
    assert!(built.is_ok(), "{built:?}");
    let built = cut_by_file(&format!(
        "fidelity = \"static\"\nsplit = \"objects\"{}",
        contact.replace("part_left", "part_lid")
    ));
    let error = built.expect_err("no such part").to_string();
    assert!(error.contains("`part_lid` does not exist"), "{error}");
}

#[test]
fn parts_of_an_object_have_materials_of_their_own() {
    let region = "select = { names = [\"left\"] }\nmaterial = \"jelly\"\nparticles = \"per_gaussian\"\n\
         [[objects.regions]]\nnames = [\"rim\"]\nmaterial = \"rubber\"";
    let (scene, _) = cut_by_file(region).unwrap_or_else(|e| panic!("{e}"));
    let [object] = &scene.objects[..] else {
        panic!("{:?}", scene.objects)
    };
    assert_eq!(object.particles.len(), 100);
    let rim = object.regions[0].particles.clone();
    assert_eq!(
        (rim.len(), object.regions[0].material.name.as_str()),
        (10, "rubber")
    );
    for p in object.particles.clone() {
        // The last row of the vase.
        let is_last_row = scene.particles.position[p][1] > 0.85;
        assert_eq!(is_last_row, rim.contains(&p), "particle {p}");
    }
}

#[test]
fn an_empty_selection_says_where_the_asset_is() {
    let error = cut(&["select = { boxes = [{ min = [1, 1, 50], max = [2, 2, 60] }] }"]);
    let error = error.expect_err("empty").to_string();
    assert!(
        error.starts_with("line 9, column 10: objects[0].select: "),
        "{error}"
    );
    assert!(error.contains("221 Gaussians"), "{error}");
    assert!(
        error.contains("[0.0000, 0.0000, 0.0000] to [10.9000, 20.0000, 0.0000]"),
        "{error}"
    );
    let error = cut(&["select = { component = 7 }"]).expect_err("absent");
    assert!(
        error.to_string().contains("component 7 does not exist"),
        "{error}"
    );
}

#[test]
fn a_name_made_by_splitting_must_be_free() {
    let text = "version = 1\n[[objects]]\nname = \"a\"\npath = \"x\"\nfidelity = \"static\"\nsplit = \"ids\"\n\
        [[objects]]\nname = \"a_1\"\nbuiltin = \"vase\"\nfidelity = \"static\"\n";
    let error = with(pair(), text).expect_err("taken").to_string();
    assert!(error.contains("`a_1` exists already"), "{error}");
}

/// The vase as one static object with these placement lines.
fn placed(lines: &str) -> Scene {
    let text = format!(
        "version = 1\n[[objects]]\nname = \"vase\"\nbuiltin = \"vase\"\nfidelity = \"static\"\n{lines}\n"
    );
    with(pair(), &text).unwrap_or_else(|e| panic!("{e}")).0
}

fn seen(scene: &Scene) -> cosplat_sim_core::scene::Aabb {
    crate::bounds::bounds_of(scene.gaussians.position.iter().map(|p| p.map(f64::from)))
        .expect("visible")
}

/// In this order.
#[test]
fn placement_is_up_scale_anchor_rotation_translation() {
    // Up along -y, the vase stands on its lip; then it is a metre high, on its "bottom", and lies on its side.
    let scene = placed(
        "up = \"-y\"\nheight = 1.0\nanchor = \"bottom\"\nrotation_deg = [0, 0, 90]\ntranslation = [0, 5, 0]",
    );
    let b = seen(&scene);
    // +y went to -x by the rotation of 90 degrees about z.
    assert!(
        (b.min[0] + 1.0).abs() < 1e-5 && b.max[0].abs() < 1e-5,
        "{b:?}"
    );
    let factor = 1.0 / 0.24;
    let raw = generate::builtin("vase").expect("known");
    let i = 1234;
    let p = DVec3::from(raw.position[i].map(f64::from));
    let up = DVec3::new(p.x, 0.24 - p.y, -p.z) * factor;
    let expected = DVec3::new(-up.y, up.x + 5.0, up.z);
    let found = DVec3::from(scene.gaussians.position[i].map(f64::from));
    // The anchor is the centre of the sampled box, which is off the axis by less than a Gaussian's distance.
    assert!(
        found.distance(expected) < 0.0035 * factor,
        "{found} {expected}"
    );
}

#[test]
fn placement_carries_covariances_and_leaves_spherical_harmonics() {
    let scene = placed("scale = 2.0\nrotation_deg = [10, 20, 30]");
    let raw = generate::builtin("vase").expect("known");
    assert_eq!(scene.gaussians.sh, raw.sh);
    let turned = DQuat::from_array(scene.objects[0].world_from_asset.map(f64::from));
    let expected = DQuat::from_rotation_z(30f64.to_radians())
        * DQuat::from_rotation_y(20f64.to_radians())
        * DQuat::from_rotation_x(10f64.to_radians());
    // Single precision.
    assert!(turned.angle_between(expected) < 1e-3, "{turned} {expected}");
    for i in [0, 777, 4242] {
        let local = DQuat::from_array(raw.rotation[i].map(f64::from));
        let world = DQuat::from_array(scene.gaussians.rotation[i].map(f64::from));
        let axis = DVec3::new(0.3, 0.4, 0.5);
        assert!((world * axis).distance(expected * (local * axis)) < 1e-5);
        for a in 0..3 {
            assert!((scene.gaussians.scale[i][a] / raw.scale[i][a] - 2.0).abs() < 1e-5);
        }
    }
}

#[test]
fn a_quaternion_and_angles_say_the_same() {
    let angles = placed("rotation_deg = [0, 90, 0]");
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let quaternion = placed(&format!("rotation_xyzw = [0, {half}, 0, {half}]"));
    for (p, q) in angles
        .gaussians
        .position
        .iter()
        .zip(&quaternion.gaussians.position)
    {
        // Sines of halves of angles in double precision, stored in single.
        assert!((0..3).all(|a| (p[a] - q[a]).abs() < 1e-6));
    }
}

#[test]
fn an_object_is_placed_after_its_asset() {
    let text = "version = 1\n[[assets]]\nname = \"v\"\nbuiltin = \"vase\"\nheight = 1.0\ntranslation = [0, 1, 0]\n\
        [[objects]]\nname = \"a\"\nasset = \"v\"\nfidelity = \"static\"\n\
        [[objects]]\nname = \"b\"\nclone = \"a\"\ntranslation = [3, 0, 0]\n";
    let (scene, report) = with(pair(), text).unwrap_or_else(|e| panic!("{e}"));
    let n = scene.objects[0].gaussians.len();
    let (a, b) = (scene.gaussians.position[5], scene.gaussians.position[n + 5]);
    assert!(
        (b[0] - a[0] - 3.0).abs() < 1e-6 && a[1] == b[1],
        "{a:?} {b:?}"
    );
    assert!((report.assets[0].placed_bounds.min[1] - 1.0).abs() < 1e-6);
    assert_eq!(report.assets.len(), 1);
}

#[test]
fn transparent_gaussians_are_left_out() {
    let mut asset = pair();
    asset.opacity[0] = 0.001;
    asset.opacity[7] = 0.04;
    let text = "version = 1\n[[objects]]\nname = \"a\"\npath = \"x\"\nfidelity = \"static\"\n";
    let (scene, report) = with(asset.clone(), text).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        (scene.gaussians.len(), report.assets[0].transparent),
        (220, 1)
    );
    let (scene, _) = with(asset, &format!("{text}min_opacity = 0.05\n")).expect("built");
    assert_eq!(scene.gaussians.len(), 219);
}

#[test]
fn one_particle_per_gaussian_binds_each_to_its_own() {
    let text = "version = 1\ndx = 0.05\n[[objects]]\nname = \"a\"\nbuiltin = \"vase\"\n\
        particles = \"per_gaussian\"\nmaterial = \"jelly\"\n";
    let (scene, _) = with(pair(), text).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(scene.particles.position.len(), scene.gaussians.len());
    for i in 0..scene.gaussians.len() {
        assert_eq!(scene.binding.particle[i][0] as usize, i);
        assert_eq!(scene.binding.weight[i][0], 1.0);
    }
}

#[test]
fn a_filled_clone_is_the_same_body_elsewhere() {
    let text = "version = 1\ndx = 0.02\n[[objects]]\nname = \"a\"\nbuiltin = \"vase\"\nmaterial = \"jelly\"\n\
        [[objects]]\nname = \"b\"\nclone = \"a\"\nrotation_deg = [0, 0, 180]\ntranslation = [1, 0, 0]\n";
    let (scene, report) = with(pair(), text).unwrap_or_else(|e| panic!("{e}"));
    let [a, b] = scene.objects.as_slice() else {
        panic!("two objects")
    };
    assert_eq!(a.particles.len(), b.particles.len());
    assert_eq!(report.fills[0], report.fills[1]);
    for (p, q) in a.particles.clone().zip(b.particles.clone()) {
        let (p, q) = (scene.particles.position[p], scene.particles.position[q]);
        let expected = [1.0 - p[0], -p[1], p[2]];
        assert!(
            (0..3).all(|i| (q[i] - expected[i]).abs() < 1e-12),
            "{p:?} {q:?}"
        );
    }
    let first = scene.binding.particle[b.gaussians.start][0] as usize;
    assert!(b.particles.contains(&first));
}
