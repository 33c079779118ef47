//! Regions of an object with a material of their own: reads `[[objects.regions]]` and puts their particles last.

use std::ops::Range;

use cosplat_sim_core::{
    materials::Material,
    scene::{MaterialRegion, Object, Scene, TurnedBox},
};

use super::{
    boundaries::turned_box,
    error::{At, Finding},
    materials::{self, Known},
    objects::{names, ranges},
    reader::Table,
};
use crate::binding;

/// One `[[objects.regions]]` entry.
#[derive(Clone, Debug)]
pub struct RegionSpec {
    /// Where it stands.
    pub at: At,
    /// Which particles.
    pub which: RegionSelect,
    /// What they are made of.
    pub material: Material,
}

/// Which particles of an object belong to a region.
#[derive(Clone, Debug, PartialEq)]
pub enum RegionSelect {
    /// Those inside a box in the world frame, with the object at its place [m].
    Box(TurnedBox),
    /// Those whose nearest Gaussian of the object has an index in one of these ranges `first..end`, from 0.
    Gaussians(Vec<[u64; 2]>),
    /// Those whose nearest Gaussian of the object belongs to one of these objects of the asset's file, or to a part of one.
    Names(Vec<String>),
}

impl RegionSpec {
    /// The same with names replaced by the Gaussians that have them; `is_named` says which of an object's Gaussians do.
    ///
    /// # Errors
    /// That of `is_named`, at the region's place.
    pub(super) fn resolved(
        &self,
        is_named: impl FnOnce(&[String]) -> Result<Vec<bool>, String>,
    ) -> Result<RegionSpec, Finding> {
        let RegionSelect::Names(names) = &self.which else {
            return Ok(self.clone());
        };
        let is_named = is_named(names).map_err(|why| Finding::new(&self.at, why))?;
        let mut first = 0;
        let ranges = is_named.chunk_by(|a, b| a == b).filter_map(|run| {
            let range = [first, first + run.len() as u64];
            first = range[1];
            run[0].then_some(range)
        });
        Ok(RegionSpec {
            which: RegionSelect::Gaussians(ranges.collect()),
            ..self.clone()
        })
    }
}

/// Reads the regions of an object.
pub(super) fn read(table: &Table, known: &Known, warnings: &mut Vec<Finding>) -> Vec<RegionSpec> {
    let mut regions = Vec::new();
    for entry in table.tables("regions") {
        let Some(table) = entry.table() else { continue };
        let at = table.at.clone();
        let material = table
            .required("material")
            .and_then(|e| materials::from_entry(&e, known, warnings));
        let which = match table.one_of(&["box", "gaussians", "names"]) {
            Some(("box", entry)) => entry.table().and_then(turned_box).map(RegionSelect::Box),
            Some(("gaussians", entry)) => ranges(&entry).map(RegionSelect::Gaussians),
            Some((_, entry)) => names(&entry).map(RegionSelect::Names),
            None => {
                table.error("selects nothing: give `box`, `gaussians` or `names`");
                None
            }
        };
        table.finish();
        if let (Some(material), Some(which)) = (material, which) {
            regions.push(RegionSpec {
                at,
                which,
                material,
            });
        }
    }
    regions
}

/// Moves the particles of the scene's last object so that those of its regions come last, in the order of the
/// regions; where regions overlap, the later one has the particle. `spacing` is the mean distance of Gaussians [m].
///
/// # Errors
/// Places and messages of regions without particles.
pub(super) fn arrange(scene: &mut Scene, specs: &[RegionSpec], spacing: f64) -> Vec<Finding> {
    let mut errors = Vec::new();
    let Some(object) = scene.objects.last_mut() else {
        return errors;
    };
    if specs.is_empty() || object.particles.is_empty() {
        return errors;
    }
    let range = object.particles.clone();
    let positions = &scene.particles.position[range.clone()];
    let centres = &scene.gaussians.position[object.gaussians.clone()];
    let nearest = match specs
        .iter()
        .any(|s| matches!(s.which, RegionSelect::Gaussians(_)))
    {
        true => nearest_gaussians(positions, centres, spacing),
        false => vec![],
    };
    // 0: outside all regions.
    let mut region_of = vec![0; range.len()];
    for (n, spec) in specs.iter().enumerate() {
        for (p, x) in positions.iter().enumerate() {
            let inside = match &spec.which {
                RegionSelect::Box(b) => b.contains(*x),
                RegionSelect::Gaussians(ranges) => ranges
                    .iter()
                    .any(|[first, end]| (*first..*end).contains(&nearest[p])),
                // Names are resolved before this.
                RegionSelect::Names(_) => false,
            };
            if inside {
                region_of[p] = n + 1;
            }
        }
    }
    let mut order: Vec<usize> = (0..range.len()).collect();
    order.sort_by_key(|&p| region_of[p]);
    let gaussians = object.gaussians.clone();
    permute(scene, range.start, gaussians, &order);
    let Some(object) = scene.objects.last_mut() else {
        return errors;
    };
    let mut start = range.start + region_of.iter().filter(|&&r| r == 0).count();
    for (n, spec) in specs.iter().enumerate() {
        let count = region_of.iter().filter(|&&r| r == n + 1).count();
        if count == 0 {
            let message = format!(
                "region {n} holds none of the {} particles of object `{}`",
                range.len(),
                object.name
            );
            errors.push(Finding::new(&spec.at, message));
        }
        add(object, start..start + count, &spec.material);
        start += count;
    }
    errors
}

