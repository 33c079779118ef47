//! Shape matching: pulls an object together that is about to fragment (Müller et al. 2005).
//!
//! A grid method tears matter where its particles lie more than about a cell apart, whatever the material says. Above
//! that spacing the particles of a coherent object move toward the best rigid or affine image of their rest shape,
//! `x <- x + s (X + G q - x)`, with the deformation gradient of that map, `F <- (1 - s) F + s G`. The centre of mass
//! stays by construction; a spin restores the angular momentum that the new distances would change; and a move that
//! raises the object's kinetic and elastic energy is not made.

use super::World;
use crate::{
    coherence::{D_P, Mode, Sums},
    mat3::{Mat3, cross},
    materials::{Coefficients, Law, polar},
    particles::{Group, Motion, NO_PARTICLE, position_in_cells},
    scene::{Coherence, CoherentMode},
    simd::{F32x16, LANES},
};

/// Spacing of stretched particles that is still safe [cells].
const SAFE_SPACING: f64 = 1.0;
/// Largest move at once [cells].
const MAX_MOVE: f64 = 0.5;

/// A particle of an object: block, group and lane.
type Place = ([i32; 3], usize, usize);

/// What must not change, or not grow.
struct Totals {
    sums: Sums,
    angular: [f64; 3],
    energy: f64,
}

impl World {
    /// Pulls an object together where it is about to fragment; `dt` [s] of substeps have passed.
    pub(super) fn match_shape(&mut self, object: usize, coherence: &Coherence, dt: f64) {
        if self.spacing(object).is_none_or(|s| s <= SAFE_SPACING) {
            return;
        }
        let places = self.places_of(object);
        let (groups, motion) = (
            self.state.particles.groups.clone(),
            self.state.particles.motion.clone(),
        );
        let before = self.totals(object, &places);
        let matched = before
            .as_ref()
            .is_some_and(|before| self.pull(object, &places, coherence, dt, before));
        let after = matched.then(|| self.totals(object, &places)).flatten();
        let gains = match (before, after) {
            (Some(before), Some(after)) => after.energy > before.energy,
            _ => true,
        };
        if gains {
            self.restore_places(&places, &groups, &motion);
            return;
        }
        // Particles may have left their blocks' reach: sort first.
        self.state.drift = f64::INFINITY;
    }

    fn restore_places(&mut self, places: &[Place], groups: &[Group], motion: &[Motion]) {
        for &(_, g, _) in places {
            self.state.particles.groups[g] = groups[g];
            self.state.particles.motion[g] = motion[g];
        }
    }

    /// Largest spacing of neighbours in an object [cells]; none where a part of it is not elastic.
    fn spacing(&self, object: usize) -> Option<f64> {
        let mut largest = 0.0;
        for (id, part) in self.parts.iter().enumerate() {
            if part.object != object || part.particles.is_empty() {
                continue;
            }
            let law = self.state.materials[id].law;
            let elastic = matches!(law, Law::FixedCorotated | Law::NeoHookean);
            if !elastic || self.state.shaped[id] {
                return None;
            }
            let volumes = &self.scene.particles.volume[part.particles.clone()];
            let mean = volumes.iter().sum::<f64>() / volumes.len() as f64;
            let stretch = f64::from(self.state.extremes[id].stretch_squared).sqrt();
            largest = f64::max(largest, stretch * mean.cbrt() / self.scene.dx);
        }
        Some(largest)
    }

    fn places_of(&self, object: usize) -> Vec<Place> {
        let particles = &self.state.particles;
        let mut places = vec![];
        for block in &particles.blocks {
            let runs = particles.runs[block.runs.clone()].iter();
            let groups = runs
                .filter(|run| self.parts[run.part].object == object)
                .flat_map(|run| run.groups.clone());
            for g in groups {
                let used = |&lane: &usize| particles.fixed[g].id[lane] != NO_PARTICLE;
                places.extend((0..LANES).filter(used).map(|lane| (block.index, g, lane)));
            }
        }
        places
    }

    /// Mass, current position [cells], position at rest [cells].
    fn particle(&self, (block, g, lane): Place) -> (f64, [f64; 3], [f64; 3]) {
        let particles = &self.state.particles;
        let x = [0, 1, 2].map(|a| particles.groups[g].x[a].0[lane]);
        let id = particles.fixed[g].id[lane] as usize;
        let rest = self.scene.particles.position[id].map(|x| x / self.scene.dx);
        let mass = f64::from(particles.fixed[g].mass.0[lane]);
        (mass, position_in_cells(block, x), rest)
    }

