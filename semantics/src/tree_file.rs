//! `NAME.tree.safetensors`: the superpoints of a splat and which of them touch, so that picking does not begin anew.
//!
//! Tensors: `superpoint` u32 `[Gaussians that can be read]`; `ground` u8 `[superpoints]`; `touch` u32 `[n][2]`;
//! `votes` f32 `[n][2]`, those that part and all. Metadata: version, hash of the asset's file, the ground plane.

use std::{collections::BTreeMap, path::Path};

use cosplat_scene::assets::tensors::serialize;
use glam::Vec3;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use crate::{SemanticsError, ground::Ground, tree::Tree};

/// Version of the format.
const VERSION: &str = "1";
/// Most superpoints: what can be joined in memory.
const MOST: usize = 1 << 24;

impl Tree {
    /// Writes the file for the asset with this hash.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path, asset_hash: u64) -> Result<(), SemanticsError> {
        let words =
            |of: &mut dyn Iterator<Item = u32>| of.flat_map(u32::to_le_bytes).collect::<Vec<u8>>();
        let pairs = self.touch.iter().flat_map(|t| [t.0, t.1]);
        let votes = self.touch.iter().flat_map(|t| t.2).map(f32::to_bits);
        let [rows, count, touching] = [self.superpoint.len(), self.size.len(), self.touch.len()];
        let ground: Vec<u8> = self.is_ground.iter().map(|g| u8::from(*g)).collect();
        let data = [
            (
                "superpoint",
                Dtype::U32,
                vec![rows],
                words(&mut self.superpoint.iter().copied()),
            ),
            ("ground", Dtype::U8, vec![count], ground),
            (
                "touch",
                Dtype::U32,
                vec![touching, 2],
                words(&mut { pairs }),
            ),
            (
                "votes",
                Dtype::F32,
                vec![touching, 2],
                words(&mut { votes }),
            ),
        ];
        let plane = self.ground.map(|g| {
            let Ground {
                up,
                offset,
                tolerance,
                confidence,
            } = g;
            [up.x, up.y, up.z, offset, tolerance, confidence]
        });
        let metadata = BTreeMap::from([
            ("cosplat.tree", VERSION.to_owned()),
            ("asset_hash", format!("{asset_hash:016x}")),
            ("plane", serde_json::json!(plane).to_string()),
        ]);
        let damaged =
            |error: safetensors::SafeTensorError| SemanticsError::format(path, error.to_string());
        let tensors = data.iter().map(|(name, kind, shape, bytes)| {
            TensorView::new(*kind, shape.clone(), bytes).map(|tensor| (*name, tensor))
        });
        let tensors = tensors.collect::<Result<Vec<_>, _>>().map_err(damaged)?;
        let bytes = serialize(tensors, &metadata).map_err(damaged)?;
        cosplat_files::write(path, bytes).map_err(SemanticsError::write(path))
    }

    /// Reads the file for an asset of `rows` Gaussians with this hash.
    ///
    /// # Errors
    /// When it cannot be read, is damaged, or belongs to another asset.
    pub fn read(path: &Path, asset_hash: u64, rows: usize) -> Result<Self, SemanticsError> {
        let bytes = SemanticsError::content(path)?;
        Self::parse(&bytes, asset_hash, rows).map_err(|why| SemanticsError::format(path, why))
    }

    /// As [`read`](Self::read), from the bytes of a file.
    ///
    /// # Errors
    /// When they are damaged or belong to another asset, in words.
    pub fn parse(bytes: &[u8], asset_hash: u64, rows: usize) -> Result<Self, String> {
        let damaged = |error: safetensors::SafeTensorError| format!("no tree of a splat: {error}");
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
        let file = SafeTensors::deserialize(bytes).map_err(damaged)?;
        let entry = |key: &str| {
            let value = header
                .metadata()
                .as_ref()
                .and_then(|entries| entries.get(key));
            value.ok_or_else(|| format!("has no metadata {key:?}"))
        };
        let tensor = |name: &str, kind: Dtype, columns: usize| {
            let found = file.tensor(name).map_err(damaged)?;
            let shape = found.shape();
            let is_right = found.dtype() == kind && shape.get(1).copied().unwrap_or(1) == columns;
            match is_right && shape.len() == 1 + usize::from(columns > 1) {
                true => Ok(found.data().to_vec()),
                false => Err(format!(
                    "{name} is {:?} {shape:?}, expected {kind:?} with {columns} columns",
                    found.dtype()
                )),
            }
        };
        let words = |name: &str, kind: Dtype, columns: usize| {
            let bytes = tensor(name, kind, columns)?;
            let words = bytes
                .as_chunks::<4>()
                .0
                .iter()
                .map(|b| u32::from_le_bytes(*b));
            Ok::<Vec<u32>, String>(words.collect())
        };
        let (version, hash) = (entry("cosplat.tree")?, entry("asset_hash")?);
        if version != VERSION {
            return Err(format!("has version {version}, expected {VERSION}"));
        }
        let superpoint = words("superpoint", Dtype::U32, 1)?;
        if *hash != format!("{asset_hash:016x}") || superpoint.len() != rows {
            return Err(format!(
                "is for an asset of {} Gaussians with hash {hash}; this one has {rows} with hash {asset_hash:016x}",
                superpoint.len()
            ));
        }
        let is_ground: Vec<bool> = tensor("ground", Dtype::U8, 1)?
            .iter()
            .map(|g| *g != 0)
            .collect();
        let (touch, votes) = (
            words("touch", Dtype::U32, 2)?,
            words("votes", Dtype::F32, 2)?,
        );
        let count = is_ground.len();
        let stranger = superpoint
            .iter()
            .chain(&touch)
            .find(|s| **s as usize >= count);
        if let Some(stranger) = stranger.or((count > MOST).then_some(&0)) {
            return Err(format!("names superpoint {stranger} of {count}"));
        }
        let touch = linked(&touch, &votes)?;
        let mut size = vec![0; count];
        superpoint.iter().for_each(|s| size[*s as usize] += 1);
        let ground = plane(entry("plane")?)?;
        let mut tree = Tree {
            superpoint,
            size,
            touch,
            ground,
            is_ground,
            ..Tree::default()
        };
        tree.join_all();
        Ok(tree)
    }
}

