//! Looks at a finished scene for what is impossible or merely suspicious.

use std::collections::HashSet;

use cosplat_sim_core::{
    cost::SceneCost,
    distance::SignedDistance,
    materials::Material,
    scene::{Aabb, Collider, ContactMethod, Fidelity, Object, Scene, Selection, Solver},
};

use super::{
    error::{At, Finding, SceneErrors},
    report::BuildReport,
    restitution::{Places, without_effect},
    spec::{Resolution, SceneFile},
    support::unsupported,
};
use crate::{bounds::bounds_of, fill::FillReport};

/// Part of an object's particles that may lie inside another object before it is called overlap.
const TOUCHING: f64 = 0.03;
/// Cells across the thinnest side of what bends. A bar 2 cells thick swings 5 % too slowly and loses 3.9 % of its way each
/// period, one of 4 cells 2 % and 1.6 %.
const FEW_CELLS: f64 = 4.0;
/// Particle-substeps per simulated second from which on it is said that they are many.
const DEAR: f64 = 1e9;
/// Particle-substeps per second of one core, about.
const SPEED: f64 = 2e7;
/// Largest component of an initial velocity [m/s].
const MAX_SPEED: f64 = 1e4;
/// Largest component of a body force per mass at time 0 [m/s^2].
const MAX_ACCELERATION: f64 = 1e9;

/// Adds warnings to the report; `at` is the place of each object in the file.
pub(super) fn check(
    scene: &Scene,
    file: &SceneFile,
    at: &[&At],
    report: &mut BuildReport,
) -> Result<(), SceneErrors> {
    let mut errors = Vec::new();
    let surfaces: Vec<SignedDistance> = scene
        .colliders
        .iter()
        .map(SignedDistance::at_start)
        .collect();
    let hollow: Vec<Finding> = scene
        .objects
        .iter()
        .zip(at)
        .zip(&report.fills)
        .filter_map(|((object, at), fill)| {
            Some(Finding::new(at, thin_walled(object, fill.as_ref()?)?))
        })
        .collect();
    report.warnings.extend(hollow);
    let mut warn = |at: &At, message: String| report.warnings.push(Finding::new(at, message));
    for (object, at) in scene.objects.iter().zip(at) {
        let found = impossible(scene, object).into_iter();
        errors.extend(found.map(|message| Finding::new(at, message)));
        let thin = thin(scene, object, file).into_iter();
        let restless = restless(object).into_iter();
        for message in thin.chain(buried(scene, object, &surfaces)).chain(restless) {
            warn(at, message);
        }
    }
    for (i, shared) in overlaps(scene) {
        warn(at[i], shared);
    }
    for (i, falls) in unsupported(scene, &surfaces) {
        warn(at[i], falls);
    }
    for (at, message) in idle(scene, file) {
        warn(&at, message);
    }
    if let Some(message) = dear(scene) {
        warn(&file.resolution_at, message);
    }
    let places = Places {
        objects: at,
        pairs: file.contact.pairs.iter().map(|(at, ..)| at).collect(),
        colliders: file.colliders.iter().map(|spec| &spec.at).collect(),
    };
    report.warnings.extend(without_effect(scene, &places));
    SceneErrors::check(errors)
}

/// What the solver cannot begin with.
fn impossible(scene: &Scene, object: &Object) -> Vec<String> {
    let mut found = Vec::new();
    let name = &object.name;
    let positions = &scene.particles.position[object.particles.clone()];
    let outside = positions
        .iter()
        .filter(|p| !scene.domain.contains(**p))
        .count();
    if outside > 0 {
        found.push(format!(
            "object `{name}`: {outside} of {} particles lie outside the domain {:.4?} to {:.4?}",
            positions.len(),
            scene.domain.min,
            scene.domain.max
        ));
    }
    for (key, field, largest) in [
        ("velocity", &object.velocity, MAX_SPEED),
        ("body_force", &object.body_force, MAX_ACCELERATION),
    ] {
        let Some(field) = field else { continue };
        let allowed = |v: &f64| v.abs() <= largest;
        let bad = |x: &&[f64; 3]| !field.at(**x, 0.0).iter().all(allowed);
        if let Some(x) = positions.iter().find(bad) {
            let value = field.at(*x, 0.0);
            found.push(format!(
                "object `{name}`: {key} is {value:?} at {x:.4?} and time 0, expected at most {largest:?} along each axis"
            ));
        }
    }
    let spheres = scene.contact.method == ContactMethod::ComSphere;
    if spheres && object.fidelity != Fidelity::Static && object.has_rigid_matter() {
        found.push(format!(
            "object `{name}` is rigid, and contact = \"com_sphere\" is for objects that deform; \
             expected \"two_scale\", \"multi_field\" or \"single_field\""
        ));
    }
    found
}

