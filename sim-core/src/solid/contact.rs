//! Surface points of solids against colliders: explicit penalty, with a tangential spring up to Coulomb's limit.
//!
//! A point that is too deep is pushed out with a pressure in proportion to its depth. Penalty keeps more energy than impulses
//! that end a substep without approach: those are inelastic impacts of the surface layer.

use rayon::prelude::*;

use super::{
    advance::Solid,
    grip::{Grip, NOTHING, OBJECTS},
    inverse::Start,
    model::SolidModel,
    nodes::NODES,
    search::{Bounds, CandidateList, FoundInCluster, MARGIN, Stand, TASK, find_near},
    state::SolidState,
    surface::SurfacePoint,
};
use crate::{
    colliders::{Placed, farthest},
    contact::ledger::{Ledger, Received},
    mat3::dot,
    report::ContactPartner,
    scene::Surface,
};

/// Pressure over the tangent at rest, per depth in cells.
const STIFFNESS: f64 = 0.5;
/// Largest share of `3 lambda + 2 mu` over `rho dx^2` that contact may add to the squared frequency of a node: with 4.5 of
/// elasticity at Gauss points, a substep of 0.8 stays stable.
const FREQUENCY: f64 = 1.5;
/// Margins within which a box is not far from colliders.
const SEARCH_MARGINS: f64 = 8.0;

/// Points that meet others, with their springs' stiffness.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactSurface {
    pub points: Vec<SurfacePoint>,
    /// Force per depth and tangent at rest [m].
    pub stiffness: Vec<f64>,
    /// Largest sum of magnitudes of a point's weights: how much farther than nodes it may move.
    pub spread: f64,
}

impl ContactSurface {
    /// The surface of a solid, with springs as stiff as its lightest nodes bear. Points that follow each other are near each other.
    pub fn new(model: &SolidModel, mut points: Vec<SurfacePoint>) -> Self {
        points.sort_by_cached_key(|point| curve(point.x.map(|x| (x / model.dx).floor() as i64)));
        let spring = |point: &SurfacePoint| STIFFNESS * point.area / model.dx;
        let density = model.total_mass / model.volume();
        let most = FREQUENCY / (density * model.dx * model.dx);
        // Row sums of the springs over the nodes' masses bound their squared frequencies.
        let mut load = vec![0.0; model.mass.len()];
        for point in &points {
            let all: f64 = point.bears.iter().map(|b| f64::from(b.1.abs())).sum();
            for &(slot, weight) in &point.bears {
                let at = slot as usize;
                load[at] += spring(point) * f64::from(weight.abs()) * all / model.mass[at];
            }
        }
        let stiffness = points.iter().map(|point| {
            let loads = point.bears.iter().map(|b| load[b.0 as usize]);
            let largest = loads.fold(most, f64::max);
            spring(point) * most / largest
        });
        let spread = |point: &SurfacePoint| -> f64 {
            point.bears.iter().map(|b| f64::from(b.1.abs())).sum()
        };
        Self {
            stiffness: stiffness.collect(),
            spread: points.iter().map(spread).fold(1.0, f64::max),
            points,
        }
    }

    /// Box around all points now, and their largest speed [m, m/s].
    pub fn extent(&self, model: &SolidModel, state: &SolidState) -> ([[f64; 3]; 2], f64) {
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let mut fastest = 0.0_f64;
        for point in &self.points {
            let [x, v] = motion(model, state, point);
            for a in 0..3 {
                min[a] = min[a].min(x[a]);
                max[a] = max[a].max(x[a]);
            }
            fastest = fastest.max(dot(v, v));
        }
        ([min, max], fastest.sqrt())
    }
}

/// Place of a cell along a curve that visits blocks of two, four and so on as wholes (Morton 1966).
fn curve(cell: [i64; 3]) -> u64 {
    const BITS: usize = 21;
    let at = cell.map(|c| (c + (1 << (BITS - 1))) as u64);
    (0..BITS).fold(0, |sum, bit| {
        let here = (0..3).map(|a| (at[a] >> bit & 1) << (3 * bit + a));
        sum + here.sum::<u64>()
    })
}

/// Place and velocity of a point of the surface [m, m/s].
pub(crate) fn motion(
    model: &SolidModel,
    state: &SolidState,
    point: &SurfacePoint,
) -> [[f64; 3]; 2] {
    let (mut u, mut v) = ([0.0; 3], [0.0; 3]);
    let nodes: &[f32] = bytemuck::cast_slice(&state.nodes);
    // Loops, not closures: those are not always inlined.
    for &(slot, weight) in &point.bears {
        // One component after the other, displacement before velocity.
        let slot = slot as usize;
        let node = &nodes[6 * NODES * (slot / NODES) + slot % NODES..][..5 * NODES + 1];
        for a in 0..3 {
            u[a] += f64::from(weight * node[NODES * a]);
            v[a] += f64::from(weight * node[NODES * (3 + a)]);
        }
    }
    for a in 0..3 {
        u[a] = point.x[a] + state.shift[a] + model.dx * u[a];
        v[a] = state.velocity[a] + model.dx * v[a];
    }
    [u, v]
}

