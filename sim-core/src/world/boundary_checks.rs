//! What makes a scene's boundaries impossible to simulate.

use super::error::{WorldError, within};
use crate::scene::{
    Collider, ColliderMotion, ColliderShape, Conditions, ImpulseAmount, Pose, Region, Scene,
    Selection, TimeSpan, TurnedBox,
};

/// Largest magnitude of a number that is not a length.
const BIG: f64 = 1e9;
/// Smallest length of a shape [m].
const SMALL: f64 = 1e-9;

fn all(what: &str, values: &[f64]) -> Result<(), WorldError> {
    for &value in values {
        within(|| what.into(), value, -BIG, BIG)?;
    }
    Ok(())
}

fn unit(what: &str, v: &[f64]) -> Result<(), WorldError> {
    let length = v.iter().map(|n| n * n).sum::<f64>().sqrt();
    within(|| format!("length of {what}"), length, 0.999, 1.001)
}

fn length(what: &str, value: f64) -> Result<(), WorldError> {
    within(|| what.into(), value, SMALL, BIG)
}

fn span(what: &str, span: &TimeSpan) -> Result<(), WorldError> {
    within(|| format!("start of {what}"), span.start, -BIG, BIG)?;
    let end = span.end;
    within(|| format!("end of {what}"), end, span.start, f64::INFINITY)
}

fn turned_box(what: &str, turned: &TurnedBox) -> Result<(), WorldError> {
    all(&format!("corner of {what}"), &turned.bounds.min)?;
    all(&format!("corner of {what}"), &turned.bounds.max)?;
    unit(&format!("the rotation of {what}"), &turned.rotation)
}

fn pose(what: &str, pose: &Pose) -> Result<(), WorldError> {
    all(&format!("position of {what}"), &pose.translation)?;
    unit(&format!("the rotation of {what}"), &pose.rotation)
}

/// Checks every number of colliders, held regions and conditions.
pub(super) fn validate(scene: &Scene) -> Result<(), WorldError> {
    for (id, one) in scene.colliders.iter().enumerate() {
        collider(&format!("collider {id}"), one)?;
    }
    for (id, region) in scene.pinned_regions.iter().enumerate() {
        let what = format!("pinned region {id}");
        turned_box(&what, &region.bounds)?;
        all(&format!("velocity of {what}"), &region.velocity)?;
        span(&what, &region.span)?;
    }
    if scene.conditions.settle > 0.0 && moves(scene) {
        return Err(WorldError::Unsettled);
    }
    conditions(&scene.conditions)
}

/// Whether something moves by itself, or acts on particles.
fn moves(scene: &Scene) -> bool {
    let conditions = &scene.conditions;
    let colliders = scene.colliders.iter();
    let regions = scene.pinned_regions.iter();
    colliders
        .map(|c| &c.motion)
        .any(|m| *m != ColliderMotion::Static)
        || regions.map(|r| r.velocity).any(|v| v != [0.0; 3])
        || scene.objects.iter().any(|o| o.body_force.is_some())
        || !conditions.prescribed.is_empty()
        || !conditions.impulses.is_empty()
        || !conditions.releases.is_empty()
}

fn collider(what: &str, collider: &Collider) -> Result<(), WorldError> {
    within(
        || format!("friction of {what}"),
        collider.friction.unwrap_or(0.0),
        0.0,
        BIG,
    )?;
    let restitution = collider.restitution;
    within(|| format!("restitution of {what}"), restitution, 0.0, 1.0)?;
    pose(what, &collider.pose)?;
    span(what, &collider.span)?;
    match &collider.shape {
        ColliderShape::HalfSpace { normal } => unit(&format!("the normal of {what}"), normal)?,
        ColliderShape::Box { half_extents } => {
            for &half in half_extents {
                length(&format!("half extent of {what}"), half)?;
            }
        }
        ColliderShape::Sphere { radius } => length(&format!("radius of {what}"), *radius)?,
        ColliderShape::Cylinder {
            radius,
            half_height,
        } => {
            length(&format!("radius of {what}"), *radius)?;
            length(&format!("half height of {what}"), *half_height)?;
        }
        ColliderShape::Capsule {
            radius,
            half_height,
        } => {
            length(&format!("radius of {what}"), *radius)?;
            within(|| format!("half height of {what}"), *half_height, 0.0, BIG)?;
        }
        ColliderShape::Mesh(mesh) => {
            let count = mesh.points.len();
            for point in &mesh.points {
                all(&format!("vertex of {what}"), point)?;
            }
            let largest = mesh.triangles.iter().flatten().max().copied();
            let last = (count as f64 - 1.0).max(0.0);
            let index = f64::from(largest.unwrap_or(0));
            within(|| format!("vertex index of {what}"), index, 0.0, last)?;
        }
    }
    match &collider.motion {
        ColliderMotion::Static => Ok(()),
        ColliderMotion::Velocity {
            linear,
            angular,
            span: when,
        } => {
            all(&format!("velocity of {what}"), linear)?;
            all(&format!("angular velocity of {what}"), angular)?;
            span(&format!("the motion of {what}"), when)
        }
        ColliderMotion::Keyframes(frames) => {
            let mut earliest = -BIG;
            for frame in frames {
                let time = frame.time;
                within(|| format!("keyframe time of {what}"), time, earliest, BIG)?;
                earliest = time.next_up();
                pose(what, &frame.pose)?;
            }
            Ok(())
        }
    }
}

fn conditions(conditions: &Conditions) -> Result<(), WorldError> {
    within(|| "settle".into(), conditions.settle, 0.0, 1e4)?;
    for (id, rule) in conditions.prescribed.iter().enumerate() {
        let what = format!("prescribed motion {id}");
        selection(&what, &rule.selection)?;
        all(&what, &rule.linear)?;
        all(&what, &rule.angular)?;
        all(&what, &rule.center)?;
        span(&what, &rule.span)?;
    }
    for (id, rule) in conditions.impulses.iter().enumerate() {
        let what = format!("impulse {id}");
        selection(&what, &rule.selection)?;
        let (ImpulseAmount::Total(impulse) | ImpulseAmount::PerParticle(impulse)) = rule.amount;
        all(&what, &impulse)?;
        within(|| format!("start of {what}"), rule.start, -BIG, BIG)?;
        within(|| format!("duration of {what}"), rule.duration, 0.0, BIG)?;
    }
    for (id, rule) in conditions.releases.iter().enumerate() {
        let what = format!("release {id}");
        selection(&what, &rule.selection)?;
        unit(&format!("the axis of {what}"), &rule.axis)?;
        all(&what, &[rule.start_position, rule.end_position])?;
        let depth = (rule.end_position - rule.start_position).abs();
        length(&format!("depth of {what}"), depth)?;
        within(
            || format!("layers of {what}"),
            f64::from(rule.layers),
            1.0,
            BIG,
        )?;
        span(&what, &rule.span)?;
        within(|| format!("end of {what}"), rule.span.end, -BIG, BIG)?;
    }
    Ok(())
}

fn selection(what: &str, selection: &Selection) -> Result<(), WorldError> {
    match selection.region {
        None => Ok(()),
        Some(Region::Box(b)) => turned_box(what, &b),
        Some(Region::Sphere { center, radius }) => {
            all(what, &center)?;
            length(&format!("radius of {what}"), radius)
        }
        Some(Region::Cylinder {
            center,
            axis,
            radius,
            half_height,
        }) => {
            all(what, &center)?;
            unit(&format!("the axis of {what}"), &axis)?;
            length(&format!("radius of {what}"), radius)?;
            length(&format!("half height of {what}"), half_height)
        }
    }
}
