//! Solids on grids of their own: from which time step on they blow up, and what the solver takes.

use anyhow::Context;
use cosplat_reference::solid::resting::RestingSolid;
use cosplat_sim_core::{
    Scene,
    materials::{Law, Material},
};
use rayon::prelude::*;

use super::{
    maps::{FEW, Map, NU, Panel, RATIOS, Row, Sample, Scale},
    samples::{FOAM, MISES, Numbers, OBJECTS, PLASTICINE, block, object, solid},
    trial::{Fate, GROWTH, START},
};

/// Substeps of a run: one per cent past the limit the fastest motion grows e-fold every four.
const STEPS: usize = 100;

/// Of solids.
const SOLIDS: Scale = Scale {
    x: "dt over what the solver takes with cfl = 1",
    line: "2 over the fastest frequency that the solver has measured",
    caption: "Double-precision oracle, which has no guard; fixed dt; displacements and velocities at random that make strains of 1e-6 at \
              the start.",
    keys: ["dt_over_own_limit", "two_over_frequency"],
};

/// Every law that solids may have.
const LAWS: [(&str, Law); 6] = [
    ("corot.", Law::FixedCorotated),
    ("neo-H.", Law::NeoHookean),
    ("Hencky", Law::Hencky),
    ("Mises", MISES),
    ("foam", FOAM),
    ("plastic.", PLASTICINE),
];

/// A solid at rest, touched by nothing.
pub struct SolidSample {
    solid: RestingSolid,
    /// What the solver takes with a small `cfl`, over that: 2 over the fastest frequency [s].
    by_frequency: f64,
    /// What it takes with `cfl = 1` [s].
    own: f64,
}

impl SolidSample {
    /// The first object of a scene.
    fn new(scene: Scene) -> anyhow::Result<Self> {
        let solid = RestingSolid::new(scene).context("the sample cannot be a solid")?;
        Ok(Self {
            by_frequency: solid.substep(0.1) / 0.1,
            own: solid.substep(1.0),
            solid,
        })
    }
}

impl Sample for SolidSample {
    fn limit(&self) -> f64 {
        self.own
    }

    fn predicted(&self) -> f64 {
        self.by_frequency / self.own
    }

    fn fate(&self, dt: f64, steps: usize) -> Fate {
        let mut solid = self.solid.oracle.clone();
        let mut numbers = Numbers(solid.mass.len() as u64);
        let nodes = solid.displacement.iter_mut().zip(&mut solid.velocity);
        for (u, v) in nodes {
            *u = std::array::from_fn(|_| START * self.solid.dx * (numbers.next() - 0.5));
            *v = std::array::from_fn(|_| START * self.solid.dx / dt * (numbers.next() - 0.5));
        }
        solid.follow();
        let share = START / solid.largest_strain();
        for u in &mut solid.displacement {
            *u = u.map(|u| share * u);
        }
        let mut tenths = [0.0_f64; 10];
        for tenth in &mut tenths {
            for _ in 0..steps / 10 {
                solid.substep(dt, dt, [0.0; 3]);
            }
            *tenth = solid.largest_strain();
            if tenth.is_nan() || *tenth > GROWTH * START {
                return Fate::BlownUp;
            }
        }
        match tenths[9] < tenths[0] / 3.0 {
            true => Fate::Damped,
            false => Fate::Passed,
        }
    }
}

/// A solid and the limit of its time step, all over `dx sqrt(rho0 / (3 lambda + 2 mu))`.
pub struct Limit {
    /// Which.
    pub solid: String,
    /// Poisson's ratio or law.
    pub row: String,
    /// Largest stable time step.
    pub measured: f64,
    /// 2 over the fastest frequency that the solver has measured.
    pub by_frequency: f64,
    /// What the solver takes with `cfl` 0.8 and 1.
    pub taken: [f64; 2],
}

impl Limit {
    fn measure(solid: &str, name: &str, sample: SolidSample) -> Self {
        let over = |dt: f64| dt / sample.solid.time_of_tangent();
        let (by_frequency, own) = (over(sample.by_frequency), over(sample.own));
        // By bisection to one per cent.
        let (mut stable, mut unstable) = (0.5, 2.0);
        while unstable - stable > 0.01 {
            let middle = 0.5 * (stable + unstable);
            match sample.fate(middle * sample.own, STEPS) {
                Fate::BlownUp => unstable = middle,
                Fate::Passed | Fate::Damped => stable = middle,
            }
        }
        Self {
            solid: solid.into(),
            row: name.into(),
            measured: stable * own,
            by_frequency,
            taken: [0.8 * by_frequency, own],
        }
    }
}

/// What makes a solid of a material.
type Make = Box<dyn Fn(&Material) -> anyhow::Result<SolidSample> + Send + Sync>;

