//! Scenes of very many things: what each of them costs.

use super::{SceneFile, build};
use crate::summary::SceneSummary;

/// Boxes of one particle each, no two alike and apart from each other.
fn specks(count: usize) -> String {
    let mut text = "version = 1\ndx = 0.02\n".to_owned();
    for i in 0..count {
        let (size, x) = (0.006 + 4e-4 * i as f64, 0.1 * i as f64);
        text += &format!(
            "[[objects]]\nname = \"{i}\"\nshape = {{ kind = \"box\", size = [{size}, {size}, {size}] }}\n\
             translation = [{x}, 0, 0]\nmaterial = \"jelly\"\n"
        );
    }
    text
}

#[test]
fn an_object_of_one_particle_takes_less_than_50_kb() {
    let count = 20;
    let file = SceneFile::parse(&specks(count)).expect("valid");
    let (scene, _) = build(&file, &mut |_| unreachable!("no files")).expect("builds");
    assert_eq!(scene.particles.position.len(), count);
    let bytes = SceneSummary::new(&scene).memory_bytes / count;
    assert!(bytes < 50_000, "{bytes} bytes each");
    // And is still seen from all sides.
    assert!(scene.objects.iter().all(|o| o.gaussians.len() >= 100));
}
