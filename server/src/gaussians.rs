//! Every Gaussian where it is, object by object: what stays as it was needs no writing.

use std::{collections::BTreeMap, ops::Range};

use cosplat_ipc::{assembly::Placement, schema::GaussianState};
use cosplat_sim_core::{Form, Placed, Scene, World, pose::Poses};
use rayon::prelude::*;

use crate::convert::{base_colors, gaussian_objects, gaussians_as_poses};

/// Gaussians per task.
const CHUNK: usize = 1024;

/// Writes the Gaussians of a scene in motion.
pub struct GaussianWriter {
    poses: Poses,
    objects: Vec<Ranges>,
    /// Objects in their own frames, by the number of their form.
    forms: Vec<Option<(u64, Vec<GaussianState>)>>,
    /// Per slot of a pool, which version of each object is in it.
    slots: BTreeMap<usize, Vec<u64>>,
}

/// What belongs to an object.
struct Ranges {
    gaussians: Range<usize>,
    particles: Range<usize>,
}

impl GaussianWriter {
    /// Prepares what does not change from step to step.
    pub fn new(scene: &Scene) -> Self {
        let (colors, owners) = (base_colors(scene), gaussian_objects(scene));
        let poses = Poses::new(scene, |index| {
            [
                u32::from_ne_bytes(colors[index]),
                owners[index],
                index as u32,
            ]
        });
        let objects = scene.objects.iter().map(|object| Ranges {
            gaussians: object.gaussians.clone(),
            particles: object.particles.clone(),
        });
        Self {
            poses,
            objects: objects.collect(),
            forms: vec![None; scene.objects.len()],
            slots: BTreeMap::new(),
        }
    }

    /// Makes the forms that the world has now, once for all who write them.
    pub fn prepare(&mut self, world: &World) {
        for object in 0..self.objects.len() {
            let Some(placed) = world.visible(object).placed else {
                continue;
            };
            let known = self.forms[object].as_ref().map(|(number, _)| *number);
            if known != Some(placed.form)
                && let Some(form) = world.form(object)
            {
                self.forms[object] = Some((placed.form, self.make(object, &form)));
            }
        }
    }

    /// An object in its own frame, if it was prepared.
    pub fn form(&self, object: usize, placed: &Placed) -> Option<&[GaussianState]> {
        let (number, form) = self.forms[object].as_ref()?;
        (*number == placed.form).then_some(form)
    }

    /// Where an object's Gaussians are in a frame.
    pub fn range(&self, object: usize) -> Range<usize> {
        self.objects[object].gaussians.clone()
    }

    /// Writes a whole frame.
    pub fn write_all(&self, world: &World, out: &mut [GaussianState]) {
        for object in 0..self.objects.len() {
            self.write(world, object, &mut out[self.range(object)]);
        }
    }

    /// Writes into a slot of a pool what is not there already since it was written here before.
    pub fn update(&mut self, world: &World, slot: usize, out: &mut [GaussianState]) {
        let mut versions = self.slots.remove(&slot).unwrap_or_default();
        versions.resize(self.objects.len(), 0);
        for (object, version) in versions.iter_mut().enumerate() {
            let now = world.visible(object).version;
            if *version != now {
                self.write(world, object, &mut out[self.range(object)]);
                *version = now;
            }
        }
        self.slots.insert(slot, versions);
    }

    /// Writes the Gaussians of one object.
    pub fn write(&self, world: &World, object: usize, out: &mut [GaussianState]) {
        self.write_all_of(world, object, out);
        if world.is_removed(object) {
            // Nothing is seen of it, whoever draws.
            for gaussian in out {
                gaussian.color[3] = 0;
            }
        }
    }

    fn write_all_of(&self, world: &World, object: usize, out: &mut [GaussianState]) {
        if let Some(placed) = world.visible(object).placed {
            if let Some(form) = self.form(object, &placed) {
                return place(&placed, form, out);
            }
            if let Some(form) = world.form(object) {
                return place(&placed, &self.make(object, &form), out);
            }
        }
        let particles = self.objects[object].particles.clone();
        let deformations = &world.deformations()[particles.clone()];
        self.write_matter(object, &world.positions()[particles], deformations, out);
    }

    fn make(&self, object: usize, form: &Form) -> Vec<GaussianState> {
        let mut out = vec![GaussianState::default(); self.range(object).len()];
        self.write_matter(object, &form.position, &form.deformation, &mut out);
        out
    }

    /// Writes the Gaussians of an object whose particles are there, and deformed like this.
    fn write_matter(
        &self,
        object: usize,
        position: &[[f32; 3]],
        deformation: &[[f32; 9]],
        out: &mut [GaussianState],
    ) {
        let first = self.objects[object].particles.start;
        let out = gaussians_as_poses(out);
        self.poses
            .write_part(self.range(object), first, position, deformation, out);
    }
}

fn place(placed: &Placed, form: &[GaussianState], out: &mut [GaussianState]) {
    let place = Placement {
        position: placed.position,
        rotation: placed.rotation,
    };
    form.par_chunks(CHUNK)
        .zip(out.par_chunks_mut(CHUNK))
        .for_each(|(own, world)| place.place(own, world));
}
