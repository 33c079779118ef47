//! `cosplat bench table1`: the paper's Table I, counted instead of claimed.

use anyhow::Context;
use cosplat_console::say;
use cosplat_scene::load::load_text;
use cosplat_sim_core::{Work, World};
use serde::Serialize;

use crate::progress;

/// Count operations per substep for every contact method as particles and objects grow, with fitted exponents.
#[derive(clap::Args)]
pub struct Args {
    /// Largest number of particles of the two-body scene; a power of ten from 1000.
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1000..=10_000_000))]
    particles: u64,
    /// Largest number of objects.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u64).range(2..=10_000))]
    objects: u64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Contact methods of the spatial grid, in the order of the table.
const METHODS: [&str; 3] = ["single_field", "multi_field", "com_sphere"];
/// Substeps that are counted: they fit into one frame.
const SUBSTEPS: f64 = 4.0;
/// Edge of one of the two bodies [m].
const EDGE: f64 = 0.4;
/// Cells along the edge of one of many bodies.
const CELLS: f64 = 3.0;
/// Particles of one of many bodies: eight per cell.
const OF_MANY: u64 = 216;
/// Strength of the coherence constraint where the paper has one [1/s].
const COHERENCE: f64 = 50.0;

/// Operations per substep in one scene under one method.
#[derive(Debug, Serialize)]
struct Row {
    method: &'static str,
    objects: usize,
    particles: usize,
    substeps: u32,
    counts: Counts,
}

/// Operations per substep.
#[derive(Clone, Copy, Debug, Serialize)]
struct Counts {
    particle_to_grid: f64,
    grid_nodes: f64,
    grid_to_particle: f64,
    contact_nodes: f64,
    object_moments: f64,
    object_pairs: f64,
    constraint: f64,
}

impl Counts {
    const NAMES: [&'static str; 7] = [
        "particle to grid",
        "grid nodes",
        "grid to particle",
        "contact nodes",
        "object moments",
        "object pairs",
        "constraint",
    ];

    fn new(work: &Work, substeps: u32) -> Self {
        let per = |count: u64| count as f64 / f64::from(substeps.max(1));
        Self {
            particle_to_grid: per(work.particle_to_grid),
            grid_nodes: per(work.grid_nodes),
            grid_to_particle: per(work.grid_to_particle),
            contact_nodes: per(work.contact_nodes),
            object_moments: per(work.object_particles),
            object_pairs: per(work.object_pairs),
            constraint: per(work.constrained_particles),
        }
    }

    fn values(&self) -> [f64; 7] {
        [
            self.particle_to_grid,
            self.grid_nodes,
            self.grid_to_particle,
            self.contact_nodes,
            self.object_moments,
            self.object_pairs,
            self.constraint,
        ]
    }
}

/// Growth of one kind of operation.
#[derive(Debug, Serialize)]
struct Fit {
    method: &'static str,
    operation: &'static str,
    /// Exponent of the number of particles of two bodies; absent where there is nothing to count.
    particles: Option<f64>,
    /// Exponent of the number of bodies of equal size.
    objects: Option<f64>,
    /// What the paper's Table I says, for its two methods.
    claimed: &'static str,
}

#[derive(Debug, Serialize)]
struct Table {
    two_bodies: Vec<Row>,
    many_bodies: Vec<Row>,
    exponents: Vec<Fit>,
}

