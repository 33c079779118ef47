//! Which particles are of which part: those of the scene, but for what commands painted.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::Model;
use crate::{materials::Material, moments::Body, scene::Part};

/// Particles of a part of the scene that have a material of their own since a command painted them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Painted {
    /// The part of the scene that they are of.
    pub part: usize,
    /// Which, ascending; none where all were painted otherwise since.
    pub particles: Vec<u32>,
}

/// Particles that follow each other in the scene and are of one part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Portion {
    pub particles: Range<usize>,
    pub part: usize,
}

impl Model {
    /// Has parts painted that way, and no others; materials and all that is made of them are to follow.
    pub fn paint(&mut self, painted: &[Painted]) {
        self.parts.truncate(self.scene_parts);
        self.cells_per_mass.truncate(self.scene_parts);
        let mut of = vec![0; self.scene.particles.position.len()];
        for (n, part) in self.parts.iter().enumerate() {
            of[part.particles.clone()].fill(n);
        }
        for entry in painted {
            for &id in &entry.particles {
                of[id as usize] = self.parts.len();
            }
            // Mass stays: a particle has the density of the scene's part.
            let part: Part = self.parts[entry.part].clone();
            self.parts.push(part);
            self.cells_per_mass.push(self.cells_per_mass[entry.part]);
        }
        self.particle_counts = vec![0; self.parts.len()];
        self.portions.clear();
        let mut start = 0;
        for run in of.chunk_by(|a, b| a == b) {
            let end = start + run.len();
            self.particle_counts[run[0]] += run.len();
            self.portions.push(Portion {
                particles: start..end,
                part: run[0],
            });
            start = end;
        }
    }

    /// The part that a particle of the scene is of.
    pub fn part_of(&self, particle: usize) -> usize {
        let portions = &self.portions;
        let next = portions.partition_point(|portion| portion.particles.end <= particle);
        portions[next].part
    }

    /// Number of a part among those of its object.
    pub fn number_in_object(&self, part: usize) -> u16 {
        let object = self.parts[part].object;
        let before = self.parts[..part].iter();
        before.filter(|p| p.object == object).count() as u16
    }

    /// The part of the scene that a part is, or is painted on.
    pub fn scene_part(&self, part: usize, painted: &[Painted]) -> usize {
        let painted = part.checked_sub(self.scene_parts).map(|n| &painted[n]);
        painted.map_or(part, |entry| entry.part)
    }

    /// The particles of an object with what they are made of.
    pub fn bodies_of<'a>(&self, object: usize, materials: &'a [Material]) -> Vec<Body<'a>> {
        let range = &self.scene.objects[object].particles;
        let first = (self.portions).partition_point(|portion| portion.particles.end <= range.start);
        let own = self.portions[first..].iter();
        own.take_while(|portion| portion.particles.start < range.end)
            .map(|portion| Body {
                particles: portion.particles.clone(),
                density: self.parts[portion.part].material.density,
                material: &materials[portion.part],
            })
            .collect()
    }
}
