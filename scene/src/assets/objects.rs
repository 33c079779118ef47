//! `NAME.objects.safetensors`: which object every Gaussian of an asset belongs to.
//!
//! Tensors, all but the first two optional: `object` i32 `[rows]`, an index into the names, -1 for none; `confidence` f16
//! `[rows]`, 0..=1; `feature` f16 `[rows][d]`; `object_feature` f32 `[objects][D]`; `parent` i32 `[objects]`, the object that
//! one is part of, -1 for none. Rows are those of the asset's file, also the ones that cannot be read. Metadata: hash of the
//! asset's file, names, how it was made.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use half::f16;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use super::tensors;
use cosplat_files::reading;

/// Version of the format.
const VERSION: &str = "1";

/// Why a file of objects is refused.
#[derive(Debug, thiserror::Error)]
pub enum ObjectsError {
    /// It cannot be read.
    #[error("cannot read {}: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// It cannot be written.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// It is not what it should be.
    #[error("{file}: {why}")]
    Format {
        /// The file.
        file: String,
        /// What was expected and what was found.
        why: String,
    },
    /// It belongs to another asset.
    #[error(
        "{file} is for an asset of {of} rows with hash {hash:016x}; this one has {found} with hash {found_hash:016x}"
    )]
    OtherAsset {
        /// The file of objects.
        file: String,
        /// Rows that it has labels for.
        of: usize,
        /// Hash of the asset that it was made for.
        hash: u64,
        /// Rows of the asset at hand.
        found: usize,
        /// Hash of the asset at hand.
        found_hash: u64,
    },
}

/// A label for every Gaussian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labels {
    /// Index of the object; -1 for none.
    pub object: Vec<i32>,
    /// Share of the object in what is known of the Gaussian, 0..=1; 0 where its label is that of the nearest region.
    pub confidence: Vec<f32>,
}

/// Vectors of one length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vectors {
    /// Their length.
    pub dim: usize,
    /// `[vectors][dim]`.
    pub value: Vec<f32>,
}

impl Vectors {
    /// Vector `n`.
    pub fn of(&self, n: usize) -> &[f32] {
        &self.value[n * self.dim..(n + 1) * self.dim]
    }
}

/// Objects of an asset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Objects {
    /// XXH3 of the asset's file, 64 bits, seed 0.
    pub asset_hash: u64,
    /// Names of the objects, each once; empty for an object without a name.
    pub names: Vec<String>,
    /// The object that each is part of, -1 for none; empty where no object has parts.
    pub parent: Vec<i32>,
    /// What each row of the asset's file belongs to.
    pub labels: Labels,
    /// A vector for each row.
    pub feature: Option<Vectors>,
    /// A vector for each object.
    pub object_feature: Option<Vectors>,
    /// How it was made, in words.
    pub made: String,
}

impl Objects {
    /// The object that `object` is part of.
    pub fn parent_of(&self, object: usize) -> Option<usize> {
        usize::try_from(*self.parent.get(object)?).ok()
    }

    /// The object that `object` is at last a part of.
    pub fn root_of(&self, mut object: usize) -> usize {
        while let Some(parent) = self.parent_of(object) {
            object = parent;
        }
        object
    }

