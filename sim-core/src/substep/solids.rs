//! Solids on grids of their own, with the rigid bodies that they may touch: moved in substeps of their own.

use std::time::Instant;

use super::{limit::Limit, rigid::RigidGroup, springs::springs_of_solid, tally::Tally};
use crate::{
    colliders::{Substep, farthest},
    coupling::solids::{NodeImpulse, NodeImpulses},
    episodes::Episodes,
    ledger::Ledger,
    report::{DtLimit, ObjectCost, Timings},
    scene::PinnedRegion,
    solid::{
        advance::{Outside, Scratch, Solid},
        bonds::HeldFace,
        group::{Passed, Phases, advance_group},
        kernel::SolidLaw,
        mover::{Around, Mover},
        object::{HeldInRegion, SolidObject, law_of},
        rigid::RigidPeers,
        state::{NodeLoad, SolidState},
    },
    state::Given,
    timed,
};

/// Times that a failing span of solids is tried again with half the substep before one of them is taken out.
const RETRIES: i32 = 6;
/// How much faster than now a solid is expected to become within a span.
const SPEED_MARGIN: f64 = 3.0;
/// Longest part of a span with fields that turn or forces that vary [s].
const LONGEST: f64 = 1.0 / 240.0;
/// Shortest part of a span, over its length.
const SHORTEST: f64 = 1e-6;

/// Solids of a world, per object, with the memory that they work in.
pub(crate) struct Solids<'a> {
    pub states: &'a mut [Option<SolidState>],
    pub scratch: &'a mut Vec<Option<Scratch>>,
    /// What matter on the grid gives in the span.
    pub at_nodes: &'a [NodeImpulses],
    /// Pairs in contact.
    pub episodes: &'a mut Episodes,
}

/// A solid that was taken out of the state to be moved.
struct Taken {
    id: usize,
    state: SolidState,
    scratch: Scratch,
    laws: Vec<SolidLaw>,
    /// Box that it stays in [m].
    bounds: Bounds,
}

impl Taken {
    /// Keeps its state where a span begins.
    fn remember(&mut self) {
        match &mut self.scratch.before {
            Some(before) => before.clone_from(&self.state),
            none => *none = Some(self.state.clone()),
        }
    }

    /// Returns to that.
    fn undo(&mut self) {
        if let Some(before) = &self.scratch.before {
            self.state.clone_from(before);
        }
        self.scratch.search.restart();
    }
}

/// Smallest and largest coordinates [m].
type Bounds = [[f64; 3]; 2];

fn are_near([a, b]: &Bounds, [c, d]: &Bounds) -> bool {
    (0..3).all(|n| a[n] <= d[n] && c[n] <= b[n])
}

/// Solids that may touch each other, and whether rigid bodies are among what they may touch.
struct Island {
    objects: Vec<(usize, Bounds)>,
    has_bodies: bool,
}

/// Moves all solids and all rigid bodies through a span, those together that may touch each other. A solid that fails is gone
/// afterwards.
pub(crate) fn move_solids(
    given: &Given<'_>,
    span: &Substep,
    mut solids: Solids<'_>,
    rigid: &mut RigidGroup<'_>,
    tally: &mut Tally,
) {
    let (start, before) = (Instant::now(), tally.timings);
    let count = solids.states.len();
    solids.scratch.resize_with(count, || None);
    let is_solid = |n: u32| given.is_moving_solid(n as usize);
    solids.episodes.retain(is_solid);
    let islands = islands(given, span, &mut solids, rigid);
    if !islands.iter().any(|island| island.has_bodies) {
        timed(&mut tally.timings.bodies, || rigid.advance(span, None));
    }
    for island in islands {
        move_island(given, span, &island, &mut solids, rigid, tally);
    }
    let apart = |t: &Timings| t.solid_contact + t.solid_measuring + t.bodies;
    let others = apart(&tally.timings) - apart(&before);
    tally.timings.solids += start.elapsed().as_secs_f64() - others;
}

