//! From a splat to objects of a scene: pictures, masks, labels, and the scene that takes them.

use cosplat_scene::assets::{Gaussians, Paint, generate, ply};
use cosplat_semantics::{objects::Objects, transforms};
use glam::Vec3;

use crate::stage::{Process, Stage, watchdog};

/// Two boxes side by side, with the object of each Gaussian.
fn boxes() -> (Gaussians, Vec<usize>) {
    let style = generate::Style {
        spacing: 0.03,
        paint: Paint::Plain([0.7, 0.5, 0.3]),
        seed: 1,
    };
    let one = generate::surface_box([0.3, 0.3, 0.3], &style);
    let (mut all, mut truth) = (Gaussians::default(), Vec::new());
    for (object, x) in [-0.25f32, 0.25].into_iter().enumerate() {
        all.position
            .extend(one.position.iter().map(|p| [p[0] + x, p[1], p[2]]));
        all.scale.extend(&one.scale);
        all.rotation.extend(&one.rotation);
        all.opacity.extend(&one.opacity);
        all.sh.extend(&one.sh);
        truth.extend(std::iter::repeat_n(object, one.len()));
    }
    (all, truth)
}

/// The object whose Gaussian is nearest to the camera within two pixels, plus one.
fn mask(gaussians: &Gaussians, truth: &[usize], view: &cosplat_semantics::View) -> Vec<u8> {
    let (width, height) = (view.camera.width as i64, view.camera.height as i64);
    let mut nearest = vec![(f32::INFINITY, 0u8); (width * height) as usize];
    for (position, object) in gaussians.position.iter().zip(truth) {
        let (x, y, depth) = view.camera.project(Vec3::from(*position));
        for (u, v) in (-2..=2).flat_map(|u| (-2..=2).map(move |v| (u, v))) {
            let (u, v) = (x as i64 + u, y as i64 + v);
            if (0..width).contains(&u) && (0..height).contains(&v) {
                let pixel = &mut nearest[(v * width + u) as usize];
                if depth < pixel.0 {
                    *pixel = (depth, *object as u8 + 1);
                }
            }
        }
    }
    nearest.into_iter().map(|(_, object)| object).collect()
}

/// An array as numpy writes it.
fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

/// A safetensors file with a vector of two values for each word.
fn words(vectors: &[(&str, [f32; 2])]) -> Vec<u8> {
    let entry = |(n, (word, _)): (usize, &(&str, [f32; 2]))| {
        format!(
            r#""{word}":{{"dtype":"F32","shape":[2],"data_offsets":[{},{}]}}"#,
            8 * n,
            8 * n + 8
        )
    };
    let entries: Vec<String> = vectors.iter().enumerate().map(entry).collect();
    let mut header = format!("{{{}}}", entries.join(","));
    header.push_str(&" ".repeat((8 - header.len() % 8) % 8));
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    bytes.extend(
        vectors
            .iter()
            .flat_map(|(_, v)| v.iter().flat_map(|x| x.to_le_bytes())),
    );
    bytes
}

