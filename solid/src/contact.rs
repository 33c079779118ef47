//! Surface points of solids against colliders: explicit penalty, with a tangential spring up to Coulomb's limit, where they may leave;
//! walls that hold them, but by friction, [bind](super::walls).
//!
//! A point that is too deep is pushed out with a pressure in proportion to its depth. Penalty keeps more energy than impulses
//! that end a substep without approach: those are inelastic impacts of the surface layer.

use rayon::prelude::*;

use super::{
    advance::{Scratch, Solid},
    bonds::{Hold, TOUCH},
    clusters::{Cluster, bounds_of, curve, farther_of, parts_of},
    grip::{Grip, OBJECTS},
    meeting::At,
    model::SolidModel,
    nodes::NodeRow,
    penalty::CONTACT,
    search::{
        Bounds, CLUSTER, CandidateList, ClusterBox, FoundInCluster, LOOSE, MARGIN, NOWHERE, PARTS,
        Search, TASK, Ways, find_near, joined,
    },
    stand::Stand,
    state::SolidState,
    surface::SurfacePoint,
};
use crate::{
    colliders::{Placed, farthest},
    ledger::{ContactPartner, Ledger},
    mat3::length,
    simd::LANES,
};

/// Pressure over the tangent at rest, per depth in cells, where nodes bear that.
const STIFFNESS: f64 = 1.0;
/// Margins within which a box is not far from colliders.
const SEARCH_MARGINS: f64 = 8.0;

/// Points that meet others, with their springs' stiffness.
#[derive(Clone, Debug, Default)]
pub struct ContactSurface {
    /// Cluster after cluster, then those amid matter at borders of what is held, which touch nothing.
    pub points: Vec<SurfacePoint>,
    /// Force per depth and tangent at rest [m].
    pub stiffness: Vec<f64>,
    /// Their clusters.
    pub clusters: Vec<Cluster>,
}

impl ContactSurface {
    /// The surface of a solid, with springs as stiff as its lightest nodes bear. Points that follow each other are near each other.
    pub fn new(model: &SolidModel, mut points: Vec<SurfacePoint>) -> Self {
        points.sort_by_cached_key(|point| curve(point.x.map(|x| (x / model.dx).floor() as i64)));
        let spring = |point: &SurfacePoint| STIFFNESS * point.area / model.dx;
        let density = model.total_mass / model.volume();
        let most = CONTACT / (density * model.dx * model.dx);
        // Row sums of the springs over the nodes' masses bound their squared frequencies.
        let mut shares = vec![f32::NAN; model.mass.len()];
        let borne = points.iter().map(|p| model.borne_by(&p.bears, &mut shares));
        let borne: Vec<Vec<(u32, f32)>> = borne.collect();
        let mut load = vec![0.0; model.mass.len()];
        for (point, inner) in points.iter().zip(&borne) {
            let all: f64 = inner.iter().map(|b| f64::from(b.1.abs())).sum();
            for &(slot, weight) in inner {
                let at = slot as usize;
                load[at] += spring(point) * f64::from(weight.abs()) * all / model.mass[at];
            }
        }
        let stiffness = points.iter().zip(&borne).map(|(point, inner)| {
            let loads = inner.iter().map(|b| load[b.0 as usize]);
            let largest = loads.fold(most, f64::max);
            spring(point) * most / largest
        });
        let firsts = (0..points.len()).step_by(CLUSTER);
        Self {
            stiffness: stiffness.collect(),
            clusters: firsts.map(|first| Cluster::new(&points, first)).collect(),
            points,
        }
    }

    /// Boxes around the points of a cluster.
    fn cluster_box(
        &self,
        model: &SolidModel,
        rows: &[NodeRow],
        (cluster, own): (usize, f64),
    ) -> ClusterBox {
        let points = &self.points[self.clusters[cluster].points.clone()];
        ClusterBox {
            parts: parts_of(points, |point| place(model, rows, point)),
            own,
        }
    }

    /// Where the ends of a cluster are, from the solid's frame [m].
    fn ends(&self, cluster: &Cluster, model: &SolidModel, rows: &[NodeRow]) -> [[f64; 3]; 2] {
        cluster.ends().map(|n| place(model, rows, &self.points[n]))
    }

    /// Box around all points now, and a speed that none of them exceeds [m, m/s]: from the boxes of their clusters, where these are
    /// known in the frame at hand.
    pub fn reach(
        &self,
        model: &SolidModel,
        state: &SolidState,
        known: Option<&mut Scratch>,
    ) -> (Bounds, f64) {
        let bounds = match known {
            Some(Scratch { search, tiles, .. }) => {
                search.look(self, model, &tiles.rows);
                search.bounds(state)
            }
            None => self.extent(model, state),
        };
        let spread = self.clusters.iter().map(|cluster| cluster.spread);
        let own = spread.fold(1.0, f64::max) * state.fastest(model);
        (bounds, length(state.velocity) + own)
    }

