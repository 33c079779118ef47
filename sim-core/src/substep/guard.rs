//! The guard: how far a substep may carry particles, and what became of them.

use super::{limit::MAX_TRAVEL, schedule::Context};
use crate::{
    colliders::{Substep, sweep::SKIN},
    particles::{BLOCK, Extremes},
    report::DtLimit,
    state::{Given, GridMotion, Matter, Workspace},
};

/// Why a substep cannot stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Failure {
    /// Particles move absurdly for any substep, before it began.
    Absurd,
    /// Particles would have travelled too far.
    Travel,
    /// Particles turned inside out, or are nowhere.
    Deformation,
}

impl Failure {
    /// What limits the substep that is tried next.
    pub fn cause(self) -> DtLimit {
        match self {
            Self::Travel => DtLimit::Velocity,
            Self::Absurd | Self::Deformation => DtLimit::Deformation,
        }
    }
}

/// Of components of velocities the larger; compared as integers, so that NaN is the largest of all.
pub(super) fn larger(a: f32, b: f32) -> f32 {
    f32::from_bits(a.to_bits().max(b.to_bits()))
}

/// Takes note of the largest velocity components on the grid, `on_nodes` with the frame velocity, `given_later` without;
/// returns the largest distance that particles travel [cells].
pub(super) fn travel(
    at: &Context<'_>,
    [on_nodes, given_later]: [f32; 2],
    workspace: &Workspace,
    motion: &mut GridMotion,
) -> f64 {
    let now = &at.now;
    let fold = |m: f32, u: f64| m.max(u.abs() as f32);
    let given_later = given_later + motion.frame_velocity.into_iter().fold(0.0, fold);
    motion.max_speed = larger(on_nodes, given_later).into();
    let outside = OutsideSpeeds::new(&at.given, now, workspace.extent, &workspace.prescribed);
    motion.max_speed = motion.max_speed.max(outside.prescribed);
    let speed = match outside.colliders {
        None => motion.max_speed,
        Some(speed) => {
            motion.max_speed += 2.0 * speed;
            // Contact may turn a particle's way into one axis and moves it by its skin.
            3.0_f64.sqrt() * motion.max_speed + 2.0 * SKIN / now.dt
        }
    };
    now.dt * speed
}

/// Largest speeds that come from outside in a substep [cells/s].
#[derive(Clone, Copy, Debug)]
struct OutsideSpeeds {
    /// Of prescribed particles.
    prescribed: f64,
    /// Of colliders that act on particles; none when no particle is near one.
    colliders: Option<f64>,
}

impl OutsideSpeeds {
    /// How fast boundaries and rules may move particles in a substep; `speeds` is per prescribed motion.
    fn new(given: &Given<'_>, now: &Substep, [min, max]: [[i32; 3]; 2], speeds: &[f64]) -> Self {
        let touch = given.particle_conditions(*now, *now);
        let Some(touch) = touch.filter(|_| min[0] <= max[0]) else {
            return Self {
                prescribed: 0.0,
                colliders: None,
            };
        };
        // Blocks, and what may have drifted out of them.
        let min = min.map(|i| f64::from(BLOCK * i) - 2.5);
        let max = max.map(|i| f64::from(BLOCK * (i + 1)) + 1.5);
        Self {
            prescribed: given.model.rules.speed(speeds, now),
            colliders: touch.collider_speed(min, max),
        }
    }
}

/// Checks that no particle travels farther than its tiles reach.
pub(super) fn check_travel(travel: f64) -> Result<(), Failure> {
    match travel < MAX_TRAVEL {
        true => Ok(()),
        false => Err(Failure::Travel),
    }
}

/// Joins the extremes of all runs per part, and takes how far particles are out of their blocks.
pub(super) fn collect_extremes(matter: &mut Matter) {
    matter.extremes.fill(Extremes::NONE);
    let mut reach = 0.0_f32;
    for run in &matter.particles.runs {
        matter.extremes[run.part].join(&run.extremes);
        reach = reach.max(run.extremes.reach);
    }
    matter.drift = (f64::from(reach) - 0.5 * f64::from(BLOCK)).max(0.0);
}
