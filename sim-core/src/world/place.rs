//! Objects are put elsewhere, taken out of the world and brought in: whole, at rest, as they are deformed.

use super::{
    World,
    bounds::{MAX_LENGTH, within},
    fidelity::are_near,
    solid_levels::place_nodes,
};
use crate::{
    command::{CommandError, Place},
    mat3::{Mat3, dot},
    moments::object_moments,
    report::ObjectState,
    rotation::{conjugate, product, rotate},
    scene::{Fidelity, Pose},
    solid::grip::Grip,
    state::{
        away::{Away, Lifted},
        sleep::SleepState,
    },
};

/// A unit quaternion of another one that is not zero.
fn normalised(rotation: [f64; 4]) -> Result<[f64; 4], CommandError> {
    let norm = rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
    within("length of the rotation", norm, 1e-6, 1e6)?;
    Ok(rotation.map(|x| x / norm))
}

impl World {
    /// Whether an object is not there: a command removed it, or has yet to bring it in.
    ///
    /// # Panics
    /// When `object` is not an object id of the scene, like slice indexing.
    pub fn is_removed(&self, object: usize) -> bool {
        self.state.commanded.away[object].is_some()
    }

    /// Whether an object is visible only.
    fn is_shown(&self, object: usize) -> bool {
        self.model.scene.objects[object].fidelity == Fidelity::Static
    }

    /// Puts an object that is there elsewhere.
    pub(super) fn checked_place(&self, object: usize, place: &Place) -> Result<Pose, CommandError> {
        self.check_present(object)?;
        let way = self.way_to(object, place)?;
        self.check_room(object, &way)?;
        Ok(way)
    }

    /// Brings an object in that is not there.
    pub(super) fn checked_entry(&self, object: usize, place: &Place) -> Result<Pose, CommandError> {
        self.check_known(object)?;
        if !self.is_removed(object) {
            return Err(CommandError::Present { object });
        }
        let way = self.way_to(object, place)?;
        self.check_room(object, &way)?;
        Ok(way)
    }

    fn check_known(&self, object: usize) -> Result<(), CommandError> {
        let count = self.model.scene.objects.len();
        match object < count {
            true => Ok(()),
            false => Err(CommandError::UnknownObject { object, count }),
        }
    }

    /// Something of the object is there, if only to be seen.
    pub(super) fn check_present(&self, object: usize) -> Result<(), CommandError> {
        match self.mass_of(object) {
            Err(CommandError::StaticObject { .. }) => Ok(()),
            other => other.map(|_| ()),
        }
    }

    /// The rigid motion of an object from where it is, or was, to a place.
    fn way_to(&self, object: usize, place: &Place) -> Result<Pose, CommandError> {
        let Place { position, rotation } = *place;
        for x in position.iter().flatten() {
            within("position", *x, -MAX_LENGTH, MAX_LENGTH)?;
        }
        let (com, turned) = self.place_of(object);
        let turn = match rotation {
            Some(to) => product(normalised(to)?, conjugate(turned)),
            None => Pose::IDENTITY.rotation,
        };
        let (to, arm) = (position.unwrap_or(com), rotate(turn, com));
        Ok(Pose {
            translation: std::array::from_fn(|a| to[a] - arm[a]),
            rotation: turn,
        })
    }

    /// Centre of mass [m] and rotation since rest of an object, or those it had; of one that is only shown the middle of
    /// its Gaussians.
    fn place_of(&self, object: usize) -> ([f64; 3], [f64; 4]) {
        if let Some(away) = &self.state.commanded.away[object] {
            return (away.com, away.rotation);
        }
        if self.is_shown(object) {
            let pose = self.state.commanded.shown[object].unwrap_or(Pose::IDENTITY);
            return (pose.point(self.middle_of(object)), pose.rotation);
        }
        let row = self.row_of(object);
        (row.com, row.rotation)
    }

