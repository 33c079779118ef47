//! `cosplat bench stability`: where the method stays stable, what the guard does beyond, and how contact methods and
//! transfers fail.

mod catalogue;
mod guard;
mod maps;
mod samples;
mod solids;
mod tables;
mod trial;

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::Context;
use cosplat_console::say;
use rayon::prelude::*;
use serde_json::json;

use crate::{
    chart::{Class, HeatMap, HeatPanel, csv},
    machine::Run,
    page, progress,
};
use catalogue::judge::{self, Judged};
use maps::{Map, NU, Panel, TRANSFERS};
use trial::Fate;

/// Map where the method stays stable, what the guard does beyond, and how it fails otherwise.
#[derive(clap::Args)]
pub struct Args {
    /// Few settings only, for the test suite.
    #[arg(long)]
    quick: bool,
    /// Print one JSON object per measured field instead of tables.
    #[arg(long)]
    json: bool,
    /// Run only the scenes with a right value whose path contains this text, such as `bounce`.
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["quick", "write"])]
    cases: Option<String>,
    /// Write pictures and figures into DIR/stability and tables into DIR/stability.md.
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "docs", conflicts_with = "quick")]
    write: Option<PathBuf>,
}

impl Args {
    /// Everything at full size, written into a folder of documents.
    pub fn documents(folder: &Path) -> Self {
        Self {
            quick: false,
            json: false,
            cases: None,
            write: Some(folder.to_owned()),
        }
    }
}

/// The page, in the folder of documents, and its parts.
const PAGE: &str = "stability.md";
const PARTS: [&str; 5] = [
    "cosplat bench stability solids",
    "cosplat bench stability limits",
    "cosplat bench stability guard",
    "cosplat bench stability catalogue",
    "cosplat bench stability cases",
];
const MADE: &str = "cosplat bench stability made";

/// What a map found: panel by panel, row by row.
struct Found {
    map: Map,
    fates: Vec<Vec<Vec<Fate>>>,
}

impl Found {
    fn measure(map: Map) -> Self {
        let row = |panel: &Panel, row: &maps::Row| -> Vec<Fate> {
            let ratios = panel.ratios.par_iter();
            ratios.map(|ratio| row.fate(*ratio)).collect()
        };
        let panel = |panel: &Panel| {
            let rows = panel.rows.par_iter();
            rows.map(|r| row(panel, r)).collect()
        };
        let fates = map.panels.par_iter().map(panel).collect();
        Self { map, fates }
    }

    /// Panel, row, ratio, what a formula says and what happened, field by field.
    fn fields(&self) -> Vec<(&str, &str, f64, f64, Fate)> {
        let mut fields = Vec::new();
        for (panel, fates) in self.map.panels.iter().zip(&self.fates) {
            for (row, fates) in panel.rows.iter().zip(fates) {
                for (ratio, fate) in panel.ratios.iter().zip(fates) {
                    let title = panel.title.as_str();
                    fields.push((title, row.name.as_str(), *ratio, row.predicted(), *fate));
                }
            }
        }
        fields
    }

    fn csv(&self) -> String {
        let [x, line] = self.map.scale.keys;
        let header = ["panel", "row", x, line, "outcome"];
        let rows: Vec<Vec<String>> = self
            .fields()
            .into_iter()
            .map(|(panel, row, ratio, closed, fate)| {
                vec![
                    panel.into(),
                    row.into(),
                    format!("{ratio}"),
                    format!("{closed:.4}"),
                    fate.name().into(),
                ]
            })
            .collect();
        csv(&header, &rows)
    }

