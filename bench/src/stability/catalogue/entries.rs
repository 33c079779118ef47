//! The entries of the catalogue.

use anyhow::Context;

use super::Failure;
use crate::trial::{Outcome, scene_text};

/// Settings of a run.
type Settings = &'static [(&'static str, &'static str)];
/// Runs by name.
type Variants = &'static [(&'static str, Settings)];

/// Solids on grids of their own, and the contact methods on the spatial grid.
const CONTACT: Variants = &[
    ("solid", TWO_SOLIDS),
    ("single_field", &[("contact", "single_field")]),
    ("multi_field", &[("contact", "multi_field")]),
    (
        "multi_field, pic",
        &[("contact", "multi_field"), ("transfer", "pic")],
    ),
];
/// On a grid of its own.
const SOLID: Settings = &[("objects.0.solver", "\"lagrangian\"")];
/// Both objects on grids of their own.
const TWO_SOLIDS: Settings = &[
    ("objects.0.solver", "\"lagrangian\""),
    ("objects.1.solver", "\"lagrangian\""),
];
/// All transfers.
const TRANSFER: Variants = &[
    ("apic", &[]),
    ("rpic", &[("rpic_damping", "1")]),
    ("pic", &[("transfer", "pic")]),
    ("solid", SOLID),
];
/// What flies and spins for long.
const FLIGHT: Variants = &[
    ("apic", &[]),
    ("rpic", &[("rpic_damping", "1")]),
    ("solid", SOLID),
    ("rigid", &[("objects.0.fidelity", "\"rigid\"")]),
];

/// Relative velocity of the second object against the first, along an axis [m/s].
fn relative(outcome: &Outcome, axis: usize) -> anyhow::Result<f64> {
    let v = |object| outcome.last(&format!("/objects/{object}/linear_velocity/{axis}"));
    Ok(v(1)? - v(0)?)
}

/// The first and the last value of a series.
fn ends(outcome: &Outcome, pointer: &str) -> anyhow::Result<[f64; 2]> {
    let series = outcome.series(pointer);
    let ends = series.first().zip(series.last());
    let (first, last) = ends.with_context(|| format!("nothing at {pointer}"))?;
    Ok([first.1, last.1])
}

