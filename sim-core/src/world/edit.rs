//! Material edits while the world runs: what particles remember is carried over from law to law.

use std::collections::BTreeMap;

use super::{World, bounds::within};
use crate::{
    command::CommandError,
    mat3::Mat3,
    materials::{
        Law, Material,
        limits::{DeformationBounds, critical_dt},
    },
    particles::{Extremes, NO_PARTICLE, Particles, Run, position_in_cells},
    scene::ContactMethod,
    simd::LANES,
    solid::memory::forget,
    state::away::Loose,
    step::sort::{Newcomer, place},
};

/// Substeps of a frame that the stiffest commanded material may need at rest.
const MATERIAL_SUBSTEPS: f64 = 65_536.0;

impl World {
    pub(super) fn check_material(
        &self,
        object: usize,
        material: &Material,
    ) -> Result<(), CommandError> {
        material.check().map_err(|found| CommandError::OutOfRange {
            field: found.key,
            value: found.value,
            min: found.min,
            max: found.max,
        })?;
        let current = &self.model.scene.objects[object].material;
        let (density, dx) = (current.density, self.model.scene.dx);
        let room = self.model.scene.cfl * self.model.scene.frame_rate * MATERIAL_SUBSTEPS;
        // The critical step goes with one over the square root of the moduli.
        let stiffest = |soft: &Material| {
            let substeps = room * critical_dt(soft, density, dx, &DeformationBounds::REST);
            substeps * substeps
        };
        match material.law {
            Law::Rigid if self.model.scene.contact.method == ContactMethod::ComSphere => {
                Err(CommandError::RigidSphere { object })
            }
            Law::Rigid => Ok(()),
            Law::Fluid {
                bulk_modulus,
                viscosity,
            } => {
                let soft = Material {
                    law: Law::Fluid {
                        bulk_modulus: 1.0,
                        viscosity: 0.0,
                    },
                    ..material.clone()
                };
                let stiffest = stiffest(&soft).max(current.lambda());
                within("bulk_modulus_pa", bulk_modulus, 0.0, stiffest)?;
                within(
                    "viscosity_pa_s",
                    viscosity,
                    0.0,
                    room * density * dx * dx / 4.0,
                )
            }
            _ => {
                let soft = Material {
                    youngs_modulus: 1.0,
                    ..material.clone()
                };
                let stiffest = stiffest(&soft).max(current.youngs_modulus);
                within("youngs_modulus", material.youngs_modulus, 0.0, stiffest)
            }
        }
    }

    /// Gives an object, one of its regions, or these particles of it, a sorted list, a new material, and keeps it one body where
    /// a command wants that.
    pub(super) fn change_material(
        &mut self,
        object: usize,
        region: Option<usize>,
        particles: Option<&[u32]>,
        material: &Material,
    ) {
        let is_made_rigid = self.is_made_rigid(object);
        if is_made_rigid {
            self.loosen(object);
        }
        match particles {
            None => {
                let parts = self.parts_of(object, region);
                self.set_material(&parts, material);
                self.unpaint(&parts);
            }
            Some(particles) => self.paint(particles, material),
        }
        let commanded = &self.state.commanded;
        self.model.set_materials(&commanded.materials);
        self.reconsider_solid(object);
        self.freeze(object);
        if is_made_rigid && !self.is_one_body(object) {
            self.publish();
            self.stiffen(object);
        }
    }

    /// Parts of an object, or of one of its regions, painted ones among them.
    pub(super) fn parts_of(&self, object: usize, region: Option<usize>) -> Vec<usize> {
        let parts = self.model.parts.iter().enumerate();
        let own = parts.filter(|(_, part)| {
            part.object == object && (region.is_none() || part.region == region)
        });
        own.map(|(id, _)| id).collect()
    }

    /// Gives the body of an object its particles back where some of these parts are of it and are to deform.
    pub(super) fn thaw_for(&mut self, parts: &[usize], material: &Material) {
        let is_rigid = |&&part: &&usize| self.state.commanded.materials[part].law.is_rigid();
        if let (Some(&part), false) = (parts.iter().find(is_rigid), material.law.is_rigid()) {
            self.thaw(self.model.parts[part].object);
        }
    }

    /// Whether the visible deformation of a part is to be carried apart once it is no more of `old`.
    pub(super) fn is_shaped_after(&self, part: usize, old: Law, new: Law) -> bool {
        let becomes_solid = old.is_fluid() && !new.is_fluid();
        self.model.is_shaped(part, new) || becomes_solid && self.model.is_visible(part)
    }

