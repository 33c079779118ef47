//! Results: rows, gates, the table of claims and the files of all rows.

use std::{fmt::Write, fs, path::Path};

use anyhow::Context;
use serde::Serialize;

use super::case::Group;
use crate::chart::csv;

/// How far a measured value may be from its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gate {
    /// `|measured - reference| <= gate |reference|`.
    Relative(f64),
    /// `|measured - reference| <= gate`.
    Absolute(f64),
    /// `measured >= gate`, whatever the reference.
    AtLeast(f64),
    /// `measured <= gate`, whatever the reference.
    AtMost(f64),
    /// `first <= measured <= second`, whatever the reference.
    Between(f64, f64),
}

impl Gate {
    /// Whether a value passes; what is not a number does not.
    pub fn admits(self, measured: f64, reference: f64) -> bool {
        match self {
            Self::Relative(gate) => (measured - reference).abs() <= gate * reference.abs(),
            Self::Absolute(gate) => (measured - reference).abs() <= gate,
            Self::AtLeast(gate) => measured >= gate,
            Self::AtMost(gate) => measured <= gate,
            Self::Between(low, high) => (low..=high).contains(&measured),
        }
    }
}

impl Gate {
    /// How much of the gate a value uses up: 1 at its edge, more beyond, nothing at the reference.
    fn used(self, measured: f64, reference: f64) -> f64 {
        let share = |off: f64, gate: f64| match (off == 0.0, gate == 0.0) {
            (true, _) => 0.0,
            (false, true) => f64::INFINITY,
            (false, false) => off / gate,
        };
        match self {
            _ if measured.is_nan() => f64::INFINITY,
            Self::Relative(gate) => share((measured - reference).abs(), gate * reference.abs()),
            Self::Absolute(gate) => share((measured - reference).abs(), gate),
            Self::AtLeast(gate) if measured > 0.0 => gate / measured,
            Self::AtLeast(_) => f64::INFINITY,
            Self::AtMost(gate) => share(measured.max(0.0), gate),
            Self::Between(low, high) => {
                share((measured - 0.5 * (low + high)).abs(), 0.5 * (high - low))
            }
        }
    }
}

impl std::fmt::Display for Gate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Relative(gate) if *gate >= 1e-3 => write!(f, "± {} %", gate * 100.0),
            Self::Relative(gate) => write!(f, "± {gate:e} of it"),
            Self::Absolute(gate) => write!(f, "± {}", rounded(*gate)),
            Self::AtLeast(gate) => write!(f, "at least {}", rounded(*gate)),
            Self::AtMost(gate) => write!(f, "at most {}", rounded(*gate)),
            Self::Between(low, high) => write!(f, "{} to {}", rounded(*low), rounded(*high)),
        }
    }
}

/// One measured quantity of a case.
#[derive(Clone, Debug)]
pub struct Row {
    /// The line of the page that it belongs to.
    pub claim: &'static str,
    /// What is measured, with its unit.
    pub quantity: String,
    /// What it should be.
    pub reference: f64,
    /// Where that comes from.
    pub source: &'static str,
    /// What it is.
    pub measured: f64,
    /// How far it may be off.
    pub gate: Gate,
    /// The measured reason, for a row that fails.
    pub known_failure: Option<&'static str>,
    /// The command that repeats the run.
    pub command: String,
}

impl Row {
    /// Whether it is within the gate.
    pub fn passes(&self) -> bool {
        self.gate.admits(self.measured, self.reference)
    }

    /// What is unexpected about it.
    pub fn surprise(&self, case: &str) -> Option<String> {
        let told = format!(
            "{case}: {}: {} for {}, gate {}",
            self.quantity,
            short(self.measured),
            short(self.reference),
            self.gate
        );
        match (self.passes(), self.known_failure) {
            (false, None) => Some(format!("{told}: fails ({})", self.command)),
            (true, Some(_)) => Some(format!("{told}: passes, but is listed as known to fail")),
            _ => None,
        }
    }
}

/// A row as one JSON line.
#[derive(Serialize)]
pub struct Line<'a> {
    case: &'static str,
    number: u8,
    claim: &'static str,
    quantity: &'a str,
    reference: f64,
    source: &'static str,
    measured: f64,
    gate: String,
    pass: bool,
    known_failure: Option<&'static str>,
    command: &'a str,
}

impl<'a> Line<'a> {
    /// The line of a row.
    pub fn new(group: &Group, row: &'a Row) -> Self {
        Self {
            case: group.name,
            number: group.number,
            claim: row.claim,
            quantity: &row.quantity,
            reference: row.reference,
            source: row.source,
            measured: row.measured,
            gate: row.gate.to_string(),
            pass: row.passes(),
            known_failure: row.known_failure,
            command: &row.command,
        }
    }
}

/// A group with its rows and the seconds it took.
pub type Result<'a> = (&'a Group, Vec<Row>, f64);