/// Runs the measurement.
///
/// # Errors
/// When a scene cannot be built.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut table = Table {
        two_bodies: vec![],
        many_bodies: vec![],
        exponents: vec![],
    };
    let sizes = (3..8).map(|n| 10_u64.pow(n));
    let sizes: Vec<u64> = sizes.filter(|n| *n <= args.particles).collect();
    let crowds = [2, 10, 30, 100, 300, 1000, 3000, 10_000];
    let crowds: Vec<u64> = crowds.into_iter().filter(|n| *n <= args.objects).collect();
    // In particles: what takes the time.
    let length = sizes.iter().sum::<u64>() + OF_MANY * crowds.iter().sum::<u64>();
    let bar = progress::bar("table 1", METHODS.len() as u64 * length);
    for name in METHODS {
        for &wanted in &sizes {
            let row = count(name, &two_bodies(name, wanted))?;
            table.two_bodies.push(row);
            bar.inc(wanted);
        }
        for &objects in &crowds {
            let row = count(name, &many_bodies(name, objects))?;
            table.many_bodies.push(row);
            bar.inc(OF_MANY * objects);
        }
        for (k, operation) in Counts::NAMES.into_iter().enumerate() {
            let of = |rows: &[Row], size: fn(&Row) -> usize| {
                let rows = rows.iter().filter(|row| row.method == name);
                exponent(rows.map(|row| (size(row) as f64, row.counts.values()[k])))
            };
            table.exponents.push(Fit {
                method: name,
                operation,
                particles: of(&table.two_bodies, |row| row.particles),
                objects: of(&table.many_bodies, |row| row.objects),
                claimed: claimed(name, k),
            });
        }
    }
    bar.finish_and_clear();
    match args.json {
        true => say!("{}", serde_json::to_string(&table)?)?,
        false => say!("{}", table.text().trim_end())?,
    }
    Ok(())
}

/// Two cubes that touch and press on each other, of about `particles` particles together.
fn two_bodies(method: &str, particles: u64) -> String {
    let per_edge = (particles as f64 / 2.0).cbrt().round();
    let dx = EDGE / (per_edge / 2.0);
    let mut text = header(method, dx);
    for (k, side) in [-1.0, 1.0].into_iter().enumerate() {
        let x = side * (0.5 * EDGE + 0.2 * dx);
        text.push_str(&body(method, k as u64, EDGE, [x, 0.0, 0.0], -side));
    }
    text
}

/// Small cubes on a lattice, a fifth of a cell apart.
fn many_bodies(method: &str, objects: u64) -> String {
    let dx = 0.05;
    let edge = CELLS * dx;
    let side = (objects as f64).cbrt().ceil() as u64;
    let mut text = header(method, dx);
    for k in 0..objects {
        let at = [k % side, k / side % side, k / (side * side)];
        let at = at.map(|i| (edge + 0.2 * dx) * i as f64);
        text.push_str(&body(
            method,
            k,
            edge,
            at,
            if k % 2 == 0 { 1.0 } else { -1.0 },
        ));
    }
    text
}

fn header(method: &str, dx: f64) -> String {
    format!("version = 1\ncontact = \"{method}\"\ngravity = [0, 0, 0]\ndx = {dx:?}\n")
}

fn body(method: &str, k: u64, edge: f64, at: [f64; 3], velocity: f64) -> String {
    let coherence = match method {
        "com_sphere" => format!("coherence = {COHERENCE:?}\n"),
        _ => String::new(),
    };
    format!(
        "[[objects]]\nname = \"{k}\"\nshape = {{ kind = \"box\", size = [{edge:?}, {edge:?}, {edge:?}], gaussian_spacing = {edge:?} }}\n\
         translation = {at:?}\nlinear_velocity = [{velocity:?}, 0, 0]\nmaterial = \"soft_rubber\"\nsolver = \"spatial\"\nfidelity = \"mpm\"\n{coherence}"
    )
}

/// Counts a few substeps of a scene.
fn count(method: &'static str, text: &str) -> anyhow::Result<Row> {
    let scene = load_text(text.to_owned(), std::path::Path::new("table1.toml"))?.scene;
    let first = scene.objects.first().context("a scene has objects")?;
    let material = &first.material;
    // An isolated particle's limit, times the scene's fraction of it: what the solver takes as its substep.
    let stiffness = 3.0 * material.lambda() + 2.0 * material.mu();
    let dt = scene.cfl * scene.dx * (material.density / stiffness).sqrt();
    let (objects, particles) = (scene.objects.len(), scene.particles.position.len());
    let mut world = World::new(scene)?;
    let report = world.step(SUBSTEPS * dt, &[]);
    Ok(Row {
        method,
        objects,
        particles,
        substeps: report.substeps,
        counts: Counts::new(&report.work, report.substeps),
    })
}