    /// The middle of an object's Gaussians in the scene [m].
    pub(super) fn middle_of(&self, object: usize) -> [f64; 3] {
        let scene = &self.model.scene;
        let range = scene.objects[object].gaussians.clone();
        let share = (range.len().max(1) as f64).recip();
        let mut middle = [0.0; 3];
        for position in &scene.gaussians.position[range] {
            for a in 0..3 {
                middle[a] += share * f64::from(position[a]);
            }
        }
        middle
    }

    /// What is known of an object.
    pub(super) fn row_of(&self, object: usize) -> ObjectState {
        match self.report.objects.get(object) {
            Some(row) => *row,
            None => self.measured(object),
        }
    }

    /// Moments of an object as its particles were published last; the default of one that is not there.
    pub(super) fn measured(&self, object: usize) -> ObjectState {
        let known = self.body_state(object).or_else(|| self.solid_state(object));
        known.unwrap_or_else(|| {
            let bodies = (self.model).bodies_of(object, &self.state.commanded.materials);
            object_moments(&self.published.arrays(), &bodies, self.model.scene.dx)
        })
    }

    /// Moves an object.
    pub(super) fn put_elsewhere(&mut self, object: usize, way: &Pose) {
        if self.is_shown(object) {
            return self.show_elsewhere(object, way);
        }
        let before = self.row_of(object);
        let lifted = self.lift(object);
        self.set_down(object, lifted, way);
        self.book(object, &before);
    }

    /// Takes an object out of the world, at rest as it is deformed.
    pub(super) fn remove(&mut self, object: usize) {
        let before = self.row_of(object);
        let (com, rotation) = self.place_of(object);
        let lifted = match self.is_shown(object) {
            true => Lifted::default(),
            false => self.lift(object),
        };
        self.state.commanded.pins[object] = None;
        self.state.commanded.away[object] = Some(Away {
            lifted,
            com,
            rotation,
        });
        self.publish_away(object);
        self.book(object, &before);
    }

    /// Brings an object in.
    pub(super) fn bring_in(&mut self, object: usize, way: &Pose) {
        let Some(away) = self.state.commanded.away[object].take() else {
            return;
        };
        self.sight.touched(object);
        if self.is_shown(object) {
            return self.show_elsewhere(object, way);
        }
        let range = self.model.scene.objects[object].particles.clone();
        for id in away.lifted.ids(range) {
            let p = id as usize;
            self.published.volume[p] = self.model.scene.particles.volume[p];
        }
        self.set_down(object, away.lifted, way);
        self.book(object, &ObjectState::default());
    }

    fn show_elsewhere(&mut self, object: usize, way: &Pose) {
        let before = self.state.commanded.shown[object].unwrap_or(Pose::IDENTITY);
        self.state.commanded.shown[object] = Some(Pose {
            translation: way.point(before.translation),
            rotation: product(way.rotation, before.rotation),
        });
    }

    /// Takes everything of an object out of the state, at rest.
    fn lift(&mut self, object: usize) -> Lifted {
        self.rouse_around(object);
        self.wake(object);
        self.loosen(object);
        let parts = self.model.parts.iter();
        let own: Vec<bool> = parts.map(|part| part.object == object).collect();
        let mut loose = self.take_away(object, &own);
        for particle in &mut loose {
            (particle.v, particle.c) = ([0.0; 3], [0.0; 9]);
        }
        let mut body = self.state.bodies.of[object].take();
        self.state.bodies.shapes[object] = None;
        if let Some(rigid) = &mut body {
            (rigid.body.velocity, rigid.body.angular_momentum) = ([0.0; 3], [0.0; 3]);
        }
        let mut solid = self.state.solids[object].take();
        if let (Some(model), Some(state)) = (&self.model.lagrangian[object], &mut solid) {
            state.velocity = [0.0; 3];
            state.change_velocities(&model.grid, |_, _| [0.0; 3]);
            state.springs.fill(Grip::NONE);
            state.of_matter.clear();
        }
        if let Some(bounds) = self.workspace.solid_boxes.get_mut(object) {
            *bounds = None;
        }
        self.state.progress.momentum[object] = [0.0; 3];
        self.state.levels[object] = SleepState::default();
        let grabs = &mut self.state.commanded.grabs;
        grabs.retain(|grab| grab.object != object);
        self.state.matter.drift = f64::INFINITY;
        Lifted { loose, body, solid }
    }

