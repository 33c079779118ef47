//! Cases of how matter deforms, vibrates, rests and floats.

use super::super::cases::{Case, ONCE, Reading, apart, largest, less, rate};
use crate::{
    trial::{Outcome, scene_text},
    validate::{measures::period, report::Gate},
};

/// Angular momentum of a bar about its length over that of a solid one of its width at 3 rad/s.
fn spin_over(run: &Outcome) -> anyhow::Result<f64> {
    let inertia = run.last("/objects/0/mass")? * 0.05_f64.powi(2) / 6.0;
    Ok(run.last("/objects/0/angular_momentum/0")? / (3.0 * inertia))
}

/// All of them.
pub const ALL: [Case; 15] = [
    Case {
        scene: scene_text!("stability/cases/axial_8"),
        about: "free bar, eight cells a wave",
        duration: 0.05,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "period over that of the bar",
            right: 1.0,
            gate: Gate::Relative(0.04),
            read: |r| {
                Ok(period(&less(&r[0], "/probes/end/position/0", 0.992_187_5))
                    * 4.0
                    * 1000_f64.sqrt())
            },
        }],
    },
    Case {
        scene: scene_text!("stability/cases/spin_inertia_lagrangian_2"),
        about: "bar of two cells that spins about its length",
        duration: 0.05,
        files: &[],
        runs: ONCE,
        readings: &[
            Reading {
                quantity: "angular momentum over that of the bar",
                right: 1.0,
                gate: Gate::Relative(0.01),
                read: |r| spin_over(&r[0]),
            },
            Reading {
                quantity: "spin told [rad/s]",
                right: 3.0,
                gate: Gate::Relative(0.01),
                read: |r| r[0].last("/objects/0/angular_velocity/0"),
            },
        ],
    },
    Case {
        scene: scene_text!("stability/cases/spin_inertia_lagrangian_4"),
        about: "the same of four cells",
        duration: 0.05,
        files: &[],
        runs: ONCE,
        readings: &[
            Reading {
                quantity: "angular momentum over that of the bar",
                right: 1.0,
                gate: Gate::Relative(0.01),
                read: |r| spin_over(&r[0]),
            },
            Reading {
                quantity: "spin told [rad/s]",
                right: 3.0,
                gate: Gate::Relative(0.01),
                read: |r| r[0].last("/objects/0/angular_velocity/0"),
            },
        ],
    },
    Case {
        scene: scene_text!("stability/cases/torsion_free_2"),
        about: "free square bar of two cells that twists",
        duration: 0.5,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "period [s]",
            right: 0.1110,
            gate: Gate::Relative(0.05),
            read: |r| Ok(period(&less(&r[0], "/probes/end/position/2", -0.0125))),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/torsion_free_4"),
        about: "the same of four cells",
        duration: 0.5,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "period [s]",
            right: 0.1110,
            gate: Gate::Relative(0.015),
            read: |r| Ok(period(&less(&r[0], "/probes/end/position/2", -0.00625))),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/near_incompressible_2_0_499"),
        about: "clamped beam of two cells, nu 0.499",
        duration: 4.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "deflection of its tip [mm]",
            right: 11.93,
            gate: Gate::Relative(0.08),
            read: |r| Ok(-1e3 * (r[0].last("/probes/tip/position/1")? + 0.25 * 0.05)),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/near_incompressible_4_0_49"),
        about: "the same of four cells, nu 0.49",
        duration: 4.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "deflection of its tip [mm]",
            right: 12.03,
            gate: Gate::Relative(0.04),
            read: |r| Ok(-1e3 * (r[0].last("/probes/tip/position/1")? + 0.25 * 0.025)),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/sphere_on_pad_4"),
        about: "heavy rigid ball on a bonded pad of four cells",
        duration: 1.5,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "how deep it sinks in (Dimitriadis) [mm]",
            right: 15.0,
            gate: Gate::Relative(0.05),
            read: |r| Ok(1e3 * (0.7 - r[0].last("/objects/1/com/1")?)),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/coherence"),
        about: "bar whose vibration is damped while it spins",
        duration: 1.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "spin told [rad/s]",
            right: 3.0,
            gate: Gate::Relative(0.002),
            read: |r| r[0].last("/objects/0/angular_velocity/0"),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/comes_to_rest"),
        about: "elastic ball dropped from its radius",
        duration: 3.0,
        files: &[],
        runs: &[&[], &[("objects.0.fidelity", "\"auto\"")]],
        readings: &[
            Reading {
                quantity: "`mpm`: largest kinetic energy from 2.5 to 3 s, over m g R",
                right: 0.0,
                gate: Gate::AtMost(1e-4),
                read: |r| Ok(largest(&r[0], "/kinetic_energy", [2.5, 3.0]) / 4.109),
            },
            Reading {
                quantity: "`auto`: the same",
                right: 0.0,
                gate: Gate::AtMost(1e-4),
                read: |r| Ok(largest(&r[1], "/kinetic_energy", [2.5, 3.0]) / 4.109),
            },
        ],
    },
    Case {
        scene: scene_text!("stability/cases/auto_shelf"),
        about: "ball knocks on four blocks, `auto` against `mpm`",
        duration: 1.5,
        files: &[],
        runs: &[
            &[],
            &[
                ("objects.0.fidelity", "\"auto\""),
                ("objects.1.fidelity", "\"auto\""),
                ("objects.2.fidelity", "\"auto\""),
                ("objects.3.fidelity", "\"auto\""),
                ("objects.4.fidelity", "\"auto\""),
            ],
        ],
        readings: &[Reading {
            quantity: "largest distance of paths, over the radius",
            right: 0.0,
            gate: Gate::AtMost(0.02),
            read: |r| Ok(apart(r)? / 0.05),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/auto_drop"),
        about: "ball drops on a floor, `auto` against `mpm`",
        duration: 1.0,
        files: &[],
        runs: &[&[], &[("objects.0.fidelity", "\"auto\"")]],
        readings: &[Reading {
            quantity: "largest distance of paths, over the radius",
            right: 0.0,
            gate: Gate::AtMost(0.02),
            read: |r| Ok(apart(r)? / 0.1),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/buoyancy_spatial"),
        about: "block of half the density in water, both on the spatial grid",
        duration: 3.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "speed at which it rises from 2 to 3 s [cells/s]",
            right: 0.0,
            gate: Gate::Absolute(0.02),
            read: |r| Ok(rate(&r[0], "/objects/1/com/1", [2.0, 3.0])? / 0.02),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/buoyancy_lagrangian"),
        about: "the same, the block on a grid of its own",
        duration: 3.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "speed at which it rises from 2 to 3 s [cells/s]",
            right: 0.0,
            gate: Gate::Absolute(0.02),
            read: |r| Ok(rate(&r[0], "/objects/1/com/1", [2.0, 3.0])? / 0.02),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/cup_lagrangian"),
        about: "water in an elastic cup",
        duration: 1.5,
        files: &[(
            "cup.obj",
            include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../scenes/stability/cases/cup.obj"
            )),
        )],
        runs: ONCE,
        readings: &[Reading {
            quantity: "rise of its level from 0.5 to 1.5 s [cells]",
            right: 0.0,
            gate: Gate::Absolute(0.1),
            read: |r| Ok(rate(&r[0], "/probes/most/max/1", [0.5, 1.5])? / 0.015),
        }],
    },
];
