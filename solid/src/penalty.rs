//! Penalty: the spring of a point in contact, along the normal and across it.

use crate::mat3::{dot, length};

/// Largest share of `3 lambda + 2 mu` over `rho dx^2` that the springs of a surface may add to the squared frequency of a node. With half of
/// it a ball that meets a plane comes 14 % too near, with this 7. Twice it takes a tenth more substeps, a fifth more where blocks slide.
pub(super) const CONTACT: f64 = 3.0;
/// How far ahead the pressure of points that slide looks, over the substep.
const SLIDING: f64 = 0.5;
/// Share of the way to Coulomb's limit that friction of what slides goes in a substep.
const FOLLOWS: f64 = 0.25;

/// What a contact has taken in along its normal. Depth in deformed matter is the potential of no force between two solids: the surface that a
/// point faces may change at once, and distances at rest are stretched. So work tells how deep a point is at most, and no more than that
/// comes back: a passivity observer (Hannaford and Ryu 2002).
#[derive(Clone, Copy, Debug)]
pub struct Account {
    /// Work along the normal that has not been given back [J].
    pub energy: f64,
    /// Normal force by which it was done last [N].
    pub pressure: f64,
}

impl Account {
    /// Depth [m] at which a spring of some stiffness [N/m] holds what there is after an approach [m] along which it
    /// gets deeper by `slope`: half of the work is that of the force before, half that of the force then, as leapfrog kicks.
    pub fn deepest(&self, stiffness: f64, slope: f64, approach: f64) -> f64 {
        let half = 0.5 * slope * approach;
        let squared = half * half + (2.0 * self.energy + self.pressure * approach) / stiffness;
        match squared > 0.0 {
            true => (half + squared.sqrt()).max(0.0),
            false => 0.0,
        }
    }