    /// Gives parts of an object a new material.
    pub(super) fn set_material(&mut self, touched: &[usize], material: &Material) {
        self.thaw_for(touched, material);
        let mut reshaped = false;
        for &part in touched {
            let old = self.state.commanded.materials[part].law;
            let shaped = self.is_shaped_after(part, old, material.law);
            reshaped |= shaped && !self.state.matter.shaped[part];
            self.state.matter.shaped[part] |= shaped;
        }
        if reshaped {
            self.rearrange();
        }
        for &part in touched {
            let old =
                std::mem::replace(&mut self.state.commanded.materials[part], material.clone());
            if old.law.id() != material.law.id() {
                self.forget_flow(part);
                let particles = &mut self.state.matter.particles;
                let runs = particles.runs.clone();
                for run in runs.iter().filter(|run| run.part == part) {
                    carry_over(particles, run, material.law, |_| Some(old.law));
                }
            }
        }
    }

    /// Lets the points of a part that is a solid's forget what a law remembered beside the shape, which stays.
    fn forget_flow(&mut self, part: usize) {
        let object = self.model.parts[part].object;
        let number = self.model.number_in_object(part);
        if let (Some(solid), Some(state)) = (
            &self.model.lagrangian[object],
            &mut self.state.solids[object],
        ) {
            forget(&solid.grid, number, &mut state.memory);
        }
    }

    /// Turns the rigid body of an object into particles, with its momentum and angular momentum.
    pub(super) fn thaw(&mut self, object: usize) {
        if let Some(rigid) = self.state.bodies.of[object].take() {
            let loose = self.loosened(object, &rigid);
            self.put_back(object, &loose);
        }
    }

    /// Joins the particles of those parts of an object that are to be rigid to one body.
    pub(super) fn freeze(&mut self, object: usize) {
        let rigid: Vec<bool> = (0..self.model.parts.len())
            .map(|p| self.model.parts[p].object == object && self.given().is_joined(p))
            .collect();
        let mut loose = self.take_away(object, &rigid);
        if loose.is_empty() {
            return;
        }
        if let Some(body) = self.state.bodies.of[object].take() {
            // There is one already: all together make a new one.
            loose.extend(self.loosened(object, &body));
            loose.sort_unstable_by_key(|p| p.id);
        }
        let dx = self.model.scene.dx;
        self.form_body(object, &loose, Some(0.5 * dx * dx));
    }

    /// Puts particles of an object, whose velocities are those of now, into the arrays.
    pub(super) fn put_back(&mut self, object: usize, loose: &[Loose]) {
        let (dx, offset_velocity) = (self.model.scene.dx, self.offset_velocity());
        let mut newcomers = Vec::with_capacity(loose.len());
        for p in loose {
            let part = self.model.part_of(p.id as usize);
            let mass = self.model.grain(object, p.id, p.x).mass;
            for a in 0..3 {
                self.state.progress.momentum[object][a] -= mass * offset_velocity[a];
            }
            newcomers.push(Newcomer {
                id: p.id,
                part: part as u32,
                x: p.x.map(|x| x / dx),
                v: std::array::from_fn(|a| {
                    ((p.v[a] - offset_velocity[a]) / dx - self.state.motion.frame_velocity[a])
                        as f32
                }),
                c: p.c.map(|c| c as f32),
                mass: (mass / self.model.mass_unit) as f32,
            });
        }
        self.state.matter.live += newcomers.len();
        let mut placed = place(&newcomers, &self.model.fields());
        let of: BTreeMap<u32, &Loose> = loose.iter().map(|p| (p.id, p)).collect();
        write_deformation(&mut placed, &of, |p| &p.visible);
        for part in (0..self.model.parts.len()).filter(|&p| self.model.parts[p].object == object) {
            let apart = loose.iter().any(|p| p.visible != p.elastic);
            self.state.matter.shaped[part] |= apart && self.model.is_visible(part);
        }
        self.state.matter.particles.append(placed);
        // Where the visible deformation is carried apart it begins as that of the particle.
        self.rearrange();
        write_deformation(&mut self.state.matter.particles, &of, |p| &p.elastic);
    }

