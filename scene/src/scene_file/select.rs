//! Groups the Gaussians of an asset into objects: by index, semantic id, box, connection.

use std::collections::BTreeMap;

use cosplat_sim_core::scene::Aabb;

use super::{
    edit::Unplaced,
    error::suggest,
    spec::{Link, Select, Split},
};
use crate::{assets::objects::Objects, bounds::bounds_of, components};

/// An asset placed in the world, less its nearly transparent Gaussians.
pub(super) struct Placed {
    pub gaussians: Unplaced,
    /// Index of each Gaussian in the asset.
    pub index: Vec<u64>,
    /// Object of each Gaussian, where a file says them.
    pub objects: Option<Objects>,
}

/// Parts that splitting makes, each with what is put behind the object's name.
pub(super) type Parts = Vec<(String, Vec<usize>)>;

fn numbered(parts: impl IntoIterator<Item = Vec<usize>>) -> Parts {
    let named = |(n, part): (usize, Vec<usize>)| (n.to_string(), part);
    parts.into_iter().enumerate().map(named).collect()
}

impl Placed {
    /// Positions in `gaussians` that a selection names; `others` are the asset's other selections.
    pub fn select(&self, select: &Select, others: &[&Select]) -> Result<Vec<usize>, String> {
        let all = 0..self.gaussians.len();
        let position = |i: usize| self.gaussians.position[i];
        let chosen: Vec<usize> = match select {
            Select::Ranges(ranges) => {
                let inside = |i: u64| ranges.iter().any(|r| (r[0]..r[1]).contains(&i));
                all.filter(|&i| inside(self.index[i])).collect()
            }
            Select::Ids(ids) => {
                let id = self.ids()?;
                all.filter(|&i| ids.contains(&id[i])).collect()
            }
            Select::Names(names) => {
                let is_in = self.is_named(names)?;
                all.filter(|&i| is_in[i]).collect()
            }
            Select::Objects => {
                let object = &self.objects()?.labels.object;
                all.filter(|&i| object[i] >= 0).collect()
            }
            Select::Boxes(boxes) => {
                let inside = |p| boxes.iter().any(|b| b.contains(p));
                all.filter(|&i| inside(position(i))).collect()
            }
            Select::Component(n, link) => {
                let mut components = self.components(link)?;
                if *n >= components.len() {
                    let count = components.len();
                    return Err(format!("component {n} does not exist: there are {count}"));
                }
                components.swap_remove(*n)
            }
            Select::Rest => {
                let mut taken = vec![false; self.gaussians.len()];
                for other in others.iter().filter(|o| !matches!(o, Select::Rest)) {
                    for i in self.select(other, &[])? {
                        taken[i] = true;
                    }
                }
                all.filter(|&i| !taken[i]).collect()
            }
        };
        if chosen.is_empty() {
            return Err(self.nothing());
        }
        Ok(chosen)
    }

    /// Why nothing was found, with what would be there.
    fn nothing(&self) -> String {
        let count = self.gaussians.len();
        let place = bounds_of(self.gaussians.position.iter().copied()).map_or(String::new(), |b| {
            format!(", which fill the box {:.4?} to {:.4?}", b.min, b.max)
        });
        format!("selects none of the asset's {count} Gaussians{place}")
    }

    /// The parts of `chosen`, in a fixed order.
    pub fn split(&self, chosen: &[usize], split: Split) -> Result<Parts, String> {
        match split {
            Split::Components(link) => self.components_of(chosen, &link).map(numbered),
            Split::Objects => self.by_object(chosen),
            Split::Ids => {
                let id = self.ids()?;
                let mut parts: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
                for &i in chosen {
                    parts.entry(id[i]).or_default().push(i);
                }
                Ok(numbered(parts.into_values()))
            }
        }
    }

    fn objects(&self) -> Result<&Objects, String> {
        let missing =
            "needs an asset with a file of objects (key `objects`), which `cosplat lift` writes";
        self.objects.as_ref().ok_or_else(|| missing.to_owned())
    }

    /// Whether each Gaussian belongs to one of these objects or to a part of one.
    pub fn is_named(&self, names: &[String]) -> Result<Vec<bool>, String> {
        let objects = self.objects()?;
        let is_in = objects.named(names).map_err(|name| {
            let known = objects.names.iter().map(String::as_str);
            let hint = suggest(name, known.filter(|n| !n.is_empty()));
            format!("names `{name}`, which the file of objects does not have: {hint}")
        })?;
        let object = objects.labels.object.iter();
        let of = |o: &i32| usize::try_from(*o).is_ok_and(|o| is_in[o]);
        Ok(object.map(of).collect())
    }

    /// What of `chosen` belongs to each object that is no part of another, in their order.
    fn by_object(&self, chosen: &[usize]) -> Result<Parts, String> {
        let objects = self.objects()?;
        let mut parts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for &i in chosen {
            if let Ok(object) = usize::try_from(objects.labels.object[i]) {
                parts.entry(objects.root_of(object)).or_default().push(i);
            }
        }
        let name = |object: usize| match objects.names[object].as_str() {
            "" => object.to_string(),
            name => name.to_owned(),
        };
        let named = parts.into_iter().map(|(object, part)| (name(object), part));
        Ok(named.collect())
    }

    /// Semantic ids, rounded.
    fn ids(&self) -> Result<Vec<u64>, String> {
        let dim = self.gaussians.looks().feature_dim;
        if dim != 1 {
            return Err(format!(
                "needs an asset with one semantic id per Gaussian (property f_sem_0): \
                 its feature vectors have length {dim}, expected 1"
            ));
        }
        let round = |&f: &f32| if f >= 0.0 { f.round() as u64 } else { u64::MAX };
        Ok(self.gaussians.looks().feature.iter().map(round).collect())
    }

    fn components(&self, link: &Link) -> Result<Vec<Vec<usize>>, String> {
        let all: Vec<usize> = (0..self.gaussians.len()).collect();
        self.components_of(&all, link)
    }

    /// Connected components, largest first.
    fn components_of(&self, chosen: &[usize], link: &Link) -> Result<Vec<Vec<usize>>, String> {
        let points: Vec<[f64; 3]> = chosen.iter().map(|&i| self.gaussians.position[i]).collect();
        let mut parts = match link.distance {
            Some(size) => components::by_cells(&points, size),
            None => components::by_neighbours(&points),
        };
        let largest = parts.iter().map(Vec::len).max().unwrap_or(0);
        parts.retain(|p| p.len() >= link.min_gaussians);
        if parts.is_empty() {
            return Err(format!(
                "finds no connected component of {} Gaussians (`min_gaussians`): the largest has {largest}",
                link.min_gaussians
            ));
        }
        for part in &mut parts {
            part.iter_mut().for_each(|n| *n = chosen[*n]);
        }
        parts.sort_by_key(|p| (usize::MAX - p.len(), p[0]));
        Ok(parts)
    }
}

/// Longest side of a box [m].
pub(super) fn longest_side(b: &Aabb) -> f64 {
    (0..3).map(|a| b.max[a] - b.min[a]).fold(0.0, f64::max)
}
