//! Solids against each other: surface points of one against the depth in the other, through its local inverse deformation.

use super::{
    advance::Solid,
    boxes::{Boxes, COVER, NearBoxes, ROUNDING},
    clusters::middle,
    contact::ContactSurface,
    depth::DepthField,
    grip::{Grip, NOTHING},
    inverse::{FACING, HALF_SURE, KnownPlace, LocalInverse, Missing, SURE, SeenSurface, Start},
    nodes::Bears,
    penalty::{Account, NormalContact},
    search::{CLUSTER, Candidate, CandidateList, FoundInCluster, PARTS, find_near},
};
use crate::{
    ledger::Received,
    mat3::dot,
    simd::{Isa, Lanes, on_isa},
};

/// Largest depth at which a point may begin to touch [cells]: what is deeper came by way of a false root.
const ENTRY: f64 = 1.0;
/// How many times as far as what is beside a point what it faces may be.
const LATERAL: f64 = 2.0;
/// Depth up to which it hardly matters which surface a point came in by [cells].
const SHALLOW: f64 = 0.02;
/// Cosine between a normal and the opposite of a point's from which on the point faces that surface.
const FACED: f64 = 0.9;
/// How much farther than points are listed what moves by itself is known one by one [cells].
const NEIGHBOURHOOD: f64 = 4.0;
/// Share of a surface's springs that each side of a pair has: both press.
const HALF: f64 = 0.5;

/// A solid where it is, as those see it that may be in it.
pub(crate) struct Presence<'a> {
    solid: &'a Solid<'a>,
    inverse: LocalInverse<'a>,
    surface: &'a ContactSurface,
    /// Tangent at rest [Pa].
    modulus: f64,
}

/// What presses on a point.
struct Contact {
    /// [m]
    depth: f64,
    /// Change of it per way along the normal.
    slope: f64,
    /// Unit normal towards the point.
    normal: [f64; 3],
}

/// A point of one solid that another presses on.
pub(crate) struct PointContact {
    pub point: usize,
    pub grip: Grip,
    /// Force on the point [N]; its opposite is on the other's nodes.
    pub force: [f64; 3],
    /// Where, and the normal out of the other.
    pub at: [[f64; 3]; 2],
    pub pressure: f64,
    /// The other's nodes that bear it.
    pub bears: Option<Bears>,
}

impl PointContact {
    /// A point at `x` [m] that lets go.
    pub fn none(point: usize, x: [f64; 3]) -> Self {
        Self {
            point,
            grip: Grip::NONE,
            force: [0.0; 3],
            at: [x, [0.0; 3]],
            pressure: 0.0,
            bears: None,
        }
    }

    /// What its owner receives of forces that act for `kick` [s].
    pub fn received(&self, kick: f64) -> Received {
        let [at, normal] = self.at;
        Received::at(
            at,
            normal,
            kick * self.pressure,
            self.force.map(|f| kick * f),
        )
    }
}

on_isa! {
    /// How far a point is from the other at least [m]; adds what that presses on it with, or that it lets go.
    fn meet_with_isa = meet(
        here: &Presence<'_>,
        other: &Presence<'_>,
        point: (&mut Candidate, &mut Vec<PointContact>),
        within: [f64; 2],
        number: u32,
    ) -> f64
}

#[expect(
    clippy::extra_unused_type_parameters,
    reason = "compiled for each instruction set, without lanes of its own"
)]
#[inline(always)]
fn meet<V: Lanes>(
    here: &Presence<'_>,
    other: &Presence<'_>,
    point: (&mut Candidate, &mut Vec<PointContact>),
    within: [f64; 2],
    number: u32,
) -> f64 {
    here.meet(other, point, within, number)
}

impl<'a> Presence<'a> {
    /// Of a solid at present, after a look at where its clusters are, and where a search begins.
    pub fn new(
        solid: &'a Solid<'a>,
        surface: &'a ContactSurface,
        depth: &'a DepthField,
        start: Start,
    ) -> Self {
        Self {
            inverse: LocalInverse::new(
                (solid.model, solid.state),
                &solid.scratch.tiles.rows,
                depth,
                start,
            ),
            solid,
            surface,
            modulus: solid.modulus(),
        }
    }

