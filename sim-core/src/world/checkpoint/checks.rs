//! What a checkpoint must hold to be used: a checkpoint is a file, and files come from anywhere.

use super::{
    CheckpointError, Frozen, World, arrangement::check_arrangement, count, inconsistent,
    numbers::check_numbers,
};
use crate::{
    bodies::{body::Body, shape::Shape},
    command::Action,
    mat3::length,
    model::Painted,
    particles::{Block, Extremes, NO_PARTICLE},
    scene::Fidelity,
    solid::state::SolidState,
    state::{Commanded, Given, Grab, State, away::Loose, rigid::RigidBody, sleep::SleepState},
    world::{
        grab::{MAX_GRABS, MAX_STEPS as MAX_STEPS_HELD},
        paint::MAX_PAINTED,
    },
};

/// Most steps of a run.
const MAX_STEPS: u64 = 1 << 62;
/// Largest time by which velocities are behind positions [s]: half of the longest frame of a scene.
const LONGEST_OFFSET: f64 = 500.0;
/// Largest speed of a body, over what a command may cause: what falls for long is faster, and the search for impacts takes
/// its time for every cell on the way.
const FASTEST: f64 = 100.0;
/// Largest spin of a body, over what the largest commanded speed is at a cell from its centre: a push on a few particles may
/// come to as much, a fall adds none, and the search for impacts takes its time for every turn.
const FASTEST_SPIN: f64 = 4.0;
/// Largest distance of a body's particles from its centre, over the size of its object at rest.
const LARGEST_STRETCH: f64 = 4.0;
/// What lengths may be off by, relative.
const ROUNDING: f64 = 1e-6;

