//! Patches of objects that clients hold by springs.

use std::sync::Arc;

use super::{
    World,
    bounds::{MAX_LENGTH, within},
};
use crate::{
    colliders::springs::{Grasped, Hold, PatchPoint, Spring, centre, effective_mass},
    command::{CommandError, HoldChange},
    mat3::{Mat3, dot, length},
    materials::polar,
    state::Grab,
};

/// Patches that are held at once, at most.
pub(super) const MAX_GRABS: usize = 64;
/// Steps that a hold lasts without a drag, where a command does not say.
const DEFAULT_STEPS: u32 = 60;
/// The same, at most.
pub(super) const MAX_STEPS: u32 = 1_000_000;
/// Largest force, over the weight of the object; without gravity over that on Earth.
const MAX_WEIGHTS: f64 = 10.0;
/// Gravity on Earth [m/s^2].
const EARTH: f64 = 9.806_65;
/// Share of its size by which a patch is taken for a ball where its rotation is measured: one that is flat, or a line, has none
/// about itself.
const ROUND: f64 = 1e-4;

/// What a command makes of the patches that are held.
pub(super) enum Grasp {
    /// This one is held, in place of a former one of the same holder and object.
    Take(Grab),
    /// The one at this place in the list is pulled elsewhere [m].
    Drag(usize, [f64; 3]),
    /// The one at this place is not held any more.
    LetGo(usize),
}

impl World {
    /// A command of a holder about a patch of an object.
    pub(super) fn checked_hold(
        &self,
        holder: u64,
        object: usize,
        change: &HoldChange,
    ) -> Result<Grasp, CommandError> {
        self.mass_of(object)?;
        Ok(match *change {
            HoldChange::Grab {
                point,
                target,
                radius,
                steps,
            } => {
                for x in point {
                    within("point", x, -MAX_LENGTH, MAX_LENGTH)?;
                }
                within("radius", radius, f64::MIN_POSITIVE, MAX_LENGTH)?;
                self.check_target(target)?;
                within("steps", steps.into(), 0.0, MAX_STEPS.into())?;
                let is_new = self.place_of_grab(holder, object).is_err();
                if is_new && self.state.commanded.grabs.len() >= MAX_GRABS {
                    return Err(CommandError::TooManyGrabs { max: MAX_GRABS });
                }
                let particles = self.within_reach(object, point, radius);
                let (centre, _) = centre(&self.grasped(object, &particles));
                let places = particles.iter().map(|&id| {
                    let x = self.particle_place(id);
                    std::array::from_fn(|a| x[a] - centre[a])
                });
                let steps = if steps == 0 { DEFAULT_STEPS } else { steps };
                Grasp::Take(Grab {
                    object,
                    holder,
                    places: places.collect(),
                    particles,
                    offset: std::array::from_fn(|a| centre[a] - point[a]),
                    from: target,
                    target,
                    steps,
                    steps_left: steps,
                })
            }
            HoldChange::Drag { target } => {
                self.check_target(target)?;
                Grasp::Drag(self.place_of_grab(holder, object)?, target)
            }
            HoldChange::LetGo => Grasp::LetGo(self.place_of_grab(holder, object)?),
        })
    }

    /// A patch can be pulled to any place in the domain: nothing is to be lost outside.
    fn check_target(&self, target: [f64; 3]) -> Result<(), CommandError> {
        let domain = &self.model.scene.domain;
        for a in 0..3 {
            within("target", target[a], domain.min[a], domain.max[a])?;
        }
        Ok(())
    }

    /// Where in the list the patch is that somebody holds of an object.
    fn place_of_grab(&self, holder: u64, object: usize) -> Result<usize, CommandError> {
        let mut grabs = self.state.commanded.grabs.iter();
        let is_it = |grab: &Grab| (grab.holder, grab.object) == (holder, object);
        grabs
            .position(is_it)
            .ok_or(CommandError::NotHeld { object, holder })
    }