#[test]
fn a_word_finds_an_object_of_langsplats_masks() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let (gaussians, truth) = boxes();
    std::fs::write(stage.path("boxes.ply"), ply::write(&gaussians)).expect("written");
    let seen = "views boxes.ply --out seen --count 10 --size 240x180 --up +y";
    let seen: Vec<&str> = seen.split(' ').collect();
    assert!(Process::start(stage.cosplat(&seen)).wait().success());
    std::fs::create_dir(stage.path("masks")).expect("a folder");
    let views = transforms::read(&stage.path("seen/transforms.json"), None).expect("views");
    for (n, view) in views.iter().enumerate() {
        // What is mask 0 in one picture is mask 1 in the next; vectors go with it.
        let swap = |object: u8| if n % 2 == 0 { object } else { 3 - object };
        let number = |object: &u8| match object {
            0 => -1i32,
            object => i32::from(swap(*object)) - 1,
        };
        let level = mask(&gaussians, &truth, view);
        let level: Vec<u8> = level.iter().flat_map(|o| number(o).to_le_bytes()).collect();
        let path = |end: &str| stage.path(&format!("masks/{}{end}", view.name));
        let array = npy("<i4", "(4, 180, 240)", &level.repeat(4));
        std::fs::write(path("_s.npy"), array).expect("written");
        let mut vectors = [[1.0f32, 0.2], [0.1, 1.0]];
        if n % 2 == 1 {
            vectors.reverse();
        }
        let vectors: Vec<u8> = vectors
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        std::fs::write(path("_f.npy"), npy("<f4", "(2, 2)", &vectors)).expect("written");
    }
    let lift = "lift boxes.ply --views seen --masks masks --json";
    let lift: Vec<&str> = lift.split(' ').collect();
    let found = Process::start(stage.cosplat(&lift)).result();
    assert_eq!(
        found["objects"].as_array().map(Vec::len),
        Some(2),
        "{found}"
    );
    let given = [
        ("vase", [0.0, 1.0]),
        ("object", [-1.0, 0.0]),
        ("boat", [-1.0, 0.1]),
    ];
    std::fs::write(stage.path("words.safetensors"), words(&given)).expect("written");
    let find = |word: &str, negatives: &str| {
        stage.cosplat(&[
            "objects",
            "find",
            "boxes.ply",
            "--words",
            "words.safetensors",
            "--negatives",
            negatives,
            "--threshold",
            "0.9",
            "--json",
            "--word",
            word,
        ])
    };
    let found = Process::start(find("vase", "object")).result();
    let first = &found["objects"][0];
    assert_eq!(first["meant"], true, "{found}");
    let found = Process::start(find("boat", "object")).result();
    assert_eq!(found["objects"][0]["meant"], false, "{found}");
    let mut refused = Process::start(find("vase", "stuff"));
    assert_eq!(refused.wait().code(), Some(1));
    assert!(
        refused.words().contains("no vector of stuff"),
        "{}",
        refused.words()
    );
    let name = first["name"].as_str().expect("a name");
    let like = [
        "objects",
        "find",
        "boxes.ply",
        "--like",
        name,
        "--threshold",
        "0.9",
        "--json",
    ];
    let found = Process::start(stage.cosplat(&like)).result();
    let meant = found["objects"].as_array().expect("objects");
    assert_eq!(meant.iter().filter(|o| o["meant"] == true).count(), 1);
}

