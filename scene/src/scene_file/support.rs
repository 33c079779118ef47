//! Objects that look as if they stood on something through which they fall: what is only seen holds nothing.

use cosplat_sim_core::{
    distance::SignedDistance,
    mat3::{cross, dot, length},
    scene::{DomainPolicy, Fidelity, Object, Scene},
};

/// Gaussians of something that is only seen that must be below an object before it counts as standing above that.
const FEWEST: usize = 10;
/// How far from where it is seen a collider may be that holds in its place, over the object's own height, and in cells.
const NEAR: [f64; 2] = [0.25, 2.0];
/// Steps along the way down to what is seen, at most.
const STEPS: usize = 64;

/// Warnings about objects that nothing keeps from falling through one that is only seen, with their numbers; `surfaces` are the colliders.
pub(super) fn unsupported(scene: &Scene, surfaces: &[SignedDistance]) -> Vec<(usize, String)> {
    let pull = length(scene.gravity);
    if pull == 0.0 {
        return Vec::new();
    }
    let down = scene.gravity.map(|g| g / pull);
    let axes = across(down);
    let objects = scene.objects.iter();
    let seen: Vec<Seen<'_>> = objects
        .clone()
        .filter_map(|o| Seen::of(scene, o, &axes))
        .collect();
    if seen.is_empty() {
        return Vec::new();
    }
    let columns: Vec<Option<Column>> = objects.map(|o| Column::of(scene, o, axes)).collect();
    let mut found = Vec::new();
    for (id, (object, column)) in scene.objects.iter().zip(&columns).enumerate() {
        let Some(column) = column else { continue };
        if !object.present || is_held(scene, object) {
            continue;
        }
        // What else moves may be what it stands on.
        let others = columns.iter().enumerate().filter(|(other, _)| *other != id);
        if others
            .flat_map(|(_, other)| other)
            .any(|other| other.is_below(column))
        {
            continue;
        }
        let under = seen
            .iter()
            .filter_map(|seen| Some((seen, column.first_below(seen)?)));
        let Some((seen, depth)) = under.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            continue;
        };
        if !column.is_stopped(scene, surfaces, depth) {
            found.push((
                id,
                format!(
                    "object `{}` is above `{}`, which is `static`, and will fall through it: what is only seen holds nothing; \
                     a collider in its place does",
                    object.name, seen.name
                ),
            ));
        }
    }
    found
}

/// What is only seen.
struct Seen<'a> {
    name: &'a str,
    /// Its centres along the axes [m], by the first of those across.
    places: Vec<[f64; 3]>,
}

impl<'a> Seen<'a> {
    fn of(scene: &Scene, object: &'a Object, axes: &[[f64; 3]; 3]) -> Option<Self> {
        if object.fidelity != Fidelity::Static || !object.present || object.gaussians.is_empty() {
            return None;
        }
        let centers = scene.gaussians.position[object.gaussians.clone()].iter();
        let place = |p: &[f32; 3]| axes.map(|axis| dot(axis, p.map(f64::from)));
        let mut places: Vec<[f64; 3]> = centers.map(place).collect();
        places.sort_unstable_by(|a, b| a[1].total_cmp(&b[1]));
        Some(Self {
            name: &object.name,
            places,
        })
    }
}

/// Whether something holds a part of an object, or says how it moves.
fn is_held(scene: &Scene, object: &Object) -> bool {
    let positions = &scene.particles.position[object.particles.clone()];
    let mut regions = scene.pinned_regions.iter();
    regions.any(|region| positions.iter().any(|p| region.bounds.contains(*p)))
        || !scene.conditions.prescribed.is_empty()
        || object.body_force.is_some()
}

/// The room that an object takes, seen along gravity.
struct Column {
    /// Unit vectors: down, and two across.
    axes: [[f64; 3]; 3],
    /// Smallest and largest places along these [m].
    min: [f64; 3],
    max: [f64; 3],
}

impl Column {
    /// Of an object that moves; none of one without particles.
    fn of(scene: &Scene, object: &Object, axes: [[f64; 3]; 3]) -> Option<Self> {
        if object.fidelity == Fidelity::Static || object.particles.is_empty() {
            return None;
        }
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for p in &scene.particles.position[object.particles.clone()] {
            for a in 0..3 {
                let x = dot(axes[a], *p);
                (min[a], max[a]) = (min[a].min(x), max[a].max(x));
            }
        }
        Some(Self { axes, min, max })
    }

    /// Whether some of it is under another, at any depth.
    fn is_below(&self, other: &Self) -> bool {
        self.max[0] > other.max[0]
            && (1..3).all(|a| self.min[a] < other.max[a] && other.min[a] < self.max[a])
    }

    /// How far its lower end is, along gravity, about which what it stands on may be seen [m].
    fn slack(&self) -> f64 {
        NEAR[0] * (self.max[0] - self.min[0])
    }

    /// How deep the highest part of what is seen is that is under this [m], along gravity; none where there is hardly any.
    fn first_below(&self, seen: &Seen<'_>) -> Option<f64> {
        let first = seen.places.partition_point(|x| x[1] < self.min[1]);
        let end = seen.places.partition_point(|x| x[1] <= self.max[1]);
        let is_under = |x: &&[f64; 3]| {
            x[0] > self.max[0] - self.slack() && (self.min[2]..=self.max[2]).contains(&x[2])
        };
        let under = seen.places[first..end].iter().filter(is_under);
        let mut depths: Vec<f64> = under.map(|x| x[0]).collect();
        if depths.len() < FEWEST {
            return None;
        }
        // A few may float.
        Some(*depths.select_nth_unstable_by(FEWEST / 2, f64::total_cmp).1)
    }

    /// Whether a collider is met on the way to a depth [m], or about there.
    fn is_stopped(&self, scene: &Scene, surfaces: &[SignedDistance], depth: f64) -> bool {
        let near = self.slack().max(NEAR[1] * scene.dx);
        let is_bounded = scene.conditions.domain_policy == DomainPolicy::Bounce;
        let middle = |a: usize| 0.5 * (self.min[a] + self.max[a]);
        let mut at = self.max[0];
        for _ in 0..STEPS {
            let place = [at, middle(1), middle(2)];
            let x: [f64; 3] =
                std::array::from_fn(|a| (0..3).map(|n| place[n] * self.axes[n][a]).sum());
            let heights = surfaces.iter().map(|surface| surface.at(x).0);
            let height = heights.fold(f64::INFINITY, f64::min);
            if height < near || is_bounded && !scene.domain.contains(x) {
                return true;
            }
            at += height.min(depth + 2.0 * near - at).max(near);
            if at > depth + near {
                return false;
            }
        }
        true
    }
}

/// A unit vector and two across it.
fn across(down: [f64; 3]) -> [[f64; 3]; 3] {
    let least = (0..3)
        .min_by(|&a, &b| down[a].abs().total_cmp(&down[b].abs()))
        .unwrap_or(0);
    let mut other = [0.0; 3];
    other[least] = 1.0;
    let share = dot(other, down);
    let first: [f64; 3] = std::array::from_fn(|a| other[a] - share * down[a]);
    let first = first.map(|x| x / (1.0 - share * share).sqrt());
    [down, first, cross(down, first)]
}