    /// Takes hold, drags or lets go.
    pub(super) fn change_grabs(&mut self, grasp: Grasp) {
        let grabs = &mut self.state.commanded.grabs;
        match grasp {
            Grasp::Take(grab) => {
                grabs.retain(|g| (g.holder, g.object) != (grab.holder, grab.object));
                grabs.push(grab);
                // Which blocks hold its particles is to be noted.
                self.state.matter.drift = f64::INFINITY;
            }
            Grasp::Drag(place, target) => {
                let grab = &mut grabs[place];
                grab.target = target;
                grab.steps_left = grab.steps;
            }
            Grasp::LetGo(place) => {
                grabs.remove(place);
            }
        }
    }

    /// Lets springs pull through a frame of `length` [s] at all patches of which something is left.
    pub(super) fn set_springs(&mut self, length: f64) {
        let mut grabs = std::mem::take(&mut self.state.commanded.grabs);
        let springs = (grabs.iter_mut()).filter_map(|grab| self.spring(grab, length));
        self.model.rules.springs = Arc::new(springs.collect());
        self.state.commanded.grabs = grabs;
    }

    fn spring(&self, grab: &mut Grab, frame: f64) -> Option<Spring> {
        let grasped = self.grasped(grab.object, &grab.particles);
        let state = &self.report.objects[grab.object];
        let (centre, mass) = centre(&grasped);
        if grasped.is_empty() || mass <= 0.0 || state.mass <= 0.0 || frame <= 0.0 {
            return None;
        }
        let start = self.state.progress.sim_time;
        let weight = match length(self.state.commanded.gravity) {
            0.0 => EARTH,
            g => g,
        };
        let hold = Hold {
            object: grab.object,
            way: [grab.from, grab.target].map(|x| std::array::from_fn(|a| x[a] + grab.offset[a])),
            span: [start, start + frame],
            max_force: MAX_WEIGHTS * weight * state.mass,
        };
        let arm = std::array::from_fn(|a| centre[a] - state.com[a]);
        // As spin is measured: with the share of the affine part, which keeps thin objects from having none.
        let own = 0.5 * self.model.scene.dx * self.model.scene.dx * state.mass;
        let [xx, xy, xz, yy, yz, zz] = state.inertia;
        let inertia = Mat3([[xx + own, xy, xz], [xy, yy + own, yz], [xz, yz, zz + own]]);
        let effective = effective_mass(state.mass, &inertia, arm);
        Some(Spring::new(&hold, &held(grab, &grasped), effective))
    }

    /// Where a particle is [m].
    fn particle_place(&self, id: u32) -> [f64; 3] {
        self.published.cells[id as usize].map(|x| x * self.model.scene.dx)
    }

    /// Those of some particles of an object that are simulated, with places and masses.
    fn grasped(&self, object: usize, particles: &[u32]) -> Vec<Grasped> {
        let owner = &self.model.scene.objects[object];
        let published = &self.published;
        let left = particles
            .iter()
            .filter(|&&id| published.volume[id as usize] > 0.0);
        left.map(|&id| {
            let p = id as usize;
            Grasped {
                id,
                x: self.particle_place(id),
                mass: owner.density_of(p) * published.volume[p],
            }
        })
        .collect()
    }

    /// Ends a frame: springs are gone, targets reached, and who does not drag lets go in the end.
    pub(super) fn end_springs(&mut self) {
        self.model.rules.springs = Arc::default();
        for grab in &mut self.state.commanded.grabs {
            grab.from = grab.target;
            grab.steps_left -= 1;
        }
        self.state
            .commanded
            .grabs
            .retain(|grab| grab.steps_left > 0);
    }
}

