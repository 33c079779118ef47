//! Solids that have flowed too far, or are to be what solids cannot be, go over to the spatial grid, once: their particles
//! become matter there.
//!
//! Position, velocity and visible deformation of a particle are those of the nodal fields at its place. What its law knows of elastic
//! strain comes from the nearest quadrature point of its part, so that strain and what it is strained from belong together. All
//! velocities are changed alike, so that momentum stays; what angular momentum and energy change by is reported.

use super::{World, frame::Frame};
use crate::{
    mat3::{Mat3, cross, dot},
    materials::{Coefficients, Material},
    report::{GoneOver, OverReason},
    solid::{
        memory::{LARGEST_STRAIN, PartMemory, largest_strain},
        model::{CellPoint, gauss_point},
        object::SolidObject,
        state::{Sample, SolidState, Sums},
    },
    state::away::Loose,
    substep::laws_of,
};

/// Momenta about the world's origin [kg m/s, kg m^2/s] and energy [J] of matter.
#[derive(Clone, Copy, Debug, Default)]
struct Balance {
    momentum: [f64; 3],
    angular: [f64; 3],
    energy: f64,
}

impl World {
    /// Takes solids over to the spatial grid that have flowed too far, where their nodes move.
    pub(super) fn let_solids_go_over(&mut self, frame: &mut Frame) {
        for object in 0..self.state.solids.len() {
            let strain = match &self.state.solids[object] {
                Some(state) => largest_strain(&state.memory),
                None => continue,
            };
            if strain > LARGEST_STRAIN && self.is_moving_solid(object) {
                self.report_going_over(object, OverReason::Flow, frame);
            }
        }
        // Undone in the same frame is not done.
        let gone_over = &self.state.gone_over;
        frame.gone_over.retain(|gone| gone_over[gone.object]);
        frame.gone_over.sort_by_key(|gone| gone.object);
    }

    /// Takes an object that is awake over to the spatial grid where a material for all of it, a region, or these particles, a
    /// sorted list, is none for a solid.
    pub(super) fn go_over_for(
        &mut self,
        object: usize,
        particles: Option<&[u32]>,
        material: &Material,
        frame: &mut Frame,
    ) {
        if self.model.lagrangian[object].is_none() {
            return;
        }
        let reason = match particles {
            _ if !material.law.may_be_solid() => OverReason::Law,
            Some(particles) if self.splits_parts(particles, material) => OverReason::Patch,
            _ => return,
        };
        // Of a body that commands made of it come nodes first.
        self.loosen(object);
        self.report_going_over(object, reason, frame);
    }

    fn report_going_over(&mut self, object: usize, reason: OverReason, frame: &mut Frame) {
        let state = self.state.solids[object].as_ref();
        let plastic_strain = state.map_or(0.0, |state| largest_strain(&state.memory));
        let change = self.go_over(object);
        frame.gone_over.retain(|gone| gone.object != object);
        frame.gone_over.push(GoneOver {
            object,
            reason,
            plastic_strain,
            angular_momentum: change.angular,
            energy: change.energy,
        });
    }

    /// Makes spatial matter of a solid; what its balance changes by.
    fn go_over(&mut self, object: usize) -> Balance {
        let (Some(solid), Some(state)) = (
            self.model.lagrangian[object].as_ref(),
            self.state.solids[object].as_ref(),
        ) else {
            return Balance::default();
        };
        let laws = laws_of(&self.given(), object);
        let before = balance_of(&state.sums(self.model.isa, &solid.grid, &laws));
        let first = self.model.scene.objects[object].particles.start;
        let mut loose: Vec<Loose> = (0..solid.particles.len())
            .map(|n| {
                let part = self.model.part_of(first + n);
                let part = self.model.number_in_object(part);
                loosened(solid, state, n, part, (first + n) as u32)
            })
            .collect();
        let after = self.balance(object, &loose);
        let mass: f64 = loose.iter().map(|p| self.mass_of_particle(object, p)).sum();
        let change: [f64; 3] =
            std::array::from_fn(|a| (before.momentum[a] - after.momentum[a]) / mass);
        for particle in &mut loose {
            for a in 0..3 {
                particle.v[a] += change[a];
            }
        }
        let after = self.balance(object, &loose);
        self.state.solids[object] = None;
        self.state.gone_over[object] = true;
        self.model.set_gone_over(&self.state.gone_over);
        if let Some(scratch) = self.workspace.solids.get_mut(object) {
            *scratch = None;
        }
        if let Some(bounds) = self.workspace.solid_boxes.get_mut(object) {
            *bounds = None;
        }
        self.put_back(object, &loose);
        self.state.matter.drift = f64::INFINITY;
        self.publish();
        Balance {
            momentum: [0.0; 3],
            angular: std::array::from_fn(|a| after.angular[a] - before.angular[a]),
            energy: after.energy - before.energy,
        }
    }

