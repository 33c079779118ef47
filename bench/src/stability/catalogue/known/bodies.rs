//! Cases of rigid bodies.

use super::super::cases::{Case, ONCE, Reading, largest, rate};
use crate::{
    trial::scene_text,
    validate::{measures::period, report::Gate},
};

/// All of them.
pub const ALL: [Case; 9] = [
    Case {
        scene: scene_text!("stability/cases/edge_edge_1_0_05"),
        about: "crossed edges of two rigid boxes, restitution 1",
        duration: 0.1,
        files: &[],
        runs: ONCE,
        readings: &[
            Reading {
                quantity: "spin of the lower [rad/s]",
                right: -5.217,
                gate: Gate::Relative(0.02),
                read: |r| r[0].last("/objects/0/angular_velocity/2"),
            },
            Reading {
                quantity: "sideways speed of the lower [m/s]",
                right: 0.0,
                gate: Gate::Absolute(0.02),
                read: |r| r[0].last("/objects/0/linear_velocity/0"),
            },
        ],
    },
    Case {
        scene: scene_text!("stability/cases/edge_edge_0_5_0_05"),
        about: "the same, restitution 0.5",
        duration: 0.1,
        files: &[],
        runs: ONCE,
        readings: &[
            Reading {
                quantity: "spin of the lower [rad/s]",
                right: -3.913,
                gate: Gate::Relative(0.02),
                read: |r| r[0].last("/objects/0/angular_velocity/2"),
            },
            Reading {
                quantity: "sideways speed of the lower [m/s]",
                right: 0.0,
                gate: Gate::Absolute(0.02),
                read: |r| r[0].last("/objects/0/linear_velocity/0"),
            },
        ],
    },
    Case {
        scene: scene_text!("stability/cases/hoop_rigid"),
        about: "rigid ring on a peg",
        duration: 4.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "period [s]",
            right: 1.1735,
            gate: Gate::Relative(0.02),
            read: |r| Ok(period(&r[0].series("/objects/0/com/0"))),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/seesaw_left"),
        about: "plank with two rigid loads on a round bar",
        duration: 0.2,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "angular acceleration [rad/s^2]",
            right: 0.574,
            gate: Gate::Relative(0.05),
            read: |r| rate(&r[0], "/objects/0/angular_velocity/2", [0.0, 0.2]),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/plate_seam"),
        about: "rigid plate slides over the seam of two colliders",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "way to where it stops [m]",
            right: 0.680,
            gate: Gate::Relative(0.02),
            read: |r| r[0].last("/objects/0/com/0"),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/heavy_on_light_1000"),
        about: "rigid cube on one a thousand times lighter",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "height of the heavy one at the end [m]",
            right: 0.15,
            gate: Gate::Relative(0.02),
            read: |r| r[0].last("/objects/1/com/1"),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/plate_on_corks"),
        about: "steel plate on four rigid corks",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "height of the plate at the end [m]",
            right: 0.125,
            gate: Gate::Relative(0.02),
            read: |r| r[0].last("/objects/0/com/1"),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/tower_of_ten"),
        about: "ten rigid cubes, one on another",
        duration: 5.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "largest rms speed from 4 to 5 s [mm/s]",
            right: 0.0,
            gate: Gate::AtMost(1.0),
            read: |r| Ok(1e3 * (2.0 * largest(&r[0], "/kinetic_energy", [4.0, 5.0]) / 10.0).sqrt()),
        }],
    },
    Case {
        scene: scene_text!("stability/cases/turntable"),
        about: "rigid box that sticks to a turntable",
        duration: 2.0,
        files: &[],
        runs: ONCE,
        readings: &[Reading {
            quantity: "radius after 2 s [m]",
            right: 1.0,
            gate: Gate::Relative(0.001),
            read: |r| {
                Ok(r[0]
                    .last("/objects/0/com/0")?
                    .hypot(r[0].last("/objects/0/com/2")?))
            },
        }],
    },
];
