//! A solid through a span of time: substeps that its own tangent bounds.

use super::{
    bonds::Walls,
    dissipation::{Dissipation, Vibration},
    frequency::{Pressed, Vibrating},
    kernel::{Extremes, Moving, SolidLaw, Step, Tiles, substep},
    limit::{Deformed, Motions, VISCOSITY},
    memory::remember,
    model::SolidModel,
    nodes::{Conditions, NODES, NodeBlock, slot, write},
    search::Search,
    state::SolidState,
    surface::SurfacePoint,
};
use crate::{
    mat3::length,
    simd::{F32x16, Isa},
    timed,
};

/// Substeps from one look at the tangent to the next, while it is near that at rest.
const LOOK: u64 = 4;
/// Tangent over that at rest from which on every substep looks.
const WATCHED: f64 = 1.6;
/// Part of the largest tangent known that the next look keeps, of matter that flows: it stays flat, and substeps that follow every swing
/// of its tangent would feed the swing.
const KEPT: f32 = 0.999;
/// Speed of nodes in the solid's frame over that of sound from which on their gradient is looked at.
const FAST: f64 = 0.4;
/// Depth that contact may come to in the substep in which it begins [cells]: with a whole cell blocks that met at 40 m/s came away with
/// almost three times their energy, with 0.4 with what finer substeps leave them.
const DEEPENS: f64 = 0.4;

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
    /// How fast its motions are.
    pub(super) motions: Motions,
    /// What its matter loses.
    pub dissipation: Dissipation,
    /// Its state where the span at hand began, if that may be undone.
    pub before: Option<SolidState>,
    /// Processor time that it took [s]: all of it, and what of that measured its fastest motions.
    pub seconds: Seconds,
}

/// Processor time of a solid [s].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seconds {
    /// Of all that was done for it.
    pub all: f64,
    /// Of measuring its fastest motions, which bound substeps, and its first mode.
    pub measuring: f64,
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
            motions: Motions::default(),
            dissipation: Dissipation::default(),
            before: None,
            seconds: Seconds::default(),
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
        self.search.ended = None;
    }
}