/// A point in contact: its spring, force [N], and what the ledger is told.
#[derive(Clone, Debug)]
struct Pressed {
    point: usize,
    grip: Grip,
    force: [f64; 3],
    received: Vec<(usize, Received)>,
}

impl Solid<'_> {
    /// Adds the forces of colliders, which have moved for `moved` [s] since they were last looked at and act for `kick` [s].
    pub fn meet_colliders(
        &mut self,
        surface: &ContactSurface,
        colliders: &[Placed<'_>],
        [moved, kick]: [f64; 2],
        (object, ledger): (usize, &mut Ledger),
    ) {
        if colliders.is_empty() {
            return;
        }
        let [min, max] = self.look(surface).0;
        let stand = |placed: &Placed<'_>| {
            let at = placed.start;
            let stand = Stand {
                place: at.translation,
                turn: at.rotation,
                radius: farthest(at.translation, min, max),
                own: 0.0,
            };
            (placed.id as u32, stand)
        };
        let with: Vec<(u32, Stand)> = colliders.iter().map(stand).collect();
        let mut list = self.candidates(surface, &with, |solid, due| {
            solid.near_colliders(surface, colliders, [min, max], due)
        });
        let way = list.way;
        let (solid, state, modulus) = (&*self, &*self.state, self.modulus());
        let points = list.points.par_iter_mut().with_min_len(TASK);
        let pressed: Vec<Pressed> = points
            .filter(|watched| watched.until <= way)
            .filter_map(|watched| {
                let n = watched.point as usize;
                let [x, v] = solid.point(surface, n);
                let stiffness = modulus * surface.stiffness[n];
                let at = At {
                    x,
                    v,
                    stiffness,
                    moved,
                };
                let (clear, pressed) = at.meet(n, colliders, state.springs[n], kick);
                watched.until = way + clear.max(0.0);
                pressed
            })
            .collect();
        self.keep(list);
        for one in pressed {
            self.state.springs[one.point] = one.grip;
            self.push(&surface.points[one.point].bears, one.force);
            for (collider, received) in &one.received {
                ledger.add(object, ContactPartner::Collider(*collider), received);
            }
        }
    }

    /// Points of the clusters that are due which may soon touch colliders, and those that do; `min` and `max` are corners of a box
    /// around all [m].
    fn near_colliders(
        &self,
        surface: &ContactSurface,
        colliders: &[Placed<'_>],
        [min, max]: Bounds,
        due: &[usize],
    ) -> Vec<FoundInCluster> {
        let (springs, margin) = (&self.state.springs, self.margin());
        let far = SEARCH_MARGINS * margin;
        if !colliders.iter().any(|placed| placed.is_near(min, max, far))
            && springs.iter().all(|grip| grip.with >= OBJECTS)
        {
            return due.iter().map(|_| FoundInCluster::none(far)).collect();
        }
        find_near(due, surface.points.len(), margin, |n| {
            let x = self.point(surface, n)[0];
            let distances = colliders.iter().map(|placed| placed.distance(x).value);
            match springs[n].with < OBJECTS {
                true => 0.0,
                false => distances.fold(f64::INFINITY, f64::min),
            }
        })
    }

    /// Adds a force [N] on nodes that share it by weights.
    pub fn push(&mut self, bears: &[(u32, f32)], force: [f64; 3]) {
        let scale = (self.model.dx * self.model.dx).recip();
        if force == [0.0; 3] {
            return;
        }
        for &(slot, weight) in bears {
            let share = force.map(|f| (f64::from(weight) * f * scale) as f32);
            self.scratch.conditions.add_force(slot as usize, share);
        }
    }
}

