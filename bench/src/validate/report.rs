//! Results: rows, gates, the table.

use std::fmt::Write;

use serde::Serialize;

use super::Case;

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
    pub fn new(case: &Case, row: &'a Row) -> Self {
        Self {
            case: case.name,
            number: case.number,
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

/// A case with its rows and the seconds it took.
pub type Result<'a> = (&'a Case, Vec<Row>, f64);

/// The rows as a Markdown table.
pub fn table(results: &[Result<'_>]) -> String {
    let mut text = String::from(
        "| case | quantity | reference | source | measured | gate | |\n| --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut reasons = String::new();
    let mut failures = 0;
    for (case, rows, _) in results {
        for row in rows {
            let verdict = if row.passes() { "pass" } else { "**fails**" };
            let (reference, measured) = (short(row.reference), short(row.measured));
            let _ = writeln!(
                text,
                "| {} {} | {} | {reference} | {} | {measured} | {} | {verdict} |",
                case.number, case.name, row.quantity, row.source, row.gate
            );
            failures += usize::from(!row.passes());
            if let (false, Some(reason)) = (row.passes(), row.known_failure) {
                let _ = writeln!(
                    reasons,
                    "- {} {}, {}: {reason}",
                    case.number, case.name, row.quantity
                );
            }
        }
    }
    let rows: usize = results.iter().map(|(_, rows, _)| rows.len()).sum();
    let seconds: f64 = results.iter().map(|(_, _, seconds)| seconds).sum();
    let _ = writeln!(
        text,
        "\n{} cases, {rows} rows, {failures} of them fail; {seconds:.0} s.",
        results.len()
    );
    if !reasons.is_empty() {
        let _ = write!(text, "\nWhy rows fail:\n\n{reasons}");
    }
    text
}

/// The page, in the folder of documents, and its part that holds the table.
pub const PAGE: &str = "validation.md";
pub const PART: &str = "cosplat bench validate";

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
    fn a_known_failure_that_passes_is_a_surprise() {
        let mut row = Row {
            quantity: "height [m]".into(),
            reference: 1.0,
            source: "",
            measured: 1.0,
            gate: Gate::Relative(0.01),
            known_failure: Some("the grid is coarse"),
            command: String::new(),
        };
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
