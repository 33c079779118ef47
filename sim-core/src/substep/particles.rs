//! P2G and G2P: the particle pass, once per group of objects that move in the same way.

use super::{
    guard::Failure,
    limit::{MAX_STRAIN, MAX_TRAVEL},
    rates::Rate,
    schedule::{Context, Schedule},
    springs::forget_springs,
    tally::{Tally, timed},
};
use crate::{
    colliders::{Substep, touch::ParticleConditions},
    grid::{Sums, node_means},
    particles::NO_PARTICLE,
    report::Work,
    state::{Given, GridMotion, Matter, Workspace},
    step::{
        particle_pass::particle_pass,
        pass::{Findings, Pass, Stage},
    },
};

/// Objects whose particles move in the same way, and when.
struct Groups {
    /// Per group its rate, the substep that ends and the one that begins.
    all: Vec<(Rate, [Substep; 2])>,
    /// Per object its group, if its particles are to be moved.
    of: Vec<Option<usize>>,
}

impl Groups {
    /// Who moves at the end of a substep, or, without a `next` one, comes to the grid before one: all.
    fn new(at: &Context<'_>, next: Option<&Schedule>, motion: &GridMotion) -> Self {
        let Context {
            given,
            segment,
            schedule,
            ..
        } = at;
        let mut known: Vec<(Rate, f64)> = vec![];
        let mut of = Vec::with_capacity(motion.velocity_offsets.len());
        for (object, &offset) in motion.velocity_offsets.iter().enumerate() {
            let rate = segment.rates.of(object);
            let moves = next.is_none() || rate == Rate::Fine || at.ends_coarse();
            of.push(moves.then(|| {
                let found = known.iter().position(|group| *group == (rate, offset));
                found.unwrap_or_else(|| {
                    known.push((rate, offset));
                    known.len() - 1
                })
            }));
        }
        let all = known.into_iter();
        let all =
            all.map(|(rate, offset)| (rate, segment.substeps(schedule, next, given, rate, offset)));
        Self {
            all: all.collect(),
            of,
        }
    }

    /// Coupled objects as those of a single group, the only one that moves.
    fn coupled(&self) -> Vec<Option<usize>> {
        let is_coupled = |group: &Option<usize>| {
            let (rate, _) = self.all[(*group)?];
            (rate == Rate::Coupled).then_some(0)
        };
        self.of.iter().map(is_coupled).collect()
    }
}

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
        let groups = Groups::new(at, None, motion);
        let findings = pass(at, Stage::Scatter, &groups, matter, motion, workspace);
        work.particle_to_grid += moved(at, matter, &groups.of);
        scatter_forces(at, &groups, matter, motion, workspace, work);
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
        let groups = Groups::new(at, Some(next), motion);
        let stage = if ends { Stage::Gather } else { Stage::Fused };
        let findings = pass(at, stage, &groups, matter, motion, workspace);
        let moved = moved(at, matter, &groups.of);
        work.grid_to_particle += moved;
        if !ends {
            work.particle_to_grid += moved;
            scatter_forces(at, &groups, matter, motion, workspace, work);
        }
        match findings.bad {
            true => Err(Failure::Deformation),
            false => Ok(()),
        }
    })
}

/// One stage of the particle pass for all groups.
fn pass(
    at: &Context<'_>,
    stage: Stage,
    groups: &Groups,
    matter: &mut Matter,
    motion: &GridMotion,
    workspace: &mut Workspace,
) -> Findings {
    let Context { given, segment, .. } = at;
    let Given {
        model, commanded, ..
    } = *given;
    let touches = groups.all.iter().map(|&(_, [now, next])| {
        ParticleConditions::new(
            &model.boundaries,
            &commanded.paths,
            &model.rules,
            &commanded.pins,
            now,
            next,
            commanded.gravity,
        )
    });
    let touches: Vec<Option<ParticleConditions<'_>>> = touches.collect();
    let conditions = &model.scene.conditions;
    let passes = groups.all.iter().zip(&touches);
    let passes = passes.map(|(&(rate, [now, next]), touch)| Pass {
        stage,
        dt: now.dt as f32,
        kick: next.kick,
        frame_velocity: motion.frame_velocity,
        next_frame_velocity: given.frame_velocity_after(motion.frame_velocity, next.kick),
        next_keep: model.velocity_kept(next.kick),
        affine_kept: conditions.affine_kept(),
        // Of coupled objects those forces that do not depend on velocities come by themselves.
        laws: match rate {
            Rate::Coupled => &model.constants.viscous_laws,
            Rate::Fine | Rate::Isolated => &model.constants.laws,
        },
        max_strain: MAX_STRAIN as f32,
        max_speed: (MAX_TRAVEL / segment.smallest_dt) as f32,
        max_rate: (MAX_STRAIN / segment.smallest_dt) as f32,
        domain: model.domain_in_cells(),
        touch: touch.as_ref(),
        concerned: &workspace.concerned,
    });
    particle_pass(
        model.isa,
        &passes.collect::<Vec<_>>(),
        &groups.of,
        &mut matter.particles,
        &mut workspace.backup,
        &mut workspace.motion,
        &mut workspace.grid,
    )
}

/// Takes what coupled objects brought to the grid for their velocities there, and works out what forces add to those per
/// second.
fn scatter_forces(
    at: &Context<'_>,
    groups: &Groups,
    matter: &mut Matter,
    motion: &GridMotion,
    workspace: &mut Workspace,
    work: &mut Work,
) {
    let coupled = groups.coupled();
    if coupled.iter().all(Option::is_none) {
        return;
    }
    let model = at.given.model;
    let fields = |field: u32| coupled[field as usize].is_some();
    node_means(model.isa, &mut workspace.grid, Sums::Velocities, fields);
    let pass = Pass {
        stage: Stage::Forces,
        dt: 0.0,
        kick: 1.0,
        frame_velocity: motion.frame_velocity,
        next_frame_velocity: motion.frame_velocity,
        next_keep: 1.0,
        affine_kept: None,
        laws: &model.constants.laws,
        max_strain: f32::INFINITY,
        max_speed: f32::INFINITY,
        max_rate: f32::INFINITY,
        domain: model.domain_in_cells(),
        touch: None,
        concerned: &[],
    };
    work.particle_to_grid += moved(at, matter, &coupled);
    particle_pass(
        model.isa,
        &[pass],
        &coupled,
        &mut matter.particles,
        &mut workspace.backup,
        &mut workspace.motion,
        &mut workspace.grid,
    );
    node_means(model.isa, &mut workspace.grid, Sums::Forces, fields);
}

/// How many particles a pass moves that leaves out objects without a group.
fn moved(at: &Context<'_>, matter: &Matter, group_of: &[Option<usize>]) -> u64 {
    let moving = (matter.live - at.segment.asleep) as u64;
    if group_of.iter().all(Option::is_some) {
        return moving;
    }
    let particles = &matter.particles;
    let left_out = particles
        .blocks
        .iter()
        .filter(|b| group_of[b.field as usize].is_none());
    let groups = left_out.flat_map(|block| block.groups.clone());
    let of_group = |g: usize| {
        let ids = particles.fixed[g].id.iter();
        ids.filter(|&&id| id != NO_PARTICLE).count() as u64
    };
    moving - groups.map(of_group).sum::<u64>()
}