impl Solid<'_> {
    /// Where it stands.
    pub fn stand(&self, surface: &ContactSurface) -> Stand {
        Stand {
            place: self.state.shift,
            turn: [0.0, 0.0, 0.0, 1.0],
            radius: 0.0,
            own: surface.spread * self.scratch.search.own,
        }
    }

    /// How near to what they may touch points are listed [m].
    pub fn margin(&self) -> f64 {
        MARGIN * self.model.dx
    }

    /// A box that the points of its surface are in, and where a search for its material points begins.
    pub fn look(&mut self, surface: &ContactSurface) -> (Bounds, Start) {
        let now = self.stand(surface);
        if let Some((bounds, start, then)) = &self.scratch.search.seen {
            let grown = now.own - then.own;
            if grown < self.margin() {
                let (mut bounds, mut start) = (*bounds, *start);
                for a in 0..3 {
                    let way = now.place[a] - then.place[a];
                    bounds[0][a] += way - grown;
                    bounds[1][a] += way + grown;
                    start.centre[0][a] += way;
                }
                return (bounds, start);
            }
        }
        let bounds = surface.extent(self.model, self.state).0;
        let start = Start::of(self.model, self.state);
        self.scratch.search.seen = Some((bounds, start, now));
        (bounds, start)
    }

    /// Points that may touch these things where they stand, found by `find` in the clusters of which that is not known any more. They
    /// go back by [`keep`](Self::keep).
    pub fn candidates(
        &mut self,
        surface: &ContactSurface,
        with: &[(u32, Stand)],
        find: impl FnOnce(&Self, &[usize]) -> Vec<FoundInCluster>,
    ) -> CandidateList {
        let now = self.stand(surface);
        let mut list = self.scratch.search.take(with);
        list.go_on(now, with, surface.points.len());
        let due = list.due();
        if !due.is_empty() {
            list.renew(&due, find(self, &due));
        }
        list
    }

    /// Keeps a list of points for the next substep.
    pub fn keep(&mut self, list: CandidateList) {
        self.scratch.search.lists.push(list);
    }

    /// Place and velocity of a point of its surface [m, m/s].
    #[inline(always)]
    pub fn point(&self, surface: &ContactSurface, n: usize) -> [[f64; 3]; 2] {
        motion(self.model, self.state, &surface.points[n])
    }
}

/// What presses and holds a point.
pub(crate) struct Spring {
    /// Force per stretch [N/m].
    pub stiffness: f64,
    /// Normal force [N].
    pub pressure: f64,
    /// Unit normal towards the point.
    pub normal: [f64; 3],
    /// Largest stretch that friction bears [m].
    pub most: f64,
}

impl Spring {
    /// Force [N] and stretch [m] after a relative velocity [m/s] for `moved` [s]; a contact that begins has no stretch yet.
    pub fn pull(
        &self,
        before: Option<[f64; 3]>,
        relative: [f64; 3],
        moved: f64,
    ) -> ([f64; 3], [f64; 3]) {
        let stretch: [f64; 3] = match before {
            Some(before) => std::array::from_fn(|a| before[a] + moved * relative[a]),
            None => [0.0; 3],
        };
        let along = dot(stretch, self.normal);
        let mut stretch: [f64; 3] = std::array::from_fn(|a| stretch[a] - along * self.normal[a]);
        let size = dot(stretch, stretch).sqrt();
        if size > self.most {
            stretch = stretch.map(|s| s * self.most / size);
        }
        let force =
            std::array::from_fn(|a| self.pressure * self.normal[a] - self.stiffness * stretch[a]);
        (force, stretch)
    }
}

/// A point on its way.
struct At {
    x: [f64; 3],
    v: [f64; 3],
    /// Force per depth [N/m].
    stiffness: f64,
    /// Since the springs were last stretched [s].
    moved: f64,
}

impl At {
    /// How far it is from all colliders [m], and what they do to it; nothing where it neither touches nor touched any.
    fn meet(
        &self,
        point: usize,
        colliders: &[Placed<'_>],
        before: Grip,
        kick: f64,
    ) -> (f64, Option<Pressed>) {
        let mut clear = f64::INFINITY;
        let mut out = Pressed {
            point,
            grip: Grip::NONE,
            force: [0.0; 3],
            received: vec![],
        };
        let mut deepest = 0.0;
        for placed in colliders {
            let known = before.with == placed.id as u32;
            let contact = placed.contact();
            let found = placed.distance(self.x);
            clear = clear.min(found.value);
            let holds = known && contact.surface != Surface::Separate;
            if found.value >= 0.0 && !holds {
                continue;
            }
            let mut pressure = -self.stiffness * found.value;
            if contact.surface == Surface::Separate {
                pressure = pressure.max(0.0);
            }
            let u = placed.velocity(self.x);
            let relative = std::array::from_fn(|a| self.v[a] - u[a]);
            let spring = Spring {
                stiffness: self.stiffness,
                pressure,
                normal: found.normal,
                most: match contact.surface {
                    Surface::Sticky => f64::INFINITY,
                    _ => contact.friction * pressure.max(0.0) / self.stiffness,
                },
            };
            let (force, stretch) =
                spring.pull(known.then_some(before.stretch), relative, self.moved);
            for a in 0..3 {
                out.force[a] += force[a];
            }
            let impulse = force.map(|f| kick * f);
            out.received.push((
                placed.id,
                Received::at(self.x, found.normal, kick * pressure, impulse),
            ));
            if out.grip.with == NOTHING || -found.value > deepest {
                deepest = -found.value;
                out.grip = Grip {
                    with: placed.id as u32,
                    stretch,
                };
            }
        }
        let touches = out.grip.with != NOTHING;
        if touches {
            clear = 0.0;
        }
        (clear, (touches || before.with < OBJECTS).then_some(out))
    }
}