/// The catalogue.
pub const ALL: [Failure; 22] = [
    Failure {
        name: "sticky when touching",
        scene: scene_text!("stability/apart"),
        measured: "speed of parting kept after 1 s",
        ideal: "1",
        duration: 1.0,
        variants: CONTACT,
        read: |o| Ok(relative(o, 1)? / 0.1),
        remedy: "a grid or a field per object; no transfer cures it",
    },
    Failure {
        name: "sticky at a distance",
        scene: scene_text!("stability/apart"),
        measured: "speed of parting kept after 1 s, from one cell apart",
        ideal: "1",
        duration: 1.0,
        variants: &[
            (
                "single_field",
                &[
                    ("contact", "single_field"),
                    ("objects.1.translation", "[0, 0.2, 0]"),
                ],
            ),
            (
                "multi_field",
                &[
                    ("contact", "multi_field"),
                    ("objects.1.translation", "[0, 0.2, 0]"),
                ],
            ),
            (
                "multi_field, pic",
                &[
                    ("contact", "multi_field"),
                    ("transfer", "pic"),
                    ("objects.1.translation", "[0, 0.2, 0]"),
                ],
            ),
            (
                "solid",
                &[
                    ("objects.0.solver", "\"lagrangian\""),
                    ("objects.1.solver", "\"lagrangian\""),
                    ("objects.1.translation", "[0, 0.2, 0]"),
                ],
            ),
        ],
        read: |o| Ok(relative(o, 1)? / 0.1),
        remedy: "as above",
    },
    Failure {
        name: "drag while passing",
        scene: scene_text!("stability/past"),
        measured: "speed of passing kept after 1 s, half a cell apart",
        ideal: "1",
        duration: 1.0,
        variants: CONTACT,
        read: |o| Ok(relative(o, 0)? / 0.1),
        remedy: "grids of their own",
    },
    Failure {
        name: "early contact",
        scene: scene_text!("stability/meet"),
        measured: "distance at which balls slow by 1 % [dx]",
        ideal: "0",
        duration: 0.4,
        variants: CONTACT,
        read: |o| {
            let series = o.series("/objects/0/linear_velocity/0");
            let slowed = series.iter().find(|(_, v)| *v < 0.495);
            let (t, _) = slowed.context("the balls never slowed")?;
            Ok((0.2 - t) / 0.05)
        },
        remedy: "grids of their own; finer `dx` for the others",
    },
    Failure {
        name: "loss in a collision",
        scene: scene_text!("stability/meet"),
        measured: "speed of parting over speed of approach, 8 cells across",
        ideal: "near 1 (elastic)",
        duration: 0.6,
        variants: CONTACT,
        read: |o| relative(o, 0),
        remedy: "grids of their own; finer `dx`; APIC rather than PIC",
    },
    Failure {
        name: "dissipation of spin",
        scene: scene_text!("stability/spin"),
        measured: "kinetic energy kept after 1 s (1.6 turns)",
        ideal: "1",
        duration: 1.0,
        variants: TRANSFER,
        read: |o| {
            let [first, last] = ends(o, "/kinetic_energy")?;
            Ok(last / first)
        },
        remedy: "`apic`; `rpic_damping` where vibration alone should die",
    },
    Failure {
        name: "dissipation of vibration",
        scene: scene_text!("stability/ring"),
        measured: "energy kept after 0.5 s (about 5 periods)",
        ideal: "1",
        duration: 0.5,
        variants: TRANSFER,
        read: |o| {
            let [k0, k1] = ends(o, "/kinetic_energy")?;
            let [e0, e1] = ends(o, "/elastic_energy")?;
            Ok((k1 + e1) / (k0 + e0))
        },
        remedy: "`apic`, finer `dx`",
    },
    Failure {
        name: "volume gain by spin",
        scene: scene_text!("stability/spin"),
        measured: "growth along the axis after 4 s (6.4 turns) [%]",
        ideal: "-0.03 (centrifugal)",
        duration: 4.0,
        variants: &[("apic", &[]), ("solid", SOLID)],
        read: |o| {
            let (min, max) = (
                o.series("/probes/size/min/1"),
                o.series("/probes/size/max/1"),
            );
            let height = |n: usize| Some(max.get(n)?.1 - min.get(n)?.1);
            let first = height(0).context("no frame")?;
            let last = height(min.len() - 1).context("no frame")?;
            Ok(100.0 * (last / first - 1.0))
        },
        remedy: "`F` follows the particles to second order; what is left is within a tenth of a cell",
    },
    Failure {
        name: "jitter at rest",
        scene: scene_text!("stability/rest"),
        measured: "rms speed after 2 s [mm/s]",
        ideal: "0",
        duration: 2.0,
        variants: TRANSFER,
        read: |o| Ok(1e3 * (2.0 * o.last("/kinetic_energy")? / o.last("/objects/0/mass")?).sqrt()),
        remedy: "`fidelity = \"auto\"` lets it sleep; a little `damping`",
    },
    Failure {
        name: "numerical fracture",
        scene: scene_text!("stability/hang"),
        measured: "longest that the bar gets within 1 s, over its length",
        ideal: "about 1.6",
        duration: 1.0,
        variants: &[
            ("8 per cell", &[("particles_per_cell", "8")]),
            ("27 per cell", &[("particles_per_cell", "27")]),
            (
                "27 per cell, pic",
                &[("particles_per_cell", "27"), ("transfer", "pic")],
            ),
            ("solid", SOLID),
        ],
        read: |o| {
            let (min, max) = (
                o.series("/probes/size/min/1"),
                o.series("/probes/size/max/1"),
            );
            let lengths = min.iter().zip(&max).map(|(low, high)| high.1 - low.1);
            Ok(lengths.fold(0.0, f64::max) / 0.8)
        },
        remedy: "27 `particles_per_cell` where matter stretches beyond two",
    },
    Failure {
        name: "locking as nu -> 0.5",
        scene: scene_text!("stability/lock"),
        measured: "deflection of the tip after 1.5 s [mm]",
        ideal: "as at 0.3",
        duration: 1.5,
        variants: &[
            ("nu 0.3", &[]),
            ("nu 0.45", &[("objects.0.material.poisson_ratio", "0.45")]),
            ("nu 0.49", &[("objects.0.material.poisson_ratio", "0.49")]),
            ("solid, nu 0.3", SOLID),
            (
                "solid, nu 0.49",
                &[
                    ("objects.0.solver", "\"lagrangian\""),
                    ("objects.0.material.poisson_ratio", "0.49"),
                ],
            ),
        ],
        read: |o| Ok(-1e3 * o.last("/probes/tip/position/1")?),
        remedy: "built in: particles share their volume over the grid from 0.4 on; finer `dx` for the rest",
    },
    Failure {
        name: "flat foot",
        scene: scene_text!("stability/roll"),
        measured: "distance rolled in 0.5 s over that of a rigid ball",
        ideal: "1",
        duration: 0.5,
        variants: TRANSFER,
        // A ball that does not slip goes 5/14 g sin(theta) t^2.
        read: |o| Ok(o.last("/objects/0/com/0")? / (5.0 / 14.0 * 3.99 * 0.25)),
        remedy: "finer `dx`, stiffer matter, `fidelity = \"rigid\"`",
    },
    Failure {
        name: "thin object",
        scene: scene_text!("stability/plate"),
        measured: "height of the ball's centre over the plate after 1 s [dx]",
        ideal: "about 2.2",
        duration: 1.0,
        variants: CONTACT,
        read: |o| Ok(o.last("/objects/1/com/1")? / 0.05),
        remedy: "at least two cells of thickness; thin walls as colliders",
    },
    Failure {
        name: "fast impact on a thin wall",
        scene: scene_text!("stability/shot"),
        measured: "farthest particle behind the wall's front [dx]",
        ideal: "0",
        duration: 0.04,
        variants: &[
            ("apic", &[]),
            ("pic", &[("transfer", "pic")]),
            ("solid", SOLID),
        ],
        read: |o| Ok((o.last("/probes/size/max/0")? + 0.0125) / 0.05),
        remedy: "built in: the way of every particle is followed through thin colliders",
    },
    Failure {
        name: "mass ratio 1000",
        scene: scene_text!("stability/heavy"),
        measured: "height of the heavy block over the floor after 0.5 s [dx]",
        ideal: "about 5",
        duration: 0.5,
        variants: CONTACT,
        read: |o| Ok(o.last("/objects/1/com/1")? / 0.05),
        remedy: "`fidelity = \"rigid\"` for what does not deform",
    },
    Failure {
        name: "crushing",
        scene: scene_text!("stability/crush"),
        measured: "energy after 50 ms over that at the start",
        ideal: "at most 1",
        duration: 0.05,
        variants: &[
            ("fixed_corotated", &[]),
            (
                "neo_hookean",
                &[("objects.0.material.law", "\"neo_hookean\"")],
            ),
            ("fixed_corotated, pic", &[("transfer", "pic")]),
            ("fixed_corotated, solid", SOLID),
        ],
        read: |o| {
            let [k0, k1] = ends(o, "/kinetic_energy")?;
            let [e0, e1] = ends(o, "/elastic_energy")?;
            Ok((k1 + e1) / (k0 + e0))
        },
        remedy: "built in: substeps follow the tangent, and the guard takes back what is still too long",
    },
    Failure {
        name: "stiff matter",
        scene: scene_text!("stability/stiff"),
        measured: "substeps for 0.1 s",
        ideal: "few",
        duration: 0.1,
        variants: &[
            ("1e4 Pa", &[]),
            ("1e6 Pa", &[("objects.0.material.youngs_modulus_pa", "1e6")]),
            ("1e8 Pa", &[("objects.0.material.youngs_modulus_pa", "1e8")]),
            (
                "1e8 Pa, pic",
                &[
                    ("objects.0.material.youngs_modulus_pa", "1e8"),
                    ("transfer", "pic"),
                ],
            ),
            (
                "1e8 Pa, solid",
                &[
                    ("objects.0.material.youngs_modulus_pa", "1e8"),
                    ("objects.0.solver", "\"lagrangian\""),
                ],
            ),
            ("rigid", &[("objects.0.fidelity", "\"rigid\"")]),
        ],
        read: |o| o.summary["substeps"].as_f64().context("no substeps"),
        remedy: "`fidelity = \"rigid\"`, or the softest matter that looks the same",
    },
    Failure {
        name: "turning inside out",
        scene: scene_text!("stability/invert"),
        measured: "energy after 20 ms over that after 1 ms, of random velocities ten times the speed of sound",
        ideal: "at most 1, none taken out",
        duration: 0.02,
        variants: &[
            ("seed 0", &[]),
            ("seed 1", &[("seed", "1")]),
            ("seed 2", &[("seed", "2")]),
            (
                "neo_hookean",
                &[("objects.0.material.law", "\"neo_hookean\"")],
            ),
            ("pic", &[("transfer", "pic")]),
            ("solid", SOLID),
        ],
        read: |o| {
            let [k0, k1] = ends(o, "/kinetic_energy")?;
            let [e0, e1] = ends(o, "/elastic_energy")?;
            Ok((k1 + e1) / (k0 + e0))
        },
        remedy: "built in: no substep is so long that it could turn a particle inside out",
    },
    Failure {
        name: "growth of fluids",
        scene: scene_text!("stability/slosh"),
        measured: "depth of a pool over that of its volume, twice the least height of its centre in the fifth second: it sways",
        ideal: "1",
        duration: 5.0,
        variants: &[
            ("apic", &[]),
            ("pic", &[("transfer", "pic")]),
            ("27 per cell", &[("particles_per_cell", "27")]),
            ("half the dx", &[("dx", "0.025")]),
        ],
        // The basin is 0.6 m long and 0.2 m wide: 24 litres stand 0.2 m deep.
        read: |o| {
            let late = o.series("/objects/0/com/1");
            let late = late.iter().filter(|(t, _)| *t > 4.0);
            Ok(2.0 * late.map(|(_, y)| *y).fold(f64::INFINITY, f64::min) / 0.2)
        },
        remedy: "finer `dx`; what else was tried is in [decision 0014](decisions/0014-volume-of-fluids.md)",
    },
    Failure {
        name: "round-off in flight",
        scene: scene_text!("stability/drift"),
        measured: "distance from the straight line after 30 s and 95 m [mm]",
        ideal: "0",
        duration: 30.0,
        variants: FLIGHT,
        read: |o| {
            let mut sum = 0.0;
            for (axis, speed) in [3.0, 1.0, 0.0].iter().enumerate() {
                sum += (o.last(&format!("/objects/0/com/{axis}"))? - 30.0 * speed).powi(2);
            }
            Ok(1e3 * sum.sqrt())
        },
        remedy: "not needed; bodies (`rigid`, or `auto` in flight) are in double precision",
    },
    Failure {
        name: "round-off in spin",
        scene: scene_text!("stability/drift"),
        measured: "change of angular momentum after 30 s (48 turns), over what there was [1e-6]",
        ideal: "0",
        duration: 30.0,
        variants: FLIGHT,
        read: |o| {
            let (mut change, mut whole) = (0.0, 0.0);
            for axis in 0..3 {
                let [first, last] = ends(o, &format!("/objects/0/angular_momentum/{axis}"))?;
                change += (last - first).powi(2);
                whole += first * first;
            }
            Ok(1e6 * (change / whole).sqrt())
        },
        remedy: "as above",
    },
    Failure {
        name: "particle out of the domain",
        scene: scene_text!("stability/away"),
        measured: "particles taken out and reported, of 512",
        ideal: "512",
        duration: 0.5,
        variants: &[("apic", &[])],
        read: |o| o.summary["left_domain"].as_f64().context("no count"),
        remedy: "built in: taken out and reported, or `policy = \"bounce\"`",
    },
];
