//! Matter that flows: water, sand, rods.

use crate::{
    trial::{Outcome, SceneText, Trial, scene_text},
    validate::{
        case::{Case, Size},
        measures::slope,
        report::Gate,
    },
};

const COLUMN: SceneText = scene_text!("validate/column");
const HEIGHT: f64 = 1.0;
const WEIGHT: f64 = 1000.0 * 9.81;
/// Probes, one per cell from 0.1125 m on, where particles are at rest.
const PROBES: u32 = 16;

/// 9: columns under their own weight: pressure of a fluid, stress of a solid, and rest.
pub fn column(size: Size) -> Vec<Case> {
    let (settled, end) = size.pick((1.0, 1.5), (2.0, 7.0));
    let solid = "{ law = \"neo_hookean\", youngs_modulus_pa = 1e6, poisson_ratio = 0.3, density_kg_m3 = 1000 }";
    let pressure = |run: &Outcome| {
        let (mut off, mut all) = (0.0, 0.0);
        for n in 0..PROBES {
            let exact = WEIGHT * (HEIGHT - 0.1125 - 0.05 * f64::from(n));
            let pressure = -run.last(&format!("/probes/p{n:02}/stress/1/1"))?;
            off += (pressure - exact) * (pressure - exact);
            all += exact * exact;
        }
        Ok((off / all).sqrt())
    };
    let speed = |run: &Outcome| {
        let energy = run.last("/kinetic_energy")?;
        let speed = (2.0 * energy / run.last("/objects/0/mass")?).sqrt();
        Ok(speed / (9.81 * HEIGHT).sqrt())
    };
    let drift = move |run: &Outcome| {
        let heights = run.series("/objects/0/com/1");
        let at = |time: f64| {
            let found = heights.iter().find(|(t, _)| *t >= time - 1e-6);
            found.map_or(f64::NAN, |h| h.1)
        };
        Ok((at(end) - at(settled)).abs() / HEIGHT)
    };
    let mut cases = Vec::new();
    for (matter, material) in [("fluid", None), ("solid", Some(solid))] {
        let mut trial = Trial::new(&COLUMN, end);
        if let Some(material) = material {
            trial = trial.set("objects.0.material", material);
        }
        let name = |quantity: &str| format!("{matter}: {quantity}");
        cases.extend([
            Case::new(
                "error of the pressure of a fluid and a solid",
                name("L2 error of the pressure, relative"),
                &trial,
                pressure,
            )
            .against(0.0, "rho0 g (H0 - Y)")
            .within(Gate::AtMost(0.03)),
            Case::new(
                "rms speed over sqrt(g H)",
                name("rms speed over sqrt(g H)"),
                &trial,
                speed,
            )
            .against(0.0, "rest")
            .within(Gate::AtMost(1e-3)),
            Case::new(
                "sinking of the centre of mass, over H",
                name("sinking of the centre of mass after settling, over H"),
                &trial,
                drift,
            )
            .against(0.0, "rest")
            .within(Gate::AtMost(1e-3)),
        ]);
    }
    cases
}

const DAM_BREAK: SceneText = scene_text!("validate/dam_break");
/// Width of the column of water [m].
const A: f64 = 0.2;

/// `t sqrt(2 g / a)` and front over `a` for a = 1.125 in, n^2 = 2.
const MARTIN_MOYCE: [(f64, f64); 9] = [
    (0.849, 1.245),
    (1.212, 1.443),
    (1.602, 1.884),
    (2.283, 2.689),
    (2.950, 3.728),
    (3.598, 4.528),
    (3.905, 4.999),
    (4.592, 5.841),
    (4.961, 6.271),
];

/// The same of an ideal fluid: `docs/derivations/dam_break.py`, whose own spread is 1.5 %.
const POTENTIAL: [(f64, f64); 3] = [(0.849, 1.40), (1.212, 1.74), (1.602, 2.14)];