    /// Puts an object that was lifted into the state, after a rigid motion.
    fn set_down(&mut self, object: usize, lifted: Lifted, way: &Pose) {
        let Lifted {
            mut loose,
            body,
            solid,
        } = lifted;
        let axis = |a: usize| rotate(way.rotation, std::array::from_fn(|b| f64::from(a == b)));
        let turn = Mat3::from_columns(axis(0), axis(1), axis(2));
        for particle in &mut loose {
            particle.x = way.point(particle.x);
            particle.visible = super::bodies::turned(&turn, &particle.visible);
            particle.elastic = super::bodies::turned(&turn, &particle.elastic);
        }
        if !loose.is_empty() {
            self.put_back(object, &loose);
        }
        if let Some(mut rigid) = body {
            rigid.body.com = way.point(rigid.body.com);
            rigid.body.rotation = product(way.rotation, rigid.body.rotation);
            self.state.bodies.shapes[object] = Some(self.shape_of(object, &rigid));
            self.state.bodies.of[object] = Some(rigid);
            self.sight.formed(object);
        }
        if let (Some(model), Some(mut state)) = (&self.model.lagrangian[object], solid) {
            place_nodes(&model.grid, &mut state, |x| way.point(x));
            self.state.solids[object] = Some(state);
        }
        self.state.matter.drift = f64::INFINITY;
        self.publish();
        if self.is_made_rigid(object) && !self.is_one_body(object) {
            self.stiffen(object);
        }
    }

    /// Wakes what is beside an object, within a block: that is as far as matter reaches through the grid. Who is awake
    /// forgets that it was still: what it rests on may be gone.
    pub(super) fn rouse_around(&mut self, object: usize) {
        let blocks = self.blocks_of(object).into_owned();
        for other in 0..self.model.scene.objects.len() {
            if other != object && are_near(&self.blocks_of(other), &blocks, 1) {
                self.wake(other);
            }
        }
    }

    /// Writes the particles of an object that is not there: where they were, without motion or mass.
    pub(super) fn publish_away(&mut self, object: usize) {
        let Some(away) = self.state.commanded.away[object].take() else {
            return;
        };
        let (lifted, dx) = (&away.lifted, self.model.scene.dx);
        for particle in &lifted.loose {
            self.published.update_loose(particle, dx);
        }
        if let Some(rigid) = &lifted.body {
            self.published.update_body(rigid, [0.0; 3], dx);
        }
        let range = self.model.scene.objects[object].particles.clone();
        if let (Some(model), Some(state)) = (&self.model.lagrangian[object], &lifted.solid) {
            let rest = &self.model.scene.particles.position;
            self.published
                .update_solid(self.model.isa, range.start, (model, rest), state);
        }
        for id in lifted.ids(range) {
            self.published.freeze(id);
        }
        self.state.commanded.away[object] = Some(away);
        self.sight.touched(object);
    }

    /// Takes note of what an edit made of an object, and of the energy and mass that it brought.
    pub(super) fn book(&mut self, object: usize, before: &ObjectState) {
        self.publish();
        let gravity = self.state.commanded.gravity;
        let energy = |row: &ObjectState| {
            row.kinetic_energy + row.elastic_energy - row.mass * dot(gravity, row.com)
        };
        let mut after = self.measured(object);
        after.level = self.level(object, after.mass);
        self.workspace.edited[0] += energy(&after) - energy(before);
        self.workspace.edited[1] += after.mass - before.mass;
        if let Some(row) = self.report.objects.get_mut(object) {
            *row = after;
        }
    }
}
