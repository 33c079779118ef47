//! `cosplat bench kernel`: particle-substeps per second of the solver, as multiples of a plain scalar loop's.
//!
//! Solver, yardstick and reference solver take turns in one process, so that all meet the same clock and the same
//! neighbours; ratios are taken round by round. Sorting, particle pass and grid pass count, reports do not.

mod measure;
mod report;
mod scene;
mod solids;
mod yardstick;

#[cfg(test)]
mod tests;

use std::path::PathBuf;

use anyhow::ensure;
use cosplat_console::{note, say};
use cosplat_sim_core::Isa;

use crate::{machine::Run, page, progress};
pub use measure::{Case, Quartiles, Runner, on_processor};
use measure::{Measured, measure};
use report::{line, sentence};

/// Measure particle-substeps per second, and how many times faster that is than a plain scalar loop.
#[derive(clap::Args)]
pub struct Args {
    /// Materials, by the names of their laws; all when left out.
    #[arg(long, value_delimiter = ',', value_parser = clap::builder::PossibleValuesParser::new(scene::MATERIALS))]
    materials: Vec<String>,
    /// Particles in the block, rounded to powers of two.
    #[arg(long, value_delimiter = ',', default_value = "262144", value_parser = clap::value_parser!(u32).range(64..=1 << 24))]
    particles: Vec<u32>,
    /// Particles per cell: 1, 2, 4 or 8.
    #[arg(long, value_delimiter = ',', default_value = "8", value_parser = per_cell)]
    per_cell: Vec<u32>,
    /// Threads.
    #[arg(long, value_delimiter = ',', default_value = "1", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Vec<u16>,
    /// Instruction sets: avx512, avx2, portable; the best one when left out.
    #[arg(long, value_delimiter = ',')]
    isas: Vec<Isa>,
    /// Hang a Gaussian on every particle: plastic laws then carry the visible shape as well.
    #[arg(long)]
    gaussians: bool,
    /// Measure solids on grids of their own: full and cut cells, large and small blocks, two threads.
    #[arg(long, conflicts_with_all = ["materials", "particles", "per_cell", "threads", "isas", "gaussians"])]
    solids: bool,
    /// Rounds; in each of them every configuration runs for one frame.
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(3..=10_000))]
    rounds: u32,
    /// Print one JSON object per configuration.
    #[arg(long)]
    json: bool,
    /// Measure the full set in some minutes and write its tables between the markers of this Markdown file.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["materials", "particles", "per_cell", "threads", "isas", "gaussians"])]
    table: Option<PathBuf>,
}

fn per_cell(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(n @ (1 | 2 | 4 | 8)) => Ok(n),
        _ => Err("must be 1, 2, 4 or 8".into()),
    }
}

impl Args {
    /// What to measure: materials with their cases.
    fn plan(&self) -> Vec<(String, Vec<Case>)> {
        if self.table.is_some() {
            return full_set();
        }
        let isas = if self.isas.is_empty() {
            vec![Isa::detect()]
        } else {
            self.isas.clone()
        };
        let mut cases = Vec::new();
        for &particles in &self.particles {
            for &per_cell in &self.per_cell {
                for &isa in &isas {
                    for &threads in &self.threads {
                        cases.push(Case {
                            particles,
                            per_cell,
                            threads,
                            isa,
                            gaussians: self.gaussians,
                        });
                    }
                }
            }
        }
        let all = scene::MATERIALS.map(str::to_owned);
        let names = if self.materials.is_empty() {
            all.as_slice()
        } else {
            &self.materials
        };
        names
            .iter()
            .map(|name| (name.clone(), cases.clone()))
            .collect()
    }
}

/// The configurations that the bars are about, and what else is worth a line.
fn full_set() -> Vec<(String, Vec<Case>)> {
    let best = Isa::detect();
    let plain = Case {
        particles: 1 << 18,
        per_cell: 8,
        threads: 1,
        isa: best,
        gaussians: false,
    };
    let mut base = vec![
        plain.clone(),
        Case {
            particles: 1 << 20,
            ..plain.clone()
        },
        Case {
            threads: 2,
            ..plain.clone()
        },
    ];
    if best != Isa::Avx2 && Isa::Avx2.is_available() {
        base.push(Case {
            isa: Isa::Avx2,
            ..plain.clone()
        });
    }
    let mut set: Vec<(String, Vec<Case>)> = scene::MATERIALS
        .map(|name| (name.to_owned(), base.clone()))
        .into();
    for (name, cases) in &mut set {
        match name.as_str() {
            "fixed_corotated" => {
                let small = Case {
                    particles: 1 << 15,
                    ..plain.clone()
                };
                cases.push(small);
                cases.extend([2, 1].map(|per_cell| Case {
                    per_cell,
                    ..plain.clone()
                }));
            }
            "von_mises" => cases.push(Case {
                gaussians: true,
                ..plain.clone()
            }),
            _ => {}
        }
    }
    set
}

/// Runs the measurement.
///
/// # Errors
/// When no threads can be started, the processor lacks an instruction set, or the file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.solids {
        return solids::run(args.rounds, args.json, args.table.as_deref());
    }
    let plan = args.plan();
    for (_, cases) in &plan {
        for case in cases {
            ensure!(
                case.isa.is_available(),
                "this processor has no {}",
                case.isa
            );
        }
    }
    if let Some(path) = &args.table {
        // Better now than after minutes of measuring.
        page::check(path, &[report::PART])?;
    }
    let here = Run::here();
    let turns: usize = plan
        .iter()
        .map(|(_, cases)| {
            let mut densities: Vec<u32> = cases.iter().map(|case| case.per_cell).collect();
            densities.sort_unstable();
            densities.dedup();
            cases.len() + densities.len()
        })
        .sum();
    let bar = progress::bar("bench kernel", u64::from(args.rounds) * turns as u64);
    let mut results: Vec<(String, Vec<Measured>)> = Vec::new();
    for (name, cases) in plan {
        let measured = measure(&name, &cases, args.rounds, &bar)?;
        for measured in &measured {
            let text = if args.json {
                line(&name, measured, &here).to_string()
            } else {
                sentence(&name, measured)
            };
            bar.suspend(|| say!("{text}"))?;
        }
        results.push((name, measured));
    }
    bar.finish_and_clear();
    if let Some(path) = &args.table {
        page::put(path, &[(report::PART, report::tables(&results, &here))])?;
        note!("wrote {}", path.display());
    }
    Ok(())
}
