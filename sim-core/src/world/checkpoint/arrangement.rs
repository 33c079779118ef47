//! Particles of a checkpoint must be arranged as a sort leaves them: kernels rely on it without looking.

use std::array::from_fn;

use super::{CheckpointError, count, inconsistent};
use crate::{
    mat3::Mat3,
    model::{MAX_CELLS, Model},
    particles::{BLOCK, NO_PARTICLE, Particles, Run},
    simd::LANES,
};

/// Largest distance of a lane from its block's centre along one axis [cells]: its stencil stays within one block around.
const MAX_DISTANCE: f32 = 4.0;
/// Least volume of a particle over its volume at rest: laws divide by it in single precision. Nothing that ran comes near it.
const LEAST_DETERMINANT: f64 = 1e-12;
/// What particles may be beyond the drift that the state says, by rounding [cells].
const ROUNDING: f32 = 1e-3;

/// Refuses particles that are not arranged so, or farther out of their blocks than `drift` [cells].
pub(super) fn check_arrangement(
    particles: &Particles,
    drift: f64,
    model: &Model,
) -> Result<(), CheckpointError> {
    check_order(particles, &model.fields())?;
    let drift = 0.5 * BLOCK as f32 + drift as f32 + ROUNDING;
    for block in &particles.blocks {
        let far = |index: &i32| f64::from(index.unsigned_abs()) > MAX_CELLS / f64::from(BLOCK);
        if block.index.iter().any(far) {
            let reason = format!("block {:?} is beyond all grids", block.index);
            return Err(inconsistent(reason));
        }
        for run in &particles.runs[block.runs.clone()] {
            check_lanes(particles, run, model, drift)?;
        }
    }
    Ok(())
}

/// Lanes hold particles of their part near their block, or nothing.
fn check_lanes(
    particles: &Particles,
    run: &Run,
    model: &Model,
    drift: f32,
) -> Result<(), CheckpointError> {
    let part = &model.parts[run.part];
    let mut shapes = run.shapes.clone();
    for group in run.groups.clone() {
        let (places, fixed) = (&particles.groups[group].x, &particles.fixed[group]);
        let shape = shapes.next().map(|shape| &particles.shapes[shape].0);
        for lane in 0..LANES {
            let (id, mass) = (fixed.id[lane], fixed.mass.0[lane]);
            let near = |x: f32| x.abs() <= MAX_DISTANCE && (x.abs() <= drift || id == NO_PARTICLE);
            if !places.iter().all(|x| near(x.0[lane])) {
                return Err(inconsistent("a particle is not near its block".into()));
            }
            let expected = match id {
                NO_PARTICLE => 0.0,
                id if part.particles.contains(&(id as usize))
                    && model.part_of(id as usize) == run.part =>
                {
                    let volume = model.scene.particles.volume[id as usize];
                    (volume * part.material.density / model.mass_unit) as f32
                }
                id => {
                    let reason = format!("particle {id} is not one of part {}", run.part);
                    return Err(inconsistent(reason));
                }
            };
            if mass != expected {
                let reason = format!("a lane has the mass {mass}, expected {expected}");
                return Err(inconsistent(reason));
            }
            let f = &particles.groups[group].f;
            let det = Mat3(from_fn(|i| from_fn(|j| f64::from(f[3 * i + j].0[lane])))).det();
            if id != NO_PARTICLE && det.abs() < LEAST_DETERMINANT {
                return Err(inconsistent(format!(
                    "det F of particle {id} is {det:e}, expected at least {LEAST_DETERMINANT:e} in magnitude"
                )));
            }
            let visible = shape.filter(|_| id != NO_PARTICLE);
            if visible.is_some_and(|f| !f.iter().all(|f| f.0[lane].abs() <= 1e12)) {
                return Err(inconsistent(format!("the shape of particle {id} is none")));
            }
        }
    }
    Ok(())
}

/// Blocks, runs, groups and shapes follow each other without a gap.
fn check_order(particles: &Particles, fields: &[u32]) -> Result<(), CheckpointError> {
    let groups = particles.groups.len();
    count("velocity groups", particles.motion.len(), groups)?;
    count("mass groups", particles.fixed.len(), groups)?;
    count("memory groups", particles.memory.len(), groups)?;
    count("flag groups", particles.flags.len(), groups)?;
    let (mut run_end, mut group_end, mut shape_end) = (0, 0, 0);
    let mut last = None;
    for block in &particles.blocks {
        let follows = block.runs.start == run_end
            && block.groups.start == group_end
            && block.shapes.start == shape_end
            && block.runs.end <= particles.runs.len()
            && last.is_none_or(|last| last < (block.field, block.index));
        if !follows {
            return Err(inconsistent(format!(
                "block {:?} is out of order",
                block.index
            )));
        }
        for run in particles.runs.get(block.runs.clone()).unwrap_or_default() {
            let shapes = run.shapes.len();
            let fits = run.groups.start == group_end
                && run.groups.end > run.groups.start
                && run.shapes.start == shape_end
                && (shapes == 0 || shapes == run.groups.len())
                && run.part < fields.len()
                && fields[run.part] == block.field;
            if !fits {
                return Err(inconsistent(format!(
                    "a run of part {} is out of order",
                    run.part
                )));
            }
            (group_end, shape_end) = (run.groups.end, run.shapes.end.max(shape_end));
        }
        run_end = block.runs.end;
        if block.groups.end != group_end || block.shapes.end != shape_end {
            return Err(inconsistent(format!("block {:?} has a gap", block.index)));
        }
        last = Some((block.field, block.index));
    }
    count("runs in blocks", run_end, particles.runs.len())?;
    count("groups in blocks", group_end, groups)?;
    count("shapes in blocks", shape_end, particles.shapes.len())?;
    Ok(())
}
