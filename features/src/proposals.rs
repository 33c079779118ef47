//! Masks that a network proposes, and the vector of each: the mean of a map of features over its pixels.
//!
//! SAM's masks overlap, and a picture of masks has one at each pixel. LangSplat's levels say which: the best of those at a pixel,
//! the smallest, the best again, and the largest.

use std::path::Path;

use cosplat_semantics::{MaskMap, dense::DenseMap, objects::Vectors};

use crate::{
    FeaturesError,
    config::{Config, MasksConfig},
    network::{Network, Tensor, Worker},
    picture::Picture,
};

/// A network that proposes masks.
pub struct Proposer {
    config: MasksConfig,
    /// The network.
    pub network: Network,
}

/// Masks of a picture, the best first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Proposals {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// For each mask, the pixels that lie in it, in rising order.
    pub masks: Vec<Vec<u32>>,
}

impl Proposer {
    /// Loads the network of a TOML file.
    ///
    /// # Errors
    /// When the file is of another kind, or its network cannot be loaded.
    pub fn load(path: &Path) -> Result<Self, FeaturesError> {
        let config = match Config::read(path)? {
            Config::Masks(config) => config,
            other => {
                let why = format!("kind is {:?}, expected \"masks\"", other.kind());
                return Err(FeaturesError::config(path, why));
            }
        };
        let outputs: Vec<&str> = [Some(&config.output), config.scores.as_ref()]
            .into_iter()
            .flatten()
            .map(String::as_str)
            .collect();
        let input = config.input.as_deref();
        let network = Network::load(path, &config.network, input, &outputs)?;
        Ok(Self { config, network })
    }

    /// Masks of a picture: those with a score of at least `least_score`, less those that a better one is much like. What of them
    /// lies beside a padded picture is left out.
    ///
    /// # Errors
    /// When the network does not run, or gives other shapes.
    pub fn masks(&self, worker: &Worker, picture: &Picture) -> Result<Proposals, FeaturesError> {
        let [width, height] = self.config.picture.size;
        let shown = picture.shown(&self.config.picture);
        let input = self.network.input(&[1, 3, height, width], shown)?;
        let mut found = self.network.run(worker, input)?.into_iter();
        let masks = found.next().unwrap_or_else(|| Tensor {
            shape: Vec::new(),
            value: Vec::new(),
        });
        let &[1, count, height @ 1..=usize::MAX, width @ 1..=usize::MAX] = masks.shape.as_slice()
        else {
            let why = format!(
                "has shape {:?}, expected [1, masks, rows, columns]",
                masks.shape
            );
            return Err(self.network.first(why));
        };
        let scores = match (found.next(), &self.config.scores) {
            (Some(scores), Some(name)) if scores.shape != [1, count] => {
                let why = format!("has shape {:?}, expected [1, {count}]", scores.shape);
                return Err(self.network.output(name, why));
            }
            (Some(scores), _) => scores.value,
            _ => vec![self.config.least_score; count],
        };
        let pixels = width * height;
        let [columns, rows] = self
            .config
            .picture
            .covered_of(picture.size(), [width, height]);
        let inside = |n: usize| {
            let lines = masks.value[n * pixels..(n + 1) * pixels].chunks_exact(width);
            let values = lines.take(rows).flat_map(|line| &line[..columns]);
            let inside = (0..)
                .zip(values)
                .filter(|(_, v)| **v > self.config.threshold);
            inside.map(|(pixel, _)| pixel).collect::<Vec<u32>>()
        };
        let mut order: Vec<usize> = (0..count)
            .filter(|n| scores[*n] >= self.config.least_score)
            .collect();
        order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
        let mut kept = Vec::<Vec<u32>>::new();
        for mask in order
            .into_iter()
            .map(inside)
            .filter(|mask| !mask.is_empty())
        {
            let is_new = |other: &Vec<u32>| alike(other, &mask) <= self.config.overlap;
            if kept.iter().all(is_new) {
                kept.push(mask);
            }
        }
        Ok(Proposals {
            width: columns,
            height: rows,
            masks: kept,
        })
    }
}

/// Intersection over union of two masks.
fn alike(a: &[u32], b: &[u32]) -> f32 {
    let (mut rest, mut both) = (b, 0usize);
    for pixel in a {
        let skip = rest.partition_point(|other| other < pixel);
        rest = &rest[skip..];
        both += usize::from(rest.first() == Some(pixel));
    }
    both as f32 / (a.len() + b.len() - both) as f32
}