const AHEAD: &str = "ahead by 10 to 21 % where the gate is, 3 tenths of the width from T = 1.2 on, with 10 and with 20 cells: so is potential flow, \
     as far as it goes (rows below). The experiment has a dam that takes time to go, and friction on its floor; coarse cells used to make up for both.";

const LATE: &str = "at first the front's acceleration is all in one cell, 5.02 % behind at T = 1.212; with 20 cells it is within 2 %.";

/// Why a front is not where the experiment has it, by resolution and time.
fn why_ahead(cells: u32, t: f64) -> Option<&'static str> {
    let fails: &[f64] = match cells {
        10 => &[1.212, 1.602, 2.283],
        _ => &[0.849, 1.212, 1.602, 2.283, 4.592],
    };
    fails.contains(&t).then_some(AHEAD)
}

/// A column of water, `cells` across and four deep, until the time `end` in units of `sqrt(a / 2 g)`.
fn dam(cells: u32, end: f64) -> (f64, Trial) {
    let dx = A / f64::from(cells);
    let unit = (A / (2.0 * 9.81)).sqrt();
    let trial = Trial::new(&DAM_BREAK, end * unit + 0.005)
        .set("dx", dx)
        .set("objects.0.shape.size", format!("[0.2, 0.4, {}]", 4.0 * dx))
        .set("colliders.2.point", format!("[0, 0, {}]", 2.0 * dx))
        .set("colliders.3.point", format!("[0, 0, {}]", -2.0 * dx));
    (dx, trial)
}

/// Front over `a` at a time, between frames by straight lines.
fn front(run: &Outcome, dx: f64, t: f64) -> anyhow::Result<f64> {
    let unit = (A / (2.0 * 9.81)).sqrt();
    // Particles are at the middle of what they stand for: half their spacing belongs to the water.
    let series: Vec<(f64, f64)> = run
        .series("/probes/water/max/0")
        .iter()
        .map(|(t, x)| (t / unit, (x + 0.25 * dx) / A))
        .collect();
    let after = series.partition_point(|&(at, _)| at < t).max(1);
    let [(t0, z0), (t1, z1)] = *series
        .get(after - 1..=after)
        .and_then(|pair| <&[(f64, f64); 2]>::try_from(pair).ok())
        .ok_or_else(|| anyhow::anyhow!("no frames about {t}"))?;
    Ok(z0 + (z1 - z0) * (t - t0) / (t1 - t0))
}

/// 14: a column of water collapses: the front against Martin and Moyce, and against potential flow.
pub fn dam_break(size: Size) -> Vec<Case> {
    let coarse = (10, 3.0);
    let fine = (20, 4.6);
    let mut cases = Vec::new();
    for &(cells, end) in size.pick(&[coarse][..], &[coarse, fine]) {
        let (dx, trial) = dam(cells, end);
        for (t, reference) in MARTIN_MOYCE.into_iter().filter(|(t, _)| *t <= end) {
            let high = if t <= 3.0 { 1.1 } else { 1.15 };
            cases.push(
                Case::new(
                    "front over a, T = 0.8 to 5",
                    format!("a/dx = {cells}: front over a at T = {t}"),
                    &trial,
                    move |run| front(run, dx, t),
                )
                .against(reference, "Martin and Moyce 1952, a = 1.125 in")
                .within(Gate::Between(0.95 * reference, high * reference))
                .fails(why_ahead(cells, t)),
            );
        }
        for (t, reference) in POTENTIAL {
            cases.push(
                Case::new(
                    "front over a, against an ideal fluid",
                    format!("a/dx = {cells}: front over a at T = {t}, against an ideal fluid"),
                    &trial,
                    move |run| front(run, dx, t),
                )
                .against(reference, "potential flow, docs/derivations/dam_break.py")
                .within(Gate::Relative(0.05))
                .fails((cells == 10 && t < 1.5).then_some(LATE)),
            );
        }
    }
    if size == Size::Full {
        let [(fine_dx, fine), (coarse_dx, coarse)] =
            [fine, coarse].map(|(cells, end)| dam(cells, end));
        cases.push(
            Case::of_all(
                "fronts with 10 and 20 cells, difference",
                "fronts with 10 and 20 cells, difference at T = 2.283 and 2.95, relative",
                [fine, coarse],
                move |runs| {
                    // Later than at first, when the front's acceleration is all in one cell.
                    let mut apart = 0.0_f64;
                    for t in [2.283, 2.950] {
                        let coarse = front(runs[1], coarse_dx, t)?;
                        apart = apart.max((coarse / front(runs[0], fine_dx, t)? - 1.0).abs());
                    }
                    Ok(apart)
                },
            )
            .against(0.0, "convergence; of first order it was 0.06")
            .within(Gate::AtMost(0.02)),
        );
    }
    cases
}

