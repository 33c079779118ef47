//! Commands say how objects are modelled: as matter, as one body, as a body that stands, or with as little as is allowed.

use super::World;
use crate::{
    command::CommandError,
    materials::{Law, Material},
    scene::{ContactMethod, Fidelity},
};

impl World {
    /// Whether a command wants an object to be one body, whatever its material.
    pub(super) fn is_made_rigid(&self, object: usize) -> bool {
        let wanted = self.state.commanded.fidelity[object];
        matches!(wanted, Some(Fidelity::Rigid | Fidelity::Static))
    }

    /// Models an object otherwise.
    pub(super) fn check_fidelity(
        &self,
        object: usize,
        fidelity: Fidelity,
    ) -> Result<(), CommandError> {
        self.mass_of(object)?;
        let refuse = |why: &'static str| {
            Err(CommandError::Fidelity {
                object,
                fidelity: fidelity.name(),
                why,
            })
        };
        match fidelity {
            Fidelity::Rigid | Fidelity::Static => {
                if self.model.scene.contact.method == ContactMethod::ComSphere {
                    return Err(CommandError::RigidSphere { object });
                }
                if !self.laws_of_object(object).all(Self::keeps_shape) {
                    return refuse("some of its matter flows and keeps no shape");
                }
            }
            Fidelity::Mpm => {
                if self.laws_of_object(object).all(|law| law.is_rigid()) {
                    return refuse("its law is rigid: give it a material that deforms");
                }
            }
            Fidelity::Auto => {
                if !self.model.scene.contact.method.tells_apart() {
                    return refuse("contact = \"single_field\" does not tell objects apart");
                }
            }
        }
        Ok(())
    }

    /// What a command made one body keeps a shape.
    pub(super) fn check_keeps_shape(
        &self,
        object: usize,
        material: &Material,
    ) -> Result<(), CommandError> {
        if !self.is_made_rigid(object) || Self::keeps_shape(material.law) {
            return Ok(());
        }
        Err(CommandError::Fidelity {
            object,
            fidelity: material.law.name(),
            why: "a command made it one body, and this matter keeps no shape",
        })
    }

    /// A law of matter that can be one body for a while.
    pub(super) fn keeps_shape(law: Law) -> bool {
        law.is_solid() || law.is_rigid()
    }

    fn laws_of_object(&self, object: usize) -> impl Iterator<Item = Law> + '_ {
        let model = &self.model;
        let parts = model.parts.iter().zip(&self.state.commanded.materials);
        let own = parts
            .enumerate()
            .filter(move |(n, (part, _))| part.object == object && model.particle_counts[*n] > 0);
        own.map(|(_, (_, material))| material.law)
    }

    /// Has an object modelled as commanded.
    pub(super) fn recast(&mut self, object: usize, fidelity: Fidelity) {
        let before = self.row_of(object);
        let stood = self.state.commanded.fidelity[object] == Some(Fidelity::Static);
        self.rouse_around(object);
        self.wake(object);
        self.loosen(object);
        self.state.commanded.fidelity[object] = Some(fidelity);
        let commanded = &self.state.commanded;
        self.model.set_materials(&commanded.materials);
        let is_joined = matches!(fidelity, Fidelity::Rigid | Fidelity::Static);
        if !is_joined {
            // What the scene has as one body is matter now, but for what its law makes rigid.
            self.thaw(object);
            self.freeze(object);
        }
        self.publish();
        if is_joined && !self.is_one_body(object) {
            self.stiffen(object);
        }
        let pin = &mut self.state.commanded.pins[object];
        if fidelity == Fidelity::Static {
            let all = self.model.scene.objects[object].particles.clone();
            let all: Vec<u32> = all.map(|p| p as u32).collect();
            pin.get_or_insert_default().extend(&all);
        } else if stood {
            *pin = None;
        }
        self.state.matter.drift = f64::INFINITY;
        self.book(object, &before);
    }

    /// Makes one body of an object's matter, as it was published last.
    pub(super) fn stiffen(&mut self, object: usize) {
        let state = self.measured(object);
        self.state.levels[object].proxy = Some(state.elastic_energy);
        match self.model.lagrangian[object] {
            Some(_) => self.freeze_solid(object),
            None => self.freeze(object),
        }
    }
}
