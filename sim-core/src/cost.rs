//! What a scene takes per simulated second while everything is as it begins: each kind of matter in the substeps of its own solver.

use crate::{
    materials::limits::{DeformationBounds, critical_dt},
    scene::{Aabb, Object, Part, Scene, Solver},
    solid::expected::expected,
};

/// The substeps of one object at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectCost {
    /// What each of its substeps works on: particles on the spatial grid, quadrature points of a grid of its own.
    pub points: usize,
    /// Largest substep that its own matter allows at rest [s], `cfl` included, > 0.
    pub dt: f64,
    /// Substeps per frame, by what it shares its substeps with.
    pub substeps: u64,
}

/// What a scene takes at rest. Nothing of it is known of contact, which makes substeps of solids shorter, and of sleep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneCost {
    /// Per object of the scene; none of what takes no substeps: rigid bodies, what is only seen, and what is not yet there.
    pub objects: Vec<Option<ObjectCost>>,
    /// The object that asks for the shortest substep, where that is shorter than a frame.
    pub limited_by: Option<usize>,
    /// Substeps per frame, the most of any object: 1 where nothing takes more.
    pub substeps: u64,
    /// Points of all objects times their substeps, per simulated second [1/s].
    pub updates_per_second: f64,
}

/// Objects that share their substeps.
struct Group {
    members: Vec<usize>,
    bounds: Aabb,
}

impl SceneCost {
    /// Of a scene at rest. Matter on the spatial grid has one substep. So have solids on grids of their own that begin within a cell of each
    /// other, and their substeps end where one of the spatial grid does.
    pub fn at_rest(scene: &Scene) -> Self {
        let objects = scene.objects.iter().enumerate();
        let mut own: Vec<Option<ObjectCost>> = objects
            .map(|(id, object)| of_object(scene, id, object))
            .collect();
        let frame = scene.frame_rate.recip();
        let shares = |span: f64, dt: f64| (span / dt - 1e-6).ceil().max(1.0);
        let shortest = |members: &[usize]| {
            let dts = members.iter().filter_map(|&id| Some(own[id]?.dt));
            dts.fold(f64::INFINITY, f64::min)
        };
        let is_own = |id: &usize| scene.objects[*id].solver == Solver::Lagrangian;
        let stepped = (0..own.len()).filter(|&id| own[id].is_some());
        let (solids, spatial): (Vec<usize>, Vec<usize>) = stepped.partition(is_own);
        let on_grid = shares(frame, shortest(&spatial));
        let mut substeps = vec![on_grid; own.len()];
        for group in groups(scene, &solids) {
            let each = shares(frame / on_grid, shortest(&group.members));
            for id in group.members {
                substeps[id] = on_grid * each;
            }
        }
        let mut cost = Self {
            substeps: 1,
            ..Self::default()
        };
        let mut least = frame;
        for (id, (object, substeps)) in own.iter_mut().zip(substeps).enumerate() {
            let Some(object) = object else { continue };
            object.substeps = substeps as u64;
            cost.substeps = cost.substeps.max(object.substeps);
            cost.updates_per_second += object.points as f64 * substeps * scene.frame_rate;
            if object.dt < least {
                (least, cost.limited_by) = (object.dt, Some(id));
            }
        }
        cost.objects = own;
        cost
    }
}

fn of_object(scene: &Scene, id: usize, object: &Object) -> Option<ObjectCost> {
    if !object.is_matter() || !object.present {
        return None;
    }
    if let Some(solid) = expected(scene, id) {
        return Some(ObjectCost {
            points: solid.points,
            dt: solid.dt,
            substeps: 1,
        });
    }
    let moves = |part: &Part| !part.material.law.is_rigid() && !part.particles.is_empty();
    let limit = |part: &Part| {
        let kept = scene
            .conditions
            .time_step_kept(part.material.law.is_fluid());
        let density = part.material.density;
        let rest = &DeformationBounds::REST;
        scene.cfl * kept * critical_dt(&part.material, density, scene.dx, rest)
    };
    let parts: Vec<Part> = object.parts(id).filter(moves).collect();
    Some(ObjectCost {
        points: parts.iter().map(|part| part.particles.len()).sum(),
        dt: parts.iter().map(limit).fold(f64::INFINITY, f64::min),
        substeps: 1,
    })
}

/// Solids by which of them begin within a cell of each other.
fn groups(scene: &Scene, solids: &[usize]) -> Vec<Group> {
    let mut groups: Vec<Group> = vec![];
    for &id in solids {
        let mut joined = Group {
            members: vec![id],
            bounds: around(scene, id),
        };
        // What it joins may reach others.
        while let Some(near) = groups
            .iter()
            .position(|other| meet(&joined.bounds, &other.bounds))
        {
            let other = groups.swap_remove(near);
            joined.members.extend(other.members);
            joined.bounds = Aabb {
                min: std::array::from_fn(|a| joined.bounds.min[a].min(other.bounds.min[a])),
                max: std::array::from_fn(|a| joined.bounds.max[a].max(other.bounds.max[a])),
            };
        }
        groups.push(joined);
    }
    groups
}

fn meet(one: &Aabb, other: &Aabb) -> bool {
    (0..3).all(|a| one.min[a] <= other.max[a] && other.min[a] <= one.max[a])
}

/// Box of an object's particles, larger by half a cell on every side.
fn around(scene: &Scene, id: usize) -> Aabb {
    let positions = &scene.particles.position[scene.objects[id].particles.clone()];
    let far = |a: usize, pick: fn(f64, f64) -> f64, none: f64| {
        positions.iter().map(|x| x[a]).fold(none, pick)
    };
    let half = 0.5 * scene.dx;
    Aabb {
        min: std::array::from_fn(|a| far(a, f64::min, f64::INFINITY) - half),
        max: std::array::from_fn(|a| far(a, f64::max, f64::NEG_INFINITY) + half),
    }
}
