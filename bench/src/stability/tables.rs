//! Tables.

use std::fmt::Write as _;

use super::{
    catalogue::{Measured, judge::Judged},
    guard::Field,
    solids::Limit,
};
use crate::chart::csv;

/// A number with three digits.
fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !(1e-2..1e4).contains(&size) => format!("{value:.1e}"),
        size => {
            let decimals = (2 - size.log10().floor() as i32).clamp(0, 4) as usize;
            format!("{value:.decimals$}")
        }
    }
}

/// Measured limits of clusters against the closed form.
pub fn limits(limits: &[(&str, f64, f64, f64)]) -> String {
    let mut text = String::from(
        "| transfer | nu | closed form, over that of APIC | smallest of the samples, measured |\n| --- | --- | --- | --- |\n",
    );
    for (transfer, nu, closed, measured) in limits {
        let _ = writeln!(text, "| {transfer} | {nu} | {closed:.3} | {measured:.2} |");
    }
    text
}

/// Measured limits of solids beside what the solver takes.
pub fn solids(limits: &[Limit]) -> String {
    let mut text = String::from(
        "| solid | nu or law | stable up to, measured | 2 over the fastest frequency | taken with `cfl` 0.8 | taken with `cfl` 1 | measured limit over that |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for limit in limits {
        let Limit {
            solid,
            row,
            measured,
            by_frequency,
            taken: [usual, most],
        } = limit;
        let _ = writeln!(
            text,
            "| {solid} | {row} | {measured:.2} | {by_frequency:.2} | {usual:.2} | {most:.2} | {:.2} |",
            measured / most
        );
    }
    text
}

/// What the guard did, scene by scene, where it had to do something or energy grew.
pub fn guard(fields: &[Field]) -> String {
    let mut text = String::from(
        "| scene | transfer or solver | `cfl` | substeps taken back | particles taken out | largest energy over start | not a number |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for field in fields.iter().filter(|field| field.class() > 0) {
        let found = field.found;
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} |",
            field.scene,
            field.transfer,
            field.cfl,
            found.rollbacks,
            found.quarantined,
            short(found.energy),
            found.lost
        );
    }
    text
}

/// The same as a file.
pub fn guard_csv(fields: &[Field]) -> String {
    let header = [
        "scene",
        "transfer",
        "cfl",
        "rollbacks",
        "quarantined",
        "largest_energy_over_start",
        "not_a_number",
    ];
    let row = |field: &Field| {
        let found = field.found;
        vec![
            field.scene.into(),
            field.transfer.into(),
            format!("{}", field.cfl),
            format!("{}", found.rollbacks),
            format!("{}", found.quarantined),
            format!("{}", found.energy),
            format!("{}", found.lost),
        ]
    };
    csv(&header, &fields.iter().map(row).collect::<Vec<_>>())
}

/// Failures, scene by scene.
pub fn catalogue(failures: &[Measured]) -> String {
    let mut text = String::from(
        "| failure | scene | measured | without it | found | remedy |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    for Measured { failure, runs } in failures {
        let found: Vec<String> = runs
            .iter()
            .map(|run| {
                let mut text = format!("{}: **{}**", run.variant, short(run.value));
                if run.quarantined > 0 {
                    let _ = write!(text, " ({} taken out)", run.quarantined);
                }
                text
            })
            .collect();
        let file = failure.scene.path;
        let _ = writeln!(
            text,
            "| {} | [{}](../{file}) | {} | {} | {} | {} |",
            failure.name,
            file.rsplit('/').next().unwrap_or(file),
            failure.measured,
            failure.ideal,
            found.join("<br>"),
            failure.remedy
        );
    }
    text
}

/// Cases with right values, figure by figure, after how many miss their gates.
pub fn cases(judged: &[Judged]) -> String {
    let all = || judged.iter().flat_map(Judged::figures);
    let missed = all()
        .filter(|(reading, value)| !reading.admits(*value))
        .count();
    let mut text = format!(
        "{missed} of {} figures miss their gate.\n\n| case | scene | measured | right, gate | found | gate |\n| --- | --- | --- | --- | --- | --- |\n",
        all().count()
    );
    for one in judged {
        let file = one.case.scene.path;
        for (reading, value) in one.figures() {
            let met = if reading.admits(value) {
                "met"
            } else {
                "**missed**"
            };
            let _ = writeln!(
                text,
                "| {} | [{}](../{file}) | {} | {} | **{}** | {met} |",
                one.case.about,
                file.rsplit('/').next().unwrap_or(file),
                reading.quantity,
                reading.allowed(),
                short(value),
            );
        }
    }
    text
}
