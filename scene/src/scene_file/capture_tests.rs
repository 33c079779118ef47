//! Stories about splats as captures have them: far from their origin, with floaters, with numbers that were activated twice.

use cosplat_sim_core::scene::Scene;

use super::*;
use crate::assets::{Gaussians, generate, ply, read};

/// The file of a vase of a few thousand Gaussians, moved by `offset`, with its places in double precision or not.
fn file(offset: [f64; 3], is_double: bool) -> Vec<u8> {
    let vase = generate::builtin("vase").expect("known");
    let single = ply::write(&vase);
    let text = String::from_utf8_lossy(&single[..single.len().min(2000)]).into_owned();
    let header = text.find("end_header\n").expect("a header") + "end_header\n".len();
    let row = (single.len() - header) / vase.len();
    let mut words = text[..header].to_owned();
    if is_double {
        for axis in ["x", "y", "z"] {
            words = words.replace(
                &format!("property float {axis}\n"),
                &format!("property double {axis}\n"),
            );
        }
    }
    let mut bytes = words.into_bytes();
    for (place, rest) in vase.position.iter().zip(single[header..].chunks(row)) {
        for a in 0..3 {
            let x = f64::from(place[a]) + offset[a];
            match is_double {
                true => bytes.extend(x.to_le_bytes()),
                false => bytes.extend((x as f32).to_le_bytes()),
            }
        }
        bytes.extend(&rest[12..]);
    }
    bytes
}

fn built(bytes: &[u8], object: &str) -> Result<(Scene, Vec<String>), SceneErrors> {
    let text = format!(
        "version = 1\ncells_per_object = 8\ngravity = [0, 0, 0]\n[[objects]]\nname = \"vase\"\npath = \"vase.ply\"\nmaterial = \"rubber\"\n\
         up = \"-y\"\n{object}\n"
    );
    let file = SceneFile::parse(&text)?;
    let (scene, report) = build(&file, &mut |name| Ok(read(name, bytes)?))?;
    let warnings = report.warnings.iter().map(ToString::to_string);
    Ok((scene, warnings.collect()))
}

/// As [`built`], of Gaussians in memory.
fn of(gaussians: &Gaussians, object: &str) -> Result<(Scene, Vec<String>), SceneErrors> {
    built(&ply::write(gaussians), object)
}

fn volume(scene: &Scene) -> f64 {
    scene.particles.volume.iter().sum()
}

const OFFSET: [f64; 3] = [500_000.25, -4_649_776.5, 130.125];

#[test]
fn a_georeferenced_splat_is_what_it_is_at_its_origin() {
    let anchored = "anchor = \"bottom\"\ntranslation = [1, 2, 3]";
    let (near, _) = built(&file([0.0; 3], true), anchored).expect("built");
    let (far, warnings) = built(&file(OFFSET, true), anchored).expect("built");
    assert_eq!(warnings.len(), 0, "{warnings:?}");
    // Round-off of places of 5e6 m in double precision: 1e-9 m.
    assert!((volume(&far) / volume(&near) - 1.0).abs() < 1e-5);
    for (a, b) in near.gaussians.position.iter().zip(&far.gaussians.position) {
        assert!((0..3).all(|n| (a[n] - b[n]).abs() < 1e-6), "{a:?} {b:?}");
    }
    let (one, two) = (near.dx, far.dx);
    assert!((one / two - 1.0).abs() < 1e-6, "{one} {two}");
    // In two steps as well.
    let text = "version = 1\n[[assets]]\nname = \"a\"\npath = \"vase.ply\"\n[[objects]]\nname = \"vase\"\nasset = \"a\"\n\
                fidelity = \"static\"\nup = \"-y\"\nanchor = \"bottom\"\ntranslation = [1, 2, 3]\n";
    let parsed = SceneFile::parse(text).expect("valid");
    let bytes = file(OFFSET, true);
    let (cut, report) = build(&parsed, &mut |name| Ok(read(name, &bytes)?)).expect("built");
    assert_eq!(report.warnings, []);
    assert_eq!(cut.gaussians.position, far.gaussians.position);
    assert!((report.assets[0].raw_bounds.min[0] - OFFSET[0]).abs() < 1.0);
}