    /// Whether each object is one of `names` or a part of one.
    ///
    /// # Errors
    /// The first name that there is not.
    pub fn named<'n>(&self, names: &'n [String]) -> Result<Vec<bool>, &'n str> {
        let of = |name: &'n String| {
            let found = self.names.iter().position(|n| n == name);
            found.filter(|_| !name.is_empty()).ok_or(name.as_str())
        };
        let wanted: BTreeSet<usize> = names.iter().map(of).collect::<Result<_, _>>()?;
        let is_in = |object: usize| {
            let mut chain = std::iter::successors(Some(object), |o| self.parent_of(*o));
            chain.any(|o| wanted.contains(&o))
        };
        Ok((0..self.names.len()).map(is_in).collect())
    }

    /// Objects of some of the rows, in the order given.
    #[must_use]
    pub fn subset(&self, rows: &[usize]) -> Objects {
        let feature = self.feature.as_ref().map(|f| Vectors {
            dim: f.dim,
            value: rows.iter().flat_map(|&row| f.of(row)).copied().collect(),
        });
        Objects {
            labels: Labels {
                object: rows.iter().map(|&row| self.labels.object[row]).collect(),
                confidence: rows
                    .iter()
                    .map(|&row| self.labels.confidence[row])
                    .collect(),
            },
            feature,
            asset_hash: self.asset_hash,
            names: self.names.clone(),
            parent: self.parent.clone(),
            object_feature: self.object_feature.clone(),
            made: self.made.clone(),
        }
    }

    /// The reverse of [`subset`](Self::subset): row `rows[n]` of `count` is what row `n` is here, others belong to nothing.
    #[must_use]
    pub fn spread(mut self, rows: &[usize], count: usize) -> Objects {
        if rows.len() == count {
            return self;
        }
        let mut labels = Labels {
            object: vec![-1; count],
            confidence: vec![0.0; count],
        };
        for (n, &row) in rows.iter().enumerate() {
            labels.object[row] = self.labels.object[n];
            labels.confidence[row] = self.labels.confidence[n];
        }
        self.labels = labels;
        if let Some(feature) = &mut self.feature {
            let mut value = vec![0.0; count * feature.dim];
            for (n, &row) in rows.iter().enumerate() {
                value[row * feature.dim..][..feature.dim].copy_from_slice(feature.of(n));
            }
            feature.value = value;
        }
        self
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// When vectors are not as many as rows or objects.
    pub fn to_bytes(&self) -> Result<Vec<u8>, safetensors::SafeTensorError> {
        let rows = self.labels.object.len();
        let ints = |of: &[i32]| of.iter().flat_map(|o| o.to_le_bytes()).collect::<Vec<u8>>();
        let halves = |of: &[f32]| {
            let halves = of.iter().map(|c| f16::from_f32(*c));
            halves.flat_map(f16::to_le_bytes).collect::<Vec<u8>>()
        };
        let mut data = vec![
            ("object", Dtype::I32, vec![rows], ints(&self.labels.object)),
            (
                "confidence",
                Dtype::F16,
                vec![rows],
                halves(&self.labels.confidence),
            ),
        ];
        if let Some(f) = &self.feature {
            data.push(("feature", Dtype::F16, vec![rows, f.dim], halves(&f.value)));
        }
        if let Some(f) = &self.object_feature {
            let bytes = f.value.iter().flat_map(|v| v.to_le_bytes()).collect();
            let shape = vec![self.names.len(), f.dim];
            data.push(("object_feature", Dtype::F32, shape, bytes));
        }
        if !self.parent.is_empty() {
            let shape = vec![self.names.len()];
            data.push(("parent", Dtype::I32, shape, ints(&self.parent)));
        }
        let given = data
            .iter()
            .map(|(name, kind, shape, bytes)| {
                Ok((*name, TensorView::new(*kind, shape.clone(), bytes)?))
            })
            .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
        let names = serde_json::to_string(&self.names).unwrap_or_default();
        let metadata = BTreeMap::from([
            ("cosplat.objects", VERSION.to_owned()),
            ("asset_hash", format!("{:016x}", self.asset_hash)),
            ("names", names),
            ("made", self.made.clone()),
        ]);
        tensors::serialize(given, &metadata)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), ObjectsError> {
        let bytes = self.to_bytes().map_err(|error| ObjectsError::Format {
            file: path.display().to_string(),
            why: error.to_string(),
        })?;
        cosplat_files::write(path, bytes).map_err(|cause| ObjectsError::Write {
            path: path.to_owned(),
            cause,
        })
    }

    /// Reads the file for an asset of `rows` rows with this hash.
    ///
    /// # Errors
    /// When it cannot be read, is damaged, or belongs to another asset.
    pub fn read(path: &Path, asset_hash: u64, rows: usize) -> Result<Self, ObjectsError> {
        let bytes =
            reading::read(path, reading::LARGEST_DATA).map_err(|cause| ObjectsError::Read {
                path: path.to_owned(),
                cause,
            })?;
        Self::parse(&path.display().to_string(), &bytes, asset_hash, rows)
    }

    /// As [`read`](Self::read), from the bytes of `file`.
    ///
    /// # Errors
    /// When they are damaged, or belong to another asset.
    pub fn parse(
        file: &str,
        bytes: &[u8],
        asset_hash: u64,
        rows: usize,
    ) -> Result<Self, ObjectsError> {
        let objects = Self::parse_any(file, bytes)?;
        let of = objects.labels.object.len();
        match (of, objects.asset_hash) == (rows, asset_hash) {
            true => Ok(objects),
            false => Err(ObjectsError::OtherAsset {
                file: file.to_owned(),
                of,
                hash: objects.asset_hash,
                found: rows,
                found_hash: asset_hash,
            }),
        }
    }

    /// As [`parse`](Self::parse), whatever asset they belong to.
    ///
    /// # Errors
    /// When they are damaged.
    pub fn parse_any(file: &str, bytes: &[u8]) -> Result<Self, ObjectsError> {
        parse(bytes).map_err(|why| ObjectsError::Format {
            file: file.to_owned(),
            why,
        })
    }
}

/// Bytes of a tensor, and its shape.
type Found<'b> = (&'b [u8], Vec<usize>);

/// Tensors of a file, by name, kind and shape.
struct Tensors<'b>(SafeTensors<'b>);