/// Whether a quaternion is a rotation.
fn is_unit(rotation: &[f64; 4]) -> bool {
    (rotation.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < ROUNDING
}

impl World {
    /// Everything that the solver relies on without looking.
    pub(super) fn check_snapshot(
        &self,
        state: &State,
        frozen: &[Frozen],
    ) -> Result<(), CheckpointError> {
        self.check_counts(state, frozen.len())?;
        check_numbers(state)?;
        check_numbers(&frozen)?;
        self.check_motion(state)?;
        self.check_commanded(state)?;
        self.check_grabs(state)?;
        self.check_edits(state)?;
        self.check_solids(state)?;
        self.check_particles(state)?;
        self.check_bodies(state)?;
        self.check_levels(state)?;
        let scene = &self.model.scene;
        let is_there = |n: u32| (n as usize) < scene.objects.len();
        match state.in_contact.fields().all(is_there) {
            false => Err(inconsistent("an object in contact is not there".into())),
            true => check_arrangement(&state.matter.particles, state.matter.drift, &self.model),
        }
    }

    /// Painted particles are of the parts of the scene that they say, each once.
    pub(super) fn check_painted(&self, painted: &[Painted]) -> Result<(), CheckpointError> {
        let model = &self.model;
        let mut seen = vec![false; model.scene.particles.position.len()];
        for entry in painted {
            let part = model.parts[..model.scene_parts].get(entry.part);
            let own = part.map(|part| &part.particles);
            let is_paintable = part.is_some_and(|part| model.lagrangian[part.object].is_none());
            let mut is_new = |id: &u32| {
                let is_own = own.is_some_and(|own| own.contains(&(*id as usize)));
                is_own && !std::mem::replace(&mut seen[*id as usize], true)
            };
            let is_sound = is_paintable
                && entry.particles.is_sorted_by(|a, b| a < b)
                && entry.particles.iter().all(&mut is_new);
            if !is_sound || painted.len() > MAX_PAINTED {
                let reason = format!("what is painted of part {} is none of it", entry.part);
                return Err(inconsistent(reason));
            }
        }
        Ok(())
    }

    /// As many of each as the scene has.
    fn check_counts(&self, state: &State, frozen: usize) -> Result<(), CheckpointError> {
        let scene = &self.model.scene;
        let (parts, objects) = (self.model.parts.len(), scene.objects.len());
        for (what, found, expected) in [
            ("materials", state.commanded.materials.len(), parts),
            ("shape marks", state.matter.shaped.len(), parts),
            ("extremes", state.matter.extremes.len(), parts),
            ("momenta", state.progress.momentum.len(), objects),
            ("rigid bodies", state.bodies.of.len(), objects),
            ("solids", state.solids.len(), objects),
            ("solids that went over", state.gone_over.len(), objects),
            ("model levels", state.levels.len(), objects),
            ("pins", state.commanded.pins.len(), objects),
            (
                "model levels wanted",
                state.commanded.fidelity.len(),
                objects,
            ),
            ("absences", state.commanded.away.len(), objects),
            ("shown poses", state.commanded.shown.len(), objects),
            (
                "colliders",
                state.commanded.paths.len(),
                scene.colliders.len(),
            ),
            ("frozen particles", frozen, state.matter.removed.len()),
        ] {
            count(what, found, expected)?;
        }
        Ok(())
    }

    /// Times and velocities that a run can have come to.
    fn check_motion(&self, state: &State) -> Result<(), CheckpointError> {
        let (progress, motion) = (&state.progress, &state.motion);
        let offset = motion.velocity_offset;
        if !(0.0..=LONGEST_OFFSET).contains(&offset) {
            let reason = format!("velocities are {offset} s behind positions");
            return Err(inconsistent(reason));
        }
        let is_timed = progress.steps <= MAX_STEPS && progress.sim_time >= 0.0;
        let is_slow =
            length(motion.frame_velocity) * self.model.scene.dx <= FASTEST * self.max_speed();
        if !is_timed || !is_slow || motion.max_speed < 0.0 || state.matter.drift < 0.0 {
            let reason = format!(
                "step {} at {} s with the frame velocity {:?} cells/s is none of a run",
                progress.steps, progress.sim_time, motion.frame_velocity
            );
            return Err(inconsistent(reason));
        }
        let negative = |e: &Extremes| {
            let all = [e.stretch_squared, e.min_j, e.max_j, e.stiffness];
            all.iter().any(|x| *x < 0.0)
        };
        match state.matter.extremes.iter().any(negative) {
            true => Err(inconsistent("a square is negative".into())),
            false => Ok(()),
        }
    }

    /// What commands can have led to: the checks are theirs.
    fn check_commanded(&self, state: &State) -> Result<(), CheckpointError> {
        let Commanded {
            gravity,
            materials,
            paths,
            ..
        } = &state.commanded;
        let scene = &self.model.scene;
        if *gravity != scene.gravity {
            let gravity = Action::SetGravity { gravity: *gravity };
            self.check(&gravity)
                .map_err(|e| inconsistent(e.to_string()))?;
        }
        for (part, material) in self.model.parts.iter().zip(materials) {
            if *material != part.material {
                let judged = self.check_material(part.object, material);
                judged.map_err(|e| inconsistent(format!("object {}: {e}", part.object)))?;
            }
        }
        for (collider, path) in paths.iter().enumerate() {
            let Some(path) = path else { continue };
            let poses = [path.from, path.to];
            let turned = poses.iter().all(|pose| is_unit(&pose.rotation));
            let way = std::array::from_fn(|a| poses[1].translation[a] - poses[0].translation[a]);
            let fastest = self.max_speed() / scene.frame_rate;
            if !turned || length(way) > (1.0 + ROUNDING) * fastest {
                let reason = format!(
                    "collider {collider} moves from {:?} to {:?}",
                    path.from, path.to
                );
                return Err(inconsistent(reason));
            }
        }
        Ok(())
    }

    /// Patches are of particles of their objects, and pulled to places in the domain.
    fn check_grabs(&self, state: &State) -> Result<(), CheckpointError> {
        let grabs = &state.commanded.grabs;
        let objects = &self.model.scene.objects;
        for (n, grab) in grabs.iter().enumerate() {
            let own = objects.get(grab.object).map(|object| &object.particles);
            let is_own = |p: &u32| own.is_some_and(|own| own.contains(&(*p as usize)));
            let is_patch = grab.particles.iter().all(is_own)
                && grab.particles.is_sorted_by(|a, b| a < b)
                && grab.places.len() == grab.particles.len()
                && grab.places.iter().flatten().all(|x| x.is_finite())
                && [grab.from, grab.target]
                    .iter()
                    .all(|x| self.model.is_inside(*x));
            let is_held =
                (1..=grab.steps).contains(&grab.steps_left) && grab.steps <= MAX_STEPS_HELD;
            let before = grabs[..n].iter();
            let is_known = |g: &Grab| (g.holder, g.object) == (grab.holder, grab.object);
            if !is_patch || !is_held || before.into_iter().any(is_known) || n >= MAX_GRABS {
                let reason = format!("the patch of object {} is none", grab.object);
                return Err(inconsistent(reason));
            }
        }
        Ok(())
    }

    /// What edits made of objects.
    fn check_edits(&self, state: &State) -> Result<(), CheckpointError> {
        let commanded = &state.commanded;
        for (object, o) in self.model.scene.objects.iter().enumerate() {
            let (away, shown) = (&commanded.away[object], &commanded.shown[object]);
            let is_shown = o.fidelity == Fidelity::Static;
            let turned = [
                away.as_ref().map(|away| away.rotation),
                shown.map(|pose| pose.rotation),
            ];
            let is_turned = turned.iter().flatten().all(is_unit);
            let fits = match is_shown {
                true => commanded.fidelity[object].is_none(),
                false => shown.is_none(),
            };
            if !is_turned || !fits {
                let reason = format!("object {object} is neither there nor away");
                return Err(inconsistent(reason));
            }
            let Some(away) = away else { continue };
            let lifted = &away.lifted;
            let own = |p: &Loose| o.particles.contains(&(p.id as usize));
            if !lifted.loose.iter().all(own) || is_shown && !lifted.loose.is_empty() {
                let reason = format!("object {object} is away with particles of others");
                return Err(inconsistent(reason));
            }
            if let Some(rigid) = &lifted.body {
                self.check_body(object, rigid)?;
            }
            if let Some(solid) = &lifted.solid {
                self.check_solid(object, solid)?;
            }
        }
        Ok(())
    }

    /// Bodies are in the domain, and made of particles of their objects about where these were at rest.
    fn check_bodies(&self, state: &State) -> Result<(), CheckpointError> {
        for (object, rigid) in state.bodies.of.iter().enumerate() {
            if let Some(rigid) = rigid {
                self.check_body(object, rigid)?;
            }
        }
        Ok(())
    }

    fn check_body(&self, object: usize, rigid: &RigidBody) -> Result<(), CheckpointError> {
        let (scene, fastest) = (&self.model.scene, FASTEST * self.max_speed());
        let own = scene.objects[object].particles.clone();
        let is_own = rigid.members.iter().all(|m| own.contains(&(m.id as usize)));
        let size = (0..3).map(|a| {
            let places = own.clone().map(|p| scene.particles.position[p][a]);
            let [low, high] = places.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], x| {
                [l.min(x), h.max(x)]
            });
            high - low
        });
        let reach = LARGEST_STRETCH * (size.sum::<f64>() + scene.dx);
        let is_here = rigid.members.iter().all(|m| length(m.place) <= reach);
        let Body {
            com,
            rotation,
            velocity,
            ..
        } = rigid.body;
        let moves = self.model.is_inside(com) && length(velocity) <= fastest && is_unit(&rotation);
        let is_body = !rigid.members.is_empty() && (0.0..=reach * reach).contains(&rigid.own);
        if !(is_own && is_here && moves && is_body) {
            return Err(inconsistent(format!("the body of object {object} is none")));
        }
        let grains = rigid.members.iter();
        let grains = grains.map(|m| self.model.grain(object, m.id, m.place));
        let inertia = Shape::inertia(&grains.collect::<Vec<_>>(), rigid.own);
        let spin = rigid.body.spin(&inertia);
        let most = FASTEST_SPIN * self.max_speed() / scene.dx;
        if length(spin).is_nan() || length(spin) > most {
            return Err(inconsistent(format!(
                "the body of object {object} spins with {spin:?} rad/s, expected at most {most}"
            )));
        }
        Ok(())
    }

    /// What sleeps does so whole, and what is joined to a body is there alone.
    fn check_levels(&self, state: &State) -> Result<(), CheckpointError> {
        let given = Given::new(&self.model, state);
        for run in &state.matter.particles.runs {
            if run.part < self.model.parts.len() && given.is_joined(run.part) {
                let reason = format!("part {} is rigid and has particles that deform", run.part);
                return Err(inconsistent(reason));
            }
        }
        for (object, level) in state.levels.iter().enumerate() {
            let Some(sleeping) = level.sleeping() else {
                continue;
            };
            // Whoever wakes is sorted.
            check_arrangement(sleeping, f64::INFINITY, &self.model)?;
            let own = |block: &Block| block.field == object as u32;
            let parts = self.model.parts.iter().filter(|part| part.object == object);
            let is_whole = sleeping.blocks.iter().all(own)
                && !state.matter.particles.blocks.iter().any(own)
                && level.remembered_parts() == parts.count();
            if !is_whole {
                return Err(inconsistent(format!("object {object} sleeps in part")));
            }
        }
        Ok(())
    }

    /// Solids are those of the scene, with all of their nodes.
    fn check_solids(&self, state: &State) -> Result<(), CheckpointError> {
        let levels = &state.levels;
        for (object, solid) in state.solids.iter().enumerate() {
            let Some(state) = solid else {
                if self.model.lagrangian[object].is_some() && levels[object].proxy.is_some() {
                    return Err(inconsistent(format!("object {object} has no nodes")));
                }
                continue;
            };
            self.check_solid(object, state)?;
        }
        Ok(())
    }

    fn check_solid(&self, object: usize, state: &SolidState) -> Result<(), CheckpointError> {
        let Some(model) = &self.model.lagrangian[object] else {
            return Err(inconsistent(format!("object {object} is no solid")));
        };
        let (nodes, springs) = (state.nodes.len(), state.springs.len());
        count("blocks of nodes", nodes, model.grid.node_blocks.len())?;
        count("springs", springs, model.surface.points.len())?;
        if !state.overlaps.are_sound(springs) {
            let reason =
                format!("object {object} was put into something by points that it has not");
            return Err(inconsistent(reason));
        }
        count(
            "blocks of points",
            state.memory.len(),
            model.grid.point_blocks.len(),
        )?;
        for (block, memory) in state.memory.iter().enumerate() {
            if !memory.is_empty() {
                let parts = model.grid.parts.of(block).count();
                count("parts of a block", memory.len(), parts)?;
            }
        }
        if !state.relaxed.is_empty() {
            count("blocks of relaxed forces", state.relaxed.len(), nodes)?;
        }
        let slots = 64 * nodes as u64;
        let mut matter = state.of_matter.iter();
        if !state.is_sound() || matter.any(|load| u64::from(load.slot) >= slots) {
            let reason = format!("the nodes of object {object} are nowhere");
            return Err(inconsistent(reason));
        }
        Ok(())
    }

    /// Every particle is in one place: in an array, in a sleeping object, in a rigid body, or taken out.
    fn check_particles(&self, state: &State) -> Result<(), CheckpointError> {
        let mut seen = vec![false; self.model.scene.particles.position.len()];
        let taken = state.matter.removed.iter().copied();
        let sleeping = state.levels.iter().filter_map(SleepState::sleeping);
        let all = std::iter::once(&state.matter.particles).chain(sleeping);
        let here = all.flat_map(|p| p.fixed.iter().flat_map(|fixed| fixed.id));
        let members = || state.bodies.of.iter().flatten().flat_map(|r| &r.members);
        let here = here.filter(|&id| id != NO_PARTICLE);
        let solids = state.solids.iter().enumerate();
        let is_own = |id: usize| state.levels[id].proxy.is_none();
        let solids = solids.filter(|(id, solid)| solid.is_some() && is_own(*id));
        let of_solids = || {
            let ranges = solids.clone();
            ranges.flat_map(|(id, _)| self.model.scene.objects[id].particles.clone())
        };
        let elsewhere = members().map(|m| m.id).chain(of_solids().map(|p| p as u32));
        let away = || {
            let all = state.commanded.away.iter().zip(&self.model.scene.objects);
            all.filter_map(|(away, object)| Some((away.as_ref()?, object)))
                .flat_map(|(away, object)| away.lifted.ids(object.particles.clone()))
        };
        for id in taken.chain(here).chain(elsewhere).chain(away()) {
            match seen.get_mut(id as usize) {
                Some(seen) if !*seen => *seen = true,
                Some(_) => return Err(inconsistent(format!("particle {id} is in it twice"))),
                None => return Err(inconsistent(format!("particle {id} is not in the scene"))),
            }
        }
        let live = seen.iter().filter(|&&seen| seen).count() - state.matter.removed.len();
        let live = live - members().count() - of_solids().count() - away().count();
        count("live particles", state.matter.live, live)
    }
}