const SAND: SceneText = scene_text!("validate/granular");
const CYLINDER: SceneText = scene_text!("validate/sand_cylinder");
const RODS: SceneText = scene_text!("validate/aluminium_rods");
/// Width of a column of sand, radius of a cylinder of it [m].
const WIDTH: f64 = 0.2;
/// Height over width of tall columns, and of the cylinder.
const TALL: [f64; 2] = [4.0, 8.0];
const STANDING: f64 = 2.0;

const TOE: &str = "the toe is thinner than a cell and stops early on a floor that it sticks to: the runout grows \
     towards the reference as cells shrink (docs/validation.md has the numbers).";
const HIGH: &str = "the toe is too high, by 13 % with 10 cells along the height and 7 % with 20, while front, back and middle are right.";
const CELLS: &str = "how far sand runs is proportional to the height of the column, as it should be. It grows with the \
     cells along that height, whatever the column: 1.1 to 1.2, 1.5 to 1.6, 1.8 and 2 a with 10, 20, 30 and 40 cells. \
     At the same dx the taller column has more of them. \
     The 1.2 a are of a channel with sides.";
const FALL: &str = "what falls from high runs on with all that friction at a constant angle leaves it: grains lose more to each other the faster they are sheared, \
     and nothing in the law does. Transfers hide a part of it: with 15 MPa in place of 0.3 MPa, or as many substeps, it runs 0.7 times as far.";
const ROUND: &str = "the cone of 32 degrees in triaxial compression is one of 48 where sand is sheared in a plane. That \
     takes 0.2 radii off, and transfers damp what is sheared within the five cells of a radius.";

/// Twice as long as such a flow takes, `3.3 sqrt(H / g)` [s].
fn flow_time(height: f64) -> f64 {
    6.6 * (height / 9.81).sqrt()
}