/// Solids by name: cubes of a few cells, and objects of scene files.
fn shapes(quick: bool) -> Vec<(String, Make)> {
    let cubes = if quick { 2..=2 } else { 1..=3 };
    let cubes = cubes.map(|edge| -> (String, Make) {
        let name = match edge {
            1 => "one cell".into(),
            _ => format!("cube, {edge} cells"),
        };
        let make = move |material: &Material| SolidSample::new(block(material.clone(), edge, 2));
        (name, Box::new(make))
    });
    let objects = if quick { &[] } else { &OBJECTS[..] };
    let objects = objects.iter().map(|(name, text)| -> (String, Make) {
        let make = |material: &Material| {
            let mut scene = object(text, material.poisson_ratio)?;
            scene.objects[0].material = material.clone();
            SolidSample::new(scene)
        };
        ((*name).into(), Box::new(make))
    });
    cubes.chain(objects).collect()
}

/// Materials by the name of their rows: all Poisson's ratios of one law, or all laws.
fn materials(quick: bool, by_law: bool) -> Vec<(String, Material)> {
    if by_law {
        let laws = LAWS.iter();
        return laws
            .map(|(name, law)| ((*name).into(), solid(*law, 0.3)))
            .collect();
    }
    let nu = if quick { &NU[2..3] } else { &NU[..] };
    nu.iter()
        .map(|nu| (format!("{nu}"), solid(Law::NeoHookean, *nu)))
        .collect()
}

/// A panel: its title, materials by the name of their rows, and the solid that is made of each.
type PanelOfSolids = (String, Vec<(String, Material)>, Make);

/// All solids: shapes over Poisson's ratio, and a cube over laws.
fn all(quick: bool) -> Vec<PanelOfSolids> {
    let mut all: Vec<_> = shapes(quick)
        .into_iter()
        .map(|(name, make)| (name, materials(quick, false), make))
        .collect();
    let cube: Make = Box::new(|material| SolidSample::new(block(material.clone(), 2, 2)));
    all.push(("cube, 2 cells, by law".into(), materials(quick, true), cube));
    all
}

/// The map.
///
/// # Errors
/// When a solid cannot be built.
pub fn map(quick: bool) -> anyhow::Result<Map> {
    let ratios = if quick { &FEW[..] } else { &RATIOS[..] };
    let panel = |(title, materials, make): PanelOfSolids| {
        let row = |(name, material): (String, Material)| {
            Ok(Row {
                name,
                samples: vec![Box::new(make(&material)?)],
                steps: STEPS,
            })
        };
        Ok(Panel {
            title,
            ratios: ratios.to_vec(),
            rows: materials
                .into_iter()
                .map(row)
                .collect::<anyhow::Result<_>>()?,
        })
    };
    Ok(Map {
        name: "solids",
        title: "Solids on grids of their own: what becomes of a small strain without guard",
        scale: &SOLIDS,
        y: "Poisson's ratio or law",
        panels: all(quick)
            .into_iter()
            .map(panel)
            .collect::<anyhow::Result<_>>()?,
        columns: 2,
    })
}

/// Limits of all.
///
/// # Errors
/// When a solid cannot be built.
pub fn limits(quick: bool) -> anyhow::Result<Vec<Limit>> {
    let of = |(name, materials, make): PanelOfSolids| {
        let row =
            |(row, material): &(String, Material)| Ok(Limit::measure(&name, row, make(material)?));
        materials
            .par_iter()
            .map(row)
            .collect::<anyhow::Result<Vec<_>>>()
    };
    let rows = all(quick).into_par_iter().map(of);
    Ok(rows
        .collect::<anyhow::Result<Vec<_>>>()?
        .into_iter()
        .flatten()
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The measured limit is known to one per cent, and growth sets in slowly there: a tenth beyond it is certain to show.
    #[test]
    fn solids_are_stable_as_far_as_their_solver_goes() -> anyhow::Result<()> {
        for (name, materials, make) in all(true) {
            for (row, material) in materials {
                let sample = make(&material)?;
                for share in [0.5, 0.8, 1.0] {
                    let fate = sample.fate(share * sample.own, STEPS);
                    assert_ne!(
                        fate,
                        Fate::BlownUp,
                        "{name}, {row}, {share} of its own limit"
                    );
                }
                let beyond = 1.1 * sample.solid.time_of_tangent();
                let limit = Limit::measure(&name, &row, sample);
                let sample = make(&material)?;
                assert_eq!(
                    sample.fate(beyond * limit.measured, STEPS),
                    Fate::BlownUp,
                    "{name}, {row}"
                );
                assert!(limit.taken[1] < limit.measured, "{name}, {row}");
            }
        }
        Ok(())
    }
}
