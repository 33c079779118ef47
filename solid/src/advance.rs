//! A solid through a span of time: substeps that its own tangent bounds.

use super::{
    bonds::Walls,
    frequency::{CONTACT, largest_squared_frequency},
    kernel::{Extremes, SolidLaw, Step, Tiles, substep},
    memory::remember,
    model::SolidModel,
    nodes::{Conditions, NODES, slot, write},
    search::Search,
    state::SolidState,
};
use crate::simd::{F32x16, Isa};

/// Share of the stable substep that one may have at the largest tangent of the moment, and in contact.
const STABLE: f64 = 0.9;
/// Largest squared frequency over the tangent per density and squared cell size, wherever the boundary cuts: 4 / 0.943^2.
const FASTEST: f64 = 4.5;
/// What that frequency of much deformed matter is taken for over the bound: more than 1, as nodes follow others.
const DEFORMED: f64 = 1.35;
/// One over the stiffening from which on it is taken for that.
const ONSET: f64 = 1.5;
/// Time of the viscous stress over the substep, where matter is deformed most: what keeps violent release from inverting it.
const VISCOSITY: f64 = 0.1;
/// Tangents over that at rest between which viscosity sets in: bending and falling matter stays below.
const VISCOUS: [f64; 2] = [2.5, 5.0];
/// Largest change of the deformation gradient in a substep of matter that is deformed that much: what crushes it within one
/// is not seen in time.
const CHANGE: f64 = 0.2;
/// Substeps from one look at the tangent to the next, while it is near that at rest.
const LOOK: u64 = 4;
/// Tangent over that at rest from which on every substep looks.
const WATCHED: f64 = 1.1;
/// Part of the largest tangent known that the next look keeps, of matter that flows: it stays flat, and substeps that follow every swing
/// of its tangent would feed the swing.
const KEPT: f32 = 0.999;
/// Smallest substep over that at rest: beyond it a solid fails.
const SMALLEST: f64 = 1.0 / 1024.0;

/// A solid with what it works with.
#[derive(Debug)]
pub struct Solid<'a> {
    /// What never changes of it.
    pub model: &'a SolidModel,
    /// Laws of its parts.
    pub laws: &'a [SolidLaw],
    /// Its nodes and what its matter remembers.
    pub state: &'a mut SolidState,
    /// Memory that it works in.
    pub scratch: &'a mut Scratch,
}

/// Memory that a solid works in.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Springs and forces at nodes, as blocks read them.
    pub conditions: Conditions,
    /// Forces of blocks.
    pub tiles: Tiles,
    /// Nodes whose velocity is given.
    pub held: Vec<usize>,
    /// What is known of its surroundings.
    pub search: Search,
    /// What walls hold of it.
    pub walls: Walls,
    /// Largest squared frequency about rest [1/s^2], with these laws.
    fastest: Option<(Vec<SolidLaw>, f64)>,
}

/// What acts on solids everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outside {
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// Gravity [m/s^2].
    pub gravity: [f64; 3],
    /// Rate at which velocities decay [1/s].
    pub damping: f64,
    /// Share of the stability limit that a substep uses.
    pub cfl: f64,
}

impl Scratch {
    /// For a solid that nothing holds.
    pub fn new(model: &SolidModel) -> Self {
        let blocks = model.node_blocks.len();
        let mut scratch = Self {
            conditions: Conditions {
                w: vec![[F32x16::ZERO; 4]; blocks],
                force: vec![[0.0; 4]; NODES * blocks],
                forced: vec![false; blocks],
                follows: vec![true; model.extension.outer.len()],
            },
            tiles: Tiles::new(model),
            held: vec![],
            search: Search::default(),
            walls: Walls::default(),
            fastest: None,
        };
        scratch.hold_anew(model, vec![]);
        scratch
    }

    /// Lets go of all nodes but these.
    pub fn hold(&mut self, model: &SolidModel, held: Vec<usize>) {
        if held != self.held {
            self.hold_anew(model, held);
        }
    }

