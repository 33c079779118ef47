//! `cosplat bench kernel --solids`: blocks on grids of their own, against the same yardstick.
//!
//! Blocks vibrate and touch nothing. Yardstick, blocks and a loop of nothing but multiply-adds take turns in one process.

use std::{fmt::Write as _, time::Instant};

use anyhow::{bail, ensure};
use cosplat_sim_core::{Isa, VibratingBlock, materials::Material, simd::multiply_adds};
use indicatif::ProgressBar;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde_json::json;

use super::{
    measure::{Quartiles, on_processor},
    report::{spread, verdict},
    scene::{Layout, material, scene, yardstick_of},
    yardstick::Yardstick,
};
use crate::{machine::Run, page, progress};

/// The part of a page that holds the tables.
pub const PART: &str = "cosplat bench kernel --solids";

/// Laws, with the multiples of the yardstick's speed that are asked of full and of cut cells, and the operations of a point and
/// substep: those of the kernel's text, a multiply-add counting as two, and one of a division. Those of fixed corotated are with three
/// steps of the polar decomposition, as the blocks here take.
const LAWS: [(&str, [f64; 2], f64); 2] = [
    ("neo_hookean", [30.0, 12.0], 280.0),
    ("fixed_corotated", [22.0, 10.0], 400.0),
];
/// Asked of two threads: multiple of the speed of one.
const TWO_THREADS: f64 = 1.8;
/// Asked of blocks of 4,096 points: share of the speed of large ones.
const SMALL: f64 = 0.8;
/// Point-substeps that make one run of a block.
const WORK: u32 = 1 << 23;
/// Particles and substeps of a run of the yardstick, and its substep over `dx sqrt(rho / (3 lambda + 2 mu))`.
const YARDSTICK: (u32, u32, f64) = (1 << 18, 16, 0.5);
/// Rounds of multiply-adds that make one run.
const ROUNDS: u32 = 1 << 22;

/// One configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Case {
    /// Cells along each edge.
    edge: u32,
    /// Share of cells that are cut.
    cut: f64,
    threads: usize,
    isa: Isa,
}

impl Case {
    fn points(&self) -> u32 {
        8 * self.edge.pow(3)
    }
}

/// The configurations; the first is what others are compared with.
fn cases() -> Vec<Case> {
    let base = Case {
        edge: 32,
        cut: 0.0,
        threads: 1,
        isa: Isa::detect(),
    };
    let mut cases = vec![
        base,
        Case { cut: 0.2, ..base },
        Case { cut: 1.0, ..base },
        Case { edge: 8, ..base },
        Case {
            edge: 8,
            cut: 1.0,
            ..base
        },
        Case { threads: 2, ..base },
    ];
    if base.isa != Isa::Avx2 && Isa::Avx2.is_available() {
        let isa = Isa::Avx2;
        cases.push(Case { isa, ..base });
    }
    cases
}

/// A block and what it has shown [million point-substeps/s], a value per round.
struct Runner {
    case: Case,
    block: VibratingBlock,
    pool: ThreadPool,
    /// By processor time, of all threads together times their number: what they would do if each had a processor.
    by_processor: Vec<f64>,
    by_wall: Vec<f64>,
}

impl Runner {
    fn new(material: &Material, case: Case) -> anyhow::Result<Self> {
        Ok(Self {
            block: VibratingBlock::new(case.isa, material, case.edge, case.cut),
            pool: ThreadPoolBuilder::new().num_threads(case.threads).build()?,
            case,
            by_processor: vec![],
            by_wall: vec![],
        })
    }

    fn run(&mut self) -> anyhow::Result<()> {
        let substeps = WORK / self.case.points();
        let start = Instant::now();
        let block = &mut self.block;
        let (good, cpu, _) = on_processor(|| self.pool.install(|| block.advance(substeps)));
        if !good {
            bail!("a block of {} points has blown up", self.case.points());
        }
        let updates = f64::from(WORK) / 1e6;
        self.by_processor
            .push(updates * self.case.threads as f64 / cpu);
        self.by_wall.push(updates / start.elapsed().as_secs_f64());
        Ok(())
    }
}

