//! How particles move once they have gathered their velocity.

use super::Particles;
use crate::{
    colliders::Placed,
    kinematics::advance_deformation,
    mat3::{Mat3, cross},
    materials::{Coefficients, Material, Trial},
    scene::Part,
    step::{
        rigid::{BodySums, body_motion},
        rigid_contact::Point,
    },
};

impl Particles {
    /// Moves particles one by one, deforms them and lets the law have its say.
    pub(super) fn move_and_deform(&mut self, part: &Part, material: &Material, dt: f64) {
        let k = Coefficients::new(material);
        for p in part.particles.clone() {
            if self.mass[p] <= 0.0 {
                continue;
            }
            let c = Mat3(self.affine[p]);
            let a = Mat3(c.0.map(|row| row.map(|c| dt * c)));
            for i in 0..3 {
                self.position[p][i] += dt * self.velocity[p][i];
            }
            self.deformation[p] = advance_deformation(&Mat3(self.deformation[p]), &a).0;
            let trial = Trial {
                f: advance_deformation(&Mat3(self.elastic[p]), &a),
                memory: self.memory[p],
                gradient: c,
                dt,
            };
            let response = material.law.respond(&trial, &k);
            if !material.law.is_fluid() {
                self.elastic[p] = response.f.0;
            }
            self.memory[p] = response.memory;
        }
    }

    /// Moves particles as one rigid body with the linear and angular momentum that they have gathered.
    /// `walls` are the colliders in cells, `falling` is the speed that gravity adds [cells/s].
    pub(super) fn move_as_one(
        &mut self,
        body: &[usize],
        walls: &[Placed<'_>],
        falling: f64,
        dx: f64,
        dt: f64,
    ) {
        // In cells, as the law of motion expects it.
        let mut sums = BodySums::default();
        for &p in body.iter().filter(|&&p| self.mass[p] > 0.0) {
            let x = self.position[p].map(|x| x / dx);
            let v = self.velocity[p].map(|v| v / dx);
            sums.add(self.mass[p], x, v, &Mat3(self.affine[p]));
        }
        let alive = body.iter().filter(|&&p| self.mass[p] > 0.0);
        let points: Vec<Point> = alive
            .flat_map(|&p| {
                let x = self.position[p].map(|x| x / dx);
                walls.iter().filter_map(move |wall| Point::new(x, wall))
            })
            .collect();
        let Some(motion) = body_motion(&sums, [0.0; 3], dt, &points, falling) else {
            return;
        };
        let [x, y, z] = motion.spin;
        let spin = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        for &p in body {
            if self.mass[p] <= 0.0 {
                continue;
            }
            let r: [f64; 3] = std::array::from_fn(|a| self.position[p][a] / dx - motion.com[a]);
            let way = motion.turn.mul_vec(r);
            let arm = std::array::from_fn(|a| r[a] + way[a]);
            let orbit = cross(motion.spin, arm);
            for a in 0..3 {
                self.position[p][a] += dx * (motion.shift[a] + way[a]);
                self.velocity[p][a] = dx * (motion.velocity[a] + orbit[a]);
            }
            self.affine[p] = spin;
            for f in [&mut self.deformation[p], &mut self.elastic[p]] {
                let old = Mat3(*f);
                *f = motion.turn.mul(&old).blend(1.0, &old, 1.0).0;
            }
        }
    }
}
