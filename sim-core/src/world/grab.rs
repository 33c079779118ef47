//! Patches of objects that clients hold by springs.

use std::sync::Arc;

use super::{
    World,
    bounds::{MAX_LENGTH, within},
};
use crate::{
    colliders::springs::{Grasped, Hold, Spring, centre, effective_mass},
    command::{CommandError, HoldChange},
    mat3::{Mat3, length},
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
                let steps = if steps == 0 { DEFAULT_STEPS } else { steps };
                Grasp::Take(Grab {
                    object,
                    holder,
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
        let grabs = std::mem::take(&mut self.state.commanded.grabs);
        let springs = grabs.iter().filter_map(|grab| self.spring(grab, length));
        self.model.rules.springs = Arc::new(springs.collect());
        self.state.commanded.grabs = grabs;
    }

    fn spring(&self, grab: &Grab, frame: f64) -> Option<Spring> {
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
        Some(Spring::new(&hold, &grasped, effective))
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
                x: published.cells[p].map(|x| x * self.model.scene.dx),
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