    /// Takes the particles of some parts of an object out of the arrays: in scene order, with the velocities of now.
    pub(super) fn take_away(&mut self, object: usize, which: &[bool]) -> Vec<Loose> {
        let (dx, frame_velocity) = (self.model.scene.dx, self.state.motion.frame_velocity);
        let offset_velocity = self.offset_velocity();
        let mut loose = Vec::new();
        let particles = &mut self.state.matter.particles;
        for block in particles.blocks.clone() {
            let runs = particles.runs[block.runs.clone()].to_vec();
            for run in runs {
                if !which[run.part] {
                    continue;
                }
                let shapes = run.shapes.clone().map(Some).chain(std::iter::repeat(None));
                for (g, shape) in run.groups.clone().zip(shapes) {
                    for lane in 0..LANES {
                        let id = particles.fixed[g].id[lane];
                        if id == NO_PARTICLE {
                            continue;
                        }
                        let (group, motion) = (&particles.groups[g], &particles.motion[g]);
                        let at = [0, 1, 2].map(|a| group.x[a].0[lane]);
                        let elastic = std::array::from_fn(|n| group.f[n].0[lane]);
                        let visible = shape.map_or(elastic, |s| {
                            std::array::from_fn(|n| particles.shapes[s].0[n].0[lane])
                        });
                        loose.push(Loose {
                            id,
                            x: position_in_cells(block.index, at).map(|x| x * dx),
                            v: std::array::from_fn(|a| {
                                (f64::from(motion.v[a].0[lane]) + frame_velocity[a]) * dx
                                    + offset_velocity[a]
                            }),
                            c: std::array::from_fn(|n| f64::from(motion.c[n].0[lane])),
                            visible,
                            elastic,
                            memory: particles.memory[g].0[lane],
                        });
                        particles.remove(g, lane);
                    }
                }
            }
        }
        if loose.is_empty() {
            return loose;
        }
        loose.sort_unstable_by_key(|p| p.id);
        for p in &loose {
            let mass = self.model.grain(object, p.id, p.x).mass;
            for a in 0..3 {
                self.state.progress.momentum[object][a] += mass * offset_velocity[a];
            }
        }
        self.state.matter.live -= loose.len();
        self.rearrange();
        for (extremes, taken) in self.state.matter.extremes.iter_mut().zip(which) {
            if *taken {
                *extremes = Extremes::NONE;
            }
        }
        loose
    }
}

/// Gives particles a deformation gradient.
fn write_deformation(
    particles: &mut Particles,
    of: &BTreeMap<u32, &Loose>,
    which: fn(&Loose) -> &[f32; 9],
) {
    for g in 0..particles.groups.len() {
        for lane in 0..LANES {
            if let Some(member) = of.get(&particles.fixed[g].id[lane]) {
                let f = which(member);
                for n in 0..9 {
                    particles.groups[g].f[n].0[lane] = f[n];
                }
                particles.memory[g].0[lane] = member.memory;
            }
        }
    }
}

/// What the new law needs to know of the past under the old one, which `old` says of particles that had another: volume
/// passes between solids and fluids, all else that a law remembers means nothing to another.
pub(super) fn carry_over(
    particles: &mut Particles,
    run: &Run,
    new: Law,
    old: impl Fn(u32) -> Option<Law>,
) {
    let shapes = run.shapes.clone().map(Some).chain(std::iter::repeat(None));
    for (g, shape) in run.groups.clone().zip(shapes) {
        for lane in 0..LANES {
            let id = particles.fixed[g].id[lane];
            let Some(old) = (id != NO_PARTICLE).then(|| old(id)).flatten() else {
                continue;
            };
            let f = &mut particles.groups[g].f;
            let memory = &mut particles.memory[g].0[lane];
            match (old.is_fluid(), new.is_fluid()) {
                (false, true) => {
                    let elastic = Mat3(std::array::from_fn(|i| {
                        std::array::from_fn(|j| f[3 * i + j].0[lane])
                    }));
                    *memory = elastic.det() - 1.0;
                    if let Some(shape) = shape {
                        for n in 0..9 {
                            f[n].0[lane] = particles.shapes[shape].0[n].0[lane];
                        }
                    }
                }
                (true, false) => {
                    let stretch = (1.0 + *memory).cbrt();
                    *memory = 0.0;
                    for n in 0..9 {
                        f[n].0[lane] = if n % 4 == 0 { stretch } else { 0.0 };
                    }
                }
                (true, true) => {}
                (false, false) => *memory = 0.0,
            }
        }
    }
}
