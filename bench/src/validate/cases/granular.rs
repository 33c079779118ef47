//! Columns and a cylinder of sand, and a column of aluminium rods, collapse.

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{Case, Gate, Row, Size},
};

const SAND: SceneText = scene_text!("validate/granular");
const CYLINDER: SceneText = scene_text!("validate/sand_cylinder");
const RODS: SceneText = scene_text!("validate/aluminium_rods");
/// Width of a column of sand, radius of a cylinder of it [m].
const WIDTH: f64 = 0.2;
/// Height over width of tall columns, and of the cylinder.
const TALL: [f64; 2] = [4.0, 8.0];
const STANDING: f64 = 2.0;

/// The case.
pub const CASE: Case = Case {
    number: 15,
    name: "granular",
    about: "columns and a cylinder of sand run out as far as scaling laws say, one of rods as in its experiment",
    run,
};

const TOE: &str = "the toe is thinner than a cell and stops early on a floor that it sticks to: the runout grows \
     towards the reference as cells shrink (docs/validation.md has the numbers).";

const HIGH: &str = "the toe is too high, by 13 % with 10 cells along the height and 7 % with 20, while front, back and middle are right.";
const CELLS: &str = "how far sand runs is proportional to the height of the column, as it should be, and grows with the cells along that height, \
     whatever the column: 1.1 to 1.2, 1.5 to 1.6, 1.8 and 2 a with 10, 20, 30 and 40 cells. At the same dx the taller column has more of them. \
     The 1.2 a are of a channel with sides.";
const FALL: &str = "what falls from high runs on with all that friction at a constant angle leaves it: grains lose more to each other the faster they are sheared, \
     and nothing in the law does. Transfers hide a part of it: with 15 MPa in place of 0.3 MPa, or as many substeps, it runs 0.7 times as far.";
const ROUND: &str = "the cone of 32 degrees in triaxial compression is one of 48 where sand is sheared in a plane, which takes 0.2 radii off, and transfers \
     damp what is sheared within the five cells of a radius.";

fn run(size: Size) -> anyhow::Result<Vec<Row>> {
    let (dx, columns, dx_rods): (f64, &[f64], f64) = match size {
        Size::Quick => (0.02, &[1.0], 0.01),
        Size::Full => (0.01, &[0.5, 1.0, 2.0], 0.005),
    };
    let coarse = size == Size::Quick;
    let mut rows = Vec::new();
    for &ratio in columns {
        let why = (!coarse).then_some(CELLS);
        rows.extend(sand(ratio, dx, why)?);
    }
    if !coarse {
        rows.extend(tall()?);
        rows.push(cylinder()?);
    }
    rows.extend(rods(dx_rods, coarse)?);
    Ok(rows)
}

/// Twice as long as such a flow takes, `3.3 sqrt(H / g)` [s].
fn duration(height: f64) -> f64 {
    6.6 * (height / 9.81).sqrt()
}

fn column(ratio: f64, dx: f64) -> Trial {
    let height = ratio * WIDTH;
    Trial::new(&SAND, duration(height))
        .set("dx", dx)
        .set(
            "objects.0.shape.size",
            format!("[{WIDTH}, {height}, {}]", 4.0 * dx),
        )
        .set(
            "objects.0.translation",
            format!("[{}, {}, 0]", 0.5 * WIDTH, 0.5 * height),
        )
        .set("colliders.2.point", format!("[0, 0, {}]", 2.0 * dx))
        .set("colliders.3.point", format!("[0, 0, {}]", -2.0 * dx))
}

/// Runout over width.
fn runout(outcome: &Outcome, dx: f64) -> anyhow::Result<f64> {
    // Half the spacing of particles belongs to the sand.
    let front = outcome.last("/probes/sand/max/0")? + 0.25 * dx;
    Ok((front - WIDTH) / WIDTH)
}

fn sand(ratio: f64, dx: f64, why: Option<&'static str>) -> anyhow::Result<Vec<Row>> {
    let trial = column(ratio, dx);
    let outcome = trial.run()?;
    let mut rows = vec![Row {
        quantity: format!("sand, a = {ratio}: runout over width"),
        reference: 1.2 * ratio,
        source: "1.2 a, Lube et al. 2005",
        measured: runout(&outcome, dx)?,
        gate: Gate::Relative(0.08),
        known_failure: why,
        command: trial.command(),
    }];
    if ratio <= 0.7 {
        let top = outcome.last("/probes/sand/max/1")? + 0.25 * dx;
        rows.push(Row {
            quantity: format!("sand, a = {ratio}: height over width"),
            reference: ratio,
            source: "a, Lajeunesse et al. 2005",
            measured: top / WIDTH,
            gate: Gate::Relative(0.08),
            known_failure: None,
            command: trial.command(),
        });
    }
    Ok(rows)
}

