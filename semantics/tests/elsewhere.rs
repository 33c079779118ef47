//! Readers against what other programs write: models by `pycolmap`, COLMAP's own writer.

use std::path::Path;

use cosplat_semantics::colmap;
use glam::Vec3;
use serde_json::Value;

/// The files are checked in: `make.py` beside them wrote them.
#[test]
fn models_that_colmap_writes_are_read_as_it_projects() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/colmap");
    let told = std::fs::read(folder.join("seen.json")).expect("readable");
    let told: Value = serde_json::from_slice(&told).expect("JSON");
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
