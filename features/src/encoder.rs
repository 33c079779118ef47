//! An image encoder: a picture to a map of features.

use std::path::Path;

use cosplat_semantics::{dense::DenseMap, objects::Vectors};

use crate::{
    FeaturesError,
    config::{Config, ImageConfig},
    network::{Network, Tensor, Worker},
    picture::Picture,
};

/// An image encoder.
pub struct Encoder {
    config: ImageConfig,
    /// The network.
    pub network: Network,
}

impl Encoder {
    /// Loads the encoder of a TOML file.
    ///
    /// # Errors
    /// When the file is of another kind, or its network cannot be loaded.
    pub fn load(path: &Path) -> Result<Self, FeaturesError> {
        let config = match Config::read(path)? {
            Config::Image(config) => config,
            other => {
                let why = format!("kind is {:?}, expected \"image\"", other.kind());
                return Err(FeaturesError::config(path, why));
            }
        };
        let input = config.input.as_deref();
        let network = Network::load(path, &config.network, input, &[&config.output])?;
        Ok(Self { config, network })
    }

    /// The map of a picture: a vector for each patch, from the upper left to the lower right.
    ///
    /// # Errors
    /// When the network does not run, or gives another shape.
    pub fn map(&self, worker: &Worker, picture: &Picture) -> Result<DenseMap, FeaturesError> {
        let [width, height] = self.config.picture.size;
        let shown = picture.shown(&self.config.picture);
        let input = self.network.input(&[1, 3, height, width], shown)?;
        let mut found = self.network.run(worker, input)?;
        let tensor = found.swap_remove(0);
        let map = self.map_of(tensor);
        let map = map.map_err(|why| self.network.first(why))?;
        let size = [map.columns, map.rows];
        let covered = self.config.picture.covered_of(picture.size(), size);
        Ok(cut(map, covered))
    }

    fn map_of(&self, tensor: Tensor) -> Result<DenseMap, String> {
        let shape = tensor.shape;
        match (shape.as_slice(), self.config.patch) {
            (&[1, dim, rows, columns], _) if dim * rows * columns > 0 => {
                let cells = rows * columns;
                let at = |n: usize| tensor.value[n % dim * cells + n / dim];
                Ok(DenseMap {
                    rows,
                    columns,
                    vectors: Vectors {
                        dim,
                        value: (0..cells * dim).map(at).collect(),
                    },
                })
            }
            (&[1, tokens, dim], Some(patch)) if dim > 0 => {
                let [columns, rows] = self.config.picture.size.map(|side| side / patch);
                let cells = rows * columns;
                // Tokens of the whole picture and registers come first.
                let before = tokens.checked_sub(cells).ok_or_else(|| {
                    format!("has {tokens} tokens, expected at least {rows} x {columns} patches")
                })?;
                Ok(DenseMap {
                    rows,
                    columns,
                    vectors: Vectors {
                        dim,
                        value: tensor.value[before * dim..].to_vec(),
                    },
                })
            }
            (&[1, _, _], None) => Err(format!("has shape {shape:?}, for which a patch is needed")),
            _ => Err(format!(
                "has shape {shape:?}, expected [1, tokens, values] or [1, values, rows, columns]"
            )),
        }
    }
}

/// The upper left of a map.
fn cut(map: DenseMap, [columns, rows]: [usize; 2]) -> DenseMap {
    let dim = map.vectors.dim;
    let lines = map.vectors.value.chunks_exact(map.columns * dim);
    let lines = lines.take(rows).map(|line| &line[..columns * dim]);
    DenseMap {
        rows,
        columns,
        vectors: Vectors {
            dim,
            value: lines.collect::<Vec<_>>().concat(),
        },
    }
}