    /// What there is after an approach [m], with a normal force [N] in the end [J].
    pub fn after(&self, approach: f64, pressure: f64) -> f64 {
        self.energy + 0.5 * (self.pressure + pressure) * approach
    }
}

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
    /// Force [N] and stretch [m] after a relative velocity [m/s] for `moved` [s]; a contact that begins is stretched since the point came
    /// in. The pressure of what slides is damped, and friction follows it with delay (Prakash and Clifton 1993). At once it would feed
    /// vibrations along the normal until points jump, as elastic bodies that slide are unstable by Coulomb's law (Adams 1995).
    pub fn pull(
        &mut self,
        before: Option<[f64; 3]>,
        relative: [f64; 3],
        moved: f64,
    ) -> ([f64; 3], [f64; 3]) {
        let stretch: [f64; 3] = match before {
            Some(before) => std::array::from_fn(|a| before[a] + moved * relative[a]),
            None => self.since(relative, moved),
        };
        let along = dot(stretch, self.normal);
        let mut stretch: [f64; 3] = std::array::from_fn(|a| stretch[a] - along * self.normal[a]);
        let size = length(stretch);
        let held = before.map(length);
        let bears = |most: f64| held.map_or(most, |held| held + FOLLOWS * (most - held));
        if size > bears(self.most) {
            // Without friction nothing is fed, and bounces keep their energy.
            if self.most > 0.0 {
                let ahead = SLIDING * moved * self.stiffness * dot(relative, self.normal);
                let damped = (self.pressure - ahead).max(0.0);
                self.most *= damped / self.pressure;
                self.pressure = damped;
            }
            let bears = bears(self.most);
            stretch = stretch.map(|s| s * bears / size);
        }
        let force =
            std::array::from_fn(|a| self.pressure * self.normal[a] - self.stiffness * stretch[a]);
        (force, stretch)
    }

    /// Way since a point came in that has moved with a relative velocity [m/s] for `moved` [s]: without it, what slides and jumps rubs too
    /// little.
    fn since(&self, relative: [f64; 3], moved: f64) -> [f64; 3] {
        let approach = (-dot(relative, self.normal)).max(0.0);
        let inside = match approach * moved > self.depth {
            true => self.depth / approach,
            false => moved,
        };
        relative.map(|v| inside * v)
    }

    /// What it holds [J]: the force is the slope of that.
    pub fn energy(&self, stretch: [f64; 3]) -> f64 {
        0.5 * self.stiffness * (self.depth * self.depth + dot(stretch, stretch))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a point so deep [m] under a plane, with this friction.
    fn spring(stiffness: f64, depth: f64, friction: f64) -> Spring {
        Spring {
            stiffness,
            depth,
            pressure: stiffness * depth,
            normal: [0.0, 0.0, 1.0],
            most: friction * depth,
        }
    }

    #[test]
    fn depth_is_bounded_by_the_work_that_was_done() {
        let stiffness = 100.0;
        let of = |depth: f64| Account {
            energy: 0.5 * stiffness * depth * depth,
            pressure: stiffness * depth,
        };
        // A spring that gets deeper as bodies approach is bounded by itself, on its way in and out.
        for (from, to) in [(0.0, 0.01), (0.01, 0.03), (0.03, 0.02), (0.02, 0.0)] {
            let (account, approach) = (of(from), to - from);
            let deepest = account.deepest(stiffness, 1.0, approach);
            assert!((deepest - to).abs() < 1e-9, "{deepest} {to}");
            let after = account.after(approach, stiffness * deepest);
            assert!((after - of(to).energy).abs() < 1e-9);
        }
        // What is found inside and parts was given nothing.
        assert_eq!(of(0.0).deepest(stiffness, 1.0, -0.01), 0.0);
        // A surface that is farther at once gives back what was put in, but for the substep in which bodies part.
        let (mut account, mut given) = (of(0.01), 0.0);
        for _ in 0..100 {
            let pressure = stiffness * account.deepest(stiffness, 1.0, -1e-3).min(0.05);
            let energy = account.after(-1e-3, pressure);
            given += account.energy - energy;
            account = Account { energy, pressure };
        }
        let last = 0.5 * stiffness * 1e-3 * 1e-3;
        assert!((given - of(0.01).energy).abs() <= last, "{given}");
    }

    #[test]
    fn contact_that_begins_rubs_by_the_way_since_it_did() {
        let (stiffness, depth, moved) = (100.0, 0.01, 1e-2);
        let pull = |along: f64, approach: f64| {
            let mut spring = spring(stiffness, depth, 0.5);
            let (force, _) = spring.pull(None, [along, 0.0, -approach], moved);
            assert_eq!(force[2], spring.pressure);
            -force[0] / spring.pressure
        };
        // It came in half of the time ago.
        assert!((pull(0.1, 2.0) - 0.1 * 0.5 * moved / depth).abs() < 1e-12);
        // At the start, or before; and more than Coulomb's law bears.
        assert!((pull(0.1, 0.0) - 0.1 * moved / depth).abs() < 1e-12);
        assert!((pull(3.0, 0.5) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn pressure_is_damped_where_friction_slides_alone() {
        let (stiffness, depth, moved) = (100.0, 0.01, 1e-3);
        let pressed = |friction: f64, along: f64| {
            let mut spring = spring(stiffness, depth, friction);
            let held = 0.3 * friction * depth;
            let (force, _) = spring.pull(Some([held, 0.0, 0.0]), [along, 0.0, 2.0], moved);
            assert_eq!(force[2], spring.pressure);
            // No more than a quarter of the way to what Coulomb's law bears.
            let most = 0.75 * stiffness * held + 0.25 * friction * spring.pressure;
            assert!(-force[0] <= most * (1.0 + 1e-12), "{force:?} {most}");
            spring.pressure
        };
        // Frictionless, and stuck.
        assert_eq!(pressed(0.0, 3.0), stiffness * depth);
        assert_eq!(pressed(0.5, 0.5), stiffness * depth);
        let damped = stiffness * (depth - SLIDING * moved * 2.0);
        assert!((pressed(0.5, 6.0) - damped).abs() < 1e-12);
    }
}
