//! Commands on the reference state.

use std::ops::Range;

use cosplat_sim_core::{
    colliders::{CommandedForce, Loaded, Path, Substep},
    command::{Action, Command},
    mat3::Mat3,
    materials::Material,
    rotation::{from_rotation_vector, product},
    scene::Pose,
};

use crate::{Particles, ReferenceWorld};

impl ReferenceWorld {
    /// Applies commands in the given order. An object that is not in the scene is passed over.
    pub(crate) fn apply(&mut self, commands: &[Command]) {
        for command in commands {
            self.act(&command.action);
        }
    }

    /// What the new law needs of the past: volume passes between solids and fluids, all else is forgotten.
    fn set_material(&mut self, object: usize, region: Option<usize>, material: &Material) {
        for (part, current) in self.parts.iter().zip(&mut self.materials) {
            if part.object != object || region.is_some() && part.region != region {
                continue;
            }
            let old = std::mem::replace(current, material.clone()).law;
            if old.id() == material.law.id() {
                continue;
            }
            for p in part.particles.clone() {
                let memory = &mut self.particles.memory[p];
                match (old.is_fluid(), material.law.is_fluid()) {
                    (false, true) => *memory = Mat3(self.particles.elastic[p]).det() - 1.0,
                    (true, false) => {
                        self.particles.elastic[p] = Mat3::diagonal([(1.0 + *memory).cbrt(); 3]).0;
                        *memory = 0.0;
                    }
                    (true, true) => {}
                    (false, false) => *memory = 0.0,
                }
            }
        }
    }

    fn act(&mut self, action: &Action) {
        let range = |object: usize| {
            self.scene
                .objects
                .get(object)
                .map_or(0..0, |o| o.particles.clone())
        };
        match *action {
            Action::Impulse { object, impulse } => {
                self.particles.push(&Vec::from_iter(range(object)), impulse);
            }
            Action::ImpulseAt {
                object,
                impulse,
                point,
                radius,
            } => {
                let touched = self.particles.within(range(object), point, radius);
                self.particles.push(&touched, impulse);
            }
            Action::SetVelocity {
                object,
                linear,
                angular: [x, y, z],
            } => {
                let spin = Mat3([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]);
                // The velocity is that of now; those of particles are behind.
                let linear = std::array::from_fn(|i| linear[i] - self.lag * self.gravity[i]);
                self.particles
                    .set_affine_motion(range(object), linear, spin);
            }
            Action::SetMaterial {
                object,
                region,
                // Brushes are the solver's alone, as edits below.
                patch: None,
                ref material,
            } => self.set_material(object, region, material),
            Action::SetGravity { gravity } => self.gravity = gravity,
            Action::MoveCollider { collider, pose } => self.send_collider(collider, |_| pose),
            Action::ColliderVelocity {
                collider,
                linear,
                angular,
            } => self.drive_collider(collider, linear, angular),
            Action::Force {
                object,
                force,
                torque,
            } => self.hold_force(object, &Vec::from_iter(range(object)), force, torque),
            Action::ForceAt {
                object,
                force,
                point,
                radius,
            } => {
                let touched = self.particles.within(range(object), point, radius);
                self.hold_force(object, &touched, force, [0.0; 3]);
            }
            Action::Save { snapshot } => {
                let mut kept = self.clone();
                kept.snapshots.clear();
                self.snapshots.insert(snapshot, kept);
            }
            Action::Restore { snapshot } => {
                if let Some(kept) = self.snapshots.get(&snapshot).cloned() {
                    self.go_back(kept);
                }
            }
            Action::Pin {
                object,
                point,
                radius,
            } => {
                let held = self.particles.within(range(object), point, radius);
                self.pin(object, Some(held));
            }
            Action::Release { object } => self.pin(object, None),
            // The solver's alone: they change nothing here.
            Action::Hold { .. }
            | Action::SetMaterial { .. }
            | Action::SetPose { .. }
            | Action::SetFidelity { .. }
            | Action::Remove { .. }
            | Action::BringIn { .. }
            | Action::Undo
            | Action::Redo => {}
            Action::Reset => self.go_back(Self::new(&self.scene)),
        }
    }

