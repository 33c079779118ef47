//! Penalty: the spring of a point in contact, along the normal and across it.

use super::grip::Grip;
use crate::mat3::{dot, length};

/// Largest share of `3 lambda + 2 mu` over `rho dx^2` that the springs of a surface may add to the squared frequency of a node. With half of
/// it a ball that meets a plane comes 14 % too near, with this 7. Twice it takes a tenth more substeps, a fifth more where blocks slide.
pub(super) const CONTACT: f64 = 3.0;
/// How far ahead the pressure of points that slide looks, over the substep.
const SLIDING: f64 = 1.0;
/// Share of the way to Coulomb's limit that friction of what slides goes in a substep. With 0.25 and half the look ahead a block that
/// vibrates on a slope that holds it crept down by 1.3 cells/s for ever. With 0.15 a block that slides from rest is 1.1 % too far after 3 s.
const FOLLOWS: f64 = 0.2;

/// What a contact has taken in along its normal: no more than that comes back, a passivity observer (Hannaford and Ryu 2002).
///
/// A spring alone gives back more than it took where it ends amid a substep, and as leapfrog keeps the energy of the substeps themselves
/// that is all it gains. Depth in deformed matter is not even the potential of a force: the surface that a point faces may change at once,
/// and distances at rest are stretched. What the last substep of a contact gave too much is a debt that the next contact keeps.
#[derive(Clone, Copy, Debug)]
pub struct Account {
    /// Work along the normal that has not been given back [J], < 0 for a debt.
    pub energy: f64,
    /// Normal force by which it was done last [N].
    pub pressure: f64,
}

impl Account {
    /// Of a point, with a spring of some stiffness [N/m].
    pub fn of(grip: &Grip, stiffness: f64) -> Self {
        Self {
            energy: grip.energy - 0.5 * stiffness * dot(grip.stretch, grip.stretch),
            pressure: grip.pressure,
        }
    }

    /// Depth [m] at which a spring of some stiffness [N/m] holds what there is after an approach [m] along which it
    /// gets deeper by `slope`: half of the work is that of the force before, half that of the force then, as leapfrog kicks.
    pub fn deepest(&self, stiffness: f64, slope: f64, approach: f64) -> f64 {
        let half = 0.5 * slope * approach;
        // What approaches is pressed on whatever is owed, or it would come in without resistance; what parts gets nothing until all is paid.
        let energy = match approach > 0.0 {
            true => self.energy.max(0.0),
            false => self.energy,
        };
        let squared = half * half + (2.0 * energy + self.pressure * approach) / stiffness;
        match squared > 0.0 {
            true => (half + squared.sqrt()).max(0.0),
            false => 0.0,
        }
    }

    /// What there is after an approach [m], with a normal force [N] in the end [J].
    pub fn after(&self, approach: f64, pressure: f64) -> f64 {
        self.energy + 0.5 * (self.pressure + pressure) * approach
    }

    /// What the point remembers where the contact has ended in an approach [m] < 0.
    pub fn part(&self, approach: f64) -> Grip {
        Grip::parted((-self.after(approach, 0.0)).max(0.0))
    }
}

/// A point in contact.
#[derive(Clone, Copy, Debug)]
pub struct NormalContact {
    /// Force per depth, and per stretch [N/m].
    pub stiffness: f64,
    /// How deep the point is in [m].
    pub depth: f64,
    /// Change of that per way along the normal.
    pub slope: f64,
    /// Unit normal towards the point.
    pub normal: [f64; 3],
    /// Coefficient of friction.
    pub friction: f64,
    /// How far the two have come nearer along the normal since they were looked at [m].
    pub approach: f64,
}

impl NormalContact {
    /// Force [N], and what the point remembers of it; `with` tells what it touches, `account` what that took before if it is known, and
    /// `stretch` that of the spring [m], if the contact does not begin. The two have moved with a relative velocity [m/s] for `moved` [s].
    #[inline(always)]
    pub fn press(
        &self,
        with: u32,
        (account, stretch): (Option<Account>, Option<[f64; 3]>),
        (relative, moved): ([f64; 3], f64),
    ) -> ([f64; 3], Grip) {
        let stiffness = self.stiffness;
        let depth = account.map_or(self.depth, |account| {
            let deepest = account.deepest(stiffness, self.slope, self.approach);
            self.depth.min(deepest)
        });
        let effective_depth = depth * self.slope;
        let mut spring = Spring {
            stiffness,
            depth,
            pressure: stiffness * effective_depth,
            normal: self.normal,
            most: self.friction * effective_depth.max(0.0),
        };
        let (force, stretch) = spring.pull(stretch, relative, moved);
        let pressed_in = match account {
            Some(account) => account.after(self.approach, spring.pressure),
            None => 0.5 * stiffness * depth * depth,
        };
        let grip = Grip {
            with,
            stretch,
            energy: pressed_in + 0.5 * stiffness * dot(stretch, stretch),
            pressure: spring.pressure,
            depth: self.depth,
            ..Grip::NONE
        };
        (force, grip)
    }
}

