//! Surface points of solids against rigid bodies: the penalty of [`contact`](super::contact), with its opposite on the body.
//!
//! Bodies move by the engine of `bodies` in the substeps of the solids. That takes what acts as a constant force through a
//! substep, so that rest on other bodies and on colliders stays rest. Nodes take impulses between substeps. Both get the same
//! in sum, because [`Exchange`] gives a body what is missing of it in the next substep.

use super::{
    advance::Solid,
    contact::ContactSurface,
    grip::{Grip, NOTHING},
    pairs::PointContact,
    penalty::{Account, NormalContact},
    search::{CandidateList, FoundInCluster, find_near},
    stand::Stand,
};
use crate::{
    bodies::actor::Actor,
    colliders::Substep,
    mat3::{cross, dot},
    rotation::rotate,
};

/// Largest depth at which a point may begin to touch [cells]: what is deeper began elsewhere.
const ENTRY: f64 = 2.0;
/// Share of what a node bears of springs that a body may: `CONTACT` over four times what pushes and turns it.
const SHARE: f64 = 0.75;

/// A force [N], or an impulse [N s], and its moment about the world's origin [N m].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// The force or impulse.
    pub force: [f64; 3],
    /// Its moment.
    pub moment: [f64; 3],
}

impl Wrench {
    /// Of a force with a torque about a point [m].
    pub fn about(point: [f64; 3], force: [f64; 3], torque: [f64; 3]) -> Self {
        let turn = cross(point, force);
        Self {
            force,
            moment: std::array::from_fn(|a| torque[a] + turn[a]),
        }
    }

    /// Force, and torque about a point [m].
    pub fn load_about(&self, point: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let turn = cross(point, self.force);
        (
            self.force,
            std::array::from_fn(|a| self.moment[a] - turn[a]),
        )
    }

    /// Adds `scale` times another.
    pub fn add(&mut self, scale: f64, other: &Self) {
        for a in 0..3 {
            self.force[a] += scale * other.force[a];
            self.moment[a] += scale * other.moment[a];
        }
    }
}

/// Rigid bodies that solids meet.
pub trait RigidPeers {
    /// All of them where they are.
    fn actors(&self) -> &[Actor<'_>];
    /// Their numbers in the scene.
    fn objects(&self) -> &[usize];
    /// Moves all by a substep under these forces.
    fn advance(&mut self, now: &Substep, forces: &[Wrench]);
    /// Gives each an impulse at once.
    fn push(&mut self, impulses: &[Wrench]);
}

/// What solids have given to bodies, and what nodes have got of the same forces: as much in sum.
#[derive(Clone, Debug, Default)]
pub struct Exchange {
    before: Vec<Wrench>,
    dt: f64,
}

impl Exchange {
    /// Force through a substep of `dt` [s] > 0 where `now` acts at its start: half of what forces changed by since the substep
    /// before is made good.
    pub fn through(&mut self, now: Vec<Wrench>, dt: f64) -> Vec<Wrench> {
        let mut through = now.clone();
        self.make_good(&now, 0.5 * self.dt / dt, &mut through);
        (self.before, self.dt) = (now, dt);
        through
    }

    /// Impulse at the end, where `now` acts.
    pub fn rest(&self, now: &[Wrench]) -> Vec<Wrench> {
        let mut rest = vec![Wrench::default(); now.len()];
        self.make_good(now, 0.5 * self.dt, &mut rest);
        rest
    }

    fn make_good(&self, now: &[Wrench], scale: f64, sums: &mut [Wrench]) {
        for ((sum, now), before) in sums.iter_mut().zip(now).zip(&self.before) {
            sum.add(scale, now);
            sum.add(-scale, before);
        }
    }
}

/// A solid whose points bodies press on.
pub(crate) struct Pressed<'a> {
    pub solid: &'a Solid<'a>,
    pub surface: &'a ContactSurface,
    pub springs: &'a [Grip],
    /// Tangent at rest [Pa].
    pub modulus: f64,
    /// Cell size [m].
    pub dx: f64,
    /// Largest tangent at rest over density, which its substeps are for [m^2/s^2].
    pub fastest: f64,
}

