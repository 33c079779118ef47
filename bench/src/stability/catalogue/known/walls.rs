//! Cases of matter at colliders.

use anyhow::Context;

use super::super::cases::{Case, ONCE, Reading, energy_over_first, energy_rise, largest, rate};
use crate::{
    trial::{Outcome, scene_text},
    validate::report::Gate,
};

/// Friction on a block with `mu = 0.4` over `mu` times its weight, by its acceleration under gravity along the bed and across it [m/s^2].
fn friction(run: &Outcome, [along, across]: [f64; 2]) -> anyhow::Result<f64> {
    let gains = rate(run, "/objects/0/linear_velocity/0", [0.1, 1.0])?;
    Ok((along - gains) / (0.4 * across))
}

/// Objects whose centre is farther than so much [m] from the middle of the jar along any axis.
fn outside(run: &Outcome, reach: f64) -> anyhow::Result<f64> {
    let objects = run
        .frames
        .last()
        .and_then(|frame| frame["objects"].as_array());
    let far = objects.context("no objects")?.iter().filter(|object| {
        let at = |axis: usize| object["com"][axis].as_f64().unwrap_or(f64::INFINITY);
        (0..3).any(|axis| at(axis).abs() > reach)
    });
    Ok(far.count() as f64)
}

/// Energy never rises.
const ENERGY_STAYS: Reading = Reading {
    quantity: "largest energy over that at first",
    right: 1.0,
    gate: Gate::AtMost(1.002),
    read: energy_over_first,
};

/// What is read of a ball that meets a thin wall 0.1 m from the origin, with cells of 0.0125 m.
const AT_WALL: &[Reading] = &[
    Reading {
        quantity: "farthest particle behind the front of the wall at the end [dx]",
        right: 0.0,
        gate: Gate::AtMost(0.5),
        read: |r| Ok((r[0].last("/probes/ball/max/0")? - 0.1) / 0.0125),
    },
    ENERGY_STAYS,
];