    /// Box around all points now [m].
    pub fn extent(&self, model: &SolidModel, state: &SolidState) -> Bounds {
        let rows = NodeRow::of(&state.nodes);
        let bounds = bounds_of(&self.points, |point| place(model, &rows, point));
        bounds.map(|x| std::array::from_fn(|a| x[a] + state.shift[a]))
    }
}

/// Place of a point of the surface, from the solid's frame [m].
#[inline(always)]
fn place(model: &SolidModel, rows: &[NodeRow], point: &SurfacePoint) -> [f64; 3] {
    let u: [f32; 4] = NodeRow::about(rows, &point.bears);
    let mut x = point.x;
    for a in 0..3 {
        x[a] += model.dx * f64::from(u[a]);
    }
    x
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
            self.scratch.search.bound.clear();
            return;
        }
        self.look(surface);
        let [min, max] = self.bounds();
        let stand = |placed: &Placed<'_>| {
            let at = placed.start;
            let stand = Stand {
                place: at.translation,
                turn: at.rotation,
                radius: farthest(at.translation, min, max),
            };
            (placed.id as u32, stand)
        };
        let with: Vec<(u32, Stand)> = colliders.iter().map(stand).collect();
        let mut list = self.candidates((&with, &[]), moved, |solid, due| {
            solid.near_colliders(surface, colliders, [min, max], due)
        });
        let (solid, state, modulus) = (&*self, &*self.state, self.modulus());
        let pressed = list.meet(&solid.scratch.search.own, |watched, met| {
            let n = watched.point as usize;
            let [x, v] = solid.motion(surface, n);
            let at = At {
                x,
                v,
                stiffness: modulus * surface.stiffness[n],
                touch: TOUCH * solid.model.dx,
                overlaps: &state.overlaps,
                moved,
            };
            at.meet(n, colliders, (state.springs[n], met), kick)
        });
        self.keep(list);
        for one in pressed.into_iter().flatten() {
            let bound = match one.hold {
                Some(Hold::Flat(bound)) => Some(bound),
                Some(Hold::Point(bond)) => {
                    self.scratch.walls.bonds.push(bond);
                    None
                }
                None => None,
            };
            self.scratch.search.bind(one.point, bound);
            self.state.springs[one.point] = one.grip;
            self.push(&surface.points[one.point].bears, one.force);
            for (collider, received) in one.received.iter().chain(&one.more) {
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
        let springs = &self.state.springs;
        let far = SEARCH_MARGINS * self.margin();
        if !colliders.iter().any(|placed| placed.is_near(min, max, far))
            && springs.iter().all(|grip| grip.with >= OBJECTS)
        {
            return due.iter().map(|_| FoundInCluster::none(far)).collect();
        }
        let clear = |x: [f64; 3]| {
            let distances =
                (colliders.iter()).map(|placed| placed.distance(x).value - placed.skin());
            distances.fold(f64::INFINITY, f64::min)
        };
        find_near(due, |cluster| {
            self.near(surface, cluster, |grip| grip.with < OBJECTS, clear)
        })
    }

    /// Adds a force [N] on nodes that share it by weights.
    pub fn push(&mut self, bears: &[(u32, f32)], force: [f64; 3]) {
        let scale = (self.model.dx * self.model.dx).recip();
        if force == [0.0; 3] {
            return;
        }
        let force = force.map(|f| (scale * f) as f32);
        self.scratch.conditions.share_force(bears, force);
    }
}

impl Search {
    /// Looks at where the clusters of a surface are, those again that may have moved far.
    pub fn look(&mut self, surface: &ContactSurface, model: &SolidModel, rows: &[NodeRow]) {
        let Self {
            ways,
            own,
            ends,
            boxes,
            groups,
            is_fresh,
            lists,
            ..
        } = self;
        if std::mem::replace(is_fresh, true) {
            return;
        }
        ways.resize(model.node_blocks.len(), 0.0);
        let clusters = &surface.clusters;
        let at = |cluster: &Cluster| surface.ends(cluster, model, rows);
        if ends.is_empty() {
            ends.extend(clusters.iter().map(at));
            own.clear();
            own.resize(clusters.len(), 0.0);
        } else {
            let all = own.par_iter_mut().zip(ends).zip(clusters);
            let all = all.with_min_len(TASK / CLUSTER);
            all.for_each(|((own, ends), cluster)| {
                let before = std::mem::replace(ends, at(cluster));
                *own += cluster.way(ways).max(farther_of(&before, ends));
            });
        }
        ways.fill(0.0);
        groups.clear();
        let fastest = |own: &[f64]| own.iter().copied().fold(0.0, f64::max);
        groups.extend(own.chunks(LANES / PARTS).map(fastest));
        let loose = LOOSE * model.dx;
        let own = &*own;
        let look = |n: usize| surface.cluster_box(model, rows, (n, own[n]));
        let lists = &*lists;
        if boxes.is_empty() {
            let all = (0..own.len()).into_par_iter().with_min_len(TASK / CLUSTER);
            all.map(look).collect_into_vec(boxes);
            return;
        }
        let all = boxes
            .par_iter_mut()
            .enumerate()
            .with_min_len(TASK / CLUSTER);
        // A box that is far from everything may be loose.
        let clear = |n: usize| {
            lists
                .iter()
                .map(|list| list.clear(n, own))
                .fold(f64::INFINITY, f64::min)
        };
        all.filter(|(n, one)| {
            let grown = own[*n] - one.own;
            grown > loose && grown > loose + 0.5 * clear(*n)
        })
        .for_each(|(n, one)| *one = look(n));
    }
}

