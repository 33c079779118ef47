//! Material edits while the world runs: what particles remember is carried over from law to law.

use std::collections::BTreeMap;

use super::{World, bodies::Loose};
use crate::{
    mat3::Mat3,
    materials::{Law, Material},
    particles::{Extremes, NO_PARTICLE, Particles, Run, position_in_cells},
    scene::Part,
    simd::LANES,
    step::sort::{Newcomer, place},
};

impl World {
    /// Gives an object, or one of its regions, a new material.
    pub(super) fn set_material(
        &mut self,
        object: usize,
        region: Option<usize>,
        material: &Material,
    ) {
        let touched: Vec<usize> = (0..self.parts.len())
            .filter(|&p| {
                let part = &self.parts[p];
                part.object == object && (region.is_none() || part.region == region)
            })
            .collect();
        let stiffens = |part: usize| self.state.materials[part].law.is_rigid();
        if touched
            .iter()
            .any(|&part| stiffens(part) && !material.law.is_rigid())
        {
            self.thaw(object);
        }
        let mut reshaped = false;
        for &part in &touched {
            let old = self.state.materials[part].law;
            let becomes_solid = old.is_fluid() && !material.law.is_fluid();
            let shaped =
                self.is_shaped(part, material.law) || becomes_solid && self.is_visible(part);
            reshaped |= shaped && !self.state.shaped[part];
            self.state.shaped[part] |= shaped;
        }
        if reshaped {
            self.rearrange();
        }
        for part in touched {
            let old = std::mem::replace(&mut self.state.materials[part], material.clone());
            if old.law.id() != material.law.id() {
                let particles = &mut self.state.particles;
                let runs = particles.runs.clone();
                for run in runs.iter().filter(|run| run.part == part) {
                    carry_over(particles, run, old.law, material.law);
                }
            }
        }
        self.freeze(object);
    }

    /// Turns the rigid body of an object into particles, with its momentum and angular momentum.
    pub(super) fn thaw(&mut self, object: usize) {
        if let Some(rigid) = self.state.rigid[object].take() {
            let loose = self.loosened(object, &rigid);
            self.put_back(object, &loose);
        }
    }

    /// Joins the particles of those parts of an object that are to be rigid to one body.
    pub(super) fn freeze(&mut self, object: usize) {
        let rigid: Vec<bool> = (0..self.parts.len())
            .map(|p| self.parts[p].object == object && self.is_joined(p))
            .collect();
        let mut loose = self.take_away(object, &rigid);
        if loose.is_empty() {
            return;
        }
        if let Some(body) = self.state.rigid[object].take() {
            // There is one already: all together make a new one.
            loose.extend(self.loosened(object, &body));
            loose.sort_unstable_by_key(|p| p.id);
        }
        let dx = self.scene.dx;
        self.form_body(object, &loose, Some(0.5 * dx * dx));
    }

    /// Puts particles of an object, whose velocities are those of now, into the arrays.
    pub(super) fn put_back(&mut self, object: usize, loose: &[Loose]) {
        let (dx, owed) = (self.scene.dx, self.owed(object));
        let mut newcomers = Vec::with_capacity(loose.len());
        for p in loose {
            let mine = |part: &Part| part.particles.contains(&(p.id as usize));
            let Some(part) = self.parts.iter().position(mine) else {
                continue;
            };
            let mass = self.grain(object, p.id, p.x).mass;
            for a in 0..3 {
                self.state.momentum[object][a] -= mass * owed[a];
            }
            newcomers.push(Newcomer {
                id: p.id,
                part: part as u32,
                x: p.x.map(|x| x / dx),
                v: std::array::from_fn(|a| {
                    ((p.v[a] - owed[a]) / dx - self.state.carrier[a]) as f32
                }),
                c: p.c.map(|c| c as f32),
                mass: (mass / self.mass_unit) as f32,
            });
        }
        self.state.live += newcomers.len();
        let fields: Vec<u32> = (0..self.parts.len()).map(|p| self.field_of(p)).collect();
        let mut placed = place(&newcomers, &fields);
        let of: BTreeMap<u32, &Loose> = loose.iter().map(|p| (p.id, p)).collect();
        write_deformation(&mut placed, &of, |p| &p.visible);
        for part in (0..self.parts.len()).filter(|&p| self.parts[p].object == object) {
            let apart = loose.iter().any(|p| p.visible != p.elastic);
            self.state.shaped[part] |= apart && self.is_visible(part);
        }
        self.state.particles.append(placed);
        // Where the visible deformation is carried apart it begins as that of the particle.
        self.rearrange();
        write_deformation(&mut self.state.particles, &of, |p| &p.elastic);
    }

    /// Takes the particles of some parts of an object out of the arrays: in scene order, with the velocities of now.
    pub(super) fn take_away(&mut self, object: usize, which: &[bool]) -> Vec<Loose> {
        let (dx, carrier) = (self.scene.dx, self.state.carrier);
        let owed = self.owed(object);
        let mut loose = Vec::new();
        let particles = &mut self.state.particles;
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
                                (f64::from(motion.v[a].0[lane]) + carrier[a]) * dx + owed[a]
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
            let mass = self.grain(object, p.id, p.x).mass;
            for a in 0..3 {
                self.state.momentum[object][a] += mass * owed[a];
            }
        }
        self.state.live -= loose.len();
        self.rearrange();
        for (extremes, taken) in self.state.extremes.iter_mut().zip(which) {
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

/// What the new law needs to know of the past under the old one: volume passes between solids and fluids, all
/// else that a law remembers means nothing to another.
fn carry_over(particles: &mut Particles, run: &Run, old: Law, new: Law) {
    let shapes = run.shapes.clone().map(Some).chain(std::iter::repeat(None));
    for (g, shape) in run.groups.clone().zip(shapes) {
        for lane in 0..LANES {
            if particles.fixed[g].id[lane] == NO_PARTICLE {
                continue;
            }
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
