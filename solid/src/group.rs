//! Solids that move together through a span of time: those that may touch each other share their substeps.

use rayon::prelude::*;

use super::{
    advance::{Shares, Solid},
    bonds::binds,
    depth::DepthField,
    ended::Ended,
    grip::{ContactWith, Grip},
    inverse::Start,
    members::Members,
    mover::{Around, Mover},
    overlap::Others,
    pairs::{PointContact, Presence},
    rigid::{
        Exchange, Pressed as PressedByBodies, RigidPeers, Wrench, near_body, opposite, stand_of,
    },
    search::{Bounds, CandidateList},
    stand::Stand,
    walls::WallsAt,
};
use crate::{
    bodies::actor::Actor,
    colliders::{Placed, Substep},
    episodes::Episodes,
    ledger::{ContactPartner, Ledger},
    mat3::length,
    scene::Scene,
    timed,
};

/// How far ahead solids that come near each other are looked for [substeps].
const AHEAD: f64 = 4.0;

/// What a span came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed {
    /// Substeps.
    pub substeps: u64,
    /// Smallest of them [s].
    pub smallest: f64,
    /// The last of them [s].
    pub last: f64,
}

/// Wall time of some phases of a span [s]; what is left are forces and motion of nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Phases {
    /// Contact: with colliders, among solids and with rigid bodies.
    pub contact: f64,
    /// Rigid bodies among themselves.
    pub bodies: f64,
}