    fn hold_anew(&mut self, model: &SolidModel, held: Vec<usize>) {
        for block in 0..model.node_blocks.len() {
            for x in 0..4 {
                for lane in 0..16 {
                    let mass = model.mass[slot(block, [x, lane])];
                    let w = if mass > 0.0 { model.dx / mass } else { 0.0 };
                    self.conditions.w[block][x].0[lane] = w as f32;
                }
            }
        }
        for &n in &held {
            self.conditions.w[n / NODES][n / 16 % 4].0[n % 16] = 0.0;
        }
        let outer = model.extension.outer.iter();
        for (&slot, follows) in outer.zip(&mut self.conditions.follows) {
            *follows = !held.contains(&(slot as usize));
        }
        self.held = held;
        self.walls.restart();
    }
}

impl Solid<'_> {
    /// Tangent over density at rest [m^2/s^2].
    fn tangent_at_rest(&self) -> f64 {
        let laws = self.laws.iter();
        laws.map(|law| law.tangent_at_rest() / law.density)
            .fold(0.0, f64::max)
    }

    /// Speed that no wave in it at rest exceeds [m/s].
    pub(super) fn sound_at_rest(&self) -> f64 {
        self.tangent_at_rest().sqrt()
    }

    /// Tangent at rest of the stiffest of it [Pa].
    pub fn modulus(&self) -> f64 {
        let laws = self.laws.iter();
        laws.map(SolidLaw::tangent_at_rest).fold(0.0, f64::max)
    }

    /// Present tangent over that at rest, at least 1.
    fn stiffening(&self) -> f64 {
        (f64::from(self.state.tangent) / self.tangent_at_rest()).max(1.0)
    }

    /// Whether points of it remember flow.
    fn flows(&self) -> bool {
        self.state.memory.iter().any(|block| !block.is_empty())
    }

    /// Share of the largest viscosity that it has at present.
    fn viscous_share(&self) -> f64 {
        let beyond = (self.stiffening() - VISCOUS[0]) / (VISCOUS[1] - VISCOUS[0]);
        beyond.clamp(0.0, 1.0)
    }

    /// Largest squared frequency of its motions [1/s^2]: at rest, and now.
    fn frequencies(&self) -> [f64; 2] {
        let at_rest = FASTEST * self.tangent_at_rest() / (self.model.dx * self.model.dx);
        let measured = match &self.scratch.fastest {
            Some((laws, fastest)) if laws == self.laws => *fastest,
            _ => at_rest,
        };
        // What was measured holds for matter that is near rest; the bound holds for what is not.
        let (share, stiffening) = (measured / at_rest, self.stiffening());
        let share = share + (DEFORMED - share).max(0.0) * (ONSET * (stiffening - 1.0)).min(1.0);
        [measured, at_rest * share * stiffening]
    }

    /// Largest substep now [s]: that at rest by a power of the eighth root of one half, so that it seldom changes.
    pub fn limit(&self, cfl: f64) -> f64 {
        let [at_rest, now] = self.frequencies();
        let rest = 2.0 * cfl / at_rest.sqrt();
        let touching = match self.scratch.search.touched {
            true => CONTACT * self.tangent_at_rest() / (self.model.dx * self.model.dx),
            false => 0.0,
        };
        // A viscous stress over a time `t` takes about `omega t / 2` of the stable substep.
        let viscous = 1.0 - VISCOSITY * self.viscous_share();
        let sound = 2.0 * STABLE * viscous / (now + touching).sqrt();
        let bound = sound.min(CHANGE / f64::from(self.state.rate));
        let mut limit = rest;
        while limit > bound && limit > SMALLEST * rest {
            limit *= 0.5_f64.powf(0.125);
        }
        limit
    }

    /// Whether the frame moves with the solid: nothing holds it in the world.
    fn is_free(&self) -> bool {
        self.scratch.held.is_empty()
    }

    /// Before a span, the first of a frame or another: the frame moves with the solid, or stands where nodes are held. `given` is the velocity of a held node
    /// by its place in the list [m/s].
    pub fn begin(
        &mut self,
        outside: &Outside,
        begins_frame: bool,
        given: impl Fn(usize) -> [f64; 3],
    ) {
        remember(self.model, self.laws, &mut self.state.memory);
        if self.state.tangent == 0.0 {
            // Nothing is known of it yet: a substep of no length looks.
            self.substep(outside, 0.0, 0.0, 0);
        }
        self.measure(outside.isa);
        self.place_frame(begins_frame, given);
        self.scratch.tiles.look_at(&self.state.nodes);
    }

    fn place_frame(&mut self, begins_frame: bool, given: impl Fn(usize) -> [f64; 3]) {
        if begins_frame {
            self.scratch.search.restart();
        }
        // The first substep is chosen before anything is looked for: what was in contact last is taken for being so.
        // Walls that bind hold no energy, and make nothing faster.
        let mut springs = self.state.springs.iter();
        self.scratch.search.touched |= springs.any(|grip| grip.energy > 0.0);
        if self.is_free() {
            if begins_frame {
                self.state.recentre(self.model);
            }
            return;
        }
        self.state.set_frame_velocity(self.model, [0.0; 3]);
        self.state.velocity = [0.0; 3];
        for (n, &slot) in self.scratch.held.iter().enumerate() {
            let v = given(n).map(|v| (v / self.model.dx) as f32);
            write(&mut self.state.nodes[slot / NODES].v, slot, v);
        }
    }

    /// Measures its fastest motion, if that is not known for its laws.
    fn measure(&mut self, isa: Isa) {
        let known = self.scratch.fastest.as_ref();
        if known.is_some_and(|(laws, _)| laws == self.laws) {
            return;
        }
        // Nothing is held, and nothing acts.
        let Scratch {
            conditions,
            mut tiles,
            ..
        } = Scratch::new(self.model);
        let fastest =
            largest_squared_frequency(isa, self.model, self.laws, &conditions, &mut tiles);
        self.scratch.fastest = Some((self.laws.to_vec(), fastest));
    }

    /// Takes a substep in which forces act for `kick` [s], and nodes move for `drift` [s] after that.
    pub fn substep(&mut self, outside: &Outside, kick: f64, drift: f64, index: u64) -> Extremes {
        let keep = (-outside.damping * kick).exp();
        let free = self.is_free();
        if free {
            for a in 0..3 {
                let v = &mut self.state.velocity[a];
                *v = keep * (*v + kick * outside.gravity[a]);
                self.state.shift[a] += drift * *v;
            }
        }
        let (stiffening, share) = (self.stiffening(), self.viscous_share());
        let step = Step {
            kick: kick as f32,
            drift: drift as f32,
            keep: keep as f32,
            gravity: match free {
                true => [0.0; 3],
                false => outside.gravity.map(|g| (g / self.model.dx) as f32),
            },
            viscosity: (VISCOSITY * share * kick) as f32,
            wants_extremes: index.is_multiple_of(LOOK) || stiffening > WATCHED || drift == 0.0,
        };
        let Scratch {
            conditions,
            tiles,
            search,
            ..
        } = &mut *self.scratch;
        let found = substep(
            outside.isa,
            self.model,
            self.laws,
            conditions,
            self.state.moving(),
            tiles,
            &step,
        );
        let scale = drift * self.model.dx;
        let ways = tiles.speeds.iter().map(|&speed| scale * f64::from(speed));
        search.move_on(ways);
        if step.wants_extremes {
            let kept = if self.flows() {
                KEPT * self.state.tangent
            } else {
                0.0
            };
            (self.state.tangent, self.state.rate) = (found.tangent.max(kept), found.rate);
        }
        found
    }
}

/// Substeps of a span of time, all of equal length but where limits change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shares {
    /// What is left [s].
    pub remaining: f64,
    /// The substep at hand [s].
    pub dt: f64,
    /// Substeps so far.
    pub taken: u64,
}

impl Shares {
    /// The first of a span [s] > 0.
    pub fn first(length: f64, limit: f64) -> Self {
        Self {
            remaining: length,
            dt: share(length, limit),
            taken: 0,
        }
    }

    /// Goes on to the next, and how long forces act between the two [s]; none at the end of the span.
    pub fn next(&mut self, limit: f64) -> Option<f64> {
        let before = self.dt;
        self.remaining -= before;
        self.taken += 1;
        // Less than any substep: what rounding left.
        if self.remaining <= 1e-9 * before {
            return None;
        }
        self.dt = share(self.remaining, limit);
        Some(0.5 * (before + self.dt))
    }
}

fn share(length: f64, limit: f64) -> f64 {
    length / (length / limit - 1e-6).ceil().max(1.0)
}