fn add(object: &mut Object, particles: Range<usize>, material: &Material) {
    object.regions.push(MaterialRegion {
        particles,
        material: material.clone(),
    });
}

/// Index of the nearest Gaussian of every particle.
fn nearest_gaussians(positions: &[[f64; 3]], centres: &[[f32; 3]], spacing: f64) -> Vec<u64> {
    let centres: Vec<[f64; 3]> = centres.iter().map(|c| c.map(f64::from)).collect();
    let positions: Vec<[f32; 3]> = positions.iter().map(|x| x.map(|x| x as f32)).collect();
    let bound = binding::bind(&positions, &centres, spacing, 0);
    bound
        .particle
        .iter()
        .map(|slots| u64::from(slots[0]))
        .collect()
}

/// Reorders the particles from `first` on: new place `n` takes the particle that was at `order[n]`.
fn permute(scene: &mut Scene, first: usize, gaussians: Range<usize>, order: &[usize]) {
    let range = first..first + order.len();
    let position: Vec<_> = order
        .iter()
        .map(|&p| scene.particles.position[first + p])
        .collect();
    let volume: Vec<_> = order
        .iter()
        .map(|&p| scene.particles.volume[first + p])
        .collect();
    scene.particles.position[range.clone()].copy_from_slice(&position);
    scene.particles.volume[range.clone()].copy_from_slice(&volume);
    let mut place = vec![0; order.len()];
    for (new, &old) in order.iter().enumerate() {
        place[old] = (first + new) as u32;
    }
    // Gaussians are bound to particles of their own object only.
    for slots in &mut scene.binding.particle[gaussians] {
        for id in slots {
            *id = place[*id as usize - first];
        }
    }
}

#[cfg(test)]
mod tests {
    use cosplat_sim_core::Scene;

    use crate::scene_file::{SceneFile, build};

    fn scene(regions: &str) -> Result<Scene, String> {
        let text = format!(
            r#"version = 1
dx = 0.05
[materials.stiff]
preset = "rubber"
density_kg_m3 = 2000
[[objects]]
name = "block"
shape = {{ kind = "box", size = [0.4, 0.2, 0.2] }}
translation = [1, 0, 0]
material = "jelly"
{regions}
"#
        );
        let file = SceneFile::parse(&text).map_err(|e| e.to_string())?;
        let built = build(&file, &mut |_| unreachable!("no files"));
        Ok(built.map_err(|e| e.to_string())?.0)
    }

    #[test]
    fn a_box_gives_half_of_an_object_another_material() {
        let text = r#"[[objects.regions]]
box = { min = [1, -1, -1], max = [2, 1, 1] }
material = "stiff"
"#;
        let scene = scene(text).expect("valid");
        let plain = self::scene("").expect("valid");
        let object = &scene.objects[0];
        let region = &object.regions[0];
        assert_eq!(region.material.density, 2000.0);
        assert_eq!(region.particles.end, object.particles.end);
        assert_eq!(2 * region.particles.len(), object.particles.len());
        for p in object.particles.clone() {
            let right = scene.particles.position[p][0] >= 1.0;
            assert_eq!(right, region.particles.contains(&p));
        }
        // Gaussians stay bound to the same places.
        let bound_to = |scene: &Scene| -> Vec<[f64; 3]> {
            let slots = scene.binding.particle.iter();
            slots
                .map(|s| scene.particles.position[s[0] as usize])
                .collect()
        };
        assert_eq!(bound_to(&scene), bound_to(&plain));
    }

    #[test]
    fn an_index_set_takes_the_particles_nearest_to_its_gaussians() {
        let text = r#"[[objects.regions]]
gaussians = [[0, 200]]
material = "stiff"
"#;
        let scene = scene(text).expect("valid");
        let region = &scene.objects[0].regions[0].particles;
        assert!(!region.is_empty());
        let nearest = |x: [f64; 3]| {
            let distance =
                |g: &[f32; 3]| -> f64 { (0..3).map(|a| (f64::from(g[a]) - x[a]).powi(2)).sum() };
            let gaussians = scene.gaussians.position.iter().enumerate();
            let best = gaussians.min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
            best.map_or(0, |(n, _)| n)
        };
        for p in scene.objects[0].particles.clone().step_by(7) {
            let inside = nearest(scene.particles.position[p]) < 200;
            assert_eq!(inside, region.contains(&p), "particle {p}");
        }
    }

    #[test]
    fn a_region_that_is_empty_or_selects_nothing_is_an_error() {
        let text = r#"[[objects.regions]]
box = { min = [5, -1, -1], max = [6, 1, 1] }
material = "stiff"
"#;
        let error = scene(text).expect_err("nothing there");
        assert!(error.contains("region 0 holds none of"), "{error}");
        let error = scene("[[objects.regions]]\nmaterial = \"stiff\"\n").expect_err("no choice");
        assert!(
            error.contains("give `box`, `gaussians` or `names`"),
            "{error}"
        );
    }
}
