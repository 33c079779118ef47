//! Springs that hold patches of a solid: they pull its particles, and nodes bear that.

use super::{advance::Solid, model::CellPoint, nodes::Bears, object::SolidObject};
use crate::{
    colliders::{
        Substep,
        springs::{Given, Spring},
    },
    mat3::dot,
};

/// A spring on particles of a solid.
#[derive(Debug)]
pub struct SolidSpring<'a> {
    spring: &'a Spring,
    points: Vec<BornePoint<'a>>,
    /// What they were given in the span.
    pub given: Given,
}

/// A particle of a patch.
#[derive(Debug)]
struct BornePoint<'a> {
    site: &'a CellPoint,
    /// Nodes that bear what acts on it, with weights.
    bears: Bears,
    /// Its place from the centre of the patch [m].
    place: [f64; 3],
    /// Its mass [kg].
    mass: f64,
    /// Impulse of the kick at hand [N s].
    impulse: [f64; 3],
    /// Its velocity before that [m/s].
    before: [f64; 3],
}

impl<'a> SolidSpring<'a> {
    /// A spring on particles of a solid, which are the scene's from `first` on.
    pub fn new(spring: &'a Spring, solid: &'a SolidObject, first: usize) -> Self {
        let points = spring.held().map(|held| {
            let site = &solid.particles[held.id as usize - first];
            let stencil = solid.grid.stencil_at(site);
            BornePoint {
                site,
                bears: stencil.map(|(slot, weight)| (slot as u32, weight as f32)),
                place: held.place,
                mass: held.mass,
                impulse: [0.0; 3],
                before: [0.0; 3],
            }
        });
        Self {
            spring,
            points: points.collect(),
            given: Given::default(),
        }
    }

    /// Pushes particles by what the spring has in the kick of a substep.
    pub fn push(&mut self, solid: &mut Solid<'_>, now: &Substep) {
        if now.kick <= 0.0 {
            return;
        }
        let kick = self.spring.kick(now);
        for point in &mut self.points {
            let x = solid.state.sample(solid.model, point.site).x;
            let (v, _) = solid.state.velocity_at(solid.model, point.site);
            let change = self.spring.change(&kick, point.place, x, v);
            point.impulse = change.map(|dv| point.mass * dv);
            point.before = v;
            solid.push(&point.bears, point.impulse.map(|j| j / now.kick));
        }
    }

    /// Takes note of the velocities after a kick.
    pub fn settle(&mut self, solid: &Solid<'_>) {
        for point in &mut self.points {
            let (after, _) = solid.state.velocity_at(solid.model, point.site);
            let impulse = std::mem::take(&mut point.impulse);
            let mean = std::array::from_fn(|a| 0.5 * (point.before[a] + after[a]));
            self.given.add(&Given {
                impulse,
                work: dot(impulse, mean),
            });
        }
    }
}
