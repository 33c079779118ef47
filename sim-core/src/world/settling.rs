//! What happens before time 0: objects that stand where they are placed take up their own weight.
//!
//! Matter begins without stress, so gravity sets it ringing. A scene may let it come to rest first.

use super::{Frame, World};
use crate::{
    interruption::Interruption,
    particles::{Extremes, Motion, NO_PARTICLE},
    simd::LANES,
    step::sort::Newcomer,
};

/// Damping in that time, over its length: vibration shrinks by `e^-10`, and what is slower than one swing in it creeps.
const DECAY: f64 = 20.0;

impl World {
    /// Lets everything come to rest under gravity, as long as the scene says, then gives the particles the velocities
    /// of `newcomers` and the bodies theirs. Time does not pass, and what is still afterwards may sleep at once.
    pub(super) fn come_to_rest(&mut self, newcomers: &[Newcomer]) {
        let span = self.model.scene.conditions.settle;
        let objects = 0..self.model.scene.objects.len();
        for motion in &mut self.state.matter.particles.motion {
            *motion = Motion::REST;
        }
        for object in objects.clone() {
            self.set_body_velocity(object, [0.0; 3], [0.0; 3]);
        }
        self.start_solids(false);
        let own = self.model.damping;
        self.model.damping = own + DECAY / span;
        self.publish();
        self.report = self.measure(&Frame::new(0.0));
        let frames = (span * self.model.scene.frame_rate).ceil().max(1.0);
        for _ in 0..frames as usize {
            let mut frame = Frame::new(span / frames);
            self.advance(&mut frame, Interruption::never());
            self.publish();
            self.report = self.measure(&frame);
            for object in objects.clone() {
                if self.given().is_automatic(object) {
                    self.watch(object, frame.length);
                }
            }
        }
        self.model.damping = own;
        self.begin(newcomers);
        self.publish();
    }

    /// Gives everything its initial velocity, and forgets how it came to rest.
    fn begin(&mut self, newcomers: &[Newcomer]) {
        let mut of = vec![usize::MAX; self.model.scene.particles.position.len()];
        for (n, newcomer) in newcomers.iter().enumerate() {
            of[newcomer.id as usize] = n;
        }
        let particles = &mut self.state.matter.particles;
        for (motion, fixed) in particles.motion.iter_mut().zip(&particles.fixed) {
            *motion = Motion::REST;
            for lane in (0..LANES).filter(|&lane| fixed.id[lane] != NO_PARTICLE) {
                let newcomer = &newcomers[of[fixed.id[lane] as usize]];
                for a in 0..3 {
                    motion.v[a].0[lane] = newcomer.v[a];
                }
                for n in 0..9 {
                    motion.c[n].0[lane] = newcomer.c[n];
                }
            }
        }
        for (id, object) in self.model.scene.objects.iter().enumerate() {
            let moves = object.velocity.is_some()
                || object.linear_velocity != [0.0; 3]
                || object.velocity_gradient != [[0.0; 3]; 3];
            if moves {
                self.state.levels[id].forget_poses();
            }
        }
        for object in 0..self.model.scene.objects.len() {
            self.start_body(object);
        }
        self.start_solids(true);
        self.state.matter.extremes.fill(Extremes::NONE);
        self.state.motion.frame_velocity = [0.0; 3];
        self.state.motion.max_speed = 0.0;
        self.state.motion.velocity_offset = 0.0;
        self.state.matter.drift = f64::INFINITY;
        self.state.in_contact = Default::default();
        self.state.progress.momentum.fill([0.0; 3]);
    }
}
