//! How particles move once they have gathered their velocity.

use cosplat_sim_core::{
    kinematics::advance_deformation,
    mat3::Mat3,
    materials::{Coefficients, Material, Trial},
    scene::Part,
};

use crate::Particles;

impl Particles {
    /// Moves particles one by one, deforms them and lets the law have its say.
    pub(crate) fn move_and_deform(&mut self, part: &Part, material: &Material, dt: f64) {
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
}