impl<'a> Solid<'a> {
    fn deformed(&self) -> Deformed<'a> {
        Deformed {
            model: self.model,
            laws: self.laws,
            tangent: self.state.tangent.into(),
            rate: self.state.rate.into(),
            at_once: self.scratch.dissipation.at_once(),
        }
    }

    /// Speed that no wave in it at rest exceeds [m/s].
    pub(super) fn sound_at_rest(&self) -> f64 {
        self.deformed().tangent_at_rest().sqrt()
    }

    /// Tangent at rest of the stiffest of it [Pa].
    pub fn modulus(&self) -> f64 {
        let laws = self.laws.iter();
        laws.map(SolidLaw::tangent_at_rest).fold(0.0, f64::max)
    }

    /// Whether points of it remember flow.
    fn flows(&self) -> bool {
        self.state.memory.iter().any(|block| !block.is_empty())
    }

    /// Largest substep now [s], after one of `drift` [s].
    pub fn limit(&self, cfl: f64, drift: f64) -> f64 {
        let Scratch {
            motions, search, ..
        } = &*self.scratch;
        let [by_motions, smallest] = motions.limit(&self.deformed(), search.contact, cfl);
        let by_contact = search.limit(DEEPENS * self.model.dx, drift, by_motions);
        by_contact.max(smallest)
    }

    /// Expects to meet something in a frame that begins.
    pub fn expect_contact(&mut self) {
        let speed = length(self.state.velocity) + self.fastest();
        // The other may be as fast.
        self.scratch.search.expect(2.0 * speed);
    }

    /// Measures its fastest motion about rest, if that is not known for its laws.
    fn measure_at_rest(&mut self, isa: Isa, (points, stiffness): (&[SurfacePoint], &[f64])) {
        if self.scratch.motions.knows(self.laws) {
            return;
        }
        let Scratch {
            mut conditions,
            mut tiles,
            ..
        } = Scratch::new(self.model);
        let surface = Pressed {
            points,
            stiffness,
            tangent: self.modulus(),
        };
        let rest = vec![NodeBlock::REST; self.model.node_blocks.len()];
        let vibrating = Vibrating {
            isa,
            model: self.model,
            laws: self.laws,
            conditions: &mut conditions,
            pressed: None,
            tiles: &mut tiles,
            about: &rest,
        };
        let motions = &mut self.scratch.motions;
        motions.measure_at_rest(vibrating, surface);
    }

    /// Measures it where it is, if that is worth it; whether it is known then.
    fn measure_now(&mut self, isa: Isa, deformed: &Deformed<'_>, shares: &Shares) -> bool {
        let Scratch {
            conditions,
            tiles,
            search,
            motions,
            ..
        } = &mut *self.scratch;
        let vibrating = Vibrating {
            isa,
            model: self.model,
            laws: self.laws,
            conditions,
            pressed: None,
            tiles,
            about: &self.state.nodes,
        };
        motions.measure_now(deformed, search.contact, shares.remaining, vibrating)
    }

    /// Whether the frame moves with the solid: nothing holds it in the world.
    pub(super) fn is_free(&self) -> bool {
        self.scratch.held.is_empty()
    }

    /// Before a span, the first of a frame or another: the frame moves with the solid, or stands where nodes are held. `given` is the velocity of a held node
    /// by its place in the list [m/s]; the surface is its own.
    pub fn begin(
        &mut self,
        outside: &Outside,
        surface: (&[SurfacePoint], &[f64]),
        begins_frame: bool,
        given: impl Fn(usize) -> [f64; 3],
    ) {
        remember(self.model, self.laws, &mut self.state.memory);
        let mut seconds = self.scratch.seconds.measuring;
        timed(&mut seconds, || {
            self.measure_at_rest(outside.isa, surface);
            let Scratch {
                dissipation,
                held,
                conditions,
                ..
            } = &mut *self.scratch;
            dissipation.find_first_mode(self.model, self.laws, (held, conditions));
        });
        self.scratch.seconds.measuring = seconds;
        if self.state.tangent == 0.0 {
            // Nothing is known of it yet: a substep of no length looks.
            self.substep(outside, [0.0; 2], &Shares::NONE, false);
        }
        self.place_frame(begins_frame, given);
        self.scratch.tiles.look_at(&self.state.nodes);
    }

    fn place_frame(&mut self, begins_frame: bool, given: impl Fn(usize) -> [f64; 3]) {
        if begins_frame {
            self.scratch.search.restart();
            self.scratch.motions.restart();
        }
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
            let block = &mut self.state.nodes[slot / NODES];
            write(&mut block.v, slot, v);
            write(&mut block.p, slot, v);
        }
    }

    /// Takes a substep in which forces act for `kick` [s], and nodes move for `drift` [s] after that. What `stands` has not moved since
    /// the substep before.
    pub(crate) fn substep(
        &mut self,
        outside: &Outside,
        [kick, drift]: [f64; 2],
        shares: &Shares,
        stands: bool,
    ) -> Extremes {
        let vibration = Vibration {
            state: self.state,
            held: &self.scratch.held,
        };
        self.scratch.dissipation.look(&vibration, kick);
        let keep = (-outside.damping * kick).exp();
        let (free, deformed) = (self.is_free(), self.deformed());
        if free {
            for a in 0..3 {
                let v = &mut self.state.velocity[a];
                *v = keep * (*v + kick * outside.gravity[a]);
                self.state.shift[a] += drift * *v;
            }
        }
        let (stiffening, share) = (deformed.stiffening(), deformed.viscous_share());
        let (is_fast, flows) = (self.is_fast(), self.flows());
        let viscosity = VISCOSITY * share * kick;
        // Those that depend on velocities are others now.
        let knows_forces = stands && !flows && !is_fast && viscosity == 0.0;
        let mut step = Step {
            kick: kick as f32,
            drift: drift as f32,
            keep: keep as f32,
            gravity: match free {
                true => [0.0; 3],
                false => outside.gravity.map(|g| (g / self.model.dx) as f32),
            },
            viscosity: viscosity as f32,
            wants_extremes: !knows_forces
                && (shares.taken.is_multiple_of(LOOK) || stiffening > WATCHED || drift == 0.0),
            wants_rate: is_fast,
            knows_forces,
        };
        if step.wants_extremes && drift > 0.0 && !flows {
            let mut seconds = self.scratch.seconds.measuring;
            step.wants_rate |= timed(&mut seconds, || {
                self.measure_now(outside.isa, &deformed, shares)
            });
            self.scratch.seconds.measuring = seconds;
        }
        let Scratch {
            conditions,
            tiles,
            search,
            dissipation,
            ..
        } = &mut *self.scratch;
        let state = &mut *self.state;
        let blocks = state.nodes.len();
        let moving = Moving {
            nodes: &mut state.nodes,
            memory: &mut state.memory,
            relaxing: dissipation.relaxing(&mut state.relaxed, blocks, kick),
        };
        let found = substep(
            outside.isa,
            self.model,
            self.laws,
            conditions,
            moving,
            tiles,
            &step,
        );
        dissipation.lost += found.lost;
        let scale = drift * self.model.dx;
        let ways = tiles.speeds.iter().map(|&speed| scale * f64::from(speed));
        search.move_on(ways);
        self.note(&found, &step, (is_fast, flows));
        found
    }

    /// Takes note of what a substep found, of matter that is fast, or flows.
    fn note(&mut self, found: &Extremes, step: &Step, (is_fast, flows): (bool, bool)) {
        let at_rest = self.deformed().tangent_at_rest();
        let Scratch { tiles, motions, .. } = &mut *self.scratch;
        let looked = step.wants_extremes;
        let counts = step.viscosity > 0.0 || is_fast;
        let growth = motions.note(&tiles.sums, found, looked);
        if let Some(growth) = growth {
            let tangent = (growth * at_rest) as f32;
            let kept = if flows {
                KEPT * self.state.tangent
            } else {
                0.0
            };
            self.state.tangent = tangent.max(kept);
        }
        if counts || looked {
            self.state.rate = if counts { found.rate } else { 0.0 };
        }
    }

    /// Books what matter loses in the second half of a kick [s], after walls have bound it.
    pub(super) fn book_loss(&mut self, kick: f64) {
        let Scratch {
            tiles, dissipation, ..
        } = &mut *self.scratch;
        if dissipation.at_once() > 1.0 {
            dissipation.lost += tiles.lost(self.model, &self.state.nodes, kick as f32);
        }
    }

    /// Whether nodes are so fast in the solid's frame that it may change much within a substep: that is less than the time in which a wave
    /// goes through a cell.
    fn is_fast(&self) -> bool {
        self.fastest() > FAST * self.sound_at_rest()
    }

    /// Largest speed of a node relative to the frame, as of the latest substep or look at the nodes [m/s].
    fn fastest(&self) -> f64 {
        let speeds = self.scratch.tiles.speeds.iter().copied();
        self.model.dx * f64::from(speeds.fold(0.0, f32::max))
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
    /// Of no time.
    const NONE: Self = Self {
        remaining: 0.0,
        dt: 0.0,
        taken: 0,
    };

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
