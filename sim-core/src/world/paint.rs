//! A brush: commands give a patch of an object another material.
//!
//! Kernels know a material per run of particles, and runs are of parts. So a patch becomes a part of its own, of the
//! density that its particles have, and they are sorted anew. Nothing changes for a kernel.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    World,
    bounds::{MAX_LENGTH, finite, within},
    edit::carry_over,
};
use crate::{
    command::{CommandError, Patch},
    materials::{Law, Material},
    model::Painted,
    particles::Extremes,
    state::Matter,
    step::sort::sort_into,
};

/// Parts that can be painted at once: each costs little in every substep.
pub(super) const MAX_PAINTED: usize = 64;

impl World {
    /// Particles of an object that a patch names, ascending.
    pub(super) fn painted_by(
        &self,
        object: usize,
        region: Option<usize>,
        patch: &Patch,
        material: &Material,
    ) -> Result<Vec<u32>, CommandError> {
        let (Patch::Ball { point, .. } | Patch::Box { centre: point, .. }) = *patch;
        finite("point", &point)?;
        for x in point {
            within("point", x, -MAX_LENGTH, MAX_LENGTH)?;
        }
        let mut particles = match *patch {
            Patch::Ball { point, radius } => {
                within("radius", radius, f64::MIN_POSITIVE, MAX_LENGTH)?;
                self.within_reach(object, point, radius)
            }
            Patch::Box { centre, half } => self.within_box(object, centre, half)?,
        };
        if let Some(region) = region {
            let range = &self.model.scene.objects[object].regions[region].particles;
            particles.retain(|id| range.contains(&(*id as usize)));
        }
        let found = self.state.commanded.painted.len() + self.new_parts(&particles, material);
        match found > MAX_PAINTED {
            true => Err(CommandError::TooManyPainted {
                found,
                max: MAX_PAINTED,
            }),
            false => Ok(particles),
        }
    }

    /// Simulated particles of an object in a box, ascending.
    fn within_box(
        &self,
        object: usize,
        centre: [f64; 3],
        half: [f64; 3],
    ) -> Result<Vec<u32>, CommandError> {
        for x in half {
            within("half edge", x, 0.0, MAX_LENGTH)?;
        }
        let (dx, published) = (self.model.scene.dx, &self.published);
        let is_in = |p: &usize| {
            let x = published.cells[*p];
            published.volume[*p] > 0.0 && (0..3).all(|a| (x[a] * dx - centre[a]).abs() <= half[a])
        };
        let all = self.model.scene.objects[object].particles.clone();
        let found: Vec<u32> = all.filter(is_in).map(|p| p as u32).collect();
        match found.is_empty() {
            true => Err(CommandError::NothingThere {
                object,
                centre,
                half,
            }),
            false => Ok(found),
        }
    }

    /// How many parts painting particles adds.
    fn new_parts(&self, particles: &[u32], material: &Material) -> usize {
        let strokes = self.strokes(particles, material);
        let (whole, some): (Vec<&Stroke>, Vec<&Stroke>) =
            strokes.iter().partition(|stroke| stroke.is_whole);
        let kin = |stroke: &Stroke| self.scene_part(stroke.from);
        let homeless = some.into_iter().filter(|stroke| {
            let joins = |other: &&Stroke| kin(other) == kin(stroke);
            self.receiver(kin(stroke), material).is_none() && !whole.iter().any(joins)
        });
        homeless.map(kin).collect::<BTreeSet<usize>>().len()
    }

    fn scene_part(&self, part: usize) -> usize {
        self.model.scene_part(part, &self.state.commanded.painted)
    }

    /// A part of this material on a part of the scene, or one without particles.
    fn receiver(&self, scene_part: usize, material: &Material) -> Option<usize> {
        let kin = || (0..self.model.parts.len()).filter(|&n| self.scene_part(n) == scene_part);
        let is_same = |n: &usize| self.state.commanded.materials[*n] == *material;
        let same = kin().find(is_same);
        same.or_else(|| kin().find(|&n| self.model.particle_counts[n] == 0))
    }

    /// What painting particles comes to, part by part; parts that are of the material already are left out.
    fn strokes(&self, particles: &[u32], material: &Material) -> Vec<Stroke> {
        let commanded = &self.state.commanded;
        let mut of_parts: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        for &id in particles {
            let part = self.model.part_of(id as usize);
            of_parts.entry(part).or_default().push(id);
        }
        of_parts.retain(|part, _| commanded.materials[*part] != *material);
        let strokes = of_parts.into_iter().map(|(from, particles)| Stroke {
            from,
            is_whole: particles.len() == self.model.particle_counts[from],
            particles,
        });
        strokes.collect()
    }

