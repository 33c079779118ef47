//! A solid of those that move together, and everything around them.

use std::time::Instant;

use super::{
    advance::{Outside, Solid},
    bonds::HeldFace,
    object::SolidObject,
    springs::SolidSpring,
};
use crate::{
    colliders::{Boundaries, Paths},
    interruption::Interruption,
    scene::Scene,
};

/// A solid of a group.
#[derive(Debug)]
pub struct Mover<'a> {
    /// Itself.
    pub solid: Solid<'a>,
    /// What the scene says of it.
    pub object: &'a SolidObject,
    /// Its number in the scene.
    pub id: usize,
    /// Friction that its surface states.
    pub friction: Option<f64>,
    /// Colliders that it may touch, by their numbers.
    pub colliders: Vec<usize>,
    /// Forces on nodes throughout the span, over the squared cell size [Pa].
    pub steady: Vec<(usize, [f32; 3])>,
    /// Springs that hold patches of it.
    pub springs: Vec<SolidSpring<'a>>,
    /// Velocity of each held node [m/s].
    pub given: Vec<[f64; 3]>,
    /// Parts of its surface that are held.
    pub faces: Vec<HeldFace<'a>>,
}

impl Mover<'_> {
    /// Does something for it, and adds the time that this takes to its own.
    pub(super) fn timed<T>(&mut self, act: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let found = act(self);
        self.solid.scratch.seconds.all += start.elapsed().as_secs_f64();
        found
    }
}

/// Everything around solids.
#[derive(Clone, Copy, Debug)]
pub struct Around<'a> {
    /// What acts everywhere.
    pub outside: Outside,
    /// Colliders [m].
    pub scene: &'a Scene,
    /// The same, placed at moments.
    pub boundaries: &'a Boundaries,
    /// Where commanded ones go during the frame.
    pub paths: &'a Paths,
    /// Start and length of the frame [s].
    pub frame: [f64; 2],
    /// Whether the frame has to end before it is done.
    pub interruption: &'a Interruption<'a>,
}
