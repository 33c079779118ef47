//! Maps of features: a vector for each cell of a picture, as an image encoder makes them.
//!
//! A map is a `.npy` or a `.safetensors` with one tensor of the picture's name, `[rows][columns][values]`; its cells cover the
//! whole picture. A cell is a mask with a vector, so that maps go to Gaussians by the weights that masks go by: the mean over
//! pixels of `w_ip` times the vector there (the closed form of [`lift`](mod@crate::lift)).

use std::path::{Path, PathBuf};

use safetensors::{Dtype, SafeTensors};

use crate::{Evidence, MaskMap, SemanticsError, lift::Labels, npy, objects::Vectors};

/// Most cells along a side; the means of more are taken. A Gaussian keeps a sum for each cell that it covers.
const MOST_CELLS: usize = 128;
/// Most values of a vector, as many as the largest encoders have.
const MOST_VALUES: usize = 8192;
/// Values of all Gaussians that are summed at once; views are gone through again for the next ones.
const BLOCK: usize = 64;

/// Ends of torch files of maps, as nerfstudio and Feature 3DGS have them: found, to be refused with the line that converts.
const TORCH: [&str; 3] = [".pt", ".pth", "_fmap_CxHxW.pt"];

/// Features of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseMap {
    /// Cells from top to bottom.
    pub rows: usize,
    /// Cells from left to right.
    pub columns: usize,
    /// `[rows][columns]` vectors.
    pub vectors: Vectors,
}

/// Where the map of a view is, if there is one.
pub fn find(folder: &Path, view: &str) -> Option<PathBuf> {
    let file = |end: &str| Some(folder.join(format!("{view}{end}"))).filter(|path| path.is_file());
    let readable = file(".npy").or_else(|| file(".safetensors"));
    readable.or_else(|| TORCH.into_iter().find_map(file))
}

/// Reads a map; one of more than 128 cells along a side is made smaller.
///
/// # Errors
/// When the file cannot be read or is no such array.
pub fn read(path: &Path) -> Result<DenseMap, SemanticsError> {
    if path.extension().is_some_and(|e| e == "pt" || e == "pth") {
        return Err(SemanticsError::format(
            path,
            "a torch file may run programs when it is read; convert it, values first as they mostly are: \
             python -c \"import sys,torch,numpy; \
             numpy.save(sys.argv[2],torch.load(sys.argv[1],weights_only=True).float().cpu().movedim(0,-1).numpy())\" \
             PICTURE.pt PICTURE.npy",
        ));
    }
    let bytes = SemanticsError::content(path)?;
    parse(path, &bytes)
}

/// As [`read`], from the bytes of the file; its name says which of the two formats they have.
///
/// # Errors
/// When they are no such array.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<DenseMap, SemanticsError> {
    let is_array = path.extension().is_some_and(|e| e == "npy");
    let array = match is_array {
        true => npy::floats(bytes),
        false => tensor(bytes),
    };
    let map = array.and_then(DenseMap::new);
    map.map(DenseMap::coarse)
        .map_err(|why| SemanticsError::format(path, why))
}

/// Writes a map as `VIEW.npy`, float32.
///
/// # Errors
/// When it cannot be written.
pub fn write(folder: &Path, view: &str, map: &DenseMap) -> Result<(), SemanticsError> {
    let path = folder.join(format!("{view}.npy"));
    cosplat_files::write(&path, map.to_bytes()).map_err(SemanticsError::write(&path))
}

/// The one tensor of a file of safetensors.
fn tensor(bytes: &[u8]) -> Result<npy::Array<f32>, String> {
    let file = SafeTensors::deserialize(bytes)
        .map_err(|error| format!("no safetensors file of a map: {error}"))?;
    let tensors = file.tensors();
    let [(name, tensor)] = tensors.as_slice() else {
        return Err(format!("has {} tensors, expected one", tensors.len()));
    };
    let data = tensor.data();
    let value: Vec<f32> = match tensor.dtype() {
        Dtype::F32 => {
            let values = data.as_chunks::<4>().0.iter();
            values.map(|b| f32::from_le_bytes(*b)).collect()
        }
        Dtype::F16 => {
            let values = data.as_chunks::<2>().0.iter();
            values
                .map(|b| half::f16::from_le_bytes(*b).to_f32())
                .collect()
        }
        kind => return Err(format!("{name:?} is {kind:?}, expected F32 or F16")),
    };
    if let Some(at) = value.iter().position(|v| !v.is_finite()) {
        return Err(format!(
            "has {} at {at}, expected finite numbers",
            value[at]
        ));
    }
    Ok(npy::Array {
        shape: tensor.shape().to_vec(),
        value,
    })
}