/// What presses and holds a point.
struct Spring {
    /// Force per stretch, and per depth [N/m].
    stiffness: f64,
    /// How deep the point is in [m].
    depth: f64,
    /// Normal force [N].
    pressure: f64,
    /// Unit normal towards the point.
    normal: [f64; 3],
    /// Largest stretch that friction bears [m].
    most: f64,
}

impl Spring {
    /// Force [N] and stretch [m] after a relative velocity [m/s] for `moved` [s]; a contact that begins is stretched since the point came
    /// in. The pressure of what slides is damped, and friction follows it with delay (Prakash and Clifton 1993). At once it would feed
    /// vibrations along the normal until points jump, as elastic bodies that slide are unstable by Coulomb's law (Adams 1995).
    fn pull(
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grip::NOTHING;

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

    /// A chain of masses that flies between two walls for 6 s, with substeps of a share of what is stable in contact: the largest energy
    /// that leapfrog keeps, over that at first, while it touches neither.
    fn growth(keeps_account: bool, share: f64) -> f64 {
        const ENDS: [(usize, f64); 2] = [(0, 1.0), (5, -1.0)];
        // Five cells of 20 mm of a density of 1000 kg/m^3 and a speed of sound of 52 m/s. The largest squared frequency of the free chain is
        // 4 c^2 / dx^2, and a spring of 1.5 times that of a cell at both ends makes that 5.618.
        let (dx, c): (f64, f64) = (0.02, 52.0);
        let mass = |n: usize| if n.is_multiple_of(5) { 10.0 } else { 20.0 };
        let spring = 1000.0 * c * c / dx;
        let (stiffness, fastest) = (1.5 * spring, 5.618_f64.sqrt() * c / dx);
        let dt = share * 2.0 / fastest;
        let (mut u, mut v) = ([0.0_f64; 6], [0.5_f64; 6]);
        let (mut memories, mut largest) = ([Grip::NONE; 2], 0.0_f64);
        let pull = |u: &[f64; 6], n: usize| spring * (u[n + 1] - u[n]);
        for _ in 0..(6.0 / dt) as usize {
            let mut force = [0.0; 6];
            for n in 0..5 {
                force[n] += pull(&u, n);
                force[n + 1] -= pull(&u, n);
            }
            for (held, (n, normal)) in memories.iter_mut().zip(ENDS) {
                let (depth, known) = (-normal * u[n] - 0.005, held.with == 0);
                let account = keeps_account.then(|| Account::of(held, stiffness));
                let approach = match known {
                    true => depth - held.depth,
                    false => -dt * normal * v[n],
                };
                if depth > 0.0 {
                    let contact = NormalContact {
                        stiffness,
                        depth,
                        slope: 1.0,
                        normal: [normal, 0.0, 0.0],
                        friction: 0.0,
                        approach,
                    };
                    let stretch = known.then_some(held.stretch);
                    let moved = ([v[n], 0.0, 0.0], dt);
                    let (given, grip) = contact.press(0, (account, stretch), moved);
                    force[n] += given[0];
                    *held = grip;
                } else if known {
                    *held = account.map_or(Grip::NONE, |account| account.part(approach));
                }
            }
            let before = u;
            for n in 0..6 {
                v[n] += dt * force[n] / mass(n);
                u[n] += dt * v[n];
            }
            if memories.iter().all(|grip| grip.with == NOTHING) {
                let moving: f64 = (0..6).map(|n| 0.5 * mass(n) * v[n] * v[n]).sum();
                let strain = (0..5).map(|n| 0.5 * pull(&before, n) * pull(&u, n) / spring);
                largest = largest.max(moving + strain.sum::<f64>());
            }
            if largest > 1e6 {
                break;
            }
        }
        largest / (0.5 * 100.0 * 0.25)
    }

    #[test]
    fn contact_makes_no_energy_in_substeps_as_long_as_are_taken() {
        for share in [0.3, 0.5, 0.7, 0.8] {
            let (kept, alone) = (growth(true, share), growth(false, share));
            // But for what the last substep of a contact gave too much at both ends, and the next has not yet kept: at most an eighth of
            // what a spring holds over the way of a substep, at twice the speed at first.
            let way = share * 2.0 / (5.618_f64.sqrt() * 52.0 / 0.02);
            let owed = 2.0 * 0.125 * 2.028e8 * way * way / 12.5;
            assert!(kept < 1.0 + owed, "{share}: {kept} {owed}");
            assert!(share < 0.8 || alone > 100.0, "{share}: {alone}");
        }
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
            // No more than its share of the way to what Coulomb's law bears.
            let most = (1.0 - FOLLOWS) * stiffness * held + FOLLOWS * friction * spring.pressure;
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