/// Columns from which sand falls rather than spreads, eight cells wide.
fn tall() -> anyhow::Result<Vec<Row>> {
    let dx = WIDTH / 8.0;
    let mut rows: Vec<Row> = Vec::new();
    for ratio in TALL {
        let trial = column(ratio, dx);
        rows.push(Row {
            quantity: format!("sand, a = {ratio}: runout over width"),
            reference: 1.9 * ratio.powf(2.0 / 3.0),
            source: "1.9 a^(2/3), Lube et al. 2005",
            measured: runout(&trial.run()?, dx)?,
            gate: Gate::Relative(0.08),
            known_failure: Some(FALL),
            command: trial.command(),
        });
    }
    let growth: f64 = rows[1].measured / rows[0].measured;
    let command = rows[1].command.clone();
    rows.push(Row {
        quantity: format!(
            "sand, a = {} to {}: exponent of the runout",
            TALL[0], TALL[1]
        ),
        reference: 2.0 / 3.0,
        source: "a^(2/3), Lube et al. 2005",
        measured: growth.ln() / (TALL[1] / TALL[0]).ln(),
        gate: Gate::Relative(0.08),
        known_failure: Some(FALL),
        command,
    });
    Ok(rows)
}

fn cylinder() -> anyhow::Result<Row> {
    let dx = WIDTH / 5.0;
    let trial = Trial::new(&CYLINDER, duration(STANDING * WIDTH));
    Ok(Row {
        quantity: format!("cylinder of dry_sand, a = {STANDING}: runout over radius"),
        reference: 1.6 * STANDING.sqrt(),
        source: "1.6 sqrt(a), Lube et al. 2004",
        measured: runout(&trial.run()?, dx)?,
        gate: Gate::Relative(0.08),
        known_failure: Some(ROUND),
        command: trial.command(),
    })
}

fn rods(dx: f64, coarse: bool) -> anyhow::Result<Vec<Row>> {
    let trial = Trial::new(&RODS, 0.8)
        .set("dx", dx)
        .set("objects.0.shape.size", format!("[0.2, 0.1, {}]", 4.0 * dx))
        .set("colliders.2.point", format!("[0, 0, {}]", 2.0 * dx))
        .set("colliders.3.point", format!("[0, 0, {}]", -2.0 * dx));
    let outcome = trial.run()?;
    let row = |quantity: &str, reference: f64, measured: f64, gate: f64, why| Row {
        quantity: format!("rods: {quantity} [m]"),
        reference,
        source: "Bui et al. 2008, experiment",
        measured,
        gate: Gate::Relative(gate),
        known_failure: why,
        command: trial.command(),
    };
    let mut rows = vec![
        row(
            "front",
            0.422,
            outcome.last("/probes/rods/max/0")? + 0.25 * dx,
            0.08,
            coarse.then_some(TOE),
        ),
        row(
            "height at the wall",
            0.0992,
            outcome.last("/probes/rods/max/1")? + 0.25 * dx,
            0.05,
            None,
        ),
    ];
    for (x, height, why) in [(0.12, 0.0722, None), (0.241, 0.0348, Some(HIGH))] {
        let name = format!("surface at x = {x}");
        rows.push(row(&name, height, surface(&outcome, x)?, 0.05, why));
    }
    Ok(rows)
}

/// Where the density along a line of point probes passes half of that at rest; they stand 5 mm apart.
fn surface(outcome: &Outcome, x: f64) -> anyhow::Result<f64> {
    let filled = |height: f64| {
        let name = format!("/probes/{x} {height:.3}/density");
        outcome.last(&name).unwrap_or(0.0) / 2650.0
    };
    let heights: Vec<f64> = (2..20).map(|n| 0.005 * f64::from(n)).collect();
    for pair in heights.windows(2) {
        let (low, high) = (filled(pair[0]), filled(pair[1]));
        if low >= 0.5 && high < 0.5 {
            return Ok(pair[0] + 0.005 * (low - 0.5) / (low - high));
        }
    }
    anyhow::bail!("no surface at x = {x}")
}