#[test]
fn maps_of_features_find_objects_that_are_there() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let (gaussians, truth) = boxes();
    std::fs::write(stage.path("boxes.ply"), ply::write(&gaussians)).expect("written");
    let seen = "views boxes.ply --out seen --count 10 --size 240x180 --up +y";
    let seen: Vec<&str> = seen.split(' ').collect();
    assert!(Process::start(stage.cosplat(&seen)).wait().success());
    std::fs::create_dir(stage.path("maps")).expect("a folder");
    // As a patch encoder has them: a vector for each patch of 10 pixels, nothing, the left or the right box.
    let vector = [[-1.0f32, 0.0], [0.1, 1.0], [1.0, 0.1]];
    for view in transforms::read(&stage.path("seen/transforms.json"), None).expect("views") {
        let pixels = mask(&gaussians, &truth, &view);
        let cells = (0..18 * 24).map(|n| pixels[(n / 24 * 10 + 5) * 240 + n % 24 * 10 + 5]);
        let values: Vec<u8> = cells
            .flat_map(|object| vector[usize::from(object)])
            .flat_map(f32::to_le_bytes)
            .collect();
        let path = stage.path(&format!("maps/{}.npy", view.name));
        std::fs::write(path, npy("<f4", "(18, 24, 2)", &values)).expect("written");
    }
    let lift = "lift boxes.ply --views seen --maps maps --every --json";
    let lift: Vec<&str> = lift.split(' ').collect();
    let mut refused = Process::start(stage.cosplat(&lift));
    assert_eq!(refused.wait().code(), Some(1));
    assert!(refused.words().contains("need objects that are there"));

    let tree = ["objects", "tree", "boxes.ply", "--json"];
    assert!(Process::start(stage.cosplat(&tree)).wait().success());
    let found = Process::start(stage.cosplat(&lift)).result();
    assert_eq!((&found["views"], &found["values"]), (&10.into(), &2.into()));
    let given = [("duck", [1.0, 0.0]), ("object", [-1.0, 0.0])];
    std::fs::write(stage.path("words.safetensors"), words(&given)).expect("written");
    let find =
        "objects find boxes.ply --words words.safetensors --word duck --negatives object --json";
    let find: Vec<&str> = find.split(' ').collect();
    let meant = Process::start(stage.cosplat(&find)).result();
    let name = &meant["objects"][0]["name"];

    // What is meant is the right box, and each of its Gaussians has its vector.
    let file = std::fs::read(stage.path("boxes.objects.safetensors")).expect("a file");
    let hash = cosplat_scene::sources::SourceFile::of(
        cosplat_scene::sources::SourceKind::Asset,
        "boxes.ply",
        &stage.path("boxes.ply"),
        &std::fs::read(stage.path("boxes.ply")).expect("a splat"),
    );
    let objects = Objects::parse("objects", &file, hash.hash, truth.len()).expect("objects");
    let right = objects
        .names
        .iter()
        .position(|n| n == name.as_str().unwrap_or_default());
    let right = right.expect("an object") as i32;
    let agree = |n: &usize| (objects.labels.object[*n] == right) == (truth[*n] == 1);
    let share = (0..truth.len()).filter(agree).count() as f64 / truth.len() as f64;
    assert!(share > 0.99, "{share}");
    // Patches on the rim of a box have a corner of what is beside it: most Gaussians lie within.
    let every = objects.feature.expect("a vector for each");
    let alike = |n: &usize| (every.of(*n)[0] > every.of(*n)[1]) == (truth[*n] == 1);
    let share = (0..truth.len()).filter(alike).count() as f64 / truth.len() as f64;
    assert!(share > 0.9, "{share}");
}