impl Solid<'_> {
    /// How near to what they may touch points are listed [m].
    pub fn margin(&self) -> f64 {
        MARGIN * self.model.dx
    }

    /// Looks at where its clusters are.
    pub fn look(&mut self, surface: &ContactSurface) {
        let Scratch { search, tiles, .. } = &mut *self.scratch;
        search.look(surface, self.model, &tiles.rows);
    }

    /// Where it stands, after a [`look`](Self::look).
    pub fn stand(&self) -> Stand {
        self.scratch.search.stand(self.state)
    }

    /// A box that the points of its surface are in, after a [`look`](Self::look) [m].
    pub fn bounds(&self) -> Bounds {
        self.scratch.search.bounds(self.state)
    }

    /// Points of a cluster that are near something, or hold on to it; `clear` tells how far a place is from that at least [m].
    pub fn near(
        &self,
        surface: &ContactSurface,
        cluster: usize,
        holds: impl Fn(&Grip) -> bool,
        clear: impl Fn([f64; 3]) -> f64,
    ) -> FoundInCluster {
        let (points, springs) = (&surface.clusters[cluster].points, &self.state.springs);
        if !springs[points.clone()].iter().any(&holds) {
            let (centre, radius) = self.ball(cluster);
            let beyond = clear(centre) - radius;
            if beyond >= self.margin() {
                return FoundInCluster::none(beyond);
            }
        }
        FoundInCluster::of(points.clone(), self.margin(), |n| {
            match holds(&springs[n]) {
                true => 0.0,
                false => clear(self.place(surface, n)),
            }
        })
    }

    /// A ball around a cluster: centre and radius [m].
    pub fn ball(&self, cluster: usize) -> ([f64; 3], f64) {
        let search = &self.scratch.search;
        let ClusterBox { parts, own } = &search.boxes[cluster];
        let bounds = parts.iter().fold(NOWHERE, |all, one| joined(&all, one));
        let half: [f64; 3] = std::array::from_fn(|a| 0.5 * (bounds[1][a] - bounds[0][a]));
        let centre = std::array::from_fn(|a| bounds[0][a] + half[a] + self.state.shift[a]);
        (centre, length(half) + (search.own[cluster] - *own))
    }

    /// Points that may touch these things where they stand, found by `find` in the clusters of which that is not known any more.
    /// `others` are the ways of groups of what moves besides [m], and all have moved for `moved` [s]. They go back by [`keep`](Self::keep).
    pub fn candidates(
        &mut self,
        (with, others): (&[(u32, Stand)], &[f64]),
        moved: f64,
        find: impl FnOnce(&Self, &[usize]) -> Vec<FoundInCluster>,
    ) -> CandidateList {
        let mut list = self.scratch.search.take(with);
        self.refresh(&mut list, (with, others), moved, find);
        list
    }

    /// Brings a list that was taken up to where things stand, as [`candidates`](Self::candidates) does.
    pub fn refresh(
        &self,
        list: &mut CandidateList,
        (with, others): (&[(u32, Stand)], &[f64]),
        moved: f64,
        find: impl FnOnce(&Self, &[usize]) -> Vec<FoundInCluster>,
    ) {
        let own = &self.scratch.search.own;
        let ways = Ways { own, others };
        list.go_on(self.stand(), with, &ways, moved);
        let due = list.due(&ways);
        if !due.is_empty() {
            list.renew(&due, &ways, find(self, &due));
        }
    }

    /// Keeps a list of points for the next substep.
    pub fn keep(&mut self, list: CandidateList) {
        self.scratch.search.keep(list);
    }

    /// Place of a point of its surface [m].
    #[inline(always)]
    pub fn place(&self, surface: &ContactSurface, n: usize) -> [f64; 3] {
        let mut x = place(self.model, &self.scratch.tiles.rows, &surface.points[n]);
        for a in 0..3 {
            x[a] += self.state.shift[a];
        }
        x
    }

    /// Place [m] and velocity [m/s] of a point of its surface.
    #[inline(always)]
    pub fn motion(&self, surface: &ContactSurface, n: usize) -> [[f64; 3]; 2] {
        let point = &surface.points[n];
        let row: [f32; 8] = NodeRow::about(&self.scratch.tiles.rows, &point.bears);
        let (mut x, mut v) = (point.x, self.state.velocity);
        for a in 0..3 {
            x[a] += self.state.shift[a] + self.model.dx * f64::from(row[a]);
            v[a] += self.model.dx * f64::from(row[3 + a]);
        }
        [x, v]
    }
}