/// What a solid knows of its surroundings since the frame began; nothing where it begins.
fn known_in_frame<'a>(span: &Substep, scratch: &'a mut Option<Scratch>) -> Option<&'a mut Scratch> {
    let begins = span.time == span.frame_start;
    scratch.as_mut().filter(|_| !begins)
}

/// Groups of solids that may touch each other within a span. All bodies are one, as far as that goes.
fn islands(
    given: &Given<'_>,
    span: &Substep,
    solids: &mut Solids<'_>,
    rigid: &RigidGroup<'_>,
) -> Vec<Island> {
    let pull = crate::mat3::length(given.commanded.gravity);
    let all = solids.states.iter().zip(&mut *solids.scratch).enumerate();
    let all = all.filter(|(id, _)| given.is_moving_solid(*id));
    let boxes = all.filter_map(|(id, (state, scratch))| {
        let solid = given.model.lagrangian[id].as_ref()?;
        let known = known_in_frame(span, scratch);
        let reach = (solid.surface).reach(&solid.grid, state.as_ref()?, known);
        let ([min, max], speed) = reach;
        let margin = SPEED_MARGIN * speed * span.dt + pull * span.dt * span.dt + solid.grid.dx;
        Some((id, [min.map(|x| x - margin), max.map(|x| x + margin)]))
    });
    let boxes: Vec<(usize, Bounds)> = boxes.collect();
    let bodies: Vec<Bounds> = rigid
        .reaches(SPEED_MARGIN, span.dt)
        .map(|(com, radius)| [com.map(|x| x - radius), com.map(|x| x + radius)])
        .collect();
    // What has touched stays together until it has parted.
    let in_contact = |a: usize, b: usize| {
        let pair = [a.min(b) as u32, a.max(b) as u32];
        solids.episodes.has(pair)
    };
    let mut islands: Vec<Island> = vec![];
    for (id, bounds) in boxes {
        let mut joined = Island {
            has_bodies: bodies.iter().any(|body| are_near(body, &bounds))
                || rigid.numbers().iter().any(|&body| in_contact(id, body)),
            objects: vec![(id, bounds)],
        };
        let mut apart = vec![];
        for island in islands {
            let is_one = |one: &(usize, Bounds)| are_near(&one.1, &bounds) || in_contact(id, one.0);
            let touches =
                joined.has_bodies && island.has_bodies || island.objects.iter().any(is_one);
            if touches {
                joined.objects.extend(island.objects);
                joined.has_bodies |= island.has_bodies;
            } else {
                apart.push(island);
            }
        }
        joined.objects.sort_by_key(|one| one.0);
        apart.push(joined);
        islands = apart;
    }
    islands.sort_by_key(|island| island.objects[0].0);
    islands
}

/// Moves an island through a span.
fn move_island(
    given: &Given<'_>,
    span: &Substep,
    island: &Island,
    solids: &mut Solids<'_>,
    rigid: &mut RigidGroup<'_>,
    tally: &mut Tally,
) {
    let mut left: Vec<Taken> = island
        .objects
        .iter()
        .filter_map(|&(id, bounds)| solids.take(given, span, id, bounds))
        .collect();
    let bodies = rigid.places();
    let has = |n: u32| island.objects.iter().any(|one| one.0 == n as usize);
    let in_contact = solids.episodes.take_of(has);
    while !left.is_empty() {
        left.iter_mut().for_each(Taken::remember);
        let mut bad = left[0].id;
        for retry in 0..=RETRIES {
            let (mut ledger, mut episodes) = (Ledger::default(), in_contact.clone());
            let cfl = given.model.scene.cfl * 0.5_f64.powi(retry);
            let peers = island.has_bodies.then_some(&mut *rigid);
            let mut phases = Phases::default();
            let accounts = (&mut episodes, &mut ledger, &mut phases);
            let moved = move_together(given, span, &mut left, cfl, peers, accounts);
            tally.timings.solid_contact += phases.contact;
            tally.timings.bodies += phases.bodies;
            match moved {
                Ok(passed) => {
                    rigid.ledger.merge(&ledger);
                    solids.episodes.put_back(episodes);
                    count(tally, given, &mut left, &passed);
                    left.into_iter().for_each(|one| solids.put_back(one));
                    return;
                }
                Err(object) => bad = object,
            }
            left.iter_mut().for_each(Taken::undo);
            if island.has_bodies {
                rigid.put_back(&bodies);
            }
            tally.solids.rollbacks += 1;
        }
        left.retain(|one| one.id != bad);
    }
    if island.has_bodies {
        timed(&mut tally.timings.bodies, || rigid.advance(span, None));
    }
}