/// Turns a patch in the hand as its particles have turned, and gives those that are left their places about their centre.
fn held(grab: &mut Grab, grasped: &[Grasped]) -> Vec<PatchPoint> {
    let left: Vec<usize> = grasped
        .iter()
        .filter_map(|p| grab.particles.binary_search(&p.id).ok())
        .collect();
    let (centre, mass) = centre(grasped);
    let mut middle = [0.0; 3];
    for (p, &n) in grasped.iter().zip(&left) {
        for a in 0..3 {
            middle[a] += p.mass / mass * grab.places[n][a];
        }
    }
    // Of the rotations the one that brings places nearest to particles.
    let (mut sums, mut size) = (Mat3([[0.0; 3]; 3]), 0.0);
    for (p, &n) in grasped.iter().zip(&left) {
        let place: [f64; 3] = std::array::from_fn(|a| grab.places[n][a] - middle[a]);
        for a in 0..3 {
            for b in 0..3 {
                sums.0[a][b] += p.mass * (p.x[a] - centre[a]) * place[b];
            }
        }
        size += p.mass * dot(place, place);
    }
    for a in 0..3 {
        sums.0[a][a] += ROUND * size;
    }
    if size > 0.0 && sums.det() > 0.0 {
        let scaled = Mat3(sums.0.map(|row| row.map(|x| x / size)));
        let turn = polar::rotation(&scaled);
        let all = grab.places.iter_mut().chain([&mut middle]);
        all.for_each(|place| *place = turn.mul_vec(*place));
    }
    let places = left.iter().map(|&n| &grab.places[n]);
    let held = grasped.iter().zip(places).map(|(p, place)| PatchPoint {
        id: p.id,
        place: std::array::from_fn(|a| place[a] - middle[a]),
        mass: p.mass,
    });
    held.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A patch at rest, and its particles after a quarter of a turn about z, a shift and a stretch along what was x.
    fn turned(places: &[[f64; 3]]) -> (Grab, Vec<Grasped>) {
        let grab = Grab {
            object: 0,
            holder: 1,
            particles: (0..places.len() as u32).collect(),
            places: places.to_vec(),
            offset: [0.0; 3],
            from: [0.0; 3],
            target: [0.0; 3],
            steps: 1,
            steps_left: 1,
        };
        let grasped = places.iter().enumerate().map(|(n, &[x, y, z])| Grasped {
            id: n as u32,
            x: [2.0 - y, 3.0 + 1.5 * x, 4.0 + z],
            mass: 2.0,
        });
        (grab, grasped.collect())
    }

    fn off(a: [f64; 3], b: [f64; 3]) -> f64 {
        length(std::array::from_fn(|n| a[n] - b[n]))
    }

    #[test]
    fn a_patch_turns_in_the_hand_and_keeps_its_shape() {
        let corners = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.5, 0.0]];
        let round = [[0.0, -0.5, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, -0.2]];
        let places = [corners, round].concat();
        // All of them, those of a plane, and those of a line.
        for count in [6, 4, 2] {
            let places = &places[..count];
            let middle = |a: usize| places.iter().map(|x| x[a]).sum::<f64>() / count as f64;
            let middle: [f64; 3] = std::array::from_fn(middle);
            let (mut grab, grasped) = turned(places);
            let found = held(&mut grab, &grasped);
            for (held, place) in found.iter().zip(places) {
                let [x, y, z] = std::array::from_fn(|a| place[a] - middle[a]);
                // What a ball's share in the patch bends: a few times its size.
                assert!(
                    off(held.place, [-y, x, z]) < 10.0 * ROUND,
                    "{held:?} {place:?}"
                );
            }
        }
    }

    #[test]
    fn a_patch_that_has_lost_particles_has_its_centre_elsewhere() {
        let places = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]];
        let (mut grab, grasped) = turned(&places);
        let found = held(&mut grab, &grasped[1..]);
        assert_eq!(found.len(), 3);
        for a in 0..3 {
            let sum: f64 = found.iter().map(|held| held.mass * held.place[a]).sum();
            assert!(sum.abs() < 1e-12, "{found:?}");
        }
        let (mut single, grasped) = turned(&places[1..2]);
        let alone = held(&mut single, &grasped);
        assert_eq!(alone[0].place, [0.0; 3]);
        assert_eq!(held(&mut single, &[]).len(), 0);
    }
}