impl<'b> Tensors<'b> {
    /// Bytes of a tensor of this kind with `axes` axes, and its shape; none where there is none.
    fn get(&self, name: &str, kind: Dtype, axes: usize) -> Result<Option<Found<'b>>, String> {
        let Ok(tensor) = self.0.tensor(name) else {
            return Ok(None);
        };
        let (found, shape) = (tensor.dtype(), tensor.shape());
        if found != kind || shape.len() != axes {
            return Err(format!(
                "{name} is {found:?} {shape:?}, expected {kind:?} with {axes} axes"
            ));
        }
        Ok(Some((tensor.data(), shape.to_vec())))
    }

    fn required(&self, name: &str, kind: Dtype) -> Result<(&'b [u8], usize), String> {
        let found = self.get(name, kind, 1)?;
        let (bytes, shape) = found.ok_or_else(|| format!("has no tensor {name:?}"))?;
        Ok((bytes, shape[0]))
    }

    /// Vectors `[count][dim]`, all finite.
    fn vectors(&self, name: &str, kind: Dtype, count: usize) -> Result<Option<Vectors>, String> {
        let Some((bytes, shape)) = self.get(name, kind, 2)? else {
            return Ok(None);
        };
        if shape[0] != count {
            return Err(format!("{name} has {} rows, expected {count}", shape[0]));
        }
        let value = match kind {
            Dtype::F16 => halves(bytes),
            _ => {
                let words = bytes.as_chunks::<4>().0.iter();
                words.map(|b| f32::from_le_bytes(*b)).collect()
            }
        };
        if let Some(at) = value.iter().position(|v| !v.is_finite()) {
            return Err(format!(
                "{name} has {} at {at}, expected finite numbers",
                value[at]
            ));
        }
        let dim = shape[1];
        Ok(Some(Vectors { dim, value }))
    }
}

fn ints(bytes: &[u8]) -> Vec<i32> {
    let words = bytes.as_chunks::<4>().0.iter();
    words.map(|b| i32::from_le_bytes(*b)).collect()
}

fn halves(bytes: &[u8]) -> Vec<f32> {
    let halves = bytes.as_chunks::<2>().0.iter();
    halves.map(|b| f16::from_le_bytes(*b).to_f32()).collect()
}

fn parse(bytes: &[u8]) -> Result<Objects, String> {
    let damaged = |error: safetensors::SafeTensorError| format!("no file of objects: {error}");
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
    let tensors = Tensors(SafeTensors::deserialize(bytes).map_err(damaged)?);
    let entry = |key: &str| {
        let entries = header.metadata().as_ref();
        let value = entries.and_then(|entries| entries.get(key));
        value.ok_or_else(|| format!("has no metadata {key:?}"))
    };
    let version = entry("cosplat.objects")?;
    if version != VERSION {
        return Err(format!("has version {version}, expected {VERSION}"));
    }
    let hash = entry("asset_hash")?;
    let asset_hash = u64::from_str_radix(hash, 16)
        .map_err(|_| format!("asset_hash is {hash:?}, expected 16 hexadecimal digits"))?;
    let names: Vec<String> = serde_json::from_str(entry("names")?)
        .map_err(|error| format!("names are no list of texts: {error}"))?;
    let mut taken = BTreeSet::new();
    if let Some(twice) = names.iter().find(|n| !n.is_empty() && !taken.insert(*n)) {
        return Err(format!("has the name {twice:?} twice, expected each once"));
    }
    let (object, rows) = tensors.required("object", Dtype::I32)?;
    let (confidence, also) = tensors.required("confidence", Dtype::F16)?;
    if rows != also {
        return Err(format!("confidence has {also} rows, expected {rows}"));
    }
    let labels = Labels {
        object: ints(object),
        confidence: halves(confidence),
    };
    let most = names.len() as i32;
    if let Some(stranger) = labels.object.iter().find(|o| !(-1..most).contains(*o)) {
        return Err(format!(
            "names object {stranger}, expected -1 to {}",
            most - 1
        ));
    }
    if let Some(bad) = labels.confidence.iter().find(|c| !(0.0..=1.0).contains(*c)) {
        return Err(format!("has the confidence {bad}, expected 0 to 1"));
    }
    let parent = match tensors.get("parent", Dtype::I32, 1)? {
        Some((bytes, _)) => ints(bytes),
        None => Vec::new(),
    };
    check_tree(&parent, names.len())?;
    Ok(Objects {
        asset_hash,
        labels,
        feature: tensors.vectors("feature", Dtype::F16, rows)?,
        object_feature: tensors.vectors("object_feature", Dtype::F32, names.len())?,
        parent,
        names,
        made: entry("made").cloned().unwrap_or_default(),
    })
}

