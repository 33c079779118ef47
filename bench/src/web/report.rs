//! From what was seen to figures beside what is asked of them.

use anyhow::{Context, ensure};
use serde::Serialize;

use super::{
    page::Seen,
    session::{Step, Watched},
};
use crate::quantiles::quantile;

/// One page alone.
pub struct OnePage {
    pub steps_per_second: f64,
    pub frames_per_second: f64,
    /// Of processor time that the page server takes.
    pub cores: f64,
}

/// A page that was stopped for a while.
pub struct Stopped {
    /// From its going on to the newest step of that moment [s]; none where it does not come.
    pub back_seconds: Option<f64>,
    /// Changes that it did not get, by the numbers of steps.
    pub missed: u64,
    /// The same as the server counts it.
    pub dropped: u64,
}

impl Stopped {
    /// Of a page that went on at a moment [ns], when the newest step was this one.
    pub fn of(seen: &Seen, at: u64, step: u64) -> Self {
        let back = seen
            .answers
            .iter()
            .find(|got| got.at >= at && got.step >= step);
        let news: Vec<_> = seen.answers.iter().filter(|got| got.has_news).collect();
        let missed = news
            .windows(2)
            .map(|two| two[1].step.saturating_sub(two[0].step + 1));
        Self {
            back_seconds: back.map(|got| (got.at - at) as f64 * 1e-9),
            missed: missed.sum(),
            // The first answer is of everything, and follows none.
            dropped: news.iter().skip(1).map(|got| got.dropped).sum(),
        }
    }
}

/// Frames from each click to the first frame that the page got and that shows it: 1 for the next one.
///
/// # Errors
/// When a click is not in the journal at the step that its answer says, or the page ended before its frame.
pub fn reactions(seen: &Seen, applied: &[u64]) -> anyhow::Result<Vec<f64>> {
    ensure!(
        seen.clicks.len() == applied.len(),
        "{} clicks were answered and {} are in the journal",
        seen.clicks.len(),
        applied.len()
    );
    let frames = seen.clicks.iter().zip(applied).map(|(click, step)| {
        ensure!(
            click.step == *step,
            "a click takes effect at step {} by its answer and {step} by the journal",
            click.step
        );
        let shows = seen
            .answers
            .iter()
            .find(|got| got.has_news && got.step >= *step);
        let shows = shows.context("a page ended before what it clicked moved")?;
        Ok(shows.step.saturating_sub(click.shown) as f64)
    });
    frames.collect()
}

/// All that is measured, once.
pub struct Round {
    /// Steps without any page.
    pub alone: Vec<Step>,
    pub one_page: OnePage,
    /// With three pages, of which one is stopped.
    pub beside: Watched,
    pub stopped: Stopped,
    /// Largest answer with something new [byte].
    pub answer_bytes: u64,
    /// From click to reaction [frames].
    pub clicks: Vec<f64>,
}

/// A figure, and what is asked of it.
#[derive(Debug, Serialize)]
struct Row {
    what: String,
    unit: &'static str,
    found: f64,
    /// At least this, where that is asked.
    least: Option<f64>,
    /// At most this, where that is asked.
    most: Option<f64>,
    /// Whether it is as asked.
    holds: bool,
}

impl Row {
    fn told(what: impl Into<String>, unit: &'static str, found: f64) -> Self {
        Self {
            what: what.into(),
            unit,
            found,
            least: None,
            most: None,
            holds: true,
        }
    }

    // What is not a number is neither.
    fn at_least(self, least: f64) -> Self {
        Self {
            least: Some(least),
            holds: self.holds && self.found >= least,
            ..self
        }
    }

    fn at_most(self, most: f64) -> Self {
        Self {
            most: Some(most),
            holds: self.holds && self.found <= most,
            ..self
        }
    }

    fn line(&self) -> String {
        let number = |value: f64| match value.abs() {
            0.0 => "0".to_owned(),
            size if size < 100.0 => format!("{value:.3}"),
            _ => format!("{value:.0}"),
        };
        let asked = match (self.least, self.most) {
            (None, None) => String::new(),
            (Some(least), _) => format!("at least {}", number(least)),
            (None, Some(most)) => format!("at most {}", number(most)),
        };
        let verdict = match (asked.is_empty(), self.holds) {
            (true, _) => "",
            (false, true) => "holds",
            (false, false) => "**fails**",
        };
        let (what, unit, found) = (&self.what, self.unit, number(self.found));
        let found = format!("{found} {unit}");
        format!("| {what} | {} | {asked} | {verdict} |", found.trim_end())
    }
}

/// Medians over rounds.
#[derive(Debug, Serialize)]
pub struct Report {
    rounds: usize,
    /// Without a page, in all rounds.
    steps: usize,
    /// In all rounds.
    clicks: usize,
    rows: Vec<Row>,
}