impl Proposals {
    /// One mask at each pixel, by LangSplat's levels.
    pub fn levels(&self) -> [MaskMap; 4] {
        let best: Vec<usize> = (0..self.masks.len()).collect();
        let mut small = best.clone();
        // Stable: of masks as large as each other, the better one.
        small.sort_by_key(|n| self.masks[*n].len());
        let mut large = best.clone();
        large.sort_by_key(|n| std::cmp::Reverse(self.masks[*n].len()));
        [&best, &small, &best, &large].map(|order| self.flat(order))
    }

    /// The first mask of `order` at each pixel.
    fn flat(&self, order: &[usize]) -> MaskMap {
        let mut mask = vec![-1; self.width * self.height];
        for n in order.iter().rev() {
            for pixel in &self.masks[*n] {
                mask[*pixel as usize] = *n as i32;
            }
        }
        MaskMap {
            width: self.width,
            height: self.height,
            mask,
        }
    }

    /// A unit vector for each mask: the mean of the map over its pixels. Zeros where that has no length.
    pub fn pooled(&self, map: &DenseMap) -> Vectors {
        let dim = map.vectors.dim;
        // The cell that the centre of a pixel falls into.
        let at = |k: usize, from: usize, to: usize| (2 * k + 1) * to / (2 * from);
        let cell = |pixel: &u32| {
            let (row, column) = (*pixel as usize / self.width, *pixel as usize % self.width);
            at(row, self.height, map.rows) * map.columns + at(column, self.width, map.columns)
        };
        let mut value = Vec::with_capacity(self.masks.len() * dim);
        for mask in &self.masks {
            let mut pixels = vec![0u32; map.rows * map.columns];
            mask.iter().for_each(|pixel| pixels[cell(pixel)] += 1);
            let mut sum = vec![0.0f64; dim];
            for (n, count) in pixels.iter().enumerate().filter(|(_, count)| **count > 0) {
                let vector = map.vectors.of(n).iter();
                sum.iter_mut()
                    .zip(vector)
                    .for_each(|(sum, v)| *sum += f64::from(*count) * f64::from(*v));
            }
            let length = sum.iter().map(|s| s * s).sum::<f64>().sqrt();
            let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
            value.extend(sum.iter().map(|s| (s * scale) as f32));
        }
        Vectors { dim, value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_over_each_other_are_told_apart_by_level() {
        // Two pixels in a row of four, all four, and the last: the second lies over the others.
        let all = Proposals {
            width: 4,
            height: 1,
            masks: vec![vec![0, 1], vec![0, 1, 2, 3], vec![3]],
        };
        let levels = all.levels();
        let of = |level: usize| levels[level].mask.clone();
        assert_eq!(of(0), [0, 0, 1, 1], "the best first");
        assert_eq!(of(1), [0, 0, 1, 2], "the smallest");
        assert_eq!(of(2), of(0));
        assert_eq!(of(3), [1, 1, 1, 1], "the largest");
    }

    #[test]
    fn a_mask_has_the_mean_of_the_map_over_its_pixels() {
        let map = DenseMap {
            rows: 1,
            columns: 2,
            vectors: Vectors {
                dim: 2,
                value: vec![3.0, 0.0, 0.0, 4.0],
            },
        };
        // Two pixels a cell: both of the left one and one of the right one, (6, 4) in all.
        let all = Proposals {
            width: 4,
            height: 1,
            masks: vec![vec![0, 1, 2], vec![3]],
        };
        let found = all.pooled(&map).value;
        let length = 52.0f32.sqrt();
        let expected = [6.0 / length, 4.0 / length, 0.0, 1.0];
        // Rounding of a quotient.
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-6),
            "{found:?}"
        );
    }

    #[test]
    fn likeness_is_intersection_over_union() {
        for (a, b, expected) in [
            (vec![0, 1, 2], vec![1, 2, 5], 0.5),
            (vec![0, 1], vec![0, 1], 1.0),
            (vec![9], vec![0, 1], 0.0),
        ] {
            assert_eq!((alike(&a, &b), alike(&b, &a)), (expected, expected));
        }
    }
}
