//! From nothing but a splat to objects of a scene: what it stands on, what hangs together, and a stroke on each.

use cosplat_scene::assets::{Gaussians, Paint, generate, ply};

use crate::stage::{Process, Stage, watchdog};

/// A box on a box on a plate, each of another colour: Gaussians, and how many of them each has.
pub fn tower() -> (Gaussians, [usize; 3]) {
    let style = |seed, paint| generate::Style {
        spacing: 0.02,
        paint: Paint::Plain(paint),
        seed,
    };
    let parts = [
        (
            generate::surface_disc(0.8, &style(1, [0.5, 0.5, 0.5])),
            0.0f32,
        ),
        (
            generate::surface_box([0.3, 0.3, 0.3], &style(2, [0.8, 0.2, 0.1])),
            0.15,
        ),
        (
            generate::surface_box([0.2, 0.2, 0.2], &style(3, [0.1, 0.3, 0.8])),
            0.4,
        ),
    ];
    let mut all = Gaussians::default();
    let sizes = parts.each_ref().map(|part| part.0.len());
    for (part, y) in &parts {
        let place = |p: &[f32; 3]| [p[0], p[1] + y, p[2]];
        all.position.extend(part.position.iter().map(place));
        all.scale.extend(&part.scale);
        all.rotation.extend(&part.rotation);
        all.opacity.extend(&part.opacity);
        all.sh.extend(&part.sh);
    }
    (all, sizes)
}

/// Objects of the tower get materials by word; the scene that comes of it stands on the ground that was found.
fn materials_by_word(stage: &Stage) {
    fn line<'a>(words: &[&'a str]) -> Vec<&'a str> {
        let start = [
            "objects",
            "materials",
            "tower.ply",
            "--json",
            "--scene",
            "made.toml",
        ];
        let words = words.iter().flat_map(|word| ["--word", *word]);
        start.into_iter().chain(words).collect()
    }
    let given = line(&["low=box", "high=cushion"]);
    let told = Process::start(stage.cosplat(&given)).result();
    let made = told["materials"].as_array().expect("materials");
    let of = |n: usize| [&made[n]["object"], &made[n]["material"]];
    assert_eq!(of(0), ["low", "cardboard"]);
    assert_eq!(of(1), ["high", "foam"]);
    assert_eq!(told["without_word"][0], "ground", "{told}");
    let text = std::fs::read_to_string(stage.path("made.toml")).expect("a scene");
    assert!(text.contains("[materials.\"foam\"]") && text.contains("material = \"foam\""));
    let report = Process::start(stage.cosplat(&["explain", "made.toml", "--json"])).result();
    let objects = report["objects"].as_array().expect("objects");
    assert_eq!(objects.len(), 3, "{report}");
    let foot = objects[0]["gaussian_box"]["min"][1]
        .as_f64()
        .expect("a height");
    assert!(foot.abs() < 0.01, "{report}");
    for (wrong, words) in [
        ("low=unobtainium", "no word for"),
        ("left=box", "does not exist"),
    ] {
        let mut refused = Process::start(stage.cosplat(&line(&[wrong])));
        assert_eq!(refused.wait().code(), Some(1));
        assert!(refused.words().contains(words), "{}", refused.words());
    }
    let table = [
        "objects",
        "materials",
        "--json",
        "--write-table",
        "words.toml",
    ];
    assert!(Process::start(stage.cosplat(&table)).wait().success());
    let own = std::fs::read_to_string(stage.path("words.toml")).expect("a table");
    let own = own.replace("cushion = \"foam\"", "cushion = \"jelly\"");
    std::fs::write(stage.path("words.toml"), own).expect("written");
    let mut edited = given;
    edited.extend(["--table", "words.toml"]);
    let told = Process::start(stage.cosplat(&edited)).result();
    assert_eq!(told["materials"][1]["material"], "jelly", "{told}");
}

#[test]
fn strokes_part_a_tower_that_hangs_together() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let (gaussians, sizes) = tower();
    std::fs::write(stage.path("tower.ply"), ply::write(&gaussians)).expect("written");
    let tree = [
        "objects",
        "tree",
        "tower.ply",
        "--picture",
        "tree.png",
        "--json",
    ];
    let found = Process::start(stage.cosplat(&tree)).result();
    assert_eq!(found["ground"]["axis"], "+y", "{found}");
    assert_eq!(
        found["objects"].as_array().map(Vec::len),
        Some(2),
        "{found}"
    );
    assert_eq!(found["objects"][0]["name"], "ground", "{found}");
    assert!(stage.path("tree.png").is_file());

    let list = ["objects", "list", "tower.ply", "--json"];
    let listed = Process::start(stage.cosplat(&list)).result();
    assert_eq!(listed["nodes"].as_array().map(Vec::len), Some(2));

    let pick = [
        "objects",
        "pick",
        "tower.ply",
        "--stroke",
        "low:0.15,0.15,0 0,0.15,0.15",
        "--stroke",
        "high:0.1,0.4,0",
        "--json",
    ];
    let picked = Process::start(stage.cosplat(&pick)).result();
    let objects = picked["objects"].as_array().expect("objects");
    for (name, expected) in [("ground", sizes[0]), ("low", sizes[1]), ("high", sizes[2])] {
        let object = objects.iter().find(|o| o["name"] == name).expect("named");
        let size = object["gaussians"].as_u64().expect("a count") as f64;
        // Edges of boxes are of either.
        assert!((size / expected as f64 - 1.0).abs() < 0.02, "{picked}");
    }
    let scene = "version = 1\nframe_rate = 50\ndx = 0.05\n[[assets]]\nname = 'tower'\npath = 'tower.ply'\nup = '+y'\n\
                 objects = 'tower.objects.safetensors'\n\
                 [[objects]]\nname = 'top'\nasset = 'tower'\nselect = { names = ['high'] }\nmaterial = 'soft_rubber'\n";
    std::fs::write(stage.path("scene.toml"), scene).expect("written");
    let run = ["simulate", "scene.toml", "--duration", "0.02", "--json"];
    let report = Process::start(stage.cosplat(&run)).result();
    assert_eq!(report["objects"].as_array().map(Vec::len), Some(1));

    materials_by_word(&stage);

    for (wrong, words) in [
        (["--node", "99999=x"], "does not exist"),
        (["--stroke", "x@there:1,2"], "none of the 0 views"),
        (["--stroke", "x:1,2"], "no point of 3 numbers"),
    ] {
        let line = ["objects", "pick", "tower.ply", wrong[0], wrong[1]];
        let mut refused = Process::start(stage.cosplat(&line));
        assert_eq!(refused.wait().code(), Some(1));
        assert!(refused.words().contains(words), "{}", refused.words());
    }
    // Another splat of that name.
    std::fs::write(
        stage.path("tower.ply"),
        ply::write(&generate::surface_disc(
            0.8,
            &generate::Style {
                spacing: 0.02,
                paint: Paint::Plain([0.5; 3]),
                seed: 1,
            },
        )),
    )
    .expect("written");
    let mut refused = Process::start(stage.cosplat(&["objects", "pick", "tower.ply"]));
    assert_eq!(refused.wait().code(), Some(1));
    assert!(
        refused.words().contains("objects tree"),
        "{}",
        refused.words()
    );
}
