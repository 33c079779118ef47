//! What was measured of scenes, as JSON lines, sentences and a Markdown table.

use std::fmt::Write as _;

use cosplat_sim_core::report::Timings;
use serde_json::{Value, json};

use super::run::Measured;
use crate::machine::Run;

/// The part of a page that holds the table.
pub const PART: &str = "cosplat bench scenes";

/// One scene with one number of threads.
pub struct Row {
    /// Its file.
    pub scene: String,
    /// Threads.
    pub threads: u16,
    /// Speed of the kernel with its materials [million updates/s], where it simulates any.
    pub kernel: Option<f64>,
    /// What the run came to.
    pub measured: Measured,
}

impl Row {
    /// Million particle updates per second.
    fn rate(&self) -> f64 {
        self.measured.updates as f64 / self.measured.seconds / 1e6
    }

    /// Simulated seconds per second.
    fn pace(&self) -> f64 {
        self.measured.simulated / self.measured.seconds
    }

    /// Share of the kernel's speed.
    fn ratio(&self) -> Option<f64> {
        self.kernel.map(|kernel| self.rate() / kernel)
    }
}

/// One JSON object.
pub fn line(row: &Row, run: &Run) -> Value {
    let measured = &row.measured;
    let phases: serde_json::Map<_, _> = Timings::PHASES
        .iter()
        .zip(measured.shares)
        .map(|(name, share)| ((*name).to_owned(), share.into()))
        .collect();
    json!({
        "scene": row.scene,
        "threads": row.threads,
        "updates": measured.updates,
        "substeps": measured.substeps,
        "seconds": measured.seconds,
        "simulated_per_s": row.pace(),
        "updates_per_s": row.rate() * 1e6,
        "kernel_updates_per_s": row.kernel.map(|rate| rate * 1e6),
        "ratio_to_kernel": row.ratio(),
        "phases": phases,
        "allocations_per_substep": measured.allocations,
        "machine": run.machine,
        "commit": run.commit,
        "flags": run.flags,
    })
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |value| format!("{value:.digits$}"))
}

fn percents(shares: &[f64]) -> String {
    let texts: Vec<_> = shares.iter().map(|s| format!("{:.0}", 100.0 * s)).collect();
    texts.join(", ")
}

/// One line for people.
pub fn sentence(row: &Row) -> String {
    format!(
        "{}, {} threads: {:.3} simulated s/s, {:.2} million updates/s, {} of the kernel's {} million/s; {} %: {}; {} allocations per substep",
        row.scene,
        row.threads,
        row.pace(),
        row.rate(),
        number(row.ratio(), 2),
        number(row.kernel, 1),
        Timings::PHASES.join(", "),
        percents(&row.measured.shares),
        number(row.measured.allocations, 1),
    )
}

/// The table, with a caption.
pub fn table(rows: &[Row], duration: f64, run: &Run) -> String {
    let mut text = format!(
        "First {duration} s of every scene. {}\n\n| scene | threads | simulated s/s | updates [million] | speed [million/s] | ratio to the kernel | {} [%] | allocations per substep |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n",
        run.caption("threads as listed"),
        Timings::PHASES.join(", ")
    );
    for row in rows {
        let _ = writeln!(
            text,
            "| `{}` | {} | {:.3} | {:.1} | {:.2} | {} | {} | {} |",
            row.scene,
            row.threads,
            row.pace(),
            row.measured.updates as f64 / 1e6,
            row.rate(),
            number(row.ratio(), 2),
            percents(&row.measured.shares),
            number(row.measured.allocations, 1),
        );
    }
    text
}
