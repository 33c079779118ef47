//! What was measured, as JSON lines, sentences and Markdown tables.

use std::fmt::Write as _;

use cosplat_sim_core::Isa;
use serde_json::{Value, json};

use super::measure::{Measured, Quartiles};
use crate::machine::Run;

/// The part of a page that holds the tables.
pub const PART: &str = "cosplat bench kernel";

/// Asked of one thread at 262,144 particles, 8 per cell, AVX-512: multiples of the yardstick's speed, what that was taken to
/// mean [million/s], and the yardstick that this follows from [million/s].
const BARS: [(&str, [f64; 3]); 6] = [
    ("fixed_corotated", [6.0, 30.0, 5.4]),
    ("neo_hookean", [5.0, 31.0, 7.0]),
    ("snow", [11.0, 20.0, 1.9]),
    ("fluid", [4.5, 38.0, 9.0]),
    ("drucker_prager", [8.0, 18.0, 2.0]),
    ("von_mises", [8.0, 18.0, 2.0]),
];
/// Asked at a million particles: share of the speed at 262,144.
const LARGE: f64 = 0.9;
/// Asked of AVX2: share of the speed with AVX-512.
const AVX2: f64 = 0.55;
/// Asked of two threads: multiple of the speed of one.
const TWO_THREADS: f64 = 1.7;

impl Measured {
    fn rate(&self) -> Quartiles {
        Quartiles::of(self.rates.clone())
    }

    /// Particle state that a fused substep reads and writes, per particle [bytes]: position and deformation both,
    /// mass and the law's number; tiles and node velocities come on top.
    fn state_bytes(&self, name: &str) -> u32 {
        let (position, matrix, number) = (2 * 12, 2 * 36, 4);
        match name {
            "fluid" => position + 3 * number + if self.case.gaussians { matrix } else { 0 },
            "fixed_corotated" | "neo_hookean" => position + matrix + 2 * number,
            _ if self.case.gaussians => position + 2 * matrix + 3 * number,
            _ => position + matrix + 3 * number,
        }
    }

    fn ratio(&self) -> Quartiles {
        Quartiles::of_ratios(&self.rates, &self.yardstick)
    }
}

/// One JSON object.
pub fn line(name: &str, measured: &Measured, run: &Run) -> Value {
    let case = &measured.case;
    let [sort, particles, grid] = measured.phases;
    json!({
        "material": name,
        "particles": measured.particles,
        "particles_per_cell": case.per_cell,
        "threads": case.threads,
        "isa": case.isa.to_string(),
        "gaussians": case.gaussians,
        "rounds": measured.rates.len(),
        "mparticle_substeps_per_s": measured.rate(),
        "bytes_per_particle_substep": measured.state_bytes(name),
        "phases": {"sort": sort, "particles": particles, "grid": grid},
        "yardstick": Quartiles::of(measured.yardstick.clone()),
        "ratio": measured.ratio(),
        "reference": Quartiles::of(measured.reference.clone()),
        "machine": run.machine,
        "commit": run.commit,
        "flags": run.flags,
    })
}

/// One line for people.
pub fn sentence(name: &str, measured: &Measured) -> String {
    let case = &measured.case;
    let (rate, ratio) = (measured.rate(), measured.ratio());
    let [sort, particles, grid] = measured.phases.map(|share| 100.0 * share);
    format!(
        "{name}: {:.1} million particle-substeps/s (quartiles {:.1} to {:.1}), {:.2} times the yardstick; {} \
         particles, {} per cell{}, {} threads, {}; sort {sort:.0} %, particles {particles:.0} %, grid {grid:.0} %",
        rate.median,
        rate.q1,
        rate.q3,
        ratio.median,
        measured.particles,
        case.per_cell,
        if case.gaussians {
            ", with Gaussians"
        } else {
            ""
        },
        case.threads,
        case.isa,
    )
}

/// `median (q1 to q3)`.
pub fn spread(q: Quartiles, digits: usize) -> String {
    format!(
        "{:.digits$} ({:.digits$} to {:.digits$})",
        q.median, q.q1, q.q3
    )
}

/// A measured value against the least that is asked.
pub fn verdict(found: Option<Quartiles>, asked: f64) -> String {
    match found {
        None => "not measured".into(),
        Some(q) if q.median >= asked => format!("{}, met", spread(q, 2)),
        Some(q) => format!("{}, **missed**", spread(q, 2)),
    }
}

/// All tables.
pub fn tables(results: &[(String, Vec<Measured>)], run: &Run) -> String {
    let mut text = format!(
        "\n\nMachine: {}. Commit `{}`, {}, {}; load average at the start {}.\n\n",
        run.machine, run.commit, run.flags, run.date, run.load
    );
    bars(&mut text, results);
    lines(&mut text, results);
    text
}

/// Every bar, and whether it is met. Writing to a string cannot fail.
fn bars(text: &mut String, results: &[(String, Vec<Measured>)]) {
    text.push_str(
        "| law | speed asked [million/s] | speed | yardstick assumed [million/s] | yardstick | ratio asked | ratio | 1,048,576 particles, asked 0.9 | AVX2, asked 0.55 | two threads, asked 1.7 |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for (name, measured) in results {
        let base = &measured[0];
        let against_base = |wanted: &dyn Fn(&Measured) -> bool| {
            let other = measured.iter().find(|m| wanted(m))?;
            Some(Quartiles::of_ratios(&other.rates, &base.rates))
        };
        let asked = BARS.iter().find(|(law, _)| law == name).map(|bar| bar.1);
        let text_of = |n: usize| asked.map_or("none".into(), |asked| format!("{}", asked[n]));
        let large = against_base(&|m| m.particles == 1 << 20);
        let avx2 = against_base(&|m| m.case.isa == Isa::Avx2 && base.case.isa == Isa::Avx512);
        let two = against_base(&|m| m.case.threads == 2);
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            text_of(1),
            spread(base.rate(), 1),
            text_of(2),
            spread(Quartiles::of(base.yardstick.clone()), 2),
            text_of(0),
            verdict(Some(base.ratio()), asked.map_or(0.0, |asked| asked[0])),
            verdict(large, LARGE),
            verdict(avx2, AVX2),
            verdict(two, TWO_THREADS),
        );
    }
    text.push('\n');
}

/// Every configuration.
fn lines(text: &mut String, results: &[(String, Vec<Measured>)]) {
    text.push_str(
        "| law | particles | per cell | threads | instruction set | speed [million/s] | times the yardstick | sort, particles, grid [%] | reference path [million/s] |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for (name, measured) in results {
        for m in measured {
            let [sort, particles, grid] = m.phases.map(|share| 100.0 * share);
            let _ = writeln!(
                text,
                "| {name}{} | {} | {} | {} | {} | {} | {} | {sort:.0}, {particles:.0}, {grid:.0} | {:.2} |",
                if m.case.gaussians {
                    ", with Gaussians"
                } else {
                    ""
                },
                m.particles,
                m.case.per_cell,
                m.case.threads,
                m.case.isa,
                spread(m.rate(), 1),
                spread(m.ratio(), 2),
                Quartiles::of(m.reference.clone()).median,
            );
        }
    }
    text.push('\n');
}
