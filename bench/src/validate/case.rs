//! A figure with a known answer, before it is measured.

use serde_json::{Value, json};

use super::report::{Gate, Row};
use crate::trial::{Outcome, Trial};

/// How large a case is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Seconds, for the test suite.
    Quick,
    /// As the case is defined.
    Full,
}

impl Size {
    /// One of two.
    pub fn pick<T>(self, quick: T, full: T) -> T {
        match self {
            Self::Quick => quick,
            Self::Full => full,
        }
    }
}

/// Cases about one matter.
pub struct Group {
    /// Number in the list of recommended cases.
    pub number: u8,
    /// Short name, as on the command line.
    pub name: &'static str,
    /// What it shows, in one line.
    pub about: &'static str,
    /// Its cases, in the order of the table.
    pub cases: fn(Size) -> Vec<Case>,
}

impl Group {
    /// Whether a user means it: by name or number.
    pub fn is(&self, wanted: &str) -> bool {
        wanted == self.name || wanted == self.number.to_string()
    }
}

type Read = Box<dyn Fn(&[&Outcome]) -> anyhow::Result<f64>>;
type Session = Box<dyn Fn() -> anyhow::Result<f64>>;

/// How a figure comes about.
enum Measure {
    /// From reports of runs.
    Runs(Vec<Trial>, Read),
    /// From a session with a client.
    Session(Session),
}

/// What a figure should be.
enum Reference {
    Is(f64),
    /// Of the run itself, as of the time at which it ended.
    Of(Read),
}

/// A scene, what is read from its run, what that should be and how far it may be off.
pub struct Case {
    claim: &'static str,
    quantity: String,
    measure: Measure,
    reference: Reference,
    source: &'static str,
    gate: Gate,
    known_failure: Option<&'static str>,
    command: String,
}

impl Case {
    fn with(claim: &'static str, quantity: String, measure: Measure, command: String) -> Self {
        Self {
            claim,
            quantity,
            measure,
            reference: Reference::Is(0.0),
            source: "",
            gate: Gate::Absolute(0.0),
            known_failure: None,
            command,
        }
    }

    /// Read from one run. `claim` is the line of the page that it belongs to, `quantity` says the unit.
    pub fn new(
        claim: &'static str,
        quantity: impl Into<String>,
        trial: &Trial,
        read: impl Fn(&Outcome) -> anyhow::Result<f64> + 'static,
    ) -> Self {
        let all = [trial.clone()];
        Self::of_all(claim, quantity, all, move |runs| read(runs[0]))
    }

    /// Read from several runs; the first is the one whose command is shown.
    pub fn of_all(
        claim: &'static str,
        quantity: impl Into<String>,
        trials: impl Into<Vec<Trial>>,
        read: impl Fn(&[&Outcome]) -> anyhow::Result<f64> + 'static,
    ) -> Self {
        let trials = trials.into();
        let command = trials[0].command();
        let measure = Measure::Runs(trials, Box::new(read));
        Self::with(claim, quantity.into(), measure, command)
    }

    /// Order of convergence between two runs (size, run), from the error of each.
    pub fn order(
        claim: &'static str,
        quantity: impl Into<String>,
        [coarse, fine]: [(f64, Trial); 2],
        error: impl Fn(&Outcome) -> anyhow::Result<f64> + 'static,
    ) -> Self {
        let sizes = (coarse.0 / fine.0).ln();
        let case = Self::of_all(claim, quantity, [coarse.1, fine.1], move |runs| {
            Ok((error(runs[0])? / error(runs[1])?).ln() / sizes)
        });
        Self {
            command: "see the rows above".into(),
            ..case
        }
    }

    /// Measured in a session with a client.
    pub fn session(
        claim: &'static str,
        quantity: impl Into<String>,
        command: String,
        measure: impl Fn() -> anyhow::Result<f64> + 'static,
    ) -> Self {
        let measure = Measure::Session(Box::new(measure));
        Self::with(claim, quantity.into(), measure, command)
    }

