//! Elastic matter that is clamped at an end: whichever end, and however dense the rest of it is.

use serde_json::Value;

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{
        case::{Case, Size},
        measures::{first, period},
        report::Gate,
    },
};

const HELD: SceneText = scene_text!("validate/held");
/// Edge of a cell of it [m].
const CELL: f64 = 0.025;

/// Largest kinetic and elastic energy within a part of a run's frames, of so many [J].
fn largest_energy(run: &Outcome, [part, of]: [usize; 2]) -> f64 {
    let energy = |frame: &Value| {
        let number = |key: &str| frame[key].as_f64().unwrap_or(f64::MAX);
        number("kinetic_energy") + number("elastic_energy")
    };
    let count = run.frames.len();
    let frames = &run.frames[part * count / of..(part + 1) * count / of];
    frames.iter().map(energy).fold(0.0, f64::max)
}

/// A beam of free and held cells along an axis, held at its high end or its low one.
fn held_beam([free, held]: [u32; 2], axis: usize, high: bool, duration: f64) -> Trial {
    let triple = |x: [f64; 3]| format!("[{}, {}, {}]", x[0], x[1], x[2]);
    let along = |value: f64, others: f64| {
        let mut all = [others; 3];
        all[axis] = value;
        all
    };
    let length = CELL * f64::from(free + held);
    let middle = 0.5 * length - CELL * f64::from(held);
    let (min, max) = match high {
        true => (along(0.0, -2.0), [2.0; 3]),
        false => ([-2.0; 3], along(0.0, 2.0)),
    };
    let across = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]][axis];
    Trial::new(&HELD, duration)
        .set("gravity", triple(across))
        .set("objects.0.shape.size", triple(along(length, 4.0 * CELL)))
        .set(
            "objects.0.translation",
            triple(along(if high { -middle } else { middle }, 0.0)),
        )
        .set("pinned_regions.0.min", triple(min))
        .set("pinned_regions.0.max", triple(max))
}

/// 26: beams clamped at any of their six ends.
pub fn held(size: Size) -> Vec<Case> {
    let axes: &[usize] = size.pick(&[0], &[0, 1, 2]);
    let beams: &[([u32; 2], f64)] = size.pick(
        &[([4, 2], 0.4)],
        &[([4, 2], 0.4), ([4, 1], 0.5), ([16, 2], 1.0)],
    );
    let mut cases = vec![];
    for &(cells, duration) in beams {
        for &axis in axes {
            let [free, held] = cells;
            let name = format!(
                "{free} free cells and {held} held along {}",
                ["x", "y", "z"][axis]
            );
            let ends = [false, true].map(|high| held_beam(cells, axis, high, duration));
            for (end, trial) in ["low", "high"].into_iter().zip(&ends) {
                cases.push(
                    Case::new(
                        "energy of clamped beams, last quarter of a run over first",
                        format!("{name}, held at the {end} end: energy, last quarter over first"),
                        trial,
                        |run| Ok(largest_energy(run, [3, 4]) / largest_energy(run, [0, 4])),
                    )
                    .against(1.0, "conservation")
                    .within(Gate::AtMost(1.5)),
                );
            }
            cases.push(
                Case::of_all(
                    "energy of clamped beams over that of their mirror images",
                    format!("{name}: energy at the high end over that at the low end"),
                    ends,
                    |runs| Ok(largest_energy(runs[1], [0, 1]) / largest_energy(runs[0], [0, 1])),
                )
                .against(1.0, "symmetry")
                .within(Gate::Relative(0.002)),
            );
        }
    }
    cases
}

const UNEVEN_BEAM: SceneText = scene_text!("validate/uneven_beam");
const UNEVEN_PENDULUM: SceneText = scene_text!("validate/uneven_pendulum");

/// 27: solids whose parts differ in density by orders of magnitude.
pub fn uneven(size: Size) -> Vec<Case> {
    let all: &[(f64, u32, f64, f64)] = size.pick(
        &[(80.0, 2, 0.0114, 0.08)],
        &[(80.0, 2, 0.0114, 0.08), (300.0, 4, 0.0112, 0.04)],
    );
    let mut cases = vec![];
    for &(contrast, cells, bends, gate) in all {
        let trial = Trial::new(&UNEVEN_BEAM, 4.0)
            .set("dx", 0.1 / f64::from(cells))
            .set("objects.0.material.density_kg_m3", 1000.0 / contrast);
        cases.push(
            Case::new(
                "deflection of a beam with a dense end [m]",
                format!(
                    "deflection with an end {contrast} times as dense, {cells} cells thick [m]"
                ),
                &trial,
                |run| {
                    let tip = run.series("/probes/tip/position/1");
                    Ok(first(&tip) - tip.last().map_or(f64::NAN, |end| end.1))
                },
            )
            .against(
                bends,
                "P a^2 (3 s - a) / 6 E I, shear after Timoshenko, its own weight",
            )
            .within(Gate::Relative(gate)),
        );
    }
    if size == Size::Full {
        cases.push(
            Case::new(
                "period of a heavy bob on a strip of two cells [s]",
                "period of a heavy bob on a strip of two cells [s]",
                &Trial::new(&UNEVEN_PENDULUM, 8.0),
                |run| Ok(period(&run.series("/probes/bob/position/0"))),
            )
            .against(
                1.649,
                "2 pi sqrt((I + m d^2) / (m g d)), d less by sqrt(E I / T)",
            )
            .within(Gate::Relative(0.03)),
        );
    }
    cases
}