#[test]
fn it_is_said_where_single_precision_loses_places() {
    let warned = |bytes: &[u8], object: &str| built(bytes, object).expect("built").1;
    let said = warned(&file(OFFSET, true), "fidelity = \"static\"").join("\n");
    assert!(said.contains("`anchor = \"center\"`"), "{said}");
    assert!(said.contains("tells places 5.0e-1 m apart"), "{said}");
    // What a file lost nothing brings back.
    let said = warned(
        &file(OFFSET, false),
        "fidelity = \"static\"\nanchor = \"center\"",
    );
    assert!(
        said[0].contains("its file has places in single precision"),
        "{said:?}"
    );
    for near in [[0.0; 3], [30.0, -5.0, 80.0]] {
        let said = warned(&file(near, false), "fidelity = \"static\"");
        assert_eq!(said, [""; 0]);
    }
}

#[test]
fn text_has_double_precision_as_well() {
    let rows = "500000.0625 2 -3.0009765625 0 0 0 1 0 0 0 1 0 0 0\n";
    let names = "f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let mut text = "ply\nformat ascii 1.0\nelement vertex 1\n".to_owned();
    for name in ["x", "y", "z"] {
        text += &format!("property double {name}\n");
    }
    for name in names.split(' ') {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    let (g, report) = read("one.ply", (text.clone() + rows).as_bytes()).expect("a splat");
    assert_eq!(report.exact, [[500_000.062_5, 2.0, -3.000_976_562_5]]);
    assert_eq!(g.position, [[500_000.06, 2.0, -3.000_976_6]]);
    let (_, report) = read(
        "one.ply",
        text.replace("double", "float")
            .as_bytes()
            .iter()
            .chain(rows.as_bytes())
            .copied()
            .collect::<Vec<_>>()
            .as_slice(),
    )
    .expect("a splat");
    assert_eq!(report.exact, [[0.0; 3]; 0]);
}

#[test]
fn floaters_count_for_no_size() {
    let mut vase = generate::builtin("vase").expect("known");
    let (clean, none) = of(&vase, "height = 0.3\nanchor = \"bottom\"").expect("built");
    assert_eq!(none, [""; 0]);
    let count = vase.len();
    for (n, far) in [[100.0, 0.0, 0.0], [0.0, 60.0, 0.0], [0.3, -90.0, 0.7]]
        .into_iter()
        .enumerate()
    {
        vase.position[n * count / 3] = far;
    }
    let (scene, warnings) = of(&vase, "height = 0.3\nanchor = \"bottom\"").expect("built");
    let said = warnings.join("\n");
    assert!(
        said.contains(&format!("3 of its {count} Gaussians float")),
        "{said}"
    );
    assert!(!said.contains("thin"), "{said}");
    assert!(
        (scene.dx / clean.dx - 1.0).abs() < 0.02,
        "{} {}",
        scene.dx,
        clean.dx
    );
    assert!((volume(&scene) / volume(&clean) - 1.0).abs() < 0.05);
    // They are shown as before, and move with what is nearest.
    assert_eq!(scene.gaussians.len(), count);
    let placed = |scene: &Scene| scene.gaussians.position[1][1];
    assert!((placed(&scene) - placed(&clean)).abs() < 0.01);
}

#[test]
fn one_place_tells_no_size_and_two_may_cost_much() {
    let vase = generate::builtin("vase").expect("known");
    let few = |places: &[[f32; 3]]| {
        let mut g = Gaussians {
            sh_degree: vase.sh_degree,
            feature_dim: 0,
            ..Gaussians::default()
        };
        for place in places {
            g.position.push(*place);
            g.scale.push([1e-5; 3]);
            g.rotation.push([0.0, 0.0, 0.0, 1.0]);
            g.opacity.push(0.99);
            g.sh.extend_from_slice(&vase.sh[..vase.sh_stride()]);
        }
        g
    };
    for places in [&[[1.0, 2.0, 3.0]][..], &[[1.0; 3]; 4]] {
        let error = of(&few(places), "").expect_err("no size").to_string();
        assert!(error.contains("all at one place"), "{error}");
        assert!(!error.contains("NaN"), "{error}");
    }
    let two = few(&[[0.0; 3], [1e-5, 0.0, 0.0]]);
    let (_, warnings) = of(&two, "").expect("built");
    let said = warnings.join("\n");
    assert!(
        said.contains("million particle-substeps per simulated second"),
        "{said}"
    );
}

#[test]
fn numbers_that_were_activated_twice_are_recognised() {
    let vase = generate::builtin("vase").expect("known");
    let twice = Gaussians {
        scale: vase.scale.iter().map(|s| s.map(f32::exp)).collect(),
        ..vase.clone()
    };
    let said = of(&twice, "fidelity = \"static\"")
        .expect("built")
        .1
        .join("\n");
    assert!(
        said.contains("scales where their logarithms belong"),
        "{said}"
    );
    let twice = Gaussians {
        opacity: (0..vase.len())
            .map(|n| (n as f32 / vase.len() as f32).max(0.1))
            .map(|a| 1.0 / (1.0 + (-a).exp()))
            .collect(),
        ..vase
    };
    let said = of(&twice, "fidelity = \"static\"")
        .expect("built")
        .1
        .join("\n");
    assert!(
        said.contains("opacities where their logits belong"),
        "{said}"
    );
}

#[test]
fn what_stands_on_something_that_is_only_seen_is_named() {
    let scene = |rest: &str| {
        format!(
            "version = 1\ndx = 0.05\n[[objects]]\nname = \"cube\"\nshape = {{ kind = \"box\", size = [0.2, 0.2, 0.2] }}\n\
             translation = [0, 0.1, 0]\nmaterial = \"jelly\"\n[[objects]]\nname = \"table\"\nbuiltin = \"ground\"\nfidelity = \"static\"\n{rest}"
        )
    };
    let warned = |text: &str| {
        let file = SceneFile::parse(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let (_, report) = build(&file, &mut |_| unreachable!("no files")).expect("built");
        let warnings = report.warnings.iter().map(ToString::to_string);
        warnings.collect::<Vec<_>>().join("\n")
    };
    let falls = "object `cube` is above `table`";
    let higher = |text: String| text.replace("[0, 0.1, 0]", "[0, 3, 0]");
    for text in [
        scene(""),
        higher(scene("")),
        scene("").replace("\"jelly\"", "\"rigid\""),
    ] {
        assert!(warned(&text).contains(falls), "{text}");
    }
    let floor = "[[colliders]]\nname = \"floor\"\nnormal = [0, 1, 0]\npoint = [0, 0, 0]\n";
    let shelf = "[[colliders]]\nname = \"shelf\"\nshape = \"box\"\nsize = [2, 0.1, 2]\ntranslation = [0, 1.5, 0]\n";
    let pedestal = "[[objects]]\nname = \"pedestal\"\nclone = \"cube\"\ntranslation = [0, 1, 0]\nfidelity = \"rigid\"\n\
                    [[pinned_regions]]\nmin = [-1, 0.8, -1]\nmax = [1, 1.2, 1]\n";
    for (text, why) in [
        (scene(floor), "a floor in its place"),
        (higher(scene(shelf)), "a shelf above it"),
        (higher(scene(pedestal)), "something else that moves below"),
        (
            scene("").replace("version = 1", "version = 1\ngravity = [0, 0, 0]"),
            "no gravity",
        ),
        (
            scene("").replace("version = 1", "version = 1\ngravity = [0, 9.81, 0]"),
            "it falls upwards",
        ),
        (
            scene("[[pinned_regions]]\nmin = [-1, 0, -1]\nmax = [1, 0.1, 1]\n"),
            "it is held",
        ),
        (
            scene("").replace("[0, 0.1, 0]", "[50, 0.1, 0]"),
            "it is beside it",
        ),
    ] {
        let said = warned(&text);
        assert!(!said.contains(falls), "{why}: {said}");
    }
}