/// What was measured of one law.
struct Measured {
    name: &'static str,
    asked: [f64; 2],
    operations: f64,
    runners: Vec<Runner>,
    yardstick: Vec<f64>,
    /// Multiply-adds on one thread [billion operations/s], and the instruction set of each.
    peak: Vec<(Isa, Vec<f64>)>,
}

impl Measured {
    fn rate(&self, n: usize) -> Quartiles {
        Quartiles::of(self.runners[n].by_processor.clone())
    }

    fn ratio(&self, n: usize) -> Quartiles {
        Quartiles::of_ratios(&self.runners[n].by_processor, &self.yardstick)
    }

    /// Operations over what the processor does at most.
    fn share_of_peak(&self, n: usize) -> Quartiles {
        let runner = &self.runners[n];
        let peak = self.peak.iter().find(|(isa, _)| *isa == runner.case.isa);
        let rates = runner.by_processor.iter();
        let done = rates.map(|rate| rate * self.operations / 1e3 / runner.case.threads as f64);
        let done: Vec<f64> = done.collect();
        Quartiles::of_ratios(&done, peak.map_or(&done, |(_, rates)| rates))
    }
}

/// Measures, prints, and writes the tables between their markers in `table`.
///
/// # Errors
/// When no threads can be started, a block blows up, or the file cannot be written.
pub fn run(rounds: u32, as_json: bool, table: Option<&std::path::Path>) -> anyhow::Result<()> {
    if let Some(path) = table {
        page::check(path, &[PART])?;
    }
    let here = Run::here();
    let turns = LAWS.len() * (cases().len() + 1);
    let bar = progress::bar("bench kernel --solids", u64::from(rounds) * turns as u64);
    let mut results = vec![];
    for (name, asked, operations) in LAWS {
        let measured = measure(name, asked, operations, rounds, &bar)?;
        for n in 0..measured.runners.len() {
            let text = line(&measured, n, as_json);
            bar.suspend(|| println!("{text}"));
        }
        results.push(measured);
    }
    bar.finish_and_clear();
    if let Some(path) = table {
        page::put(path, &[(PART, tables(&results, &here))])?;
        eprintln!("wrote {}", path.display());
    }
    Ok(())
}

fn measure(
    name: &'static str,
    asked: [f64; 2],
    operations: f64,
    rounds: u32,
    bar: &ProgressBar,
) -> anyhow::Result<Measured> {
    bar.set_message(format!("{name}: prepare"));
    let Some(material) = material(name) else {
        bail!("no material `{name}`");
    };
    let (particles, substeps, cfl) = YARDSTICK;
    let scene = scene(material.clone(), &Layout::new(particles, 8), false);
    let Some(mut rod) = yardstick_of(&scene) else {
        bail!("the yardstick has no law `{name}`");
    };
    let stiffness = 3.0 * material.lambda() + 2.0 * material.mu();
    let dt = cfl * scene.dx * (material.density / stiffness).sqrt();
    let runners: Result<Vec<_>, _> = cases()
        .into_iter()
        .map(|case| Runner::new(&material, case))
        .collect();
    let mut found = Measured {
        name,
        asked,
        operations,
        runners: runners?,
        yardstick: vec![],
        peak: Isa::ALL
            .into_iter()
            .filter(|isa| isa.is_available())
            .map(|isa| (isa, vec![]))
            .collect(),
    };
    let turns = found.runners.len() + 1;
    for round in 0..rounds as usize {
        bar.set_message(format!("{name}: round {} of {rounds}", round + 1));
        for turn in 0..turns {
            match (round + turn) % turns {
                0 => found.yardstick.push(rod_rate(&mut *rod, dt, substeps)),
                n => found.runners[n - 1].run()?,
            }
            bar.inc(1);
        }
        for (isa, rates) in &mut found.peak {
            if *isa != Isa::Portable {
                let (done, cpu, _) = on_processor(|| multiply_adds(*isa, ROUNDS));
                rates.push(done / cpu / 1e9);
            }
        }
    }
    ensure!(!found.yardstick.is_empty(), "no rounds");
    Ok(found)
}

fn rod_rate(rod: &mut dyn Yardstick, dt: f64, substeps: u32) -> f64 {
    let ((), cpu, _) = on_processor(|| rod.advance(dt, substeps));
    rod.len() as f64 * f64::from(substeps) / cpu / 1e6
}

