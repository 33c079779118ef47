//! Runs the settings of a case in turns, so that all of them see the same machine.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::bail;
use indicatif::ProgressBar;

use super::case::{Case, Family, Setting};
use crate::trial::{Outcome, Trial};

/// Runs longer than this are repeated over their first part only [s].
const LONGEST: f64 = 1.5;

/// What was measured of a setting.
pub struct Measured {
    /// The settings that differ from the scene.
    pub setting: Setting,
    /// The command that repeats it.
    pub command: String,
    /// What it gave, or why it failed.
    pub result: Result<Figures, String>,
}

/// Figures of a setting that ran.
pub struct Figures {
    /// How far its result is off.
    pub error: f64,
    /// Wall seconds per simulated second, ascending.
    pub walls: Vec<f64>,
    /// Simulated seconds of the repetitions.
    pub timed: f64,
    /// Particle-updates per simulated second.
    pub updates: f64,
    /// Particles.
    pub particles: u64,
    /// Substeps of the whole run.
    pub substeps: u64,
}

impl Figures {
    /// First quartile, median, third quartile of the cost.
    pub fn quartiles(&self) -> [f64; 3] {
        let last = self.walls.len() - 1;
        [1, 2, 3].map(|n| self.walls[(last * n + 2) / 4])
    }
}

/// All of a case: runs, and which of them each family shows.
pub struct CaseResult {
    /// The case.
    pub case: &'static Case,
    /// The runs.
    pub runs: Vec<Measured>,
    /// Families with the places of their settings among the runs and the labels there.
    pub families: Vec<(&'static str, Vec<(usize, String)>)>,
    /// The command of the reference run, and its wall seconds.
    pub reference: Option<(String, f64)>,
    /// Wall seconds that the case took.
    pub seconds: f64,
}

impl CaseResult {
    /// The run that changes nothing, where it succeeded.
    pub fn default_run(&self) -> Option<&Figures> {
        let run = self.runs.iter().find(|run| run.setting.is_default())?;
        run.result.as_ref().ok()
    }
}

/// What a run cost, from its summary: wall seconds, simulated seconds, particle-updates.
fn cost(outcome: &Outcome) -> Option<[f64; 3]> {
    let number = |key: &str| outcome.summary[key].as_f64();
    Some([
        number("wall_seconds")?,
        number("sim_seconds")?,
        number("particle_updates")?,
    ])
}

/// Makes all runs of a case, `rounds` of each.
///
/// # Errors
/// When interrupted, or when the reference run fails; a setting that fails is reported in its place.
pub fn measure(
    case: &'static Case,
    rounds: usize,
    keep: impl Fn(&Setting) -> bool,
    bar: &ProgressBar,
    stop: &AtomicBool,
) -> anyhow::Result<CaseResult> {
    let start = std::time::Instant::now();
    let (settings, families) = runs_of((case.families)(), keep);
    bar.set_length((settings.len() * rounds) as u64);
    bar.set_position(0);
    let mut reference = None;
    if let Some(changes) = case.reference {
        bar.set_message("reference run");
        let plain = Trial::new(&case.scene, case.duration);
        let trial = changes
            .iter()
            .fold(plain, |trial, (key, value)| trial.set(key, value));
        let outcome = trial.run()?;
        let wall = cost(&outcome).map_or(0.0, |c| c[0]);
        reference = Some((outcome, trial.command(), wall));
    }
    let mut runs: Vec<Measured> = Vec::new();
    for setting in settings {
        check(stop)?;
        bar.set_message(setting.label.clone());
        let trial = setting.trial(&case.scene, case.duration);
        let result = trial
            .run()
            .and_then(|outcome| first(case, &outcome, reference.as_ref().map(|r| &r.0)));
        bar.inc(1);
        runs.push(Measured {
            setting,
            command: trial.command(),
            result: result.map_err(|e| format!("{e:#}")),
        });
    }
    for round in 1..rounds {
        // Forth and back: who runs first after a pause is not always the same.
        let mut order: Vec<usize> = (0..runs.len()).collect();
        if round % 2 == 1 {
            order.reverse();
        }
        for i in order {
            check(stop)?;
            bar.inc(1);
            let run = &mut runs[i];
            let Ok(figures) = &mut run.result else {
                continue;
            };
            let trial = run.setting.trial(&case.scene, figures.timed);
            // A repetition can only fail for reasons outside the solver; the others count.
            if let Some(cost) = trial.run().ok().as_ref().and_then(cost) {
                figures.walls.push(per_second(cost, figures.updates));
            }
        }
    }
    for run in &mut runs {
        if let Ok(figures) = &mut run.result {
            figures.walls.sort_by(f64::total_cmp);
        }
    }
    Ok(CaseResult {
        case,
        runs,
        families,
        reference: reference.map(|(_, command, wall)| (command, wall)),
        seconds: start.elapsed().as_secs_f64(),
    })
}

fn check(stop: &AtomicBool) -> anyhow::Result<()> {
    if stop.load(Ordering::Relaxed) {
        bail!("interrupted");
    }
    Ok(())
}

/// Wall seconds per simulated second. Where a repetition is shorter than the run, updates may come thicker in one
/// part of it: so a repetition gives the wall time of an update, and the whole run how many there are.
fn per_second([wall, simulated, updates]: [f64; 3], updates_per_second: f64) -> f64 {
    if updates > 0.0 {
        wall / updates * updates_per_second
    } else {
        wall / simulated
    }
}

/// Figures of the first, whole run.
fn first(case: &Case, run: &Outcome, reference: Option<&Outcome>) -> anyhow::Result<Figures> {
    let Some([wall, simulated, updates]) = cost(run) else {
        bail!("the summary lacks the costs");
    };
    let left = run.summary["left_domain"].as_u64().unwrap_or(0);
    let quarantined = run.summary["quarantined"].as_u64().unwrap_or(0);
    anyhow::ensure!(
        left + quarantined == 0,
        "{left} particles left the domain, {quarantined} were set aside"
    );
    let error = (case.measure)(run, reference)?;
    anyhow::ensure!(error.is_finite(), "the error is not a number");
    let count = |key: &str| run.summary[key].as_u64().unwrap_or(0);
    Ok(Figures {
        error,
        walls: vec![wall / simulated],
        timed: case.duration * (LONGEST / wall).min(1.0),
        updates: updates / simulated,
        particles: count("particles"),
        substeps: count("substeps"),
    })
}

type Shown = Vec<(&'static str, Vec<(usize, String)>)>;

/// Each different setting once, and where the families have it.
fn runs_of(families: Vec<Family>, keep: impl Fn(&Setting) -> bool) -> (Vec<Setting>, Shown) {
    let mut runs: Vec<Setting> = vec![Setting {
        label: "default".into(),
        ..Setting::default()
    }];
    let mut shown = Shown::new();
    for family in families {
        let mut places = Vec::new();
        for setting in family.settings.into_iter().filter(|s| keep(s)) {
            let same = |run: &Setting| (&run.changes, run.f64) == (&setting.changes, setting.f64);
            let label = setting.label.clone();
            let place = runs.iter().position(same).unwrap_or_else(|| {
                let named = format!("{} {label}", family.name);
                runs.push(Setting {
                    label: named,
                    ..setting.clone()
                });
                runs.len() - 1
            });
            places.push((place, label));
        }
        if !places.is_empty() {
            shown.push((family.name, places));
        }
    }
    (runs, shown)
}