/// Slope of the least-squares line through the logarithms; none where a count is zero or there are fewer than two.
fn exponent(points: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let points: Vec<(f64, f64)> = points.collect();
    if points.len() < 2 || points.iter().any(|(x, y)| *x <= 0.0 || *y <= 0.0) {
        return None;
    }
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let above: f64 = logs.iter().map(|(x, y)| (x - mx) * (y - my)).sum();
    let below: f64 = logs.iter().map(|(x, _)| (x - mx).powi(2)).sum();
    (below > 0.0).then(|| above / below)
}

/// Table I of the paper: standard MPM, and its own method.
fn claimed(method: &str, operation: usize) -> &'static str {
    match (method, operation) {
        (_, 0) => "O(alpha (N1 + N2))",
        (_, 1) => "O(beta r^2)",
        (_, 2) => "O(delta (N1 + N2))",
        ("single_field", 3) => "O(C(N1, N2, r)), up to O((N1 + N2)^2)",
        ("com_sphere", 6) => "O(N_objects^2)",
        ("com_sphere", 7) => "O(epsilon (N1 + N2))",
        _ => "-",
    }
}

impl Table {
    fn text(&self) -> String {
        let mut text = String::new();
        for (title, rows) in [
            ("two bodies, operations per substep", &self.two_bodies),
            ("many bodies, operations per substep", &self.many_bodies),
        ] {
            text.push_str(&format!(
                "{title}\n{:>13} {:>8} {:>10} {:>12} {:>12} {:>12} {:>12} {:>12} {:>12} {:>12} {:>12}\n",
                "method",
                "objects",
                "particles",
                "P2G",
                "grid",
                "G2P",
                "contact",
                "gaps",
                "moments",
                "pairs",
                "constraint"
            ));
            for row in rows {
                text.push_str(&format!(
                    "{:>13} {:>8} {:>10}",
                    row.method, row.objects, row.particles
                ));
                for value in row.counts.values() {
                    text.push_str(&format!(" {value:>12.0}"));
                }
                text.push('\n');
            }
        }
        text.push_str("exponents of particles (two bodies) and of objects (many bodies)\n");
        let shown = |e: Option<f64>| e.map_or("-".to_owned(), |e| format!("{e:.2}"));
        for fit in &self.exponents {
            text.push_str(&format!(
                "{:>13} {:>25} {:>6} {:>6}   {}\n",
                fit.method,
                fit.operation,
                shown(fit.particles),
                shown(fit.objects),
                fit.claimed
            ));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_are_those_of_power_laws() {
        let squares = (1..5).map(|n| (f64::from(n), 3.0 * f64::from(n * n)));
        assert!((exponent(squares).expect("points") - 2.0).abs() < 1e-12);
        assert_eq!(exponent([(1.0, 0.0), (2.0, 1.0)].into_iter()), None);
        assert_eq!(exponent([(1.0, 1.0)].into_iter()), None);
    }

    #[test]
    fn transfers_grow_with_particles_and_pairs_with_objects_squared() {
        let few = count("com_sphere", &many_bodies("com_sphere", 3)).expect("counted");
        let many = count("com_sphere", &many_bodies("com_sphere", 6)).expect("counted");
        assert_eq!(many.particles, 2 * few.particles);
        let [few, many] = [few, many].map(|row| (row.particles as f64, row.substeps, row.counts));
        assert_eq!(few.2.particle_to_grid, few.0);
        assert_eq!(many.2.grid_to_particle, many.0);
        assert_eq!(many.2.constraint * f64::from(many.1), many.0);
        // 3 and 15 pairs, in one segment each.
        let pairs = |(_, substeps, counts): (f64, u32, Counts)| {
            (counts.object_pairs * f64::from(substeps)).round()
        };
        assert_eq!((pairs(few), pairs(many)), (3.0, 15.0));
    }

    #[test]
    fn contact_work_is_counted_where_fields_share_nodes() {
        let of = |method| count(method, &two_bodies(method, 1000)).expect("counted");
        assert_eq!(of("single_field").counts.contact_nodes, 0.0);
        assert_eq!(of("com_sphere").counts.contact_nodes, 0.0);
        assert!(of("multi_field").counts.contact_nodes > 0.0);
        assert!((800..1300).contains(&of("single_field").particles));
    }
}