#[test]
fn masks_of_a_splats_pictures_make_objects_of_a_scene() {
    let _watchdog = watchdog();
    let stage = Stage::new();
    let (gaussians, truth) = boxes();
    std::fs::write(stage.path("boxes.ply"), ply::write(&gaussians)).expect("written");
    let views = [
        "views",
        "boxes.ply",
        "--out",
        "seen",
        "--count",
        "10",
        "--size",
        "240x180",
        "--up",
        "+y",
    ];
    assert!(Process::start(stage.cosplat(&views)).wait().success());

    let missing = [
        "lift",
        "boxes.ply",
        "--views",
        "seen",
        "--masks",
        "seen/images",
    ];
    let mut refused = Process::start(stage.cosplat(&missing));
    assert_eq!(refused.wait().code(), Some(1));
    assert!(
        refused.words().contains("expected one channel"),
        "{}",
        refused.words()
    );

    std::fs::create_dir(stage.path("masks")).expect("a folder");
    for view in transforms::read(&stage.path("seen/transforms.json"), None).expect("views") {
        let file = std::fs::File::create(stage.path(&format!("masks/{}.png", view.name)));
        let mut encoder = png::Encoder::new(file.expect("a file"), 240, 180);
        encoder.set_color(png::ColorType::Grayscale);
        let mut writer = encoder.write_header().expect("a header");
        let written = writer.write_image_data(&mask(&gaussians, &truth, &view));
        written.expect("written");
    }
    std::fs::write(
        stage.path("masks/names.json"),
        r#"{"1": "left", "2": "right"}"#,
    )
    .expect("written");
    let lift = [
        "lift",
        "boxes.ply",
        "--views",
        "seen",
        "--masks",
        "masks",
        "--ply",
        "labelled.ply",
        "--json",
    ];
    let found = Process::start(stage.cosplat(&lift)).result();
    assert_eq!(found["views"], 10, "{found}");
    assert_eq!(found["objects"][1]["name"], "right", "{found}");

    let mut refine = Process::start(stage.cosplat(&[
        "refine",
        "boxes.ply",
        "--views",
        "seen",
        "--images",
        "seen/images",
        "--masks",
        "masks",
        "--rounds",
        "2",
        "--size",
        "120",
        "--out",
        "refined.ply",
    ]));
    assert!(refine.wait().success(), "{}", refine.words());
    assert!(stage.path("refined.ply").is_file());
    assert!(stage.path("refined.objects.safetensors").is_file());

    // The file knows which asset it is of.
    let file = stage.path("boxes.objects.safetensors");
    let error = Objects::read(&file, 0, truth.len()).expect_err("another asset");
    let hash = error.to_string();
    let hash = hash.split("hash ").nth(1).and_then(|rest| rest.get(..16));
    let hash = u64::from_str_radix(hash.expect("a hash"), 16).expect("a hash");
    let objects = Objects::read(&file, hash, truth.len()).expect("of this asset");
    let right = objects
        .labels
        .object
        .iter()
        .zip(&truth)
        .filter(|(a, b)| **a == **b as i32);
    let share = right.count() as f64 / truth.len() as f64;
    // Boxes apart from each other: what is wrong are rims of the masks.
    assert!(share > 0.99, "{share}");

    let scene = |select: &str| {
        format!(
            "version = 1\nframe_rate = 50\ndx = 0.05\n[[assets]]\nname = 'boxes'\npath = 'labelled.ply'\nup = '+y'\n\
             [[objects]]\nname = 'box'\nasset = 'boxes'\n{select}\nmaterial = 'soft_rubber'\n"
        )
    };
    for (select, objects) in [("select = { ids = [2] }", 1), ("split = 'ids'", 2)] {
        std::fs::write(stage.path("scene.toml"), scene(select)).expect("written");
        let run = ["simulate", "scene.toml", "--duration", "0.02", "--json"];
        let report = Process::start(stage.cosplat(&run)).result();
        assert_eq!(
            report["objects"].as_array().map(Vec::len),
            Some(objects),
            "{report}"
        );
    }

    // The splat as it is, with the file beside it.
    let scene = |asset: &str, select: &str| {
        format!(
            "version = 1\nframe_rate = 50\ndx = 0.05\n[[assets]]\nname = 'boxes'\npath = '{asset}'\nup = '+y'\n\
             objects = 'boxes.objects.safetensors'\n\
             [[objects]]\nname = 'box'\nasset = 'boxes'\n{select}\nmaterial = 'soft_rubber'\n"
        )
    };
    let text = scene("boxes.ply", "split = 'objects'");
    std::fs::write(stage.path("scene.toml"), text).expect("written");
    let explain = ["explain", "scene.toml", "--json", "--picture", "named.png"];
    let report = Process::start(stage.cosplat(&explain)).result();
    let names = report["objects"].as_array().expect("objects");
    let names: Vec<_> = names.iter().map(|o| o["name"].as_str()).collect();
    assert_eq!(names, [Some("box_left"), Some("box_right")]);
    let picture = std::fs::read(stage.path("named.png")).expect("a picture");
    assert!(picture.starts_with(b"\x89PNG"));

    // Another splat: what both are is said.
    let text = scene("labelled.ply", "select = { names = ['left'] }");
    std::fs::write(stage.path("scene.toml"), text).expect("written");
    let mut refused = Process::start(stage.cosplat(&["explain", "scene.toml"]));
    assert_eq!(refused.wait().code(), Some(2));
    let words = refused.words();
    let rows = format!("{} rows", truth.len());
    assert!(
        words.contains(&rows) && words.matches("with hash").count() == 2,
        "{words}"
    );
}
