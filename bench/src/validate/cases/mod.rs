//! The table of cases, in the order of their numbers.

mod clamped;
mod contact;
mod elastic;
mod flow;
mod output;
mod rigid;

use super::case::Group;

macro_rules! group {
    ($number:literal, $module:ident::$name:ident, $about:literal) => {
        Group {
            number: $number,
            name: stringify!($name),
            about: $about,
            cases: $module::$name,
        }
    };
}

/// All of them.
#[rustfmt::skip]
pub const ALL: [Group; 27] = [
    group!(1, elastic::cluster, "particles alone and in clusters are stable just below the closed-form limit, and not above"),
    group!(2, rigid::free_fall, "a cube thrown up and forwards flies a parabola"),
    group!(3, elastic::spinning_cube, "a cube that turns once keeps its angular momentum and its energy"),
    group!(4, elastic::bar, "a bar held at one end vibrates along itself at its own frequency"),
    group!(5, contact::disks, "two elastic disks meet and part"),
    group!(6, elastic::manufactured_cube, "a cube follows a motion that was chosen before its forces were"),
    group!(7, elastic::vortex, "the circles of a ring turn by angles that were chosen before the forces were"),
    group!(8, elastic::cantilever, "a clamped beam swings under its own weight"),
    group!(9, flow::column, "in a column at rest pressure grows with depth"),
    group!(10, rigid::incline, "a block slides down a slope, or stays, as Coulomb says"),
    group!(11, rigid::rolling, "a disk and a ball roll or slip down a slope of 45 degrees"),
    group!(12, rigid::bouncing_ball, "after n bounces a ball rises to e^(2 n) of where it fell from"),
    group!(13, contact::stickiness, "blocks that part, or pass each other without friction, keep their speed"),
    group!(14, flow::dam_break, "a column of water, twice as high as wide, runs out over the floor"),
    group!(15, flow::granular, "columns and a cylinder of sand run out as far as scaling laws say, one of rods as in its experiment"),
    group!(16, rigid::rest, "five blocks in a stack and a block on one a hundred times lighter stay where they are"),
    group!(17, contact::taylor_bar, "a copper bar that hits a wall at 227 m/s is as short and as wide as codes agree"),
    group!(18, output::fidelity, "two spinning cubes become bodies, matter again where they meet, and bodies once more"),
    group!(19, output::covariance, "the covariance a client receives is F Sigma F^T"),
    group!(20, output::determinism, "threads and instruction sets change no bit, and a session played again is the same"),
    group!(21, flow::taylor_green, "viscosity stops vortices at the rate that is exact for them"),
    group!(22, contact::hertz, "an elastic ball stays on a plane for as long as Hertz and finite elements say"),
    group!(23, flow::floating, "a block floats as deep as its weight in water"),
    group!(24, contact::oblique, "friction turns balls that meet obliquely as Coulomb says, wherever the grid lies"),
    group!(25, elastic::soft_and_stiff, "a soft block keeps its energy beside a stiff one, and throws a stiff ball up"),
    group!(26, clamped::held, "a beam that is clamped at any of its ends keeps its energy, and is its mirror image"),
    group!(27, clamped::uneven, "light matter bends under heavy matter of the same object as it should"),
];