/// Warnings about particles that start inside colliders, whose `surfaces` these are.
fn buried(scene: &Scene, object: &Object, surfaces: &[SignedDistance]) -> Vec<String> {
    let positions = &scene.particles.position[object.particles.clone()];
    let within = |(collider, surface): (&Collider, &SignedDistance)| {
        let height = |p: &[f64; 3]| surface.at(*p).0;
        let depths = positions.iter().map(height).filter(|h| *h < 0.0);
        let (count, deepest) = depths.fold((0, 0.0f64), |(n, d), h| (n + 1, d.min(h)));
        (count > 0).then(|| {
            format!(
                "object `{}`: {count} of {} particles start inside collider `{}`, up to {:.4} m deep",
                object.name,
                positions.len(),
                collider.name,
                -deepest
            )
        })
    };
    let colliders = scene.colliders.iter().zip(surfaces);
    colliders.filter_map(within).collect()
}

/// Warnings about regions and selections that no particle is in, with their places in the file.
fn idle(scene: &Scene, file: &SceneFile) -> Vec<(At, String)> {
    let mut found = Vec::new();
    for (n, region) in scene.pinned_regions.iter().enumerate() {
        let mut positions = scene.particles.position.iter();
        if !positions.any(|p| region.bounds.contains(*p)) {
            let at = At {
                field: format!("pinned_regions[{n}]"),
                ..At::default()
            };
            found.push((at, "holds no particle of any object".into()));
        }
    }
    let empty = |selection: &Selection| selection.particles(scene).is_empty();
    let (specs, conditions) = (&file.conditions, &scene.conditions);
    let prescribed = specs.prescribed.iter().zip(&conditions.prescribed);
    let impulses = specs.impulses.iter().zip(&conditions.impulses);
    let releases = specs.releases.iter().zip(&conditions.releases);
    let selections = prescribed
        .map(|(spec, motion)| (&spec.0, &motion.selection))
        .chain(impulses.map(|(spec, impulse)| (&spec.0, &impulse.selection)))
        .chain(releases.map(|(spec, release)| (&spec.0, &release.selection)));
    for (spec, _) in selections.filter(|(_, selection)| empty(selection)) {
        found.push((spec.at.clone(), "selects no particle of any object".into()));
    }
    found
}

/// The warning about a splat object in which filling found little inside.
fn thin_walled(object: &Object, fill: &FillReport) -> Option<String> {
    let FillReport {
        solid_volume,
        thin_volume,
        ..
    } = *fill;
    let thin = thin_volume / (solid_volume + thin_volume);
    (thin > 0.5).then(|| {
        format!(
            "object `{}`: {:.0} % of its volume is in parts thinner than the grid resolves: \
             they move as a shell of about one particle",
            object.name,
            100.0 * thin
        )
    })
}

/// The warning about an object that is to sleep where it lies still, and whose matter never does.
fn restless(object: &Object) -> Option<String> {
    let is_automatic = object.fidelity == Fidelity::Auto && object.solver == Solver::Lagrangian;
    let loses = |material: &Material| material.loss > 0.0 || material.law.is_plastic();
    (is_automatic && !object.materials().any(loses)).then(|| {
        format!(
            "object `{}` has fidelity = \"auto\" and a material without `loss`: it vibrates for ever and does not sleep; rubber has \
             loss = 0.1, wood 0.01",
            object.name
        )
    })
}

/// The warning about an object that the grid cannot resolve, or only just.
fn thin(scene: &Scene, object: &Object, file: &SceneFile) -> Option<String> {
    let b = bounds_of(
        scene.particles.position[object.particles.clone()]
            .iter()
            .copied(),
    )?;
    let sides: [f64; 3] = std::array::from_fn(|a| b.max[a] - b.min[a]);
    // The particles end half a spacing inside the surface on both sides.
    let volume: f64 = scene.particles.volume[object.particles.clone()]
        .iter()
        .sum();
    let spacing = (volume / object.particles.len() as f64).cbrt();
    let side = sides.into_iter().fold(f64::INFINITY, f64::min) + spacing;
    let name = &object.name;
    // Jitter takes up to 4 % off a side of just 2 dx, which is meant to pass.
    if side < 2.0 * scene.dx * 0.95 {
        return Some(format!(
            "object `{name}` is {side:.4} m thin, less than 2 dx = {:.4} m: the grid cannot resolve it",
            2.0 * scene.dx
        ));
    }
    let bends = !object.has_rigid_matter()
        && object.material.law.is_solid()
        && object.solver == Solver::Spatial;
    // Of many particles some are as far out as jitter brings them. A tenth is for surfaces that are curved.
    let cells = (side - 2.0 * file.jitter * spacing) / scene.dx;
    if !bends || cells >= FEW_CELLS * 0.9 {
        return None;
    }
    let finer = FEW_CELLS / cells;
    let remedy = match file.resolution {
        Resolution::Dx(dx) => format!("dx = {:.2e}", dx / finer),
        Resolution::CellsPerObject(n) => format!("cells_per_object = {}", (n * finer).ceil()),
    };
    let count = scene.particles.position.len() as f64;
    Some(format!(
        "object `{name}` is {cells:.1} cells thick where it is thinnest: it bends too softly and loses what swings; \
         `{remedy}` makes that {FEW_CELLS} cells, with about {:.0} particles in the scene in place of {count}, and {:.0} times \
         the work",
        count * finer.powi(3),
        finer.powi(4)
    ))
}