    /// What it should be, and where that comes from; 0 when not said.
    pub fn against(mut self, reference: f64, source: &'static str) -> Self {
        self.reference = Reference::Is(reference);
        self.source = source;
        self
    }

    /// The same, where it depends on the run.
    pub fn against_run(
        mut self,
        source: &'static str,
        reference: impl Fn(&Outcome) -> anyhow::Result<f64> + 'static,
    ) -> Self {
        self.reference = Reference::Of(Box::new(move |runs| reference(runs[0])));
        self.source = source;
        self
    }

    /// How far it may be off; not at all when not said.
    pub fn within(mut self, gate: Gate) -> Self {
        self.gate = gate;
        self
    }

    /// That it fails, and the measured reason.
    pub fn fails(mut self, reason: impl Into<Option<&'static str>>) -> Self {
        self.known_failure = reason.into();
        self
    }

    /// What it is of, what it may be and how it is repeated, as a JSON object; nothing is run.
    pub fn plan(&self, group: &Group) -> Value {
        json!({
            "case": group.name,
            "number": group.number,
            "claim": self.claim,
            "quantity": self.quantity,
            "reference": match self.reference {
                Reference::Is(value) => Some(value),
                Reference::Of(_) => None,
            },
            "source": self.source,
            "gate": self.gate.to_string(),
            "known_failure": self.known_failure,
            "command": self.command,
        })
    }

    /// Measures it. Runs that other cases of the group have made are not made again.
    ///
    /// # Errors
    /// When a run fails, or its report lacks what is read.
    pub fn measure(self, made: &mut Runs) -> anyhow::Result<Row> {
        let (measured, reference) = match self.measure {
            Measure::Runs(trials, read) => {
                let at: Vec<usize> = trials
                    .iter()
                    .map(|trial| made.make(trial))
                    .collect::<anyhow::Result<_>>()?;
                let runs: Vec<&Outcome> = at.into_iter().map(|n| &made.0[n].1).collect();
                let reference = match self.reference {
                    Reference::Is(value) => value,
                    Reference::Of(read) => read(&runs)?,
                };
                (read(&runs)?, reference)
            }
            Measure::Session(measure) => {
                let Reference::Is(reference) = self.reference else {
                    anyhow::bail!("{} has no run to take its reference from", self.quantity);
                };
                (measure()?, reference)
            }
        };
        Ok(Row {
            claim: self.claim,
            quantity: self.quantity,
            reference,
            source: self.source,
            measured,
            gate: self.gate,
            known_failure: self.known_failure,
            command: self.command,
        })
    }
}

/// Runs that were made, by their command.
#[derive(Default)]
pub struct Runs(Vec<(String, Outcome)>);

impl Runs {
    /// Where a run is, made now if need be.
    fn make(&mut self, trial: &Trial) -> anyhow::Result<usize> {
        let command = trial.command();
        if let Some(at) = self.0.iter().position(|(made, _)| *made == command) {
            return Ok(at);
        }
        self.0.push((command, trial.run()?));
        Ok(self.0.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::validate::cases::ALL;

    #[test]
    fn every_case_has_its_own_name_and_says_what_it_is_held_against() {
        for size in [Size::Quick, Size::Full] {
            for group in &ALL {
                let cases = (group.cases)(size);
                assert!(!cases.is_empty(), "{}", group.name);
                let names: BTreeSet<&str> = cases.iter().map(|c| c.quantity.as_str()).collect();
                assert_eq!(names.len(), cases.len(), "{}", group.name);
                for case in &cases {
                    assert!(!case.source.is_empty(), "{}", case.quantity);
                    assert!(case.command.contains("cosplat") || case.command.contains("above"));
                }
            }
        }
    }

    #[test]
    fn groups_stand_in_the_order_of_their_numbers() {
        let numbers: Vec<u8> = ALL.iter().map(|group| group.number).collect();
        assert_eq!(numbers, (1..=27).collect::<Vec<u8>>());
    }
}
