//! What solids on grids of their own cannot be asked for: refused when a scene is loaded, never passed over.

use std::sync::LazyLock;

use super::error::WorldError;
use crate::{
    materials::laws::names_of_solids,
    scene::{ContactMethod, Fidelity, Object, Scene},
    solid::object::is_solid,
};

/// Nodes along one axis of a solid's box at most: numbers of nodes have 32 bits.
const LARGEST: f64 = 65_536.0;

/// Laws that solids may have.
static SOLID_LAWS: LazyLock<String> = LazyLock::new(|| {
    let names: Vec<&str> = names_of_solids().collect();
    match names.split_last() {
        Some((last, [])) => (*last).into(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => "none".into(),
    }
});

/// What is asked for in vain, and what could be.
type Refused = (String, &'static str);

/// Refuses what solids do not do.
pub(super) fn validate(scene: &Scene) -> Result<(), WorldError> {
    if !scene.objects.iter().any(is_solid) {
        return Ok(());
    }
    let checked = scene.objects.iter().zip(check_all(scene));
    let mut solids = checked.filter(|(object, _)| is_solid(object));
    solids.try_for_each(|(_, checked)| checked)
}

/// Refuses every object that cannot be a solid in its scene, whatever solver it has.
pub(super) fn check_all(scene: &Scene) -> Vec<Result<(), WorldError>> {
    let check = |(id, object): (usize, &Object)| {
        let refused = of_object(scene, object).or_else(|| of_contact(scene));
        refused.map_or(Ok(()), |(what, expected)| {
            Err(WorldError::Solid {
                object: id,
                what,
                expected,
            })
        })
    };
    scene.objects.iter().enumerate().map(check).collect()
}

/// Of the object itself.
fn of_object(scene: &Scene, object: &Object) -> Option<Refused> {
    if let Some(material) = object.materials().find(|m| !m.law.may_be_solid()) {
        let law = material.law.name();
        return Some((format!("the law {law}"), SOLID_LAWS.as_str()));
    }
    let positions = &scene.particles.position[object.particles.clone()];
    for a in 0..3 {
        let all = positions.iter().map(|x| x[a]);
        let (min, max) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        let cells = (max - min) / scene.dx;
        if cells > LARGEST {
            return Some((format!("{cells:.0} cells along one axis"), "at most 65536"));
        }
    }
    None
}

/// Of how objects meet.
fn of_contact(scene: &Scene) -> Option<Refused> {
    let simulated = |o: &&Object| o.fidelity != Fidelity::Static && !o.particles.is_empty();
    let is_alone = scene.objects.iter().filter(simulated).count() == 1;
    match scene.contact.method {
        ContactMethod::ComSphere => {
            Some(("contact = \"com_sphere\"".into(), "contact = \"two_scale\""))
        }
        ContactMethod::SingleField if !is_alone => {
            let what = "contact = \"single_field\"".into();
            Some((what, "contact = \"two_scale\""))
        }
        _ => None,
    }
}