/// The warning about a scene whose substeps are so many that somebody waits for them.
fn dear(scene: &Scene) -> Option<String> {
    let cost = SceneCost::at_rest(scene);
    let limiting = &scene.objects[cost.limited_by?];
    (cost.updates_per_second >= DEAR).then(|| {
        format!(
            "takes {:.0} million particle-substeps per simulated second at rest, about {:.1e} s of one core: dx = {:.2e} m, and `{}` has \
             {} of them per frame; with cells twice as large it takes a sixteenth, with a tenth of its stiffness a third",
            cost.updates_per_second / 1e6,
            cost.updates_per_second / SPEED,
            scene.dx,
            limiting.name,
            cost.substeps
        )
    })
}

/// Pairs of objects that share space, as the later object's index and the warning.
fn overlaps(scene: &Scene) -> Vec<(usize, String)> {
    let simulated: Vec<usize> = (0..scene.objects.len())
        .filter(|&i| {
            let object = &scene.objects[i];
            object.present && object.fidelity != Fidelity::Static
        })
        .collect();
    let boxes: Vec<Option<Aabb>> = scene
        .objects
        .iter()
        .map(|o| {
            bounds_of(
                scene.particles.position[o.particles.clone()]
                    .iter()
                    .copied(),
            )
        })
        .collect();
    let boxes: Vec<(usize, Aabb)> = simulated
        .into_iter()
        .filter_map(|o| Some((o, boxes[o]?)))
        .collect();
    let mut found = Vec::new();
    for [i, j] in meeting(&boxes) {
        let shared = shared_particles(scene, i, j);
        let count = scene.objects[j].particles.len();
        if shared as f64 > TOUCHING * count as f64 {
            let (a, b) = (&scene.objects[i].name, &scene.objects[j].name);
            found.push((
                j,
                format!("objects `{a}` and `{b}` overlap: {shared} of {count} particles of `{b}` lie among those of `{a}`"),
            ));
        }
    }
    found
}

/// Pairs of boxes that meet, the lower number first, in the order of the higher: sort and sweep along the axis on which
/// they are spread widest.
fn meeting(boxes: &[(usize, Aabb)]) -> Vec<[usize; 2]> {
    let all = bounds_of(boxes.iter().flat_map(|(_, b)| [b.min, b.max]));
    let width = |a: usize| all.map_or(0.0, |all| all.max[a] - all.min[a]);
    let axis = (0..3).fold(0, |best, a| if width(a) > width(best) { a } else { best });
    let mut order: Vec<&(usize, Aabb)> = boxes.iter().collect();
    order.sort_by(|a, b| a.1.min[axis].total_cmp(&b.1.min[axis]));
    let mut pairs = Vec::new();
    let mut open: Vec<&(usize, Aabb)> = Vec::new();
    for next in order {
        open.retain(|(_, b)| b.max[axis] >= next.1.min[axis]);
        for (i, b) in &open {
            let apart = (0..3).any(|a| b.max[a] < next.1.min[a] || next.1.max[a] < b.min[a]);
            if !apart {
                pairs.push([*i.min(&next.0), *i.max(&next.0)]);
            }
        }
        open.push(next);
    }
    pairs.sort_by_key(|&[i, j]| [j, i]);
    pairs
}

/// Particles of `j` that lie inside `i`: their cell and its six neighbours hold particles of `i`. Objects that
/// only touch, as the parts of one asset do, share no more than a layer of cells.
fn shared_particles(scene: &Scene, i: usize, j: usize) -> usize {
    let spacing = |o: usize| {
        let range = scene.objects[o].particles.clone();
        let volume: f64 = scene.particles.volume[range.clone()].iter().sum();
        (volume / range.len() as f64).cbrt()
    };
    // Wide enough that no cell inside an object is empty, however its lattice is turned.
    let size = 1.5 * spacing(i).max(spacing(j));
    let cell = |p: &[f64; 3]| p.map(|x| (x / size).floor() as i64);
    let range = |o: usize| &scene.particles.position[scene.objects[o].particles.clone()];
    let mut cells: HashSet<[i64; 3]> = HashSet::new();
    for p in range(i) {
        cells.insert(cell(p));
    }
    let inside = |p: &&[f64; 3]| {
        let here = cell(p);
        let near = |axis: usize, step: i64| {
            let mut near = here;
            near[axis] += step;
            cells.contains(&near)
        };
        cells.contains(&here) && (0..3).all(|a| near(a, -1) && near(a, 1))
    };
    range(j).iter().filter(inside).count()
}