    fn picture(&self, caption: &str) -> anyhow::Result<String> {
        let panels = self.map.panels.iter().zip(&self.fates);
        let class = |name: &str, letter: &str, tone| Class {
            name: name.into(),
            letter: letter.into(),
            tone,
        };
        let picture = HeatMap {
            title: self.map.title.into(),
            x: self.map.scale.x.into(),
            y: self.map.y.into(),
            classes: vec![
                class("pass", "", 0),
                class("damped", "d", 1),
                class("blown up", "x", 2),
            ],
            panels: panels
                .map(|(panel, fates)| HeatPanel {
                    title: panel.title.clone(),
                    x: panel.ratios.clone(),
                    y: panel.rows.iter().map(|row| row.name.clone()).collect(),
                    fields: fates
                        .iter()
                        .map(|row| row.iter().map(|fate| Some(*fate as usize)).collect())
                        .collect(),
                    line: Some(panel.rows.iter().map(maps::Row::predicted).collect()),
                })
                .collect(),
            columns: self.map.columns,
            line: self.map.scale.line.into(),
            caption: vec![self.map.scale.caption.into(), caption.into()],
        };
        picture.svg()
    }
}

/// The guard's fields as a picture.
fn guard_picture(fields: &[guard::Field], caption: &str) -> anyhow::Result<String> {
    let of = |transfer: &str| {
        let mut panel = HeatPanel {
            title: transfer.into(),
            x: vec![],
            y: vec![],
            fields: vec![],
            line: None,
        };
        for field in fields.iter().filter(|f| f.transfer == transfer) {
            if panel.y.last().map(String::as_str) != Some(field.scene) {
                panel.y.push(field.scene.into());
                panel.fields.push(vec![]);
            }
            if panel.y.len() == 1 {
                panel.x.push(field.cfl);
            }
            if let Some(row) = panel.fields.last_mut() {
                row.push(Some(field.class()));
            }
        }
        panel
    };
    let picture = HeatMap {
        title: "With guard: what becomes of scenes past the limit".into(),
        x: "cfl: dt over the limit of the transfer at the present deformation".into(),
        y: "scene".into(),
        classes: guard::CLASSES
            .map(|(name, letter, tone)| Class {
                name: name.into(),
                letter: letter.into(),
                tone,
            })
            .into(),
        panels: vec![of(guard::SOLID), of("apic"), of("pic")],
        columns: 2,
        line: String::new(),
        caption: vec![
            "The solver that everyone uses, single precision, half a second. solid: on grids of their own, apic and pic: on the \
             spatial grid. dust: 27 lone particles that spread and contract; ring: a free block that does; drop: a block hits a \
             floor at 3 m/s; pair: two balls meet at 6 m/s; held beam: one that swings."
                .into(),
            caption.into(),
        ],
    };
    picture.svg()
}

/// Measured limits of clusters of 1 to 5 by bisection: transfer, Poisson's ratio, closed form, measured.
fn limits(quick: bool) -> Vec<(&'static str, f64, f64, f64)> {
    let nu = if quick { &NU[2..3] } else { &NU[..] };
    let pairs = TRANSFERS
        .iter()
        .flat_map(|t| nu.iter().map(move |nu| (*t, *nu)));
    let pairs: Vec<_> = pairs.collect();
    pairs
        .into_par_iter()
        .map(|(transfer, nu)| {
            let row = maps::lone_and_few(transfer, nu, quick);
            (transfer, nu, row.predicted(), row.measured_limit())
        })
        .collect()
}

/// All that is measured.
struct Results {
    maps: Vec<Found>,
    solids: Vec<solids::Limit>,
    limits: Vec<(&'static str, f64, f64, f64)>,
    guarded: Vec<guard::Field>,
    failures: Vec<catalogue::Measured>,
    cases: Vec<Judged>,
}

impl Results {
    fn measure(quick: bool) -> anyhow::Result<Self> {
        let bar = progress::bar("stability", 10);
        let mut found = Vec::new();
        for make in [maps::clusters, maps::blocks, maps::materials] {
            found.push(Found::measure(make(quick)));
            bar.inc(1);
        }
        found.push(Found::measure(maps::objects(quick)?));
        bar.inc(1);
        found.push(Found::measure(solids::map(quick)?));
        bar.inc(1);
        let solids = solids::limits(quick)?;
        bar.inc(1);
        let limits = limits(quick);
        bar.inc(1);
        let guarded = guard::fields(quick)?;
        bar.inc(1);
        let failures = catalogue::measure(quick)?;
        bar.inc(1);
        let cases = judge::judge(|_| true, if quick { 2 } else { usize::MAX })?;
        bar.finish_and_clear();
        Ok(Self {
            maps: found,
            solids,
            limits,
            guarded,
            failures,
            cases,
        })
    }