/// By how much the memory of the page server is larger in the second half of a watch than in the first [byte].
fn growth(watched: &Watched) -> f64 {
    let (first, second) = watched.web_memory.split_at(watched.web_memory.len() / 2);
    let most = |half: &[u64]| half.iter().max().map_or(f64::NAN, |bytes| *bytes as f64);
    most(second) - most(first)
}

/// Median over rounds.
fn median(rounds: &[Round], of: impl Fn(&Round) -> f64) -> f64 {
    quantile(rounds.iter().map(of).collect(), 0.5)
}

impl Report {
    /// The table of rounds, and of a scene that settled [byte/s].
    pub fn of(rounds: &[Round], settled: f64) -> Self {
        let page = |of: fn(&OnePage) -> f64| median(rounds, |round| of(&round.one_page));
        let clicks: Vec<f64> = rounds.iter().flat_map(|r| r.clicks.clone()).collect();
        let count = clicks.len();
        let mut rows = vec![
            Row::told("steps with one page", "1/s", page(|p| p.steps_per_second)),
            Row::told("frames into one page", "1/s", page(|p| p.frames_per_second)).at_least(30.0),
            Row::told("page server with one page", "cores", page(|p| p.cores)).at_most(0.25),
        ];
        rows.extend(steps(rounds));
        rows.extend(stopped(rounds));
        rows.push(Row::told("a settled scene", "byte/s", settled).at_most(5000.0));
        if count > 0 {
            let [middle, most] = [0.5, 0.95].map(|part| quantile(clicks.clone(), part));
            rows.extend([
                Row::told("click to reaction, median", "frames", middle),
                Row::told("click to reaction, 95 %", "frames", most).at_most(3.0),
            ]);
        }
        Self {
            rounds: rounds.len(),
            steps: rounds.iter().map(|round| round.alone.len()).sum(),
            clicks: count,
            rows,
        }
    }

    /// As Markdown.
    pub fn table(&self) -> String {
        let mut lines = vec![
            "| measured | found | asked | |".to_owned(),
            "| --- | ---: | ---: | --- |".to_owned(),
        ];
        lines.extend(self.rows.iter().map(Row::line));
        lines.push(String::new());
        lines.push(format!(
            "Medians of {} rounds; {} steps without a page, {} clicks in all.",
            self.rounds, self.steps, self.clicks
        ));
        lines.join("\n")
    }
}

/// What is looked at of a step.
type Of = fn(&Step) -> f64;

/// Steps without a page beside those with three of which one is stopped.
fn steps(rounds: &[Round]) -> Vec<Row> {
    let own = |step: &Step| step.own_ms;
    let whole = |step: &Step| step.whole_ms;
    let cases: [(&str, Of, f64, Option<f64>); 3] = [
        ("step time, median", own, 0.5, None),
        ("step time, 99 %", own, 0.99, Some(1.05)),
        ("step and frame, 99 %", whole, 0.99, None),
    ];
    let rows = cases.into_iter().flat_map(|(name, of, part, most)| {
        let at = |steps: &[Step]| quantile(steps.iter().map(of).collect(), part);
        let alone = median(rounds, |round| at(&round.alone));
        let beside = median(rounds, |round| at(&round.beside.steps));
        let ratio = median(rounds, |round| at(&round.beside.steps) / at(&round.alone));
        let ratio = Row::told(format!("{name}: with pages over without"), "", ratio);
        [
            Row::told(format!("{name}: without a page"), "ms", alone),
            Row::told(format!("{name}: three pages, one stopped"), "ms", beside),
            match most {
                Some(most) => ratio.at_most(most),
                None => ratio,
            },
        ]
    });
    rows.collect()
}

/// What became of the page that was stopped, and of the memory of its server meanwhile.
fn stopped(rounds: &[Round]) -> [Row; 3] {
    let mega = 1e-6;
    let back = median(rounds, |r| r.stopped.back_seconds.unwrap_or(f64::INFINITY));
    let counted = |r: &Round| match (r.stopped.dropped, r.stopped.missed) {
        (0, 0) => 1.0,
        (dropped, missed) => dropped as f64 / missed as f64,
    };
    let answer = median(rounds, |r| r.answer_bytes as f64);
    let grown = median(rounds, |r| growth(&r.beside));
    [
        // A queue would hold hundreds of answers: one more or less is none.
        Row::told(
            "memory of the page server, second half of the stop over the first",
            "MB",
            grown * mega,
        )
        .at_most(answer * mega),
        Row::told("until a stopped page is at the newest step", "s", back).at_most(0.5),
        Row::told(
            "frames it did not get that are counted, of all",
            "",
            median(rounds, counted),
        )
        .at_least(1.0)
        .at_most(1.0),
    ]
}