/// Takes note of an island: the work in quadrature points times substeps, and what its solids cost.
fn count(tally: &mut Tally, given: &Given<'_>, island: &mut [Taken], passed: &Passed) {
    let solids = island
        .iter()
        .filter_map(|one| given.model.lagrangian[one.id].as_ref());
    let points: usize = solids.map(|solid| 8 * solid.grid.cells.len()).sum();
    tally.work.grid_to_particle += points as u64 * passed.substeps;
    let moved = &mut tally.solids;
    moved.substeps = moved.substeps.max(passed.substeps);
    if passed.smallest < moved.limit.dt && passed.substeps > 1 {
        moved.limit = Limit {
            dt: passed.smallest,
            cause: DtLimit::Sound,
            object: Some(island[0].id),
        };
    }
    for one in island {
        let seconds = std::mem::take(&mut one.scratch.seconds);
        tally.timings.solid_measuring += seconds.measuring;
        *tally.of_object(one.id) += ObjectCost {
            seconds: seconds.all,
            substeps: passed.substeps,
            dt_min: passed.smallest,
            dt_limit: match passed.substeps {
                1 => DtLimit::Frame,
                _ => DtLimit::Sound,
            },
            contact_points: 0,
        };
    }
}

impl Solids<'_> {
    fn take(
        &mut self,
        given: &Given<'_>,
        span: &Substep,
        id: usize,
        bounds: Bounds,
    ) -> Option<Taken> {
        let solid = given.model.lagrangian[id].as_ref()?;
        let mut state = self.states[id].take()?;
        let own = self.at_nodes.iter().filter(|(object, _)| *object == id);
        let forces = own.flat_map(|(_, impulses)| impulses);
        let load = |given: &NodeImpulse| NodeLoad {
            slot: given.slot as u32,
            force: given.impulse.map(|j| j / span.dt),
            before: state.velocity_of(&solid.grid, given.slot),
            expected: given.expected,
        };
        (state.of_matter, state.span) = (forces.map(load).collect(), span.dt);
        let scratch = self.scratch[id].take();
        Some(Taken {
            id,
            state,
            scratch: scratch.unwrap_or_else(|| Scratch::new(&solid.grid)),
            laws: laws_of(given, id),
            bounds,
        })
    }

    fn put_back(&mut self, one: Taken) {
        self.states[one.id] = Some(one.state);
        self.scratch[one.id] = Some(one.scratch);
    }
}

/// Laws of an object's parts at present.
pub(crate) fn laws_of(given: &Given<'_>, object: usize) -> Vec<SolidLaw> {
    let parts = given.model.parts.iter().zip(&given.commanded.materials);
    let own = parts.filter(|(part, _)| part.object == object);
    own.map(|(part, material)| law_of(material, &part.material))
        .collect()
}

