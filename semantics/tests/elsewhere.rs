//! Readers against what other programs write: models by `pycolmap`, COLMAP's own writer; arrays by numpy; files of objects by
//! the package `safetensors` and by hand. The files are checked in: `make.py` beside them wrote them, and says with what.

use std::path::{Path, PathBuf};

use cosplat_semantics::{
    colmap, npy,
    objects::{Objects, Vectors},
    query::Words,
};
use glam::Vec3;
use serde_json::Value;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests")
        .join(name)
}

/// What the script says about its files.
fn told(folder: &Path, file: &str) -> Value {
    let bytes = std::fs::read(folder.join(file)).expect("readable");
    serde_json::from_slice(&bytes).expect("JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    let all = value.as_array().expect("a list");
    all.iter().map(|x| x.as_f64().expect("a number")).collect()
}

#[test]
fn models_that_colmap_writes_are_read_as_it_projects() {
    let folder = folder("colmap");
    let told = told(&folder, "seen.json");
    let number = |value: &Value| value.as_f64().expect("a number");
    let points = told["points"].as_array().expect("points");
    for form in ["text", "binary"] {
        let model = folder.join(form);
        assert!(colmap::is_model(&model));
        let views = colmap::read(&model).expect("readable");
        assert_eq!(views.len(), 6, "{form}");
        for view in views {
            let seen = &told["seen"][&view.name];
            let size = [view.camera.width, view.camera.height].map(f64::from);
            assert_eq!(size, [number(&seen[0]), number(&seen[1])], "{}", view.name);
            for (k, point) in points.iter().enumerate() {
                let at = [0, 1, 2].map(|axis| number(&point[axis]) as f32);
                let (x, y, _) = view.camera.project(Vec3::from_array(at));
                for (axis, pixel) in [x, y].into_iter().enumerate() {
                    let exact = number(&seen[2][k][axis]);
                    // f32 of coordinates of some hundred pixels.
                    let off = (f64::from(pixel) - exact).abs();
                    assert!(off < 2e-3, "{form}, {}: {pixel} {exact}", view.name);
                }
            }
        }
    }
}

#[test]
fn arrays_that_numpy_saves_are_read_as_it_means_them() {
    let folder = folder("numpy");
    let told = told(&folder, "told.json");
    let bytes = |name: &str| std::fs::read(folder.join(format!("{name}.npy"))).expect("readable");
    let accepted = told["accepted"].as_object().expect("names");
    assert_eq!(accepted.len(), 24);
    for (name, said) in accepted {
        let bytes = bytes(name);
        let (ints, floats) = (npy::ints(&bytes), npy::floats(&bytes));
        let (shape, value) = if said["whole"] == true {
            assert!(floats.is_err(), "{name}");
            let found = ints.unwrap_or_else(|why| panic!("{name} {why}"));
            let value: Vec<f64> = found.value.into_iter().map(f64::from).collect();
            (found.shape, value)
        } else {
            assert!(ints.is_err(), "{name}");
            let found = floats.unwrap_or_else(|why| panic!("{name} {why}"));
            (
                found.shape,
                found.value.into_iter().map(f64::from).collect(),
            )
        };
        let shape: Vec<f64> = shape.into_iter().map(|n| n as f64).collect();
        assert_eq!(shape, numbers(&said["shape"]), "{name}");
        assert_eq!(value, numbers(&said["values"]), "{name}");
    }
    let refused = told["refused"].as_object().expect("names");
    assert_eq!(refused.len(), 9);
    for (name, words) in refused {
        let bytes = bytes(name);
        let errors = [
            npy::ints(&bytes).expect_err(name),
            npy::floats(&bytes).expect_err(name),
        ];
        let words = words.as_str().expect("words");
        assert!(
            errors.iter().any(|e| e.contains(words)),
            "{name}: {errors:?}"
        );
    }
}

#[test]
fn objects_of_other_writers_are_read() {
    let folder = folder("safetensors");
    let told = told(&folder, "told.json");
    let read = |name: &str| {
        let path = folder.join(format!("{name}.safetensors"));
        Objects::read(&path, 0x1234_5678_9abc_def0, 5)
    };
    let wide = |of: &[f32]| of.iter().copied().map(f64::from).collect::<Vec<f64>>();
    let vectors = |of: &Option<Vectors>| of.as_ref().map(|v| (v.dim, wide(&v.value)));
    let whole = |of: &[i32]| of.iter().copied().map(f64::from).collect::<Vec<f64>>();
    let rows = &told["rows"];
    for (name, is_full) in [("full", true), ("by_hand", true), ("least", false)] {
        let found = read(name).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(Value::from(found.names), told["names"], "{name}");
        assert_eq!(whole(&found.labels.object), numbers(&rows["object"]));
        let confidence = numbers(&rows["confidence"]);
        assert_eq!(wide(&found.labels.confidence), confidence, "{name}");
        assert_eq!(found.made, "by make.py");
        let said = |tensor: &str, dim: usize| is_full.then(|| (dim, numbers(&rows[tensor])));
        assert_eq!(vectors(&found.feature), said("feature", 2));
        assert_eq!(vectors(&found.object_feature), said("object_feature", 1));
        let parent = said("parent", 1).map_or(Vec::new(), |p| p.1);
        assert_eq!(whole(&found.parent), parent, "{name}");
    }
    let refused = told["refused"].as_object().expect("names");
    assert_eq!(refused.len(), 6);
    for (name, words) in refused {
        let error = read(name).expect_err(name).to_string();
        assert!(error.contains(words.as_str().expect("words")), "{error}");
    }
}

#[test]
fn vectors_of_words_of_another_writer_are_read() {
    let words = Words::read(&folder("safetensors").join("words.safetensors")).expect("words");
    assert_eq!(words.dim, 2);
    // Unit vectors of (3, 4) and (0, -2), to rounding in f32.
    for (word, expected) in [("vase", [0.6, 0.8]), ("a table", [0.0, -1.0])] {
        let off = words.vector[word].iter().zip(expected);
        let off = off
            .map(|(x, y): (&f32, f32)| (x - y).abs())
            .fold(0.0, f32::max);
        assert!(off < 1e-6, "{word}");
    }
}