/// All of them.
pub const ALL: [Case; 18] = [
    Case {
        scene: scene_text!("stability/cases/thin_wall_1e06_1_0_08"),
        about: "ball on a wall of 0.08 cells, v / c = 0.03",
        duration: 0.3,
        files: &[],
        runs: ONCE,
        readings: AT_WALL,
    },
    Case {
        scene: scene_text!("stability/cases/thin_wall_1e06_3_0_4"),
        about: "ball on a wall of 0.4 cells, v / c = 0.09",
        duration: 0.2,
        files: &[],
        runs: ONCE,
        readings: AT_WALL,
    },
    Case {
        scene: scene_text!("stability/cases/thin_wall_500000_5_1"),
        about: "ball on a wall of one cell, v / c = 0.2",
        duration: 0.2,
        files: &[],
        runs: ONCE,
        readings: AT_WALL,
    },
    Case {
        scene: scene_text!("stability/cases/fast_wall_solid"),
        about: "ball on a wall of 0.08 cells, v / c = 0.6",
        duration: 0.005,
        files: &[],
        runs: ONCE,
        readings: &[
            Reading {
                quantity: "farthest particle behind the front of the wall at the end [dx]",
                right: 0.0,
                gate: Gate::AtMost(0.5),
                read: |r| Ok((r[0].last("/probes/ball/max/0")? - 0.5995) / 0.0125),
            },
            ENERGY_STAYS,
        ],
    },
    Case {
        scene: scene_text!("stability/cases/bounce_walls_0_02"),
        about: "frictionless cube between two walls",
        duration: 3.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "largest energy over that at first",
            right: 1.0,
            gate: Gate::AtMost(1.002),
            read: energy_over_first,
        }],
    },
    Case {
        scene: scene_text!("stability/cases/bounce_floor_0_02"),
        about: "frictionless cube on a floor",
        duration: 6.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "largest energy over that at first",
            right: 1.0,
            gate: Gate::AtMost(1.002),
            read: energy_over_first,
        }],
    },
    Case {
        scene: scene_text!("stability/cases/tight_solid"),
        about: "elastic block in a spinning rigid shell",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "largest rise of the energy, over that at first",
            right: 0.0,
            gate: Gate::AtMost(0.002),
            read: |r| {
                let [rise, first] = energy_rise(&r[0], 0.0)?;
                Ok(rise / first)
            },
        }],
    },
    Case {
        scene: scene_text!("stability/cases/jar"),
        about: "twelve things in a jar, shaken for 2 s and left for 1 s",
        duration: 3.0,
        files: &[],
        runs: ONCE,
        readings: &[
            Reading {
                quantity: "largest rise of the energy after that, over motion and strain at 2 s",
                right: 0.0,
                gate: Gate::AtMost(0.002),
                read: |r| {
                    let [rise, first] = energy_rise(&r[0], 2.0)?;
                    Ok(rise / first)
                },
            },
            Reading {
                quantity: "things outside at the end",
                right: 0.0,
                gate: Gate::AtMost(0.0),
                read: |r| outside(&r[0], 0.21),
            },
        ],
    },
    Case {
        scene: scene_text!("stability/cases/slope_creep_0_0125_100000"),
        about: "block of 1e5 Pa on a slope of 33 degrees that it should stick to",
        duration: 3.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "speed from 1 to 3 s [cells/s]",
            right: 0.0,
            gate: Gate::AtMost(0.01),
            read: |r| Ok(rate(&r[0], "/objects/0/com/0", [1.0, 3.0])? / 0.0125),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/slope_creep_0_0125_1e06"),
        about: "the same of 1e6 Pa",
        duration: 3.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "speed from 1 to 3 s [cells/s]",
            right: 0.0,
            gate: Gate::AtMost(0.01),
            read: |r| Ok(rate(&r[0], "/objects/0/com/0", [1.0, 3.0])? / 0.0125),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/wedge_rigid_on_solid_1_05"),
        about: "rigid block on a solid bed, leaning 5 % beyond the threshold",
        duration: 1.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "friction over mu times its weight",
            right: 1.0,
            gate: Gate::Relative(0.01),
            read: |r| friction(&r[0], [3.798_750_671_523_450_7, 9.044_644_456_008_216]),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/wedge_rigid_on_solid_1_5"),
        about: "the same, 50 % beyond",
        duration: 1.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "friction over mu times its weight",
            right: 1.0,
            gate: Gate::Relative(0.01),
            read: |r| friction(&r[0], [5.047_203_360_744_036, 8.412_005_601_240_057]),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/starts_inside_10mm"),
        about: "block that starts 10 mm inside its floor",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "how far it is thrown up [mm]",
            right: 0.0,
            gate: Gate::AtMost(1.0),
            read: |r| Ok(1e3 * (largest(&r[0], "/objects/0/com/1", [0.0, 2.0]) - 0.1)),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/starts_inside_100mm"),
        about: "the same, 100 mm",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "how far it is thrown up [mm]",
            right: 0.0,
            gate: Gate::AtMost(1.0),
            read: |r| Ok(1e3 * (largest(&r[0], "/objects/0/com/1", [0.0, 2.0]) - 0.1)),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/heavy_on_floor"),
        about: "soft heavy block on a floor",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "lowest particle over the floor [dx]",
            right: 0.25,
            gate: Gate::AtLeast(0.0),
            read: |r| Ok(r[0].last("/probes/box/min/1")? / 0.05),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/lift_500"),
        about: "two pads lift a soft block by 60 mm",
        duration: 1.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "how far it stays behind them [mm]",
            right: 1.5,
            gate: Gate::AtMost(2.5),
            read: |r| Ok(60.0 - 600.0 * rate(&r[0], "/objects/0/com/2", [0.3499, 0.9501])?),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/lift_200_beside_sand"),
        about: "the same beside sand",
        duration: 1.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "how far it stays behind them [mm]",
            right: 1.5,
            gate: Gate::AtMost(2.5),
            read: |r| Ok(60.0 - 600.0 * rate(&r[0], "/objects/0/com/2", [0.3499, 0.9501])?),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/belt_beside_sand"),
        about: "soft block on a belt of 0.2 m/s beside sand",
        // The belt sets it trembling, with a period of 0.075 s, which a mean must cover many times.
        duration: 1.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "speed at which it is carried [m/s]",
            right: 0.2,
            gate: Gate::Relative(0.02),
            read: |r| rate(&r[0], "/objects/0/com/0", [0.4, 1.0]),
        }],
    },
];