/// Moves a group, and the rigid bodies that it may touch, from `start` for `length` [s] > 0; notes what contact gave, and adds the wall
/// time of phases, also where it fails. Where it is interrupted, all are amid the span.
///
/// # Errors
/// The number of the first object that is nowhere in the end: whoever called undoes what has changed by then.
pub fn advance_group(
    group: &mut [Mover<'_>],
    mut peers: Option<&mut dyn RigidPeers>,
    around: &Around<'_>,
    [start, length]: [f64; 2],
    (episodes, ledger, phases): (&mut Episodes, &mut Ledger, &mut Phases),
) -> Result<Passed, usize> {
    let outside = &around.outside;
    let meets = group.len() > 1 || peers.is_some();
    begin(group, around, start, meets);
    let limit = |group: &[Mover<'_>], drift: f64| {
        let limits = group
            .iter()
            .map(|mover| mover.solid.limit(outside.cfl, drift));
        limits.fold(f64::INFINITY, f64::min)
    };
    let mut shares = Shares::first(length, limit(group, 0.0));
    let mut passed = Passed {
        substeps: 0,
        smallest: f64::INFINITY,
        last: 0.0,
    };
    // How long forces act, and how long things have moved since they were last looked at.
    let (mut kick, mut moved) = (0.5 * shares.dt, 0.0);
    let mut exchange = Exchange::default();
    let mut known = known_forces(group, peers.is_some(), kick);
    loop {
        let now = Substep {
            time: start + (length - shares.remaining),
            dt: shares.dt,
            kick,
            frame_start: around.frame[0],
            frame_length: around.frame[1],
        };
        let mut members = Members::new(group, &mut peers, around, &now);
        let books = (&mut *episodes, &mut *phases);
        let given = members.substep(moved, &shares, &mut exchange, books, known.take())?;
        ledger.merge(&given);
        passed.substeps += 1;
        passed.smallest = passed.smallest.min(shares.dt);
        (passed.last, moved) = (shares.dt, shares.dt);
        if around.interruption.is_due() {
            return Ok(passed);
        }
        match shares.next(limit(group, shares.dt)) {
            Some(next) => kick = next,
            None => break,
        }
    }
    // Velocities come level with positions: colliders move as they did in the last substep.
    let now = Substep {
        time: start + length,
        dt: 0.0,
        kick: 0.5 * passed.last,
        frame_start: around.frame[0],
        frame_length: around.frame[1],
    };
    let mut members = Members::new(group, &mut peers, around, &now);
    let books = (episodes, phases);
    ledger.merge(&members.substep(moved, &shares, &mut exchange, books, None)?);
    for mover in group {
        for spring in &mover.springs {
            ledger.add_spring(mover.id, &spring.given);
        }
        ledger.lost += mover.solid.scratch.dissipation.lost;
    }
    Ok(passed)
}

/// Before a span from a time [s] on, in which a group may meet others or its own members.
fn begin(group: &mut [Mover<'_>], around: &Around<'_>, start: f64, meets: bool) {
    let now = Substep {
        time: start,
        dt: 0.0,
        kick: 0.0,
        frame_start: around.frame[0],
        frame_length: around.frame[1],
    };
    let placed = match group.iter().any(|mover| !mover.colliders.is_empty()) {
        true => around.boundaries.all(around.paths, &now),
        false => vec![],
    };
    for mover in group {
        mover.timed(|mover| begin_mover(mover, around, &placed, (start, meets)));
    }
}

/// Before a span from a time [s] on, in which one of a group may meet others, with colliders placed there.
fn begin_mover(
    mover: &mut Mover<'_>,
    around: &Around<'_>,
    placed: &[Placed<'_>],
    (start, meets): (f64, bool),
) {
    let (given, begins) = (&mover.given, start == around.frame[0]);
    let surface = &mover.object.surface;
    let surface = (&surface.points[..], &surface.stiffness[..]);
    let points = mover.faces.iter().flat_map(|face| face.points);
    let places = points.map(|&p| surface.0[p].x).collect();
    mover.solid.scratch.dissipation.begin(places);
    let outside = &around.outside;
    mover.solid.begin(outside, surface, begins, |n| given[n]);
    // Walls that bind hold no energy, and make no motion faster.
    let near = placed.iter().filter(|p| mover.colliders.contains(&p.id));
    let mut near = near.map(|placed| placed.against(mover.friction));
    let is_near_a_wall = near.any(|placed| !binds(&placed));
    mover.solid.scratch.search.contact = match (meets, is_near_a_wall) {
        (true, _) => ContactWith::Objects,
        (false, true) => ContactWith::Walls,
        (false, false) => ContactWith::Nothing,
    };
    if (meets || !mover.colliders.is_empty()) && !mover.solid.scratch.search.has_begun {
        mover.solid.expect_contact();
    }
}

impl Members<'_, '_> {
    /// Moves all by a substep, or brings velocities level with positions where that has no length; returns what contact gave. Things
    /// have moved for `moved` [s] since they were last looked at. Forces act already where what contact gives by them is known.
    fn substep(
        &mut self,
        moved: f64,
        shares: &Shares,
        exchange: &mut Exchange,
        (episodes, phases): (&mut Episodes, &mut Phases),
        known: Option<Ledger>,
    ) -> Result<Ledger, usize> {
        let (around, now, stands) = (self.around, self.now, known.is_some());
        let touched = self.group.iter().any(|mover| !mover.colliders.is_empty());
        let placed = match touched {
            true => around.boundaries.all_since(around.paths, now, moved),
            false => vec![],
        };
        let (mut given, on_bodies) = match known {
            Some(given) => (given, vec![]),
            None => timed(&mut phases.contact, || find_forces(self, &placed, moved)),
        };
        if now.dt == 0.0 {
            note_forces(self, &given);
        }
        self.book(&given, episodes);
        self.move_nodes(&placed, [now.kick, now.dt], (shares, stands), &mut given)?;
        for mover in &mut *self.group {
            for spring in &mut mover.springs {
                spring.settle(&mover.solid);
            }
        }
        if let Some(peers) = &mut self.peers {
            timed(&mut phases.bodies, || match now.dt > 0.0 {
                true => peers.advance(now, &exchange.through(on_bodies, now.dt)),
                false => peers.push(&exchange.rest(&on_bodies)),
            });
        }
        Ok(given)
    }

    /// Lets forces act for `kick` [s] and nodes move for `drift` [s] after that.
    fn move_nodes(
        &mut self,
        placed: &[Placed<'_>],
        [kick, drift]: [f64; 2],
        (shares, stands): (&Shares, bool),
        ledger: &mut Ledger,
    ) -> Result<(), usize> {
        let outside = &self.around.outside;
        let walls = WallsAt {
            placed,
            isa: outside.isa,
            kick,
            drift,
        };
        let moved = each(self.group, |mover| {
            let mut given = Ledger::default();
            let found = (mover.solid).substep(outside, [kick, drift], shares, stands);
            if found.bad {
                return Err(mover.id);
            }
            let surface = &mover.object.surface;
            mover.solid.bind(surface, &walls, (mover.id, &mut given));
            mover.solid.book_loss(kick);
            Ok(given)
        });
        for given in moved {
            ledger.merge(&given?);
        }
        Ok(())
    }
}

/// Does the same to each of a group, side by side, and takes the time of each; what comes of it is in their order.
fn each<'a, T: Send>(
    group: &mut [Mover<'a>],
    act: impl Fn(&mut Mover<'a>) -> T + Send + Sync,
) -> Vec<T> {
    let movers = group.par_iter_mut();
    movers.map(|mover| mover.timed(&act)).collect()
}

/// External forces at the moment; returns what contact gives by them, and those on rigid bodies.
fn find_forces(
    members: &mut Members<'_, '_>,
    placed: &[Placed<'_>],
    moved: f64,
) -> (Ledger, Vec<Wrench>) {
    let Members {
        group,
        peers,
        around,
        now,
    } = members;
    let (times, mut ledger) = ([moved, now.kick], Ledger::default());
    let outside = Others {
        colliders: placed,
        bodies: peers.as_ref().map_or(&[], |peers| peers.actors()),
        objects: peers.as_ref().map_or(&[], |peers| peers.objects()),
    };
    for given in each(group, |mover| meet_outside(mover, &outside, times, now)) {
        ledger.merge(&given);
    }
    if group.len() > 1 {
        meet_each_other(group, around, times, &mut ledger);
    }
    let on_bodies = match peers {
        Some(peers) => meet_bodies(group, &**peers, around.scene, times, &mut ledger),
        None => vec![],
    };
    (ledger, on_bodies)
}

/// Regions that hold faces of a solid, with their velocities [m/s].
fn held(mover: &Mover<'_>) -> impl Iterator<Item = (usize, [f64; 3])> {
    mover.faces.iter().map(|face| (face.region, face.velocity))
}

/// Keeps the forces that act where a span ends for the one that follows, and what contact gives by them.
fn note_forces(members: &mut Members<'_, '_>, given: &Ledger) {
    let group = &mut *members.group;
    // Springs pull by what time it is.
    if members.peers.is_some() || group.iter().any(|mover| !mover.springs.is_empty()) {
        return;
    }
    let ids: Vec<usize> = group.iter().map(|mover| mover.id).collect();
    for (n, mover) in group.iter_mut().enumerate() {
        mover.solid.scratch.search.ended = Some(Ended {
            group: ids.clone(),
            given: match n {
                0 => given.clone(),
                _ => Ledger::default(),
            },
            kick: members.now.kick,
            steady: mover.steady.clone(),
            faces: held(mover).collect(),
        });
    }
}

/// Takes over the forces that acted where the span before ended; returns what contact gives by them in a kick [s]. None where others moved
/// together then, or forces have to be found.
fn known_forces(group: &mut [Mover<'_>], meets_bodies: bool, kick: f64) -> Option<Ledger> {
    let take = |mover: &mut Mover<'_>| mover.solid.scratch.search.ended.take();
    let ended: Vec<Option<Ended>> = group.iter_mut().map(take).collect();
    let ended: Vec<Ended> = ended.into_iter().collect::<Option<_>>()?;
    let ids = || group.iter().map(|mover| mover.id);
    let is_same = |(one, mover): (&Ended, &Mover<'_>)| {
        let faces = one.faces.iter().copied();
        one.group.iter().copied().eq(ids()) && faces.eq(held(mover)) && mover.springs.is_empty()
    };
    if meets_bodies || !ended.iter().zip(&*group).all(is_same) {
        return None;
    }
    for (mover, ended) in group.iter_mut().zip(&ended) {
        let conditions = &mut mover.solid.scratch.conditions;
        for &(slot, force) in &ended.steady {
            conditions.add_force(slot, force.map(|f| -f));
        }
        for &(slot, force) in &mover.steady {
            conditions.add_force(slot, force);
        }
    }
    let first = ended.first()?;
    Some(first.given.times(kick / first.kick))
}

/// External forces on a solid, by springs that hold it and colliders; returns what these gave.
fn meet_outside(
    mover: &mut Mover<'_>,
    outside: &Others<'_>,
    times: [f64; 2],
    now: &Substep,
) -> Ledger {
    let mut given = Ledger::default();
    let scratch = &mut *mover.solid.scratch;
    scratch.search.begin_look();
    // Those of a substep that was undone would be bound twice.
    scratch.walls.bonds.clear();
    let conditions = &mut scratch.conditions;
    conditions.clear_forces();
    for &(slot, force) in &mover.steady {
        conditions.add_force(slot, force);
    }
    for spring in &mut mover.springs {
        spring.push(&mut mover.solid, now);
    }
    let near = outside.colliders.iter();
    let near = near.filter(|p| mover.colliders.contains(&p.id));
    let near: Vec<Placed<'_>> = near.map(|p| p.against(mover.friction)).collect();
    let surface = &mover.object.surface;
    let others = Others {
        colliders: &near,
        ..*outside
    };
    mover.solid.relax_overlaps(surface, &others, times[0]);
    mover.solid.hold_faces(surface, &mover.faces);
    mover
        .solid
        .meet_colliders(surface, &near, times, (mover.id, &mut given));
    given
}

/// Forces between the solids of a group and rigid bodies; returns those on bodies.
fn meet_bodies(
    group: &mut [Mover<'_>],
    peers: &dyn RigidPeers,
    scene: &Scene,
    [moved, kick]: [f64; 2],
    ledger: &mut Ledger,
) -> Vec<Wrench> {
    let mut on_bodies = vec![Wrench::default(); peers.actors().len()];
    for mover in group {
        for ((actor, &body), on_body) in peers
            .actors()
            .iter()
            .zip(peers.objects())
            .zip(&mut on_bodies)
        {
            let friction = scene.surface_between(mover.id, body).friction;
            let with = [friction, moved, kick];
            let given = mover.timed(|mover| meet_body(mover, (actor, body), with, ledger));
            on_body.add(1.0, &given);
        }
    }
    on_bodies
}

/// Forces between a solid and a rigid body, an object of some number, `moved` [s] since they were looked at; returns that on the body.
fn meet_body(
    mover: &mut Mover<'_>,
    (actor, body): (&Actor, usize),
    [friction, moved, kick]: [f64; 3],
    ledger: &mut Ledger,
) -> Wrench {
    let (number, surface) = (Grip::on_object(body), &mover.object.surface);
    let solid = &mut mover.solid;
    solid.look(surface);
    let with = [(number, stand_of(actor))];
    let mut list = solid.candidates((&with, &[]), moved, |solid, due| {
        near_body(solid, surface, actor, number, due)
    });
    let pressed = PressedByBodies {
        solid,
        surface,
        springs: &solid.state.springs,
        modulus: solid.modulus(),
        dx: solid.model.dx,
        fastest: solid.sound_at_rest().powi(2),
    };
    let met = pressed.pressed_by(actor, friction, moved, number, &mut list);
    solid.keep(list);
    let on_body = opposite(met.iter().flatten());
    for one in met.into_iter().flatten() {
        solid.state.springs[one.point] = one.grip;
        solid.push(&surface.points[one.point].bears, one.force);
        let received = one.received(kick);
        ledger.add(mover.id, ContactPartner::Object(body), &received);
    }
    on_body
}

/// Points of a mover that may touch another, and what that presses on them with.
struct Pressed<'a> {
    /// Places in the group: whose points, and of whom.
    pair: [usize; 2],
    /// Depths of both.
    depths: [&'a DepthField; 2],
    /// Where the other stands, by the number of its grips.
    with: (u32, Stand),
    list: CandidateList,
    /// Cluster after cluster.
    met: Vec<Vec<PointContact>>,
    /// Processor time of looking [s].
    seconds: f64,
}

/// Forces between the solids of a group.
fn meet_each_other(
    group: &mut [Mover<'_>],
    around: &Around<'_>,
    [moved, kick]: [f64; 2],
    ledger: &mut Ledger,
) {
    let seen: Vec<(Bounds, Start)> = each(group, |one| {
        one.solid.look(&one.object.surface);
        let (bounds, solid) = (one.solid.bounds(), &mut one.solid);
        let start = solid.scratch.search.start(solid.model, solid.state);
        (bounds, start)
    });
    let mut found = vec![];
    for i in 0..group.len() {
        for j in i + 1..group.len() {
            // Those that may meet in the substep after this are looked for.
            let [u, v] = [i, j].map(|n| group[n].solid.state.velocity);
            let speed = length(std::array::from_fn(|a| u[a] - v[a]));
            let margin = group[i].solid.margin() + AHEAD * speed * kick;
            let ([a, b], [c, d]) = (seen[i].0, seen[j].0);
            let is_near = (0..3).all(|n| a[n] <= d[n] + margin && c[n] <= b[n] + margin);
            let [one, other] = [i, j].map(|n| group[n].object.depth.as_ref());
            if is_near && let (Some(one), Some(other)) = (one, other) {
                for (pair, depths) in [([i, j], [one, other]), ([j, i], [other, one])] {
                    let there = &group[pair[1]];
                    let with = (Grip::on_object(there.id), there.solid.stand());
                    found.push(Pressed {
                        pair,
                        depths,
                        with,
                        list: group[pair[0]].solid.scratch.search.take(&[with]),
                        met: vec![],
                        seconds: 0.0,
                    });
                }
            }
        }
    }
    let all = &*group;
    (found.par_iter_mut()).for_each(|one| {
        let mut seconds = 0.0;
        timed(&mut seconds, || one.press(all, &seen, around, moved));
        one.seconds = seconds;
    });
    for Pressed {
        pair,
        list,
        met,
        seconds,
        ..
    } in found
    {
        let [owner, other] = pair;
        group[owner].solid.scratch.seconds.all += seconds;
        group[owner].solid.keep(list);
        let ids = pair.map(|n| group[n].id);
        for one in met.into_iter().flatten() {
            let bears = &group[owner].object.surface.points[one.point].bears;
            group[owner].solid.state.springs[one.point] = one.grip;
            group[owner].solid.push(bears, one.force);
            if let Some(bears) = &one.bears {
                group[other].solid.push(bears, one.force.map(|f| -f));
            }
            ledger.add(ids[0], ContactPartner::Object(ids[1]), &one.received(kick));
        }
    }
}

impl Pressed<'_> {
    /// Looks at what the other presses on the points with.
    fn press(
        &mut self,
        group: &[Mover<'_>],
        seen: &[(Bounds, Start)],
        around: &Around<'_>,
        moved: f64,
    ) {
        let [one, other] = self.pair.map(|n| &group[n]);
        let ([own_depth, depth], with) = (self.depths, self.with);
        let isa = around.outside.isa;
        let friction = around.scene.surface_between(one.id, other.id).friction;
        let (surface, others) = (&one.object.surface, &other.object.surface);
        let there = Presence::new(&other.solid, others, depth, seen[self.pair[1]].1);
        let find = |solid: &Solid<'_>, due: &[usize]| there.near(isa, solid, surface, with.0, due);
        let ways = &other.solid.scratch.search.groups;
        let list = &mut self.list;
        one.solid.refresh(list, (&[with], ways), moved, find);
        if !list.is_empty() {
            let here = Presence::new(&one.solid, surface, own_depth, seen[self.pair[0]].1);
            self.met = here.pressed_by(&there, isa, list, [friction, moved], with.0);
        }
    }
}
