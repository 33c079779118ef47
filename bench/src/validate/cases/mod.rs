//! The cases, in the order of their numbers.

mod bar;
mod bouncing_ball;
mod cantilever;
mod cluster;
mod column;
mod covariance;
mod dam_break;
mod determinism;
mod disks;
mod fidelity;
mod fit;
mod floating;
mod free_fall;
mod granular;
mod hertz;
mod incline;
mod manufactured_cube;
mod oblique;
mod rest;
mod rolling;
mod spinning_cube;
mod stickiness;
mod taylor_bar;
mod taylor_green;
mod vortex;

use super::Case;

/// All of them.
pub const ALL: [&Case; 24] = [
    &cluster::CASE,
    &free_fall::CASE,
    &spinning_cube::CASE,
    &bar::CASE,
    &disks::CASE,
    &manufactured_cube::CASE,
    &vortex::CASE,
    &cantilever::CASE,
    &column::CASE,
    &incline::CASE,
    &rolling::CASE,
    &bouncing_ball::CASE,
    &stickiness::CASE,
    &dam_break::CASE,
    &granular::CASE,
    &rest::CASE,
    &taylor_bar::CASE,
    &fidelity::CASE,
    &covariance::CASE,
    &determinism::CASE,
    &taylor_green::CASE,
    &hertz::CASE,
    &floating::CASE,
    &oblique::CASE,
];