    /// Whether painting particles leaves some part of its material and some of another.
    pub(super) fn splits_parts(&self, particles: &[u32], material: &Material) -> bool {
        let strokes = self.strokes(particles, material);
        strokes.iter().any(|stroke| !stroke.is_whole)
    }

    /// Gives particles of an object, a sorted list, another material.
    pub(super) fn paint(&mut self, particles: &[u32], material: &Material) {
        let mut strokes = self.strokes(particles, material);
        let from: Vec<usize> = strokes.iter().map(|stroke| stroke.from).collect();
        self.thaw_for(&from, material);
        let whole = strokes.iter().filter(|stroke| stroke.is_whole);
        let whole: Vec<usize> = whole.map(|stroke| stroke.from).collect();
        self.set_material(&whole, material);
        strokes.retain(|stroke| !stroke.is_whole);
        // Who had which law: what is remembered of it passes over.
        let mut laws: BTreeMap<u32, Law> = BTreeMap::new();
        let mut joined = vec![];
        for stroke in &strokes {
            let scene_part = self.scene_part(stroke.from);
            let to = self.receiver(scene_part, material);
            let to = to.unwrap_or_else(|| self.new_part(scene_part, material));
            self.state.commanded.materials[to] = material.clone();
            let old = self.state.commanded.materials[stroke.from].law;
            laws.extend(stroke.particles.iter().map(|&id| (id, old)));
            self.move_ids(stroke, to);
            self.model.paint(&self.state.commanded.painted);
            let shaped = self.state.matter.shaped[stroke.from]
                || self.is_shaped_after(to, old, material.law);
            self.state.matter.shaped[to] |= shaped;
            let extremes = self.state.matter.extremes[stroke.from];
            self.state.matter.extremes[to].join(&extremes);
            joined.push(to);
        }
        if joined.is_empty() {
            return;
        }
        self.sort_painted();
        let matter = &mut self.state.matter.particles;
        let runs = matter.runs.clone();
        for run in runs.iter().filter(|run| joined.contains(&run.part)) {
            let old = |id: u32| laws.get(&id).copied();
            carry_over(matter, run, material.law, |id| {
                old(id).filter(|old| old.id() != material.law.id())
            });
        }
    }

    /// Gives what is painted of parts of the scene back to these, once all of it is of their material.
    pub(super) fn unpaint(&mut self, parts: &[usize]) {
        let (first, mut is_any) = (self.model.scene_parts, false);
        for (n, entry) in self.state.commanded.painted.iter_mut().enumerate() {
            if parts.contains(&(first + n)) && !entry.particles.is_empty() {
                entry.particles.clear();
                let matter = &mut self.state.matter;
                matter.shaped[entry.part] |= matter.shaped[first + n];
                let extremes = matter.extremes[first + n];
                matter.extremes[entry.part].join(&extremes);
                is_any = true;
            }
        }
        if is_any {
            self.model.paint(&self.state.commanded.painted);
            self.sort_painted();
        }
    }

    /// Makes a part of a part of the scene.
    fn new_part(&mut self, scene_part: usize, material: &Material) -> usize {
        let commanded = &mut self.state.commanded;
        commanded.painted.push(Painted {
            part: scene_part,
            particles: vec![],
        });
        commanded.materials.push(material.clone());
        self.state.matter.shaped.push(false);
        self.state.matter.extremes.push(Extremes::NONE);
        self.model.paint(&self.state.commanded.painted);
        self.model.parts.len() - 1
    }

    /// Moves the particles of a stroke from the list of their part to that of another.
    fn move_ids(&mut self, stroke: &Stroke, to: usize) {
        let (first, painted) = (self.model.scene_parts, &mut self.state.commanded.painted);
        if let Some(entry) = stroke.from.checked_sub(first).map(|n| &mut painted[n]) {
            let is_left = |id: &u32| stroke.particles.binary_search(id).is_err();
            entry.particles.retain(is_left);
        }
        if let Some(entry) = to.checked_sub(first).map(|n| &mut painted[n]) {
            entry.particles.extend(&stroke.particles);
            entry.particles.sort_unstable();
        }
    }

    /// Sorts particles into the parts that they are of now.
    fn sort_painted(&mut self) {
        let model = &self.model;
        let mut of = vec![0; model.scene.particles.position.len()];
        for portion in &model.portions {
            of[portion.particles.clone()].fill(portion.part);
        }
        let Matter {
            particles, shaped, ..
        } = &mut self.state.matter;
        let sorted = &mut self.workspace.sorted;
        sort_into(particles, |id, _| of[id as usize], shaped, sorted);
        std::mem::swap(particles, sorted);
        self.fit_workspace();
        self.state.matter.drift = 0.0;
    }
}

/// Particles of one part that are painted.
struct Stroke {
    from: usize,
    particles: Vec<u32>,
    /// Whether these are all that it has: it stays a part.
    is_whole: bool,
}