/// One configuration, as JSON or for people.
fn line(measured: &Measured, n: usize, as_json: bool) -> String {
    let (case, rate, ratio) = (
        measured.runners[n].case,
        measured.rate(n),
        measured.ratio(n),
    );
    let share = measured.share_of_peak(n);
    if as_json {
        return json!({
            "material": measured.name,
            "points": case.points(),
            "cut_cells": case.cut,
            "threads": case.threads,
            "isa": case.isa.to_string(),
            "mpoint_substeps_per_s": rate,
            "by_wall_time": Quartiles::of(measured.runners[n].by_wall.clone()),
            "yardstick": Quartiles::of(measured.yardstick.clone()),
            "ratio": ratio,
            "share_of_peak": share,
        })
        .to_string();
    }
    format!(
        "{}: {} million point-substeps/s, {} times the yardstick, {:.0} % of all multiply-adds; {} points, {:.0} % of cells cut, {} \
         threads, {}",
        measured.name,
        spread(rate, 1),
        spread(ratio, 1),
        100.0 * share.median,
        case.points(),
        100.0 * case.cut,
        case.threads,
        case.isa,
    )
}

/// All tables. Writing to a string cannot fail.
fn tables(results: &[Measured], run: &Run) -> String {
    let mut text = format!(
        "\n\n{}\n\n\
         | law | full cells, asked 30 and 22 | every cell cut, asked 12 and 10 | 4,096 points, asked {SMALL} | two threads, asked \
         {TWO_THREADS} | the same by wall time |\n| --- | --- | --- | --- | --- | --- |\n",
        run.caption("threads as listed")
    );
    for m in results {
        let find = |wanted: &dyn Fn(&Case) -> bool| m.runners.iter().position(|r| wanted(&r.case));
        let base = &m.runners[0];
        let over = |n: Option<usize>| {
            n.map(|n| Quartiles::of_ratios(&m.runners[n].by_processor, &base.by_processor))
        };
        let cut = find(&|c| c.cut == 1.0 && c.edge == base.case.edge);
        let small = find(&|c| c.edge != base.case.edge);
        let two = find(&|c| c.threads == 2);
        let wall = two.map(|n| Quartiles::of_ratios(&m.runners[n].by_wall, &base.by_wall));
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} |",
            m.name,
            verdict(Some(m.ratio(0)), m.asked[0]),
            verdict(cut.map(|n| m.ratio(n)), m.asked[1]),
            verdict(over(small), SMALL),
            verdict(over(two), TWO_THREADS),
            wall.map_or("not measured".into(), |wall| spread(wall, 2)),
        );
    }
    text.push_str(
        "\n| law | points | cells cut [%] | threads | instruction set | speed [million/s] | times the yardstick | operations per point | \
         speed [billion operations/s per thread] | share of peak [%] |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for m in results {
        for (n, Runner { case, .. }) in m.runners.iter().enumerate() {
            let rate = m.rate(n);
            let _ = writeln!(
                text,
                "| {} | {} | {:.0} | {} | {} | {} | {} | {:.0} | {:.0} | {:.0} |",
                m.name,
                case.points(),
                100.0 * case.cut,
                case.threads,
                case.isa,
                spread(rate, 1),
                spread(m.ratio(n), 1),
                m.operations,
                rate.median * m.operations / 1e3 / case.threads as f64,
                100.0 * m.share_of_peak(n).median,
            );
        }
    }
    let yardsticks = results.iter().map(|m| {
        format!(
            "{} {} million/s",
            m.name,
            spread(Quartiles::of(m.yardstick.clone()), 2)
        )
    });
    let peaks = results[0]
        .peak
        .iter()
        .filter(|(_, rates)| !rates.is_empty());
    let peaks = peaks.map(|(isa, rates)| {
        format!(
            "{isa} {} billion operations/s",
            spread(Quartiles::of(rates.clone()), 0)
        )
    });
    let _ = write!(
        text,
        "\nYardstick: {}. Peak, of nothing but multiply-adds on one thread: {}.\n",
        yardsticks.collect::<Vec<_>>().join(", "),
        peaks.collect::<Vec<_>>().join(", "),
    );
    text
}