fn sand_column(ratio: f64, dx: f64) -> Trial {
    let height = ratio * WIDTH;
    Trial::new(&SAND, flow_time(height))
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

/// Runout over width, of all but the outermost share of the sand.
fn runout(run: &Outcome, dx: f64) -> anyhow::Result<f64> {
    // Half the spacing of particles belongs to the sand.
    let front = run.last("/probes/sand/max/0")? + 0.25 * dx;
    Ok((front - WIDTH) / WIDTH)
}

/// 15: columns and a cylinder of sand, and a column of aluminium rods, collapse.
pub fn granular(size: Size) -> Vec<Case> {
    let (dx, columns, dx_rods): (f64, &[f64], f64) =
        size.pick((0.02, &[1.0], 0.01), (0.01, &[0.5, 1.0, 2.0], 0.005));
    let coarse = size == Size::Quick;
    let mut cases = Vec::new();
    for &ratio in columns {
        let trial = sand_column(ratio, dx);
        cases.push(
            Case::new(
                "sand, a = 0.5 to 2: runout over width",
                format!("sand, a = {ratio}: runout over width"),
                &trial,
                move |run| runout(run, dx),
            )
            .against(1.2 * ratio, "1.2 a, Lube et al. 2005")
            .within(Gate::Relative(0.08))
            .fails((!coarse).then_some(CELLS)),
        );
        if ratio <= 0.7 {
            cases.push(
                Case::new(
                    "sand, a = 0.5: height over width",
                    format!("sand, a = {ratio}: height over width"),
                    &trial,
                    move |run| Ok((run.last("/probes/sand/max/1")? + 0.25 * dx) / WIDTH),
                )
                .against(ratio, "a, Lajeunesse et al. 2005")
                .within(Gate::Relative(0.08)),
            );
        }
    }
    if !coarse {
        cases.extend(tall_columns());
        cases.push(
            Case::new(
                "cylinder of sand: runout over radius",
                format!("cylinder of dry_sand, a = {STANDING}: runout over radius"),
                &Trial::new(&CYLINDER, flow_time(STANDING * WIDTH)),
                |run| runout(run, WIDTH / 5.0),
            )
            .against(1.6 * STANDING.sqrt(), "1.6 sqrt(a), Lube et al. 2004")
            .within(Gate::Relative(0.08))
            .fails(ROUND),
        );
    }
    cases.extend(rods(dx_rods, coarse));
    cases
}

/// Columns from which sand falls rather than spreads, eight cells wide.
fn tall_columns() -> Vec<Case> {
    let dx = WIDTH / 8.0;
    let mut cases: Vec<Case> = TALL
        .into_iter()
        .map(|ratio| {
            Case::new(
                "sand, a = 4 and 8: runout over width",
                format!("sand, a = {ratio}: runout over width"),
                &sand_column(ratio, dx),
                move |run| runout(run, dx),
            )
            .against(1.9 * ratio.powf(2.0 / 3.0), "1.9 a^(2/3), Lube et al. 2005")
            .within(Gate::Relative(0.08))
            .fails(FALL)
        })
        .collect();
    let [low, high] = TALL;
    cases.push(
        Case::of_all(
            "sand, a = 4 to 8: exponent of the runout",
            format!("sand, a = {low} to {high}: exponent of the runout"),
            [high, low].map(|ratio| sand_column(ratio, dx)),
            move |runs| {
                let growth = runout(runs[0], dx)? / runout(runs[1], dx)?;
                Ok(growth.ln() / (high / low).ln())
            },
        )
        .against(2.0 / 3.0, "a^(2/3), Lube et al. 2005")
        .within(Gate::Relative(0.08))
        .fails(FALL),
    );
    cases
}

fn rods(dx: f64, coarse: bool) -> Vec<Case> {
    let trial = Trial::new(&RODS, 0.8)
        .set("dx", dx)
        .set("objects.0.shape.size", format!("[0.2, 0.1, {}]", 4.0 * dx))
        .set("colliders.2.point", format!("[0, 0, {}]", 2.0 * dx))
        .set("colliders.3.point", format!("[0, 0, {}]", -2.0 * dx));
    let source = "Bui et al. 2008, experiment";
    let end = |pointer: &'static str| move |run: &Outcome| Ok(run.last(pointer)? + 0.25 * dx);
    let mut cases = vec![
        Case::new(
            "rods: front [m]",
            "rods: front [m]",
            &trial,
            end("/probes/rods/max/0"),
        )
        .against(0.422, source)
        .within(Gate::Relative(0.08))
        .fails(coarse.then_some(TOE)),
        Case::new(
            "rods: height at the wall [m]",
            "rods: height at the wall [m]",
            &trial,
            end("/probes/rods/max/1"),
        )
        .against(0.0992, source)
        .within(Gate::Relative(0.05)),
    ];
    for (x, height, why) in [(0.12, 0.0722, None), (0.241, 0.0348, Some(HIGH))] {
        cases.push(
            Case::new(
                "rods: surface at two places [m]",
                format!("rods: surface at x = {x} [m]"),
                &trial,
                move |run| surface(run, x),
            )
            .against(height, source)
            .within(Gate::Relative(0.05))
            .fails(why),
        );
    }
    cases
}

/// Where the density along a line of point probes passes half of that at rest; they stand 5 mm apart.
fn surface(run: &Outcome, x: f64) -> anyhow::Result<f64> {
    let filled = |height: f64| {
        let name = format!("/probes/{x} {height:.3}/density");
        run.last(&name).unwrap_or(0.0) / 2650.0
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

const ONE: SceneText = scene_text!("validate/taylor_green");
const NINE: SceneText = scene_text!("validate/taylor_green_array");
/// Edge of a vortex [m], half a wave.
const VORTEX_LENGTH: f64 = 0.5;
/// How much deeper the fluid is before it is pressed.
const PRESSED: f64 = 0.02;
/// How long it takes to press it [s].
const PRESSING: f64 = 0.05;
/// Rate of the kinetic energy, `4 nu k^2` with nu = 0.01 m^2/s and k = 2 pi / m [1/s].
const RATE: f64 = 0.16 * std::f64::consts::PI * std::f64::consts::PI;

/// Why a vortex between walls stops too soon.
const COARSE_WAVE: &str = "what transfers take at this size: the middle of nine vortices, which has no wall, loses 14 % too much as \
                           well; with half the cells 6 % between walls";

/// A scene with `cells` along a vortex, two cells deep, for three times as long as it takes to press it.
fn taylor_green_trial(scene: &SceneText, cells: u32) -> Trial {
    let dx = VORTEX_LENGTH / f64::from(cells);
    let depth = 2.0 * dx * (1.0 + PRESSED);
    let mut trial = Trial::new(scene, 3.0 * PRESSING).set("dx", dx);
    let boxes: &[[f64; 4]] = match scene.path == ONE.path {
        true => &[[0.5, 0.5, 0.25, 0.25]],
        false => &[
            [0.5, 0.5, 0.25, 0.25],
            [1.5, 0.5, 0.25, -0.25],
            [1.5, 0.5, 0.25, 0.75],
            [0.5, 0.5, -0.25, 0.25],
            [0.5, 0.5, 0.75, 0.25],
        ],
    };
    for (n, [width, height, x, y]) in boxes.iter().enumerate() {
        trial = trial
            .set(
                &format!("objects.{n}.shape.size"),
                format!("[{width}, {height}, {depth}]"),
            )
            .set(
                &format!("objects.{n}.translation"),
                format!("[{x}, {y}, {}]", 0.5 * depth),
            );
    }
    let speed = 2.0 * dx * PRESSED / PRESSING;
    trial
        .set("colliders.5.point", format!("[0, 0, {depth}]"))
        .set(
            "colliders.5.motion.linear_velocity",
            format!("[0, 0, {}]", -speed),
        )
}

/// Rate at which the kinetic energy of the first object falls once the fluid is pressed, over the exact one: the
/// effective viscosity over that of the fluid.
fn effective(run: &Outcome) -> anyhow::Result<f64> {
    let mut energy = run.series("/objects/0/kinetic_energy");
    energy.retain(|(t, _)| *t > PRESSING - 1e-6);
    let logarithm: Vec<(f64, f64)> = energy.iter().map(|(t, e)| (*t, e.ln())).collect();
    Ok(-slope(&logarithm) / RATE)
}

/// 21: the vortex of Taylor and Green: how fast viscosity, and the method beside it, stop a flow.
pub fn taylor_green(size: Size) -> Vec<Case> {
    let (open, walled): (&[u32], &[u32]) = size.pick((&[8, 16], &[16]), (&[8, 16, 32], &[16, 32]));
    let source = "Taylor and Green: exp(-2 nu k^2 t); 10 % at 64 cells a wave, Re = 100";
    let mut cases = Vec::new();
    for &cells in open {
        let coarser = 32.0 / f64::from(cells);
        cases.push(
            Case::new(
                "viscosity in the middle of nine vortices",
                format!(
                    "viscosity in the middle of nine vortices over that of the fluid, {} cells a wave",
                    2 * cells
                ),
                &taylor_green_trial(&NINE, cells),
                effective,
            )
            .against(1.0, source)
            // The gate at 64 cells, grown upwards at the order of the splines: transfers add viscosity, and take none.
            .within(Gate::Between(0.9, 1.0 + 0.1 * coarser * coarser)),
        );
    }
    cases.push(
        Case::order(
            "order of what the method adds to viscosity",
            "order of what the method adds to viscosity, 16 to 32 cells a wave",
            [open[0], open[1]].map(|cells| {
                let trial = taylor_green_trial(&NINE, cells);
                (VORTEX_LENGTH / f64::from(cells), trial)
            }),
            |run| Ok((effective(run)? - 1.0).abs()),
        )
        .against(3.0, "(k dx)^4 per substep of APIC, dt in proportion to dx")
        .within(Gate::AtLeast(1.8)),
    );
    for &cells in walled {
        cases.push(
            Case::new(
                "viscosity of a vortex between walls",
                format!(
                    "viscosity of a single vortex between walls over that of the fluid, {} cells a wave",
                    2 * cells
                ),
                &taylor_green_trial(&ONE, cells),
                effective,
            )
            .against(1.0, source)
            .within(Gate::Relative(0.1))
            .fails((cells == 16).then_some(COARSE_WAVE)),
        );
    }
    cases
}

const FLOATING: SceneText = scene_text!("validate/floating");
/// Edges of the tank and of the block, depth of the water without it [m].
const TANK: f64 = 0.8;
const EDGE: f64 = 0.3;
const DEPTH: f64 = 0.4;
/// Density over that of water.
const DENSITY: f64 = 0.6;
/// How long it may take to come to rest, and how long it is looked at then [s].
const SETTLED: f64 = 3.0;
const LOOKED_AT: f64 = 2.0;

const SINKS: &str = "water loses volume to the block";

/// Height of the block's centre of mass where it displaces its weight [m].
fn afloat() -> f64 {
    let draught = DENSITY * EDGE;
    DEPTH + draught * (EDGE / TANK).powi(2) - draught + 0.5 * EDGE
}

/// Heights of the block once it has settled [m].
fn settled_heights(run: &Outcome) -> Vec<f64> {
    let heights = run.series("/objects/1/com/1");
    let settled = heights.iter().filter(|(time, _)| *time > SETTLED);
    settled.map(|(_, height)| *height).collect()
}

/// 23: a light block in a tank of water: how deep it floats, and whether it stays there.
pub fn floating(size: Size) -> Vec<Case> {
    let all: &[f64] = size.pick(&[0.05], &[0.05, 0.025]);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let mut cases = Vec::new();
    for fidelity in ["rigid", "mpm"] {
        for &dx in all {
            let trial = Trial::new(&FLOATING, SETTLED + LOOKED_AT)
                .set("dx", dx)
                .set("objects.1.fidelity", format!("{fidelity:?}"));
            let name =
                |quantity: &str| format!("{fidelity}, {:.0} cells wide: {quantity}", EDGE / dx);
            cases.extend([
                Case::new(
                    "off in height [cells]",
                    name("off in height [cells]"),
                    &trial,
                    move |run| Ok((mean(&settled_heights(run)) - afloat()).abs() / dx),
                )
                .against(0.0, "Archimedes")
                .within(Gate::AtMost(1.0)),
                Case::new(
                    "sinking [cells/s]",
                    name("sinking [cells/s]"),
                    &trial,
                    move |run| {
                        let settled = settled_heights(run);
                        let (first, last) = settled.split_at(settled.len() / 2);
                        Ok(((mean(first) - mean(last)) / (0.5 * LOOKED_AT * dx)).abs())
                    },
                )
                .against(0.0, "Archimedes")
                .within(Gate::AtMost(0.01))
                .fails(SINKS),
            ]);
        }
    }
    cases
}