    /// Points of the clusters of a surface that are due which may soon touch this one, or do by a grip that `number` tells.
    pub fn near(
        &self,
        isa: Isa,
        solid: &Solid<'_>,
        surface: &ContactSurface,
        number: u32,
        due: &[usize],
    ) -> Vec<FoundInCluster> {
        let boxes = Boxes::of(self.solid.scratch.search.grown());
        find_near(due, |cluster| {
            self.find(isa, solid, surface, number, &boxes, cluster)
        })
    }

    /// Points of a cluster that may soon touch this one, or do; boxes are around this one's clusters, in its frame.
    fn find(
        &self,
        isa: Isa,
        solid: &Solid<'_>,
        surface: &ContactSurface,
        number: u32,
        boxes: &[Boxes],
        cluster: usize,
    ) -> FoundInCluster {
        let cover = COVER * self.inverse.model.dx;
        let off = |mut x: [f64; 3]| {
            for (x, shift) in x.iter_mut().zip(self.solid.state.shift) {
                *x -= shift;
            }
            x
        };
        let (centre, radius) = solid.ball(cluster);
        let most = solid.margin() + cover;
        let beyond = NEIGHBOURHOOD * self.inverse.model.dx;
        // Rounding to single precision of coordinates of a body's size.
        let close = (radius + most) * (1.0 + ROUNDING);
        let near = NearBoxes::new(isa, boxes, off(centre), [close + beyond, close]);
        let holds = |grip: &Grip| grip.with == number;
        let points = &surface.clusters[cluster].points;
        let clear = near.clear - cover - radius;
        let far = clear.max(solid.margin() + beyond);
        if clear >= solid.margin() && !solid.state.springs[points.clone()].iter().any(holds) {
            let mut none = FoundInCluster::none(clear);
            (none.near, none.far) = (near.groups, far);
            return none;
        }
        let (mut places, mut distances) = ([[0.0; 3]; CLUSTER], [(0.0, 0); CLUSTER]);
        let count = points.len();
        for (place, n) in places.iter_mut().zip(points.clone()) {
            *place = off(solid.place(surface, n)).map(|x| x as f32);
        }
        // What is not near is farther than the margin from all points.
        near.distances(&places[..count], most, &mut distances[..count]);
        let mut found = FoundInCluster::of(points.clone(), solid.margin(), |n| {
            match holds(&solid.state.springs[n]) {
                true => 0.0,
                false => f64::from(distances[n - points.start].0) - cover,
            }
        });
        for point in &mut found.points {
            point.part = distances[point.point as usize - points.start].1;
        }
        (found.near, found.far) = (near.groups, far);
        found
    }

    /// What the other presses on points of this one with, `moved` [s] since they were looked at, by Coulomb's law, cluster after cluster;
    /// `number` tells the other's springs.
    pub fn pressed_by(
        &self,
        other: &Self,
        isa: Isa,
        list: &mut CandidateList,
        [friction, moved]: [f64; 2],
        number: u32,
    ) -> Vec<Vec<PointContact>> {
        let own = &self.solid.scratch.search.own;
        list.meet(own, |watched, met| {
            meet_with_isa(isa, self, other, (watched, met), [friction, moved], number)
        })
    }

    #[inline(always)]
    fn meet(
        &self,
        other: &Self,
        (watched, met): (&mut Candidate, &mut Vec<PointContact>),
        [friction, moved]: [f64; 2],
        number: u32,
    ) -> f64 {
        let n = watched.point as usize;
        let held = self.inverse.state.springs[n];
        let before = (held.with == number).then_some(held);
        let x = self.solid.place(self.surface, n);
        if before.is_none()
            && let Some(known) = &watched.known
            && let Some(clear) = other.inverse.clear(x, known)
        {
            return clear;
        }
        let mut seen = Err(Missing::Lost);
        for known in [watched.known.as_ref(), None] {
            let near = known.map_or_else(|| other.guess(x, watched.part), KnownPlace::rest);
            seen = other.inverse.surface_from(x, near);
            if seen.is_ok() || known.is_none() {
                break;
            }
        }
        watched.known = seen.ok().map(|seen| seen.known());
        let clear = match &seen {
            Ok(seen) => SURE * seen.distance.max(0.0),
            // It is farther than cells beside matter.
            Err(Missing::NoMatter(distance)) => self.solid.margin().max(HALF_SURE * distance),
            Err(Missing::Lost) => 0.0,
        };
        let pressed = seen
            .ok()
            .and_then(|seen| self.press(other, n, (&seen, x), number, [friction, moved]));
        match pressed {
            Some(one) => met.push(one),
            None => met.extend(before.map(|_| PointContact::none(n, x))),
        }
        clear
    }

