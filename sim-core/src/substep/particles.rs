//! P2G and G2P: the particle pass.

use super::{
    guard::Failure,
    limit::{MAX_STRAIN, MAX_TRAVEL},
    schedule::{Context, Schedule},
    springs::forget_springs,
    tally::Tally,
};
use crate::{
    colliders::Substep,
    state::{GridMotion, Matter, Workspace},
    step::{
        particle_pass::particle_pass,
        pass::{Findings, Pass, Stage},
    },
    timed,
};

/// P2G where a segment begins: all velocities to the grid, with the forces of the substep at hand. Fails where particles move
/// absurdly for any substep.
pub(super) fn scatter(
    at: &Context<'_>,
    matter: &mut Matter,
    motion: &GridMotion,
    workspace: &mut Workspace,
    Tally { timings, work, .. }: &mut Tally,
) -> Result<(), Failure> {
    timed(&mut timings.particles, || {
        forget_springs(&at.given);
        let findings = pass(at, Stage::Scatter, &at.now, matter, motion, workspace);
        work.particle_to_grid += moved(at, matter);
        match findings.bad {
            true => Err(Failure::Absurd),
            false => Ok(()),
        }
    })
}

/// G2P: particles move, and their laws answer. Velocities are written out where the segment `ends`; otherwise the P2G of the
/// `next` substep follows in the same pass. Fails where particles turn inside out, or are nowhere.
pub(super) fn gather(
    at: &Context<'_>,
    next: &Schedule,
    ends: bool,
    matter: &mut Matter,
    motion: &GridMotion,
    workspace: &mut Workspace,
    Tally { timings, work, .. }: &mut Tally,
) -> Result<(), Failure> {
    timed(&mut timings.particles, || {
        let stage = if ends { Stage::Gather } else { Stage::Fused };
        let findings = pass(at, stage, &at.after(next), matter, motion, workspace);
        let moved = moved(at, matter);
        work.grid_to_particle += moved;
        if !ends {
            work.particle_to_grid += moved;
        }
        match findings.bad {
            true => Err(Failure::Deformation),
            false => Ok(()),
        }
    })
}

/// One stage of the particle pass, in which the substep at hand ends and a `next` one begins.
fn pass(
    at: &Context<'_>,
    stage: Stage,
    next: &Substep,
    matter: &mut Matter,
    motion: &GridMotion,
    workspace: &mut Workspace,
) -> Findings {
    let Context {
        given,
        segment,
        now,
        ..
    } = at;
    let model = given.model;
    let touch = given.particle_conditions(*now, *next);
    let pass = Pass {
        stage,
        dt: now.dt as f32,
        kick: next.kick,
        frame_velocity: motion.frame_velocity,
        next_frame_velocity: given.frame_velocity_after(motion.frame_velocity, next.kick),
        next_keep: model.velocity_kept(next.kick),
        affine_kept: model.scene.conditions.affine_kept(),
        laws: &model.constants.laws,
        max_strain: MAX_STRAIN as f32,
        max_speed: (MAX_TRAVEL / segment.smallest_dt) as f32,
        max_rate: (MAX_STRAIN / segment.smallest_dt) as f32,
        domain: model.domain_in_cells(),
        touch: touch.as_ref(),
        concerned: &workspace.concerned,
    };
    particle_pass(
        model.isa,
        &pass,
        &mut matter.particles,
        &mut workspace.backup,
        &mut workspace.motion,
        &mut workspace.grid,
    )
}

/// How many particles a pass moves.
fn moved(at: &Context<'_>, matter: &Matter) -> u64 {
    (matter.live - at.segment.asleep) as u64
}