impl DenseMap {
    /// A map of an array `[rows][columns][values]`.
    ///
    /// # Errors
    /// When it has another shape, in words.
    pub fn new(array: npy::Array<f32>) -> Result<Self, String> {
        let of = array.shape;
        match *of.as_slice() {
            [rows, columns, dim] if rows > 0 && columns > 0 && (1..=MOST_VALUES).contains(&dim) => {
                Ok(Self {
                    rows,
                    columns,
                    vectors: Vectors {
                        dim,
                        value: array.value,
                    },
                })
            }
            // Torch has the values first; nothing in a shape says which axis they are.
            _ => Err(format!(
                "has shape {of:?}, expected [rows, columns, values] with at most {MOST_VALUES} values; \
                 numpy.moveaxis(a, 0, -1) brings values that come first to the end"
            )),
        }
    }

    /// The map as a `.npy`, float32.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        npy::write_floats(&npy::Array {
            shape: vec![self.rows, self.columns, self.vectors.dim],
            value: self.vectors.value.clone(),
        })
    }

    /// The map with at most [`MOST_CELLS`] cells along a side: means over the cells that each stands for.
    fn coarse(self) -> Self {
        let (rows, columns) = (self.rows.min(MOST_CELLS), self.columns.min(MOST_CELLS));
        if (rows, columns) == (self.rows, self.columns) {
            return self;
        }
        let dim = self.vectors.dim;
        let span = |k: usize, of: usize, from: usize| k * from / of..(k + 1) * from / of;
        let mut value = Vec::with_capacity(rows * columns * dim);
        for (row, column) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
            let mut sum = vec![0.0f64; dim];
            let [down, across] = [
                span(row, rows, self.rows),
                span(column, columns, self.columns),
            ];
            let count = (down.len() * across.len()) as f64;
            for cell in down.flat_map(|r| across.clone().map(move |c| r * self.columns + c)) {
                let values = self.vectors.of(cell).iter();
                sum.iter_mut()
                    .zip(values)
                    .for_each(|(sum, v)| *sum += f64::from(*v));
            }
            value.extend(sum.iter().map(|sum| (sum / count) as f32));
        }
        Self {
            rows,
            columns,
            vectors: Vectors { dim, value },
        }
    }

    /// Every cell as a mask, whose vector has the mask's number.
    #[must_use]
    pub fn cells(&self) -> MaskMap {
        MaskMap {
            width: self.columns,
            height: self.rows,
            mask: (0..(self.rows * self.columns) as i32).collect(),
        }
    }
}

