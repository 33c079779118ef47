//! What can be seen of every object, and whether it is what was seen before: who publishes writes no more than moved.

use bytemuck::bytes_of;

use super::World;

/// What can be seen of an object after the latest step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Visible {
    /// Another number than before wherever any of its particles may be another one, or elsewhere.
    pub version: u64,
    /// Where the object is, as long as all of it moves as one body.
    pub placed: Option<Placed>,
}

/// Where an object is that moves as one body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Another number than before wherever [`World::form`] is another one.
    pub form: u64,
    /// Origin of its own frame, the centre of mass [m].
    pub position: [f64; 3],
    /// World-from-own rotation, unit quaternion xyzw.
    pub rotation: [f64; 4],
}

impl Placed {
    /// Bit for bit: zeros of different sign make different Gaussians.
    fn is_same(&self, other: &Self) -> bool {
        self.form == other.form
            && bytes_of(&self.position) == bytes_of(&other.position)
            && bytes_of(&self.rotation) == bytes_of(&other.rotation)
    }
}

/// Where the particles of an object are in its own frame.
#[derive(Clone, Debug, Default)]
pub struct Form {
    /// Positions in the order of the scene's particles [m].
    pub position: Vec<[f32; 3]>,
    /// Deformation gradients, row-major.
    pub deformation: Vec<[f32; 9]>,
}

/// What was seen. It belongs to no state: versions grow on, wherever the world goes back to.
#[derive(Debug, Default)]
pub(super) struct Sight {
    of: Vec<Visible>,
    /// Per object how often its body was formed.
    forms: Vec<u64>,
    /// Per object whether it came or went.
    touched: Vec<bool>,
    /// Particles that were taken out.
    removed: usize,
    /// Whether all of it may be another one.
    is_stale: bool,
}

impl Sight {
    pub fn new(objects: usize) -> Self {
        Self {
            of: vec![Visible::default(); objects],
            forms: vec![0; objects],
            touched: vec![false; objects],
            removed: 0,
            is_stale: true,
        }
    }

    /// An object has another body.
    pub fn formed(&mut self, object: usize) {
        self.forms[object] += 1;
    }

    /// An object came or went.
    pub fn touched(&mut self, object: usize) {
        self.touched[object] = true;
    }

    /// The state is another one.
    pub fn forget(&mut self) {
        self.forms.iter_mut().for_each(|form| *form += 1);
        self.is_stale = true;
    }
}

impl World {
    /// What can be seen of an object.
    ///
    /// # Panics
    /// When `object` is not an object id of the scene, like slice indexing.
    pub fn visible(&self, object: usize) -> Visible {
        self.sight.of[object]
    }

    /// The particles of an object in its own frame, as long as all of it moves as one body.
    ///
    /// # Panics
    /// When `object` is not an object id of the scene, like slice indexing.
    pub fn form(&self, object: usize) -> Option<Form> {
        self.placed(object)?;
        let range = &self.model.scene.objects[object].particles;
        let Some(rigid) = self.state.bodies.of[object].as_ref() else {
            // It is only shown, and its Gaussians follow no particle.
            return Some(Form::default());
        };
        let mut form = Form {
            position: vec![[0.0; 3]; range.len()],
            deformation: vec![[0.0; 9]; range.len()],
        };
        for member in &rigid.members {
            let at = member.id as usize - range.start;
            form.position[at] = member.place.map(|x| x as f32);
            form.deformation[at] = member.visible;
        }
        Some(form)
    }

    /// Takes note of what the step changed.
    pub(super) fn update_sight(&mut self) {
        let removed = self.state.matter.removed.len();
        let all = self.sight.is_stale || self.sight.removed != removed;
        (self.sight.is_stale, self.sight.removed) = (false, removed);
        for object in 0..self.model.scene.objects.len() {
            let placed = self.placed(object);
            let seen = &self.sight.of[object];
            let stayed = match (&placed, &seen.placed) {
                (Some(now), Some(before)) => now.is_same(before),
                (None, None) => self.state.sleeps(object) || self.is_still_matter(object),
                _ => false,
            };
            let touched = std::mem::take(&mut self.sight.touched[object]);
            let seen = &self.sight.of[object];
            let version = seen.version + u64::from(all || touched || !stayed);
            self.sight.of[object] = Visible { version, placed };
        }
    }

    /// Whether an object has neither particles that move nor a body, and is no solid.
    fn is_still_matter(&self, object: usize) -> bool {
        self.state.bodies.of[object].is_none()
            && self.state.solids[object].is_none()
            && self.state.blocks_of_particles(object).is_empty()
    }

    fn placed(&self, object: usize) -> Option<Placed> {
        if self.is_removed(object) {
            return None;
        }
        if let Some(pose) = self.state.commanded.shown[object] {
            return Some(Placed {
                form: self.sight.forms[object].max(1),
                position: pose.translation,
                rotation: pose.rotation,
            });
        }
        let rigid = self.state.bodies.of[object].as_ref()?;
        let whole = rigid.members.len() == self.model.scene.objects[object].particles.len();
        (whole && self.is_one_body(object)).then(|| Placed {
            form: self.sight.forms[object],
            position: rigid.body.com,
            rotation: rigid.body.rotation,
        })
    }
}
