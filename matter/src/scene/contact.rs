//! How objects meet each other: the method, and friction and restitution per pair.

use super::Scene;

/// What happens where two objects meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ContactMethod {
    /// Standard MPM: all objects share one grid, which glues them within its reach.
    SingleField,
    /// Every object has a grid of its own; where two meet, nodes exchange momentum along the gradient of mass.
    MultiField,
    /// The paper's equations (2) to (6): objects are spheres about their centres of mass.
    ComSphere,
    /// Bodies and solids on grids of their own meet surface to surface; what shares the spatial grid meets as by [`MultiField`](Self::MultiField).
    #[default]
    TwoScale,
}

impl ContactMethod {
    /// Names in scene files.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("single_field", Self::SingleField),
        ("multi_field", Self::MultiField),
        ("com_sphere", Self::ComSphere),
        ("two_scale", Self::TwoScale),
    ];

    /// Whether every object has nodes of its own, so that one can be modelled with less while others are in full.
    pub fn tells_apart(self) -> bool {
        matches!(self, Self::MultiField | Self::TwoScale)
    }
}

/// Friction between objects where a surface states none.
pub const DEFAULT_FRICTION: f64 = 0.4;

/// How the surface of an object answers to what it meets, as far as the scene says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactSurface {
    /// Restitution `e` to other objects, 0..=1, of rigid bodies and of the paper's spheres; where absent, 0 and 0.5.
    pub restitution: Option<f64>,
    /// Friction coefficient `mu_f`, >= 0; where absent, [`DEFAULT_FRICTION`] to other objects and that of colliders to them.
    pub friction: Option<f64>,
}

/// What holds where two objects meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairSurface {
    /// Restitution `e`, 0..=1, of rigid bodies and of the paper's spheres; where absent, 0 and 0.5.
    pub restitution: Option<f64>,
    /// Friction coefficient `mu_f`, >= 0.
    pub friction: f64,
}

/// Friction coefficient of two surfaces that meet and state one each: the geometric mean.
pub fn mean_friction(a: f64, b: f64) -> f64 {
    (a * b).sqrt()
}

impl ContactSurface {
    /// Friction coefficient to others than colliders.
    pub fn friction_to_objects(&self) -> f64 {
        self.friction.unwrap_or(DEFAULT_FRICTION)
    }

    /// Of two surfaces that meet: the geometric mean of frictions, the larger restitution.
    pub fn between(&self, other: &Self) -> PairSurface {
        PairSurface {
            restitution: match (self.restitution, other.restitution) {
                (Some(a), Some(b)) => Some(a.max(b)),
                (one, None) | (None, one) => one,
            },
            friction: mean_friction(self.friction_to_objects(), other.friction_to_objects()),
        }
    }
}

/// Surface of two particular objects that meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairRule {
    /// Object ids, in any order.
    pub objects: [usize; 2],
    /// In place of what their own surfaces make.
    pub surface: PairSurface,
}

/// How the objects of a scene meet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contact {
    /// The method.
    pub method: ContactMethod,
    /// Pairs with rules of their own; the last one counts.
    pub pairs: Vec<PairRule>,
}

impl Scene {
    /// Surface where objects `a` and `b` meet, in either order.
    ///
    /// # Panics
    /// When `a` or `b` is not an object id and no rule names the pair, like slice indexing.
    pub fn surface_between(&self, a: usize, b: usize) -> PairSurface {
        let rules = &self.contact.pairs;
        let rule = rules
            .iter()
            .rfind(|rule| rule.objects == [a, b] || rule.objects == [b, a]);
        rule.map_or_else(
            || self.objects[a].surface.between(&self.objects[b].surface),
            |rule| rule.surface,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        materials::Law,
        test_scenes::{add_box, elastic, empty},
    };

    /// And a rule for it comes first.
    #[test]
    fn a_pair_has_one_surface_in_either_order() {
        let mut scene = empty(0.1);
        for friction in [0.1, DEFAULT_FRICTION, 0.9] {
            let material = elastic(Law::NeoHookean, 1e5, 0.3);
            let id = add_box(&mut scene, material, [0.0; 3], 0.05, [1; 3]);
            scene.objects[id].surface.friction = Some(friction);
        }
        scene.objects[0].surface.restitution = Some(0.3);
        scene.objects[1].surface.restitution = Some(0.7);
        let rule = PairSurface {
            restitution: None,
            friction: 0.25,
        };
        scene.contact.pairs.push(PairRule {
            objects: [2, 1],
            surface: rule,
        });
        let made = PairSurface {
            restitution: Some(0.7),
            friction: (0.1_f64 * 0.4).sqrt(),
        };
        assert_eq!(scene.surface_between(0, 1), made);
        assert_eq!(scene.surface_between(1, 0), made);
        assert_eq!(scene.surface_between(0, 2).restitution, Some(0.3));
        assert_eq!(scene.surface_between(1, 2), rule);
        assert_eq!(scene.surface_between(2, 1), rule);
    }
}