    /// About where a place [m] is at rest, from the part of its surface that it is nearest to [m].
    fn guess(&self, x: [f64; 3], part: u32) -> [f64; 3] {
        let (cluster, part) = (part as usize / PARTS, part as usize % PARTS);
        let mut now = middle(self.solid.scratch.search.boxes[cluster].parts[part]);
        for a in 0..3 {
            now[a] += self.solid.state.shift[a];
        }
        let rest = self.surface.clusters[cluster].middles[part];
        self.inverse.back(x, [now, rest])
    }

    /// What of the other presses on a point that is in it: the nearest surface, or one that the point faces and that is little farther. A
    /// point amid thin matter is nearer to what is beside it than to what it came in by.
    fn contact_at(&self, other: &Self, n: usize, nearest: &SeenSurface) -> Contact {
        let depth = -nearest.distance;
        // The force is the slope of a potential, of half the squared depth: amid matter, where the depth is at its largest, it ends.
        let nearest_at = |farther: f64| Contact {
            depth: depth * farther,
            slope: nearest.steepness * farther,
            normal: nearest.normal,
        };
        if depth < SHALLOW * other.inverse.model.dx {
            return nearest_at(1.0);
        }
        let Some(own) = self.inverse.normal_now(&self.surface.points[n]) else {
            return nearest_at(1.0);
        };
        let facing = -dot(own, nearest.normal);
        if facing > FACED {
            return nearest_at(1.0);
        }
        let farther = 1.0 + (LATERAL - 1.0) * (1.0 - facing / FACING).clamp(0.0, 1.0);
        let faced = other.inverse.faced(nearest, own, depth * farther);
        match faced {
            Some((depth, normal)) => Contact {
                depth,
                slope: 1.0,
                normal,
            },
            None => nearest_at(farther),
        }
    }

    #[inline(always)]
    fn press(
        &self,
        other: &Self,
        n: usize,
        (nearest, x): (&SeenSurface, [f64; 3]),
        number: u32,
        [friction, moved]: [f64; 2],
    ) -> Option<PointContact> {
        let held = self.inverse.state.springs[n];
        let before = (held.with == number).then_some(held);
        if nearest.distance >= 0.0 && before.is_none() {
            return None;
        }
        let stiffness = HALF * self.modulus.min(other.modulus) * self.surface.stiffness[n];
        let bears = nearest.bears(other.inverse.model);
        let u = other.inverse.velocity_of(&bears);
        let [_, v] = self.solid.motion(self.surface, n);
        let relative = std::array::from_fn(|a| v[a] - u[a]);
        if nearest.distance >= 0.0 {
            let approach = -moved * dot(relative, nearest.normal);
            let grip = Account::of(&held, stiffness).part(approach);
            return Some(PointContact {
                grip,
                ..PointContact::none(n, x)
            });
        }
        let found = self.contact_at(other, n, nearest);
        if before.is_none() && found.depth > ENTRY * other.inverse.model.dx {
            return None;
        }
        // A point on which two others press remembers one of them.
        let account =
            (before.is_some() || held.with == NOTHING).then(|| Account::of(&held, stiffness));
        let contact = NormalContact {
            stiffness,
            depth: found.depth,
            slope: found.slope,
            normal: found.normal,
            friction,
            approach: -moved * dot(relative, found.normal),
        };
        let stretch = before.map(|grip| grip.stretch);
        let (force, grip) = contact.press(number, (account, stretch), (relative, moved));
        Some(PointContact {
            point: n,
            grip,
            force,
            at: [x, found.normal],
            pressure: grip.pressure,
            bears: Some(bears),
        })
    }
}
