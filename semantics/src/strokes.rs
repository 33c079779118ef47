//! Strokes over what a person sees part the objects of a splat that hang together.
//!
//! Superpoints under a stroke belong to its name. Linkage goes on from there; two that belong to different names never join.
//! What hangs together with no stroke on it stays as it is.

use cosplat_raster::Camera;

use crate::{Splat, tree::Tree};

/// Distance of the points of a stroke that are looked at [pixel].
const STEP: f32 = 4.0;

/// Gaussians that one name was given to.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    /// Number of the name.
    pub name: usize,
    /// Gaussians under the stroke, one for each point of it.
    pub gaussians: Vec<u32>,
}

/// Gaussians that are seen under a line through points of a picture [pixel]; none where the background is.
pub fn under(splat: &Splat, camera: &Camera, line: &[[f32; 2]]) -> Vec<u32> {
    let shown = splat.project(camera);
    let mut points = line.first().copied().into_iter().collect::<Vec<_>>();
    for pair in line.windows(2) {
        let [dx, dy] = [0, 1].map(|a| pair[1][a] - pair[0][a]);
        let steps = (dx.hypot(dy) / STEP).ceil().clamp(1.0, 10_000.0);
        let at = |k: f32| [pair[0][0] + dx * k / steps, pair[0][1] + dy * k / steps];
        points.extend((1..=steps as u32).map(|k| at(k as f32)));
    }
    let seen = points.iter().filter_map(|point| shown.pick(*point));
    seen.map(|ellipse| ellipse.payload).collect()
}

impl Tree {
    /// The name of each superpoint; -1 in what hangs together and has no stroke on it. A superpoint under several names has
    /// the one with most points, the first of equals.
    pub fn stroked(&self, strokes: &[Stroke]) -> Vec<i32> {
        let names = strokes.iter().map(|s| s.name + 1).max().unwrap_or(0);
        let mut points = vec![0u32; self.size.len() * names];
        for stroke in strokes {
            for gaussian in &stroke.gaussians {
                let superpoint = self.superpoint[*gaussian as usize] as usize;
                points[superpoint * names + stroke.name] += 1;
            }
        }
        let owner = |of: &[u32]| {
            let most = (0..names).max_by_key(|&n| (of[n], std::cmp::Reverse(n)));
            most.filter(|&n| of[n] > 0).map_or(-1, |n| n as i32)
        };
        let owners: Vec<i32> = match names {
            0 => vec![-1; self.size.len()],
            _ => points.chunks(names).map(owner).collect(),
        };
        let mut linkage = self.linkage(owners);
        linkage.run(f32::INFINITY);
        (0..self.size.len() as u32)
            .map(|s| linkage.owner_of(s))
            .collect()
    }
}