    /// One JSON object per line.
    fn print(&self) -> anyhow::Result<()> {
        for found in &self.maps {
            for (panel, row, ratio, closed, fate) in found.fields() {
                let [x, line] = found.map.scale.keys;
                let line = json!({
                    "map": found.map.name, "panel": panel, "row": row, x: ratio, line: closed, "outcome": fate.name(),
                });
                say!("{line}")?;
            }
        }
        for (transfer, nu, closed, measured) in &self.limits {
            say!(
                "{}",
                json!({"limit": transfer, "nu": nu, "closed_form": closed, "measured": measured})
            )?;
        }
        for limit in &self.solids {
            let [usual, most] = limit.taken;
            let line = json!({
                "solid": limit.solid, "row": limit.row, "measured": limit.measured,
                "two_over_frequency": limit.by_frequency, "taken_with_cfl_0.8": usual, "taken_with_cfl_1": most,
            });
            say!("{line}")?;
        }
        for field in &self.guarded {
            let found = field.found;
            let line = json!({
                "guard": field.scene, "transfer": field.transfer, "cfl": field.cfl, "rollbacks": found.rollbacks,
                "quarantined": found.quarantined, "energy": found.energy, "not_a_number": found.lost,
            });
            say!("{line}")?;
        }
        for failure in &self.failures {
            say!("{}", failure.json())?;
        }
        for case in &self.cases {
            say!("{}", case.json())?;
        }
        Ok(())
    }
}

/// Runs the command.
///
/// # Errors
/// When a scene cannot be built or run, or a file not written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(folder) = &args.write {
        let parts: Vec<_> = PARTS.into_iter().chain([MADE]).collect();
        page::check(&folder.join(PAGE), &parts)?;
    }
    if let Some(text) = &args.cases {
        let cases = judge::judge(|case| case.scene.path.contains(text), usize::MAX)?;
        anyhow::ensure!(!cases.is_empty(), "no scene with {text:?} in its path");
        if args.json {
            return cases.iter().try_for_each(|case| say!("{}", case.json()));
        }
        return say!("{}", tables::cases(&cases));
    }
    let start = Instant::now();
    let machine = Run::here();
    let results = Results::measure(args.quick)?;
    let tables = [
        tables::solids(&results.solids),
        tables::limits(&results.limits),
        tables::guard(&results.guarded),
        tables::catalogue(&results.failures),
        tables::cases(&results.cases),
    ];
    if args.json {
        results.print()?;
    } else {
        for table in &tables {
            say!("{table}")?;
        }
    }
    if let Some(folder) = &args.write {
        let page = folder.join(PAGE);
        let folder = folder.join("stability");
        let seconds = start.elapsed().as_secs_f64();
        let caption = machine.caption(&format!("{} threads", rayon::current_num_threads()));
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let put = |name: String, text: String| {
            let path = folder.join(name);
            fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
        };
        for found in &results.maps {
            put(format!("{}.svg", found.map.name), found.picture(&caption)?)?;
            put(format!("{}.csv", found.map.name), found.csv())?;
        }
        put(
            "guard.svg".into(),
            guard_picture(&results.guarded, &caption)?,
        )?;
        put("guard.csv".into(), tables::guard_csv(&results.guarded))?;
        let made = format!("{caption} It took {seconds:.0} s.");
        let parts: Vec<_> = PARTS
            .into_iter()
            .zip(tables)
            .chain([(MADE, made)])
            .collect();
        page::put(&page, &parts)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed form is the limit of a lone particle in all transfers, on both sides.
    #[test]
    fn maps_put_the_limit_where_the_closed_form_says() {
        let map = Found::measure(maps::clusters(true));
        for (panel, row, ratio, closed, fate) in map.fields() {
            let blown = fate == Fate::BlownUp;
            if panel.starts_with("one particle") {
                assert_eq!(
                    blown,
                    ratio > closed,
                    "{panel}, nu {row}, {ratio} of the limit"
                );
            } else if ratio < closed {
                assert!(!blown, "{panel}, nu {row}, {ratio} of the limit");
            }
        }
    }
}