/// Moves an island through a span, part by part of the regions that hold it.
fn move_together(
    given: &Given<'_>,
    span: &Substep,
    island: &mut [Taken],
    cfl: f64,
    mut rigid: Option<&mut RigidGroup<'_>>,
    (episodes, ledger, phases): (&mut Episodes, &mut Ledger, &mut Phases),
) -> Result<Passed, usize> {
    let around = Around {
        outside: Outside {
            isa: given.model.isa,
            gravity: given.commanded.gravity,
            damping: given.model.damping,
            cfl,
        },
        scene: &given.model.scene,
        boundaries: &given.model.solids,
        paths: &given.commanded.paths,
        frame: [span.frame_start, span.frame_length],
        interruption: given.interruption,
    };
    let mut all = Passed {
        substeps: 0,
        smallest: f64::INFINITY,
        last: 0.0,
    };
    let mut at = span.time;
    let longest = longest_part(given, island);
    for end in parts_of(given, span, longest) {
        if given.interruption.was_due() {
            break;
        }
        let part = Substep {
            time: at,
            dt: end - at,
            kick: end - at,
            ..*span
        };
        let movers = island.iter_mut().filter_map(|one| mover(given, one, &part));
        let mut group: Vec<Mover<'_>> = movers.collect();
        let peers = rigid
            .as_mut()
            .map(|rigid| &mut **rigid as &mut dyn RigidPeers);
        let accounts = (&mut *episodes, &mut *ledger, &mut *phases);
        let passed = advance_group(&mut group, peers, &around, [at, end - at], accounts)?;
        all.substeps += passed.substeps;
        all.smallest = all.smallest.min(passed.smallest);
        all.last = passed.last;
        at = end;
    }
    Ok(all)
}

/// Longest time for which what varies is taken for constant [s]: where formulas of time push, that in which a wave goes through a
/// cell, as substeps are.
fn longest_part(given: &Given<'_>, island: &[Taken]) -> f64 {
    let pushed = island.iter().filter(|one| {
        let force = &given.model.scene.objects[one.id].body_force;
        force.as_ref().is_some_and(|force| force.varies_in_time())
    });
    let squares = pushed.flat_map(|one| &one.laws);
    let squares = squares.map(|law| law.tangent_at_rest() / law.density);
    LONGEST.min(given.model.scene.dx / squares.fold(0.0, f64::max).sqrt())
}

/// Ends of the parts of a span within which what holds and pushes stays the same [s], each at most `longest` [s].
fn parts_of(given: &Given<'_>, span: &Substep, longest: f64) -> Vec<f64> {
    let (start, end) = (span.time, span.time + span.dt);
    let regions = given.model.scene.pinned_regions.iter();
    let ends = regions.flat_map(|region| [region.span.start, region.span.end]);
    let mut ends: Vec<f64> = ends.filter(|t| start < *t && *t < end).collect();
    ends.extend(given.model.rules.changes(start, end));
    if given.model.rules.vary() {
        let count = (span.dt / longest).ceil();
        ends.extend((1..count as u32).map(|n| start + f64::from(n) / count * span.dt));
    }
    ends.push(end);
    ends.sort_by(f64::total_cmp);
    // What is shorter than any substep is none.
    ends.dedup_by(|later, earlier| *later - *earlier < SHORTEST * span.dt);
    if let Some(last) = ends.last_mut() {
        *last = end;
    }
    ends
}

/// A solid with all that acts on it within a span.
fn mover<'a>(given: &Given<'a>, one: &'a mut Taken, span: &Substep) -> Option<Mover<'a>> {
    let object = given.model.lagrangian[one.id].as_ref()?;
    let (held, velocities) = held_nodes(given, one.id, (object, &one.state), span);
    one.scratch.hold(&object.grid, held);
    let mut steady = pushes(given, one.id, object, span);
    let scale = (object.grid.dx * object.grid.dx).recip();
    let scaled = |load: &NodeLoad| {
        let force = load.force.map(|f| (scale * f) as f32);
        (load.slot as usize, force)
    };
    steady.extend(one.state.of_matter.iter().map(scaled));
    let springs = springs_of_solid(given, one.id);
    Some(Mover {
        springs,
        colliders: near_colliders(given, &one.bounds, span),
        steady,
        friction: given.model.solids.friction_of(one.id),
        solid: Solid {
            model: &object.grid,
            laws: &one.laws,
            state: &mut one.state,
            scratch: &mut one.scratch,
        },
        object,
        id: one.id,
        given: velocities,
        faces: held_faces(given, object, span),
    })
}

