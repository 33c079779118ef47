//! Penalty: the spring of a point in contact, along the normal and across it.

use crate::mat3::dot;

/// Largest share of `3 lambda + 2 mu` over `rho dx^2` that the springs of a surface may add to the squared frequency of a node.
pub(super) const CONTACT: f64 = 1.5;
/// How far ahead the pressure of points that slide looks, over the substep.
const SLIDING: f64 = 0.5;

/// What presses and holds a point.
pub struct Spring {
    /// Force per stretch, and per depth [N/m].
    pub stiffness: f64,
    /// How deep the point is in [m].
    pub depth: f64,
    /// Normal force [N].
    pub pressure: f64,
    /// Unit normal towards the point.
    pub normal: [f64; 3],
    /// Largest stretch that friction bears [m].
    pub most: f64,
}

impl Spring {
    /// Force [N] and stretch [m] after a relative velocity [m/s] for `moved` [s]; a contact that begins has no stretch yet. The pressure
    /// of what slides is damped: friction follows it, and feeds vibrations along the normal until points jump.
    pub fn pull(
        &mut self,
        before: Option<[f64; 3]>,
        relative: [f64; 3],
        moved: f64,
    ) -> ([f64; 3], [f64; 3]) {
        let stretch: [f64; 3] = match before {
            Some(before) => std::array::from_fn(|a| before[a] + moved * relative[a]),
            None => [0.0; 3],
        };
        let along = dot(stretch, self.normal);
        let mut stretch: [f64; 3] = std::array::from_fn(|a| stretch[a] - along * self.normal[a]);
        let size = dot(stretch, stretch).sqrt();
        if size > self.most {
            // Without friction nothing is fed, and bounces keep their energy.
            if self.most > 0.0 {
                let ahead = SLIDING * moved * self.stiffness * dot(relative, self.normal);
                let damped = (self.pressure - ahead).max(0.0);
                self.most *= damped / self.pressure;
                self.pressure = damped;
            }
            stretch = stretch.map(|s| s * self.most / size);
        }
        let force =
            std::array::from_fn(|a| self.pressure * self.normal[a] - self.stiffness * stretch[a]);
        (force, stretch)
    }

    /// What it holds [J]: the force is the slope of that.
    pub fn energy(&self, stretch: [f64; 3]) -> f64 {
        0.5 * self.stiffness * (self.depth * self.depth + dot(stretch, stretch))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressure_is_damped_where_friction_slides_alone() {
        let (stiffness, depth, moved) = (100.0, 0.01, 1e-3);
        let pressed = |friction: f64, along: f64| {
            let mut spring = Spring {
                stiffness,
                depth,
                pressure: stiffness * depth,
                normal: [0.0, 0.0, 1.0],
                most: friction * depth,
            };
            let (force, _) = spring.pull(Some([0.0; 3]), [along, 0.0, 2.0], moved);
            assert_eq!(force[2], spring.pressure);
            // No more than Coulomb's law bears.
            assert!(force[0].abs() <= friction * spring.pressure * (1.0 + 1e-12));
            spring.pressure
        };
        // Frictionless, and stuck.
        assert_eq!(pressed(0.0, 3.0), stiffness * depth);
        assert_eq!(pressed(0.5, 3.0), stiffness * depth);
        let damped = stiffness * (depth - SLIDING * moved * 2.0);
        assert!((pressed(0.5, 6.0) - damped).abs() < 1e-12);
    }
}