impl Pressed<'_> {
    /// What a body presses on the points with, `moved` [s] since they were looked at, by Coulomb's law; `number` tells its
    /// springs. Springs that let go are among them.
    pub fn pressed_by(
        &self,
        actor: &Actor<'_>,
        friction: f64,
        moved: f64,
        number: u32,
        list: &mut CandidateList,
    ) -> Vec<Vec<PointContact>> {
        let (shape, body) = (actor.shape, &actor.body);
        let spin = body.spin(&shape.inertia);
        let area = std::f64::consts::PI * shape.radius * shape.radius;
        let bearable = SHARE * shape.inertia.mass / (self.dx * area) * self.fastest;
        let scale = self.modulus.min(bearable);
        list.meet(&self.solid.scratch.search.own, |watched, met| {
            let n = watched.point as usize;
            let [x, v] = self.solid.motion(self.surface, n);
            let before = self.springs[n];
            let known = before.with == number;
            let arm: [f64; 3] = std::array::from_fn(|a| x[a] - body.com[a]);
            if !known && dot(arm, arm) > shape.radius * shape.radius {
                return 0.0;
            }
            let found = actor.depth(x);
            let put_in = self.solid.state.overlaps.depth(n, number);
            let depth = found - put_in;
            let stiffness = scale * self.surface.stiffness[n];
            // What was put in is led out, whatever work that takes.
            let remembers = put_in == 0.0 && (known || before.with == NOTHING);
            let account = remembers.then(|| Account::of(&before, stiffness));
            let touches = depth > 0.0 && (known || put_in > 0.0 || depth <= ENTRY * self.dx);
            if !touches {
                met.extend(known.then(|| PointContact {
                    grip: match account {
                        Some(account) => account.part(depth - before.depth),
                        None => Grip::NONE,
                    },
                    ..PointContact::none(n, x)
                }));
                return -found;
            }
            let normal = rotate(body.rotation, shape.normal(body.inverse_point(x)));
            let turn = cross(spin, arm);
            let relative = std::array::from_fn(|a| v[a] - body.velocity[a] - turn[a]);
            let contact = NormalContact {
                stiffness,
                depth,
                slope: 1.0,
                normal,
                friction,
                approach: match known {
                    true => depth - before.depth,
                    false => -moved * dot(relative, normal),
                },
            };
            let stretch = known.then_some(before.stretch);
            let (force, grip) = contact.press(number, (account, stretch), (relative, moved));
            met.push(PointContact {
                point: n,
                grip,
                force,
                at: [x, normal],
                pressure: grip.pressure,
                bears: None,
            });
            0.0
        })
    }
}

/// Points of the clusters of a solid that are due which may soon touch a body, or do by a grip that `number` tells.
pub(crate) fn near_body(
    solid: &Solid<'_>,
    surface: &ContactSurface,
    actor: &Actor<'_>,
    number: u32,
    due: &[usize],
) -> Vec<FoundInCluster> {
    let (shape, body, margin) = (actor.shape, &actor.body, solid.margin());
    let clear = |x: [f64; 3]| {
        let arm: [f64; 3] = std::array::from_fn(|a| x[a] - body.com[a]);
        let beyond = dot(arm, arm).sqrt() - shape.radius;
        match beyond < margin {
            true => shape.distance(body.inverse_point(x)),
            false => beyond,
        }
    };
    find_near(due, |cluster| {
        solid.near(surface, cluster, |grip| grip.with == number, clear)
    })
}

/// Where a body stands.
pub(crate) fn stand_of(actor: &Actor<'_>) -> Stand {
    Stand {
        place: actor.body.com,
        turn: actor.body.rotation,
        radius: actor.shape.radius,
    }
}

/// Opposite of the forces on points.
pub(crate) fn opposite<'a>(met: impl Iterator<Item = &'a PointContact>) -> Wrench {
    let mut sum = Wrench::default();
    for one in met {
        sum.add(-1.0, &Wrench::about(one.at[0], one.force, [0.0; 3]));
    }
    sum
}