/// Whether every object is at last part of one that is part of none.
fn check_tree(parent: &[i32], objects: usize) -> Result<(), String> {
    if parent.is_empty() {
        return Ok(());
    }
    if parent.len() != objects {
        return Err(format!(
            "parent has {} rows, expected {objects}",
            parent.len()
        ));
    }
    let most = objects as i32;
    if let Some(stranger) = parent.iter().find(|p| !(-1..most).contains(*p)) {
        return Err(format!(
            "has parent {stranger}, expected -1 to {}",
            most - 1
        ));
    }
    // The walk that each object was last met by; a walk that meets itself goes round.
    let mut walk = vec![usize::MAX; objects];
    for first in 0..objects {
        let mut at = first;
        while walk[at] == usize::MAX {
            walk[at] = first;
            match usize::try_from(parent[at]) {
                Ok(next) => at = next,
                Err(_) => break,
            }
            if walk[at] == first {
                return Err(format!("object {at} is a part of itself"));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn objects() -> Objects {
        Objects {
            asset_hash: 0x1234_5678_9abc_def0,
            names: vec!["vase".into(), "a \"table\"".into(), "handle".into()],
            parent: vec![-1, -1, 0],
            labels: Labels {
                object: vec![0, 1, -1, 2],
                confidence: vec![1.0, 0.5, 0.0, 0.25],
            },
            feature: Some(Vectors {
                dim: 2,
                value: vec![1.0, 0.5, 0.25, -1.0, 0.0, 0.0, 3.0, 4.0],
            }),
            object_feature: Some(Vectors {
                dim: 1,
                value: vec![0.1, 0.2, 0.3],
            }),
            made: "by hand".into(),
        }
    }

    #[test]
    fn objects_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.objects.safetensors");
        objects().write(&path).expect("written");
        let again = Objects::read(&path, objects().asset_hash, 4).expect("readable");
        assert_eq!(again, objects());
        let other = Objects::read(&path, 1, 4)
            .expect_err("another asset")
            .to_string();
        assert!(
            other.contains("123456789abcdef0") && other.contains("0000000000000001"),
            "{other}"
        );
        let other = Objects::read(&path, objects().asset_hash, 5).expect_err("another asset");
        assert!(
            other.to_string().contains("of 4 rows") && other.to_string().contains("has 5"),
            "{other}"
        );
    }

    #[test]
    fn a_name_stands_for_its_parts_too() {
        let of = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
            objects().named(&names).map_err(str::to_owned)
        };
        assert_eq!(of(&["vase"]), Ok(vec![true, false, true]));
        assert_eq!(of(&["handle"]), Ok(vec![false, false, true]));
        assert_eq!(of(&["vase", "lid"]), Err("lid".into()));
        assert_eq!(of(&[""]), Err(String::new()));
        assert_eq!((objects().root_of(2), objects().root_of(1)), (0, 1));
    }

    #[test]
    fn rows_that_cannot_be_read_belong_to_nothing() {
        let rows = [1, 3, 4, 6];
        let spread = objects().spread(&rows, 7);
        assert_eq!(spread.labels.object, [-1, 0, -1, 1, -1, -1, 2]);
        assert_eq!(spread.subset(&rows), objects());
    }

    #[test]
    fn what_makes_no_sense_is_refused_in_a_sentence() {
        let refused = |change: &dyn Fn(&mut Objects), words: &str| {
            let mut objects = objects();
            change(&mut objects);
            let bytes = objects.to_bytes().expect("bytes");
            let error = Objects::parse_any("a", &bytes)
                .expect_err(words)
                .to_string();
            assert!(error.contains(words), "{error}");
        };
        refused(
            &|o| o.labels.object[2] = 3,
            "names object 3, expected -1 to 2",
        );
        refused(&|o| o.parent = vec![2, -1, 0], "is a part of itself");
        refused(&|o| o.parent = vec![0, -1, -1], "is a part of itself");
        refused(&|o| o.parent[0] = 7, "has parent 7");
        refused(&|o| o.names[2] = "vase".into(), "\"vase\" twice");
        refused(&|o| o.labels.confidence[0] = f32::NAN, "confidence NaN");
        refused(
            &|o| o.object_feature.as_mut().expect("vectors").value[1] = f32::NAN,
            "object_feature has NaN at 1",
        );
    }

    #[test]
    fn damaged_files_are_refused_and_never_panic() {
        let whole = objects().to_bytes().expect("bytes");
        for length in 0..whole.len() {
            assert!(
                Objects::parse_any("a", &whole[..length]).is_err(),
                "{length} bytes"
            );
        }
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x55;
            // Names, confidences and words may differ; an index may not leave the list.
            if let Ok(read) = Objects::parse_any("a", &bytes) {
                let most = read.names.len() as i32;
                assert!(read.labels.object.iter().all(|o| (-1..most).contains(o)));
            }
        }
    }
}