    /// Sums about the object's last centre of mass, angular momentum about it, and energy in the solver's units.
    fn totals(&self, object: usize, places: &[Place]) -> Option<Totals> {
        let particles = &self.state.particles;
        let about = self.report.objects[object].com.map(|x| x / self.scene.dx);
        let mut sums = Sums::default();
        let (mut angular, mut energy) = ([0.0; 3], 0.0);
        for &place in places {
            let (mass, x, _) = self.particle(place);
            let (_, g, lane) = place;
            let motion = &particles.motion[g];
            let v = [0, 1, 2].map(|a| f64::from(motion.v[a].0[lane]));
            let c = matrix(&motion.c, lane);
            let r = std::array::from_fn(|a| x[a] - about[a]);
            sums.add(mass, r, v, c.0);
            let orbital = cross(r, v);
            let c = c.0;
            let axial = [c[2][1] - c[1][2], c[0][2] - c[2][0], c[1][0] - c[0][1]];
            for a in 0..3 {
                angular[a] += mass * (orbital[a] + D_P * axial[a]);
                energy += 0.5 * mass * v[a] * v[a];
            }
            energy += 0.5 * mass * D_P * Mat3(c).norm_squared();
            let part = self.parts.iter().position(|part| {
                part.particles
                    .contains(&(particles.fixed[g].id[lane] as usize))
            })?;
            let material = &self.state.materials[part];
            let f = matrix(&particles.groups[g].f, lane);
            let density = self.parts[part].material.density;
            // Per mass; kinetic energy above is in cells, this in metres.
            let k = Coefficients::new(material);
            let per_mass = material.law.energy_density(&f, 0.0, &k) / density;
            energy += mass * per_mass / self.scene.dx.powi(2);
        }
        energy.is_finite().then_some(Totals {
            sums,
            angular,
            energy,
        })
    }

    /// Moves the particles; false where no map fits them.
    fn pull(
        &mut self,
        object: usize,
        places: &[Place],
        coherence: &Coherence,
        dt: f64,
        before: &Totals,
    ) -> bool {
        let (mut mass, mut now, mut rest) = (0.0, [0.0; 3], [0.0; 3]);
        for &place in places {
            let (m, x, q) = self.particle(place);
            mass += m;
            for a in 0..3 {
                now[a] += m * x[a];
                rest[a] += m * q[a];
            }
        }
        let (now, rest) = (now.map(|s| s / mass), rest.map(|s| s / mass));
        let (mut pq, mut qq) = (Mat3([[0.0; 3]; 3]), Mat3([[0.0; 3]; 3]));
        for &place in places {
            let (m, x, q) = self.particle(place);
            for a in 0..3 {
                for b in 0..3 {
                    pq.0[a][b] += m * (x[a] - now[a]) * (q[b] - rest[b]);
                    qq.0[a][b] += m * (q[a] - rest[a]) * (q[b] - rest[b]);
                }
            }
        }
        let det = qq.det();
        let flat = det <= 1e-9 * qq.norm_squared().powf(1.5) || pq.det() <= 0.0;
        if flat || !det.is_finite() {
            return false;
        }
        let map = match coherence.mode {
            CoherentMode::Rigid => polar::rotation(&pq),
            CoherentMode::Affine => {
                let g = pq.mul(&qq.cofactor());
                Mat3(g.0.map(|row| row.map(|x| x / det)))
            }
        };
        let mut farthest: f64 = 0.0;
        let goal = |q: [f64; 3]| -> [f64; 3] {
            let image = map.mul_vec(std::array::from_fn(|a| q[a] - rest[a]));
            std::array::from_fn(|a| now[a] + image[a])
        };
        for &place in places {
            let (_, x, q) = self.particle(place);
            let to = goal(q);
            for a in 0..3 {
                farthest = farthest.max((to[a] - x[a]).abs());
            }
        }
        let step = coherence.part(dt).min(MAX_MOVE / farthest.max(1e-9));
        for &place in places {
            let (_, x, q) = self.particle(place);
            let (to, (_, g, lane)) = (goal(q), place);
            let group = &mut self.state.particles.groups[g];
            for a in 0..3 {
                group.x[a].0[lane] += (step * (to[a] - x[a])) as f32;
                for b in 0..3 {
                    let f = &mut group.f[3 * a + b].0[lane];
                    *f += (step * (map.0[a][b] - f64::from(*f))) as f32;
                }
            }
        }
        self.restore_spin(object, places, before)
    }

    /// Gives an object back the angular momentum that it had.
    fn restore_spin(&mut self, object: usize, places: &[Place], before: &Totals) -> bool {
        let Some(after) = self.totals(object, places) else {
            return false;
        };
        let missing: [f64; 3] = std::array::from_fn(|a| before.angular[a] - after.angular[a]);
        let Some(spin) = Mode::spin_of(&after.sums, missing) else {
            return false;
        };
        let about = self.report.objects[object].com.map(|x| x / self.scene.dx);
        for &place in places {
            let (_, x, _) = self.particle(place);
            let more = spin.at(std::array::from_fn(|a| x[a] - about[a]));
            let (_, g, lane) = place;
            let motion = &mut self.state.particles.motion[g];
            for a in 0..3 {
                motion.v[a].0[lane] += more[a] as f32;
                for b in 0..3 {
                    motion.c[3 * a + b].0[lane] += spin.gradient.0[a][b] as f32;
                }
            }
        }
        true
    }
}

fn matrix(rows: &[F32x16; 9], lane: usize) -> Mat3<f64> {
    Mat3(std::array::from_fn(|a| {
        std::array::from_fn(|b| f64::from(rows[3 * a + b].0[lane]))
    }))
}
