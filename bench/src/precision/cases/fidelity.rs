//! What automatic fidelity saves and changes.

use crate::{
    precision::case::{Case, Family},
    trial::{Outcome, scene_text},
};

/// Two vases that collide and come to rest.
pub const VASES: Case = Case {
    name: "vases",
    title: "Two rubber vases, colliding and coming to rest, automatic fidelity",
    error: "COM, largest error over longest way",
    against: "the same run with everything modelled (fidelity = \"mpm\")",
    scene: scene_text!("precision/vases"),
    duration: 2.5,
    reference: Some(&[("objects.0.fidelity", "mpm"), ("objects.1.fidelity", "mpm")]),
    families: || {
        vec![
            Family::sweep(
                "tolerance",
                "tolerance",
                &["0.0003", "0.001", "0.003", "0.01", "0.03", "0.1", "0.3"],
                "0.01",
            ),
            Family::step(),
            Family::sweep(
                "left vase",
                "objects.0.fidelity",
                &["auto", "mpm", "rigid"],
                "auto",
            ),
        ]
    },
    measure: vases,
};

fn path(run: &Outcome, object: usize) -> Vec<[f64; 3]> {
    let [x, y, z] = [0, 1, 2].map(|a| run.series(&format!("/objects/{object}/com/{a}")));
    let points = x.iter().zip(&y).zip(&z);
    points.map(|((x, y), z)| [x.1, y.1, z.1]).collect()
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|n| (a[n] - b[n]).powi(2)).sum::<f64>().sqrt()
}

fn vases(run: &Outcome, reference: Option<&Outcome>) -> anyhow::Result<f64> {
    let (mut off, mut longest) = (0.0, 0.0);
    for object in 0..2 {
        let expected = reference.map(|r| path(r, object)).unwrap_or_default();
        let measured = path(run, object);
        anyhow::ensure!(
            measured.len() == expected.len() && !expected.is_empty(),
            "{} frames, {} in the reference",
            measured.len(),
            expected.len()
        );
        let apart = measured.iter().zip(&expected).map(|(a, b)| distance(a, b));
        off = apart.fold(off, f64::max);
        let way: f64 = expected.windows(2).map(|w| distance(&w[0], &w[1])).sum();
        longest = way.max(longest);
    }
    Ok(off / longest)
}