/// Pairs that touch with their votes; joins add the votes up.
fn linked(touch: &[u32], votes: &[u32]) -> Result<Vec<(u32, u32, [f32; 2])>, String> {
    let pairs = touch.as_chunks::<2>().0.iter();
    let pairs = pairs.zip(votes.as_chunks::<2>().0);
    let linked: Vec<_> = pairs
        .map(|(&[a, b], v)| (a, b, v.map(f32::from_bits)))
        .collect();
    let is_vote = |&(a, b, [parted, all]): &(u32, u32, [f32; 2])| {
        a != b && 0.0 <= parted && parted <= all && all.is_finite()
    };
    let total: f64 = linked.iter().map(|t| f64::from(t.2[1])).sum();
    let is_sum = total < f64::from(f32::MAX) / 2.0;
    if touch.len() != votes.len() || !linked.iter().all(is_vote) || !is_sum {
        return Err(
            "has votes that are none: expected 0 <= parting <= all for two superpoints, with a finite sum"
                .to_owned(),
        );
    }
    Ok(linked)
}

/// The ground plane, where there is one.
fn plane(text: &str) -> Result<Option<Ground>, String> {
    let plane: Option<[f32; 6]> =
        serde_json::from_str(text).map_err(|error| format!("has a plane that is none: {error}"))?;
    let ground = plane.map(|[x, y, z, offset, tolerance, confidence]| Ground {
        up: Vec3::new(x, y, z),
        offset,
        tolerance,
        confidence,
    });
    let is_finite = |g: &Ground| {
        let numbers = [g.offset, g.tolerance, g.confidence];
        g.up.is_normalized() && numbers.iter().all(|x| x.is_finite())
    };
    match ground.filter(|g| !is_finite(g)) {
        Some(bad) => Err(format!("has a plane that is none: {bad:?}")),
        None => Ok(ground),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strokes::Stroke;

    /// Four superpoints in a row, of ten Gaussians each; the second pair is least alike.
    fn row() -> Tree {
        let votes = [0.2, 0.8, 0.4];
        let touch = (0..3).map(|n| (n, n + 1, [votes[n as usize], 1.0]));
        let mut tree = Tree {
            superpoint: (0..40).map(|n| n / 10).collect(),
            size: vec![10; 4],
            touch: touch.collect(),
            is_ground: vec![true, false, false, false],
            ground: Some(Ground {
                up: Vec3::Y,
                offset: 0.5,
                tolerance: 0.01,
                confidence: 0.75,
            }),
            ..Tree::default()
        };
        tree.join_all();
        tree
    }

    #[test]
    fn a_tree_comes_back_as_it_was_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.tree.safetensors");
        row().write(&path, 7).expect("written");
        assert_eq!(Tree::read(&path, 7, 40).expect("a tree"), row());
        let other = Tree::read(&path, 8, 40)
            .expect_err("another asset")
            .to_string();
        assert!(
            other.contains("0000000000000007") && other.contains("0000000000000008"),
            "{other}"
        );
        let bytes = std::fs::read(&path).expect("bytes");
        for cut in 0..bytes.len() {
            assert!(Tree::parse(&bytes[..cut], 7, 40).is_err(), "{cut}");
        }
    }

    #[test]
    fn planes_and_votes_that_are_not_finite_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.tree.safetensors");
        let refused = |change: &dyn Fn(&mut Tree)| {
            let mut tree = row();
            change(&mut tree);
            tree.write(&path, 7).expect("written");
            Tree::read(&path, 7, 40).expect_err("refused").to_string()
        };
        for up in [Vec3::ZERO, 2.0 * Vec3::Y] {
            let error = refused(&|tree| tree.ground.as_mut().expect("a plane").up = up);
            assert!(error.contains("a plane that is none"), "{error}");
        }
        // Finite votes whose sum is not.
        let error = refused(&|tree| tree.touch.iter_mut().for_each(|t| t.2[1] = f32::MAX));
        assert!(error.contains("with a finite sum"), "{error}");
    }

    #[test]
    fn joins_have_heights_and_levels_undo_them() {
        let tree = row();
        assert_eq!(tree.join, [[0, 1], [2, 3], [4, 5]]);
        assert_eq!(tree.level(0.5), [4, 5]);
        assert_eq!(tree.level(0.3), [2, 3, 4]);
        assert_eq!(tree.leaves(6), [0, 1, 2, 3]);
        assert_eq!(tree.whole(), [(6, "ground".to_owned())]);
        // A part takes what is its own from what it is part of.
        assert_eq!(tree.of_nodes(&[6, 4, 0]), [2, 1, 0, 0]);
    }

    #[test]
    fn strokes_of_two_names_part_what_hangs_together() {
        let stroke = |name, gaussian| Stroke {
            name,
            gaussians: vec![gaussian],
        };
        assert_eq!(row().stroked(&[stroke(0, 5), stroke(1, 35)]), [0, 0, 1, 1]);
        assert_eq!(row().stroked(&[stroke(0, 5), stroke(1, 15)]), [0, 1, 1, 1]);
        assert_eq!(row().stroked(&[stroke(0, 25)]), [0; 4]);
        assert_eq!(row().stroked(&[]), [-1; 4]);
    }
}