    fn mass_of_particle(&self, object: usize, particle: &Loose) -> f64 {
        self.model.grain(object, particle.id, particle.x).mass
    }

    /// Sums over particles as the spatial solver counts them: with their affine part.
    fn balance(&self, object: usize, loose: &[Loose]) -> Balance {
        let inertia = 0.25 * self.model.scene.dx * self.model.scene.dx;
        let mut sums = Balance::default();
        for p in loose {
            let mass = self.mass_of_particle(object, p);
            let part = self.model.part_of(p.id as usize);
            let material = &self.state.commanded.materials[part];
            let (f, k) = (Mat3(rows(&p.elastic)), Coefficients::new(material));
            let elastic = (material.law).energy_density(&f, f64::from(p.memory), &k);
            let volume = self.model.scene.particles.volume[p.id as usize];
            let c = &p.c;
            let turn = [c[7] - c[5], c[2] - c[6], c[3] - c[1]];
            let orbit = cross(p.x, p.v);
            let squared: f64 = c.iter().map(|c| c * c).sum();
            for a in 0..3 {
                sums.momentum[a] += mass * p.v[a];
                sums.angular[a] += mass * (orbit[a] + inertia * turn[a]);
            }
            sums.energy += volume * elastic + 0.5 * mass * (dot(p.v, p.v) + inertia * squared);
        }
        sums
    }
}

fn balance_of(sums: &Sums) -> Balance {
    Balance {
        momentum: sums.momentum,
        angular: sums.angular,
        energy: sums.kinetic + sums.elastic,
    }
}

/// A particle of a solid by its number, as one that is alone.
fn loosened(solid: &SolidObject, state: &SolidState, n: usize, part: u16, id: u32) -> Loose {
    let (grid, site) = (&solid.grid, &solid.particles[n]);
    let Sample { x, f } = state.sample(grid, site);
    let (v, over_rest) = state.velocity_at(grid, site);
    let f = Mat3(f);
    let scale = 1.0 / f.det();
    let inverse = f.cofactor().transpose();
    let c = Mat3(over_rest).mul(&inverse);
    let (elastic, memory) = elastic_part(solid, state, site, part).unwrap_or((f, 0.0));
    Loose {
        id,
        x,
        v,
        c: std::array::from_fn(|n| scale * c.0[n / 3][n % 3]),
        visible: single(&f),
        elastic: single(&elastic),
        memory: memory as f32,
    }
}

/// Elastic deformation gradient and the law's number at the quadrature point nearest to a site; none where nothing is remembered.
fn elastic_part(
    solid: &SolidObject,
    state: &SolidState,
    site: &CellPoint,
    part: u16,
) -> Option<(Mat3<f64>, f64)> {
    let (grid, block) = (&solid.grid, site.block as usize);
    let mut parts = grid.parts.of(block);
    let place = parts.position(|(law, ..)| law == part)?;
    let memory: &PartMemory = state.memory[block].get(place)?;
    let mut cells = grid.cells[grid.point_blocks[block].cells.clone()].iter();
    let cell = cells.find(|cell| cell.number == site.number && cell.part == part)?;
    let distance = |n: usize| {
        let at = gauss_point(n);
        (0..3).map(|a| (at[a] - site.d[a]).powi(2)).sum::<f64>()
    };
    let filled = (0..8).filter(|&n| cell.volumes[n] > 0.0);
    let nearest = filled.min_by(|&a, &b| distance(a).total_cmp(&distance(b)))?;
    let f = Mat3(
        state
            .sample(
                grid,
                &CellPoint {
                    d: gauss_point(nearest),
                    ..*site
                },
            )
            .f,
    );
    let point = memory.point(site.number, nearest);
    let axes = Mat3(grid.lattice.axes().0.map(|row| row.map(f64::from)));
    let over_grid = f.mul(&axes);
    let elastic = over_grid.blend(1.0, &over_grid.mul(&point.plastic), 1.0);
    Some((elastic.mul_transposed(&axes), point.memory))
}

fn rows(f: &[f32; 9]) -> [[f64; 3]; 3] {
    std::array::from_fn(|a| std::array::from_fn(|b| f64::from(f[3 * a + b])))
}

fn single(f: &Mat3<f64>) -> [f32; 9] {
    std::array::from_fn(|n| f.0[n / 3][n % 3] as f32)
}
