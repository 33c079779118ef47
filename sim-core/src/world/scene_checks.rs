//! What makes a scene impossible to simulate, boundaries aside.

use super::{
    boundary_checks,
    error::{WorldError, within},
    solid_checks,
};
use crate::{
    model::MAX_CELLS,
    scene::{ContactMethod, Fidelity, Scene},
};

/// Checks every number that the solver computes with.
pub(super) fn validate(scene: &Scene) -> Result<(), WorldError> {
    const BIG: f64 = 1e9;
    let tiny = f64::MIN_POSITIVE;
    within(|| "dx".into(), scene.dx, 1e-6, 1e6)?;
    within(|| "cfl".into(), scene.cfl, tiny, 1.5)?;
    within(|| "frame_rate".into(), scene.frame_rate, tiny, 1e6)?;
    let reach = MAX_CELLS * scene.dx;
    for a in 0..3 {
        within(|| format!("gravity[{a}]"), scene.gravity[a], -BIG, BIG)?;
        within(
            || format!("domain.min[{a}]"),
            scene.domain.min[a],
            -reach,
            reach,
        )?;
        let min = scene.domain.min[a];
        within(
            || format!("domain.max[{a}]"),
            scene.domain.max[a],
            min,
            reach,
        )?;
    }
    boundary_checks::validate(scene)?;
    validate_particles(scene)?;
    validate_objects(scene)?;
    solid_checks::validate(scene)
}

fn validate_particles(scene: &Scene) -> Result<(), WorldError> {
    let particles = &scene.particles;
    let count = particles.position.len();
    if particles.volume.len() != count {
        return Err(WorldError::Counts {
            positions: count,
            volumes: particles.volume.len(),
        });
    }
    within(
        || "particle count".into(),
        count as f64,
        0.0,
        f64::from(u32::MAX / 64),
    )?;
    let reach = MAX_CELLS * scene.dx;
    for p in 0..count {
        let what = || format!("volume of particle {p}");
        within(what, particles.volume[p], f64::MIN_POSITIVE, 1e18)?;
        for a in 0..3 {
            let what = || format!("position[{a}] of particle {p}");
            within(what, particles.position[p][a], -reach, reach)?;
        }
    }
    Ok(())
}

fn validate_objects(scene: &Scene) -> Result<(), WorldError> {
    let count = scene.particles.position.len();
    let mut expected = 0;
    for (object, o) in scene.objects.iter().enumerate() {
        let range = &o.particles;
        let empty = range.is_empty();
        if !empty && (range.start < expected || range.end > count) {
            return Err(WorldError::ParticleRange {
                object,
                start: range.start,
                end: range.end,
                expected,
                count,
            });
        }
        if !empty {
            expected = range.end;
        }
        if o.fidelity == Fidelity::Static {
            continue;
        }
        if scene.contact.method == ContactMethod::ComSphere && o.has_rigid_matter() {
            return Err(WorldError::RigidSphere { object });
        }
        let mut end = o.regions.first().map_or(range.end, |r| r.particles.start);
        for (region, r) in o.regions.iter().enumerate() {
            let (first, last) = (r.particles.start, r.particles.end);
            if first != end || first < range.start || last < first || last > range.end {
                return Err(WorldError::RegionRange {
                    object,
                    region,
                    start: first,
                    end: last,
                    expected: end,
                });
            }
            end = last;
        }
        if end != range.end {
            return Err(WorldError::RegionRange {
                object,
                region: o.regions.len(),
                start: range.end,
                end: range.end,
                expected: end,
            });
        }
        let what = |name: &str| format!("{name} of object {object}");
        for part in o.parts(object) {
            part.material
                .check()
                .map_err(|found| WorldError::OutOfRange {
                    what: what(found.key),
                    value: found.value,
                    min: found.min,
                    max: found.max,
                })?;
        }
        for a in 0..3 {
            within(|| what("linear_velocity"), o.linear_velocity[a], -1e6, 1e6)?;
            for value in o.velocity_gradient[a] {
                within(|| what("velocity_gradient"), value, -1e6, 1e6)?;
            }
        }
    }
    Ok(())
}