/// Rows of a group by their claim, in the order in which claims first occur.
fn by_claim(rows: &[Row]) -> Vec<Vec<&Row>> {
    let mut claims: Vec<Vec<&Row>> = Vec::new();
    for row in rows {
        match claims.iter_mut().find(|of| of[0].claim == row.claim) {
            Some(of) => of.push(row),
            None => claims.push(vec![row]),
        }
    }
    claims
}

/// One line per claim as a Markdown table: how many of its rows pass, and the one that uses up most of its gate.
pub fn table(results: &[Result<'_>]) -> String {
    let mut text = String::from(
        "| case | claim | rows that pass | nearest to its gate | of | gate | from |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut reasons = String::new();
    let (mut claims, mut rows, mut failures) = (0, 0, 0);
    for (group, of_group, _) in results {
        for of_claim in by_claim(of_group) {
            let pass = of_claim.iter().filter(|row| row.passes()).count();
            let used = |row: &&&Row| row.gate.used(row.measured, row.reference);
            let Some(worst) = of_claim.iter().max_by(|a, b| used(a).total_cmp(&used(b))) else {
                continue;
            };
            let verdict = match pass == of_claim.len() {
                true => format!("{pass}"),
                false => format!("**{pass} of {}**", of_claim.len()),
            };
            let _ = writeln!(
                text,
                "| {} {} | {} | {verdict} | {} | {} | {} | {} |",
                group.number,
                group.name,
                worst.claim,
                short(worst.measured),
                short(worst.reference),
                worst.gate,
                worst.source
            );
            let mut told: Vec<&str> = Vec::new();
            for row in of_claim.iter().filter(|row| !row.passes()) {
                if let Some(reason) = row.known_failure.filter(|reason| !told.contains(reason)) {
                    told.push(reason);
                    let (number, name) = (group.number, group.name);
                    let _ = writeln!(reasons, "- {number} {name}, {}: {reason}", row.claim);
                }
            }
            claims += 1;
            rows += of_claim.len();
            failures += of_claim.len() - pass;
        }
    }
    let seconds: f64 = results.iter().map(|(_, _, seconds)| seconds).sum();
    let _ = writeln!(
        text,
        "\n{} cases, {claims} claims, {rows} rows, {failures} of them fail; {seconds:.0} s.",
        results.len()
    );
    if !reasons.is_empty() {
        let _ = write!(text, "\nWhy rows fail:\n\n{reasons}");
    }
    text
}

/// Writes all rows of each group into a file of its name.
///
/// # Errors
/// When a file cannot be written.
pub fn write_rows(folder: &Path, results: &[Result<'_>]) -> anyhow::Result<()> {
    let shown = |path: &Path| path.display().to_string();
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", shown(folder)))?;
    for (group, rows, _) in results {
        let path = folder.join(format!("{}.csv", group.name));
        let lines: Vec<Vec<String>> = rows.iter().map(fields).collect();
        fs::write(&path, csv(&HEADER, &lines))
            .with_context(|| format!("cannot write {}", shown(&path)))?;
    }
    Ok(())
}

/// Rows that are not as on record in the files of their groups, each as a sentence.
///
/// # Errors
/// When a file cannot be read.
pub fn moved(folder: &Path, results: &[Result<'_>]) -> anyhow::Result<Vec<String>> {
    let mut moved = Vec::new();
    for (group, rows, _) in results {
        let path = folder.join(format!("{}.csv", group.name));
        let record =
            fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        for row in rows {
            let fields = fields(row);
            let [line, quantity] =
                [&fields[..], &fields[..2]].map(|fields| csv(&[], &[fields.to_vec()]));
            let [line, quantity] = [line, quantity].map(|text| text.trim().to_owned());
            if record.lines().any(|recorded| recorded == line) {
                continue;
            }
            let beginning = format!("{quantity},");
            let before = record
                .lines()
                .find(|recorded| recorded.starts_with(&beginning));
            let before = before.unwrap_or("not on record");
            moved.push(format!("{}: {line}\n  before: {before}", group.name));
        }
    }
    Ok(moved)
}

const HEADER: [&str; 8] = [
    "claim",
    "quantity",
    "reference",
    "source",
    "measured",
    "gate",
    "verdict",
    "command",
];

fn fields(row: &Row) -> Vec<String> {
    vec![
        row.claim.into(),
        row.quantity.clone(),
        short(row.reference),
        row.source.into(),
        short(row.measured),
        row.gate.to_string(),
        if row.passes() { "pass" } else { "fails" }.into(),
        row.command.clone(),
    ]
}

/// The page, in the folder of documents, its part that holds the table, and the folder of all rows.
pub const PAGE: &str = "validation.md";
pub const PART: &str = "cosplat bench validate";
pub const ROWS: &str = "validation";

/// A gate without the digits of its arithmetic.
fn rounded(gate: f64) -> String {
    if gate != 0.0 && gate.abs() < 1e-3 {
        return format!("{gate:.2e}").replace(".00e", "e");
    }
    let text = format!("{gate:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A number with the digits that matter.
fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !(1e-3..1e5).contains(&size) => format!("{value:.3e}"),
        size => {
            let decimals = (4 - size.log10().floor() as i32).clamp(0, 7) as usize;
            format!("{value:.decimals$}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gates_admit_what_is_within_and_nothing_that_is_not_a_number() {
        for (gate, inside, outside) in [
            (Gate::Relative(0.1), 2.19, 2.21),
            (Gate::Absolute(0.1), 1.91, 1.89),
            (Gate::AtLeast(3.0), 3.0, 2.9),
            (Gate::AtMost(3.0), 3.0, 3.1),
            (Gate::Between(1.0, 3.0), 1.0, 0.9),
        ] {
            assert!(gate.admits(inside, 2.0), "{gate}");
            assert!(!gate.admits(outside, 2.0), "{gate}");
            assert!(!gate.admits(f64::NAN, 2.0), "{gate}");
        }
    }

    #[test]
    fn gates_are_printed_as_they_are_meant() {
        for (gate, text) in [
            (Gate::Relative(1e-6), "± 1e-6 of it"),
            (Gate::Relative(0.03), "± 3 %"),
            (Gate::Absolute(0.0), "± 0"),
            (Gate::Absolute(0.353_553_390_593), "± 0.3536"),
            (Gate::AtMost(2e-5), "at most 2e-5"),
            (Gate::AtLeast(120.0), "at least 120"),
            (Gate::Between(1.1828, 1.369_500_000_2), "1.1828 to 1.3695"),
        ] {
            assert_eq!(gate.to_string(), text);
        }
    }

    #[test]
    fn a_gate_is_used_up_at_its_edge() {
        for (gate, half, edge) in [
            (Gate::Relative(0.1), 2.1, 1.8),
            (Gate::Absolute(0.1), 1.95, 2.1),
            (Gate::AtLeast(3.0), 6.0, 3.0),
            (Gate::AtMost(3.0), 1.5, 3.0),
            (Gate::Between(1.0, 3.0), 2.5, 1.0),
        ] {
            assert!((gate.used(half, 2.0) - 0.5).abs() < 1e-12, "{gate}");
            assert!((gate.used(edge, 2.0) - 1.0).abs() < 1e-12, "{gate}");
            assert_eq!(gate.used(f64::NAN, 2.0), f64::INFINITY, "{gate}");
        }
        assert_eq!(Gate::Absolute(0.0).used(2.0, 2.0), 0.0);
        assert_eq!(Gate::AtMost(0.0).used(0.0, 0.0), 0.0);
        assert_eq!(Gate::AtMost(0.0).used(1.0, 0.0), f64::INFINITY);
    }

    fn row(claim: &'static str, measured: f64) -> Row {
        Row {
            claim,
            quantity: "height [m]".into(),
            reference: 1.0,
            source: "mechanics",
            measured,
            gate: Gate::Relative(0.01),
            known_failure: Some("the grid is coarse"),
            command: String::new(),
        }
    }

    #[test]
    fn a_claim_has_one_line_and_shows_its_worst_row() {
        let group = &crate::validate::cases::ALL[1];
        let rows = vec![row("a", 1.0), row("b", 1.0), row("a", 1.1), row("a", 1.05)];
        let text = table(&[(group, rows, 2.0)]);
        let lines: Vec<&str> = text.lines().skip(2).collect();
        assert_eq!(
            lines[0],
            "| 2 free_fall | a | **1 of 3** | 1.1000 | 1.0000 | ± 1 % | mechanics |"
        );
        assert_eq!(
            lines[1],
            "| 2 free_fall | b | 1 | 1.0000 | 1.0000 | ± 1 % | mechanics |"
        );
        assert_eq!(lines[3], "1 cases, 2 claims, 4 rows, 2 of them fail; 2 s.");
        assert_eq!(text.matches("the grid is coarse").count(), 1);
    }

    #[test]
    fn a_known_failure_that_passes_is_a_surprise() {
        let mut row = row("fall", 1.0);
        assert!(
            row.surprise("fall")
                .is_some_and(|s| s.contains("known to fail"))
        );
        row.measured = 1.1;
        assert_eq!(row.surprise("fall"), None);
        row.known_failure = None;
        assert!(row.surprise("fall").is_some_and(|s| s.contains("fails")));
    }

    #[test]
    fn numbers_are_short_and_keep_five_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1.0000"),
            (-12.34567, "-12.346"),
            (1e-7, "1.000e-7"),
            (54321.7, "54322"),
        ] {
            assert_eq!(short(value), text);
        }
    }
}