/// Nodes of a solid that are held in a span, ascending, with their velocities [m/s].
pub(super) fn held_nodes(
    given: &Given<'_>,
    object: usize,
    (solid, state): (&SolidObject, &SolidState),
    span: &Substep,
) -> (Vec<usize>, Vec<[f64; 3]>) {
    let mut held = std::collections::BTreeMap::new();
    let regions = given.model.scene.pinned_regions.iter().zip(&solid.regions);
    for (region, at_rest) in regions.filter(|(region, _)| span.is_in(&region.span)) {
        if region.span.start <= 0.0 {
            held.extend(at_rest.nodes.iter().map(|&n| (n, region.velocity)));
            continue;
        }
        // One that begins later holds what is in it then, and what comes into it.
        let passed = region.span.elapsed(span.time);
        let inside = |x: [f64; 3]| {
            let x = std::array::from_fn(|a| x[a] - passed * region.velocity[a]);
            region.bounds.contains(x)
        };
        let nodes = solid.nodes_of(|n| inside(state.sample(&solid.grid, &solid.particles[n]).x));
        held.extend(nodes.into_iter().map(|n| (n, region.velocity)));
    }
    let (rules, pins) = (&given.model.rules, &given.commanded.pins);
    if rules.hold_in(pins, span) {
        let (first, dx) = (
            given.model.scene.objects[object].particles.start,
            solid.grid.dx,
        );
        let fields = solid.held_by(|n| rules.field(pins, span, (first + n) as u32));
        held.extend(fields.into_iter().map(|(node, field)| {
            // Along the chord: at the end it is where the field takes it.
            let x = state.position(&solid.grid, node).map(|x| x / dx);
            let end = field.moved(x, span.dt);
            (
                node,
                std::array::from_fn(|a| dx * (end[a] - x[a]) / span.dt),
            )
        }));
    }
    held.into_iter().unzip()
}

/// Faces of a solid that are held in a span.
fn held_faces<'a>(given: &Given<'a>, solid: &'a SolidObject, span: &Substep) -> Vec<HeldFace<'a>> {
    let regions = given.model.scene.pinned_regions.iter().zip(&solid.regions);
    let holds = |(number, (region, held)): (usize, (&PinnedRegion, &'a HeldInRegion))| {
        let from_rest = region.span.start <= 0.0 && !held.points.is_empty();
        (from_rest && span.is_in(&region.span)).then_some(HeldFace {
            region: number,
            points: &held.points,
            velocity: region.velocity,
        })
    };
    regions.enumerate().filter_map(holds).collect()
}

/// Colliders that what stays in a box may touch within a span.
fn near_colliders(given: &Given<'_>, [min, max]: &Bounds, span: &Substep) -> Vec<usize> {
    let placed = given.model.solids.all(&given.commanded.paths, span);
    let near = placed.iter().filter(|placed| {
        let reach = farthest(placed.start.translation, *min, *max);
        placed.is_near(*min, *max, placed.speed(reach, reach) * span.dt)
    });
    near.map(|placed| placed.id).collect()
}

/// What impulses, body forces and commands push nodes with in a span, over the squared cell size [Pa].
fn pushes(
    given: &Given<'_>,
    object: usize,
    solid: &SolidObject,
    span: &Substep,
) -> Vec<(usize, [f32; 3])> {
    if !given.model.rules.push_in(span) {
        return vec![];
    }
    // Constant within the span: that of its middle is of second order.
    let middle = span.time + 0.5 * span.dt;
    let pushes = given.model.rules.pushes_at(span, middle);
    let first = given.model.scene.objects[object].particles.start;
    let dx = solid.grid.dx;
    let changes = solid.spread(|n| pushes.on((first + n) as u32));
    let nodes = changes
        .iter()
        .enumerate()
        .filter(|(_, change)| **change != [0.0; 3]);
    let force = |n: usize, change: &[f64; 3]| {
        let factor = solid.grid.mass[n] / (dx * span.dt);
        change.map(|v| (factor * v) as f32)
    };
    nodes.map(|(n, change)| (n, force(n, change))).collect()
}