/// The closed form for a vector of `dim` values: of every Gaussian the mean, by weight, of the vectors of the masks that it lies
/// in. One that no view shows has the vector of its object. `view` gives the evidence of a view and the vectors of its masks; it
/// is asked again for every 64 values, so that sums of so many are in memory at once. Vectors of another length do not count.
///
/// # Errors
/// Those of `view`.
pub fn of_gaussians<E>(
    gaussians: usize,
    dim: usize,
    views: usize,
    mut view: impl FnMut(usize) -> Result<(Vec<Evidence>, Vectors), E>,
    labels: &Labels,
    of_objects: &Vectors,
) -> Result<Vectors, E> {
    let mut value = vec![0.0; gaussians * dim];
    for start in (0..dim).step_by(BLOCK) {
        let block = BLOCK.min(dim - start);
        let mut sum = vec![0.0f32; gaussians * block];
        let mut seen = vec![0.0f32; gaussians];
        for n in 0..views {
            let (said, vectors) = view(n)?;
            if vectors.dim != dim {
                continue;
            }
            for e in said.iter().filter(|e| e.mask >= 0) {
                let of = e.gaussian as usize;
                let vector = &vectors.of(e.mask as usize)[start..start + block];
                seen[of] += e.weight;
                let sums = &mut sum[of * block..(of + 1) * block];
                sums.iter_mut()
                    .zip(vector)
                    .for_each(|(sum, v)| *sum += e.weight * v);
            }
        }
        for n in 0..gaussians {
            let out = &mut value[n * dim + start..n * dim + start + block];
            let sums = &sum[n * block..(n + 1) * block];
            if seen[n] > 0.0 {
                out.iter_mut()
                    .zip(sums)
                    .for_each(|(out, s)| *out = s / seen[n]);
            } else if let Ok(object) = usize::try_from(labels.object[n]) {
                out.copy_from_slice(&of_objects.of(object)[start..start + block]);
            }
        }
    }
    Ok(Vectors { dim, value })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(rows: usize, columns: usize, value: Vec<f32>) -> DenseMap {
        let dim = value.len() / (rows * columns);
        DenseMap::new(npy::Array {
            shape: vec![rows, columns, dim],
            value,
        })
        .expect("a map")
    }

    #[test]
    fn maps_come_back_and_large_ones_are_means() {
        let folder = tempfile::tempdir().expect("a folder");
        let small = map(2, 1, vec![1.0, 2.0, 3.0, 4.0]);
        write(folder.path(), "a", &small).expect("written");
        let path = find(folder.path(), "a").expect("a file");
        assert_eq!(read(&path).expect("a map"), small);
        let values: Vec<f32> = (0..512).map(|n| n as f32).collect();
        write(folder.path(), "b", &map(1, 256, values)).expect("written");
        let found = read(&folder.path().join("b.npy")).expect("a map");
        // Pairs of what is beside each other: 256 cells of two values to 128.
        assert_eq!((found.rows, found.columns), (1, MOST_CELLS));
        assert_eq!(found.vectors.of(127), [509.0, 510.0]);
    }

    #[test]
    fn tensors_are_maps_or_refused_in_a_sentence() {
        let file = |kind, shape: Vec<usize>, bytes: &[u8]| {
            let view = safetensors::tensor::TensorView::new(kind, shape, bytes).expect("fits");
            safetensors::serialize([("clip", view)], None).expect("bytes")
        };
        let halves: Vec<u8> = [1.5f32, -2.0]
            .iter()
            .flat_map(|v| half::f16::from_f32(*v).to_le_bytes())
            .collect();
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.safetensors");
        std::fs::write(&path, file(Dtype::F16, vec![1, 1, 2], &halves)).expect("written");
        assert_eq!(find(folder.path(), "a").as_deref(), Some(path.as_path()));
        assert_eq!(read(&path).expect("a map").vectors.value, [1.5, -2.0]);
        let refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("written");
            read(&path).expect_err("refused").to_string()
        };
        assert!(refused(&file(Dtype::F16, vec![1, 2], &halves)).contains("moveaxis"));
        assert!(refused(&file(Dtype::F16, vec![0, 1, 2], &[])).contains("moveaxis"));
        assert!(refused(&file(Dtype::I16, vec![1, 1, 2], &halves)).contains("expected F32"));
        let nan = f32::NAN.to_le_bytes();
        assert!(refused(&file(Dtype::F32, vec![1, 1, 1], &nan)).contains("finite"));
        assert!(refused(b"\x80\x02pickle").contains("safetensors"));
        let none =
            safetensors::serialize(Vec::<(&str, safetensors::tensor::TensorView)>::new(), None);
        assert!(refused(&none.expect("bytes")).contains("0 tensors"));
    }

    #[test]
    fn torch_files_are_found_and_refused_with_what_converts_them() {
        let folder = tempfile::tempdir().expect("a folder");
        for end in TORCH {
            let path = folder.path().join(format!("a{end}"));
            std::fs::write(&path, b"PK").expect("written");
            let found = find(folder.path(), "a").expect("a file");
            assert_eq!(found, path);
            let refused = read(&found).expect_err("refused").to_string();
            assert!(refused.contains("torch.load(sys.argv[1],weights_only=True)"));
            std::fs::remove_file(&path).expect("removed");
        }
        // What can be read comes first.
        std::fs::write(folder.path().join("a.pt"), b"PK").expect("written");
        write(folder.path(), "a", &map(1, 1, vec![1.0])).expect("written");
        assert!(read(&find(folder.path(), "a").expect("a file")).is_ok());
    }

    #[test]
    fn gaussians_have_the_weighted_mean_of_the_cells() {
        // More values than a block: views are asked twice.
        let dim = BLOCK + 1;
        let vectors = Vectors {
            dim,
            value: (0..2 * dim).map(|n| (n / dim) as f32 * 4.0).collect(),
        };
        let said = |gaussian, mask, weight| Evidence {
            gaussian,
            mask,
            weight,
        };
        let view = [said(0, 0, 1.0), said(0, 1, 3.0), said(1, -1, 5.0)];
        let labels = Labels {
            object: vec![0, 0, -1],
            confidence: vec![1.0; 3],
        };
        let of_objects = Vectors {
            dim,
            value: vec![7.0; dim],
        };
        let mut asked = 0;
        let found = of_gaussians(
            3,
            dim,
            2,
            |_| {
                asked += 1;
                Ok::<_, ()>((view.to_vec(), vectors.clone()))
            },
            &labels,
            &of_objects,
        );
        let found = found.expect("vectors");
        assert_eq!((found.dim, asked), (dim, 4));
        assert!(found.of(0).iter().all(|v| *v == 3.0));
        assert!(found.of(1).iter().all(|v| *v == 7.0), "its object's");
        assert!(found.of(2).iter().all(|v| *v == 0.0));
    }
}