    /// Takes another state; the number of steps and what was kept stay.
    fn go_back(&mut self, state: Self) {
        *self = Self {
            steps: self.steps,
            snapshots: std::mem::take(&mut self.snapshots),
            ..state
        };
    }

    /// Pins more particles of an object, or releases all.
    fn pin(&mut self, object: usize, held: Option<Vec<usize>>) {
        let Some(pin) = self.pins.get_mut(object) else {
            return;
        };
        match held {
            Some(held) => {
                let held: Vec<u32> = held.into_iter().map(|p| p as u32).collect();
                pin.get_or_insert_default().extend(&held);
            }
            None => *pin = None,
        }
    }

    /// Sends a collider off at a velocity for the coming frame.
    fn drive_collider(&mut self, collider: usize, linear: [f64; 3], angular: [f64; 3]) {
        let frame = self.scene.frame_rate.recip();
        let turn = from_rotation_vector(angular.map(|w| frame * w));
        self.send_collider(collider, |now| Pose {
            translation: std::array::from_fn(|i| now.translation[i] + frame * linear[i]),
            rotation: product(turn, now.rotation),
        });
    }

    /// Sends a collider to a pose, made from that of now, in the coming frame.
    fn send_collider(&mut self, collider: usize, to: impl FnOnce(Pose) -> Pose) {
        let now = Substep {
            time: self.sim_time,
            dt: 0.0,
            kick: 0.0,
            frame_start: self.sim_time,
            frame_length: 0.0,
        };
        if collider < self.paths.len() {
            let from = self
                .boundaries
                .pose(collider, &self.paths, &now, self.sim_time);
            let to = to(from);
            self.paths[collider] = Some(Path { from, to });
        }
    }

    /// Lets a force and a torque act on particles of an object during the coming frame.
    fn hold_force(&mut self, object: usize, touched: &[usize], force: [f64; 3], torque: [f64; 3]) {
        let Some(owner) = self.scene.objects.get(object) else {
            return;
        };
        let all = owner.particles.clone();
        let first = all.start;
        let loaded: Vec<Loaded> = all
            .map(|p| Loaded {
                place: self.particles.position[p],
                mass: match touched.binary_search(&p) {
                    Ok(_) => self.particles.mass[p],
                    Err(_) => 0.0,
                },
            })
            .collect();
        let held = CommandedForce::new(object, first, &loaded, force, torque, 1.0);
        self.rules.commanded.extend(held);
    }
}

impl Particles {
    /// Gives particles the velocity `linear + G (x - X)` about their centre of mass `X`, and `C = G`.
    pub(crate) fn set_affine_motion(
        &mut self,
        range: Range<usize>,
        linear: [f64; 3],
        gradient: Mat3<f64>,
    ) {
        let mut mass = 0.0;
        let mut first = [0.0; 3];
        for p in range.clone() {
            mass += self.mass[p];
            for i in 0..3 {
                first[i] += self.mass[p] * self.position[p][i];
            }
        }
        for p in range {
            let r = std::array::from_fn(|i| self.position[p][i] - first[i] / mass);
            let spin = gradient.mul_vec(r);
            self.velocity[p] = std::array::from_fn(|i| linear[i] + spin[i]);
            self.affine[p] = gradient.0;
        }
    }

    /// Shares an impulse over particles as equal velocity change.
    fn push(&mut self, touched: &[usize], impulse: [f64; 3]) {
        let mass: f64 = touched.iter().map(|&p| self.mass[p]).sum();
        if mass > 0.0 {
            for &p in touched {
                for i in 0..3 {
                    self.velocity[p][i] += impulse[i] / mass;
                }
            }
        }
    }

    /// Living particles within `radius` of `point`; the nearest one when there are none.
    fn within(&self, range: Range<usize>, point: [f64; 3], radius: f64) -> Vec<usize> {
        let distance = |p: usize| {
            (0..3)
                .map(|i| (self.position[p][i] - point[i]).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let alive: Vec<usize> = range.filter(|&p| self.mass[p] > 0.0).collect();
        let nearest = alive
            .iter()
            .map(|&p| distance(p))
            .fold(f64::INFINITY, f64::min);
        let reach = radius.max(nearest);
        alive
            .into_iter()
            .filter(|&p| distance(p) <= reach)
            .collect()
    }
}
