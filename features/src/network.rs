//! An ONNX file, loaded and run.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use rten::{Model, NodeId, RunOptions, ThreadPool, Value};
use rten_tensor::Layout;
use xxhash_rust::xxh3::Xxh3;

use crate::FeaturesError;

/// A network with one input, and the outputs that are asked for.
pub struct Network {
    path: PathBuf,
    model: Model,
    input: NodeId,
    outputs: Vec<(String, NodeId)>,
    /// XXH3 of the TOML file and of the ONNX file.
    pub hash: u64,
}

/// What comes out of a network.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// All values, the last axis the fastest.
    pub value: Vec<f32>,
}

/// A thread that runs networks.
#[derive(Clone)]
pub struct Worker(Arc<ThreadPool>);

impl Default for Worker {
    fn default() -> Self {
        Self(Arc::new(ThreadPool::with_num_threads(1)))
    }
}

impl Network {
    /// Loads the network that `network` names beside the TOML file `config`.
    ///
    /// # Errors
    /// When it cannot be read or run, or has no such input or output.
    pub fn load(
        config: &Path,
        network: &Path,
        input: Option<&str>,
        outputs: &[&str],
    ) -> Result<Self, FeaturesError> {
        let path = config.with_file_name(network);
        let mut hash = Xxh3::new();
        for file in [config, &path] {
            hash.update(&std::fs::read(file).map_err(FeaturesError::read(file))?);
        }
        // By its path: weights beyond 2 GB lie in a file beside it.
        let model = Model::load_file(&path).map_err(|error| FeaturesError::Load {
            path: path.clone(),
            why: error.to_string(),
        })?;
        let find = |kind: &'static str, name: &str, ids: &[NodeId]| {
            let known = |id: &NodeId| Some((model.node_info(*id)?.name()?, *id));
            let all: Vec<(&str, NodeId)> = ids.iter().filter_map(known).collect();
            let found = all.iter().find(|(known, _)| *known == name);
            found.map(|(_, id)| *id).ok_or_else(|| FeaturesError::Name {
                path: path.clone(),
                kind,
                name: name.to_owned(),
                known: all.iter().map(|(name, _)| (*name).to_owned()).collect(),
            })
        };
        let input = match (input, model.input_ids().first()) {
            (Some(name), _) => find("input", name, model.input_ids())?,
            (None, Some(first)) => *first,
            (None, None) => find("input", "", &[])?,
        };
        let outputs = outputs.iter().map(|name| {
            let id = find("output", name, model.output_ids())?;
            Ok(((*name).to_owned(), id))
        });
        Ok(Self {
            outputs: outputs.collect::<Result<_, FeaturesError>>()?,
            hash: hash.digest(),
            path,
            model,
            input,
        })
    }

    /// What comes out where `input` goes in.
    ///
    /// # Errors
    /// When the network does not take it, or gives numbers of another kind or none that are finite.
    pub fn run(&self, worker: &Worker, input: Value) -> Result<Vec<Tensor>, FeaturesError> {
        let ids: Vec<NodeId> = self.outputs.iter().map(|(_, id)| *id).collect();
        let options = RunOptions::default().with_thread_pool(Some(worker.0.clone()));
        let inputs = vec![(self.input, input.into())];
        let found = self.model.run(inputs, &ids, Some(options));
        let found = found.map_err(|error| FeaturesError::Run {
            path: self.path.clone(),
            why: error.to_string(),
        })?;
        let outputs = self.outputs.iter().zip(found);
        outputs
            .map(|((name, _), value)| tensor(value).map_err(|why| self.output(name, why)))
            .collect()
    }

    /// An input of numbers of 32 bits with a fraction.
    ///
    /// # Errors
    /// When they are not as many as the shape says.
    pub fn input(&self, shape: &[usize], value: Vec<f32>) -> Result<Value, FeaturesError> {
        Value::from_shape(shape, value).map_err(|error| FeaturesError::Run {
            path: self.path.clone(),
            why: error.to_string(),
        })
    }

    /// An input of whole numbers: the runtime takes 32 bits for those of 64.
    ///
    /// # Errors
    /// When they are not as many as the shape says.
    pub fn whole(&self, shape: &[usize], value: Vec<i32>) -> Result<Value, FeaturesError> {
        Value::from_shape(shape, value).map_err(|error| FeaturesError::Run {
            path: self.path.clone(),
            why: error.to_string(),
        })
    }

    /// The first output, refused in words.
    pub(crate) fn first(&self, why: String) -> FeaturesError {
        let name = self.outputs.first().map_or("", |(name, _)| name.as_str());
        self.output(name, why)
    }

    /// An output, refused in words.
    pub(crate) fn output(&self, name: &str, why: String) -> FeaturesError {
        FeaturesError::Output {
            path: self.path.clone(),
            name: name.to_owned(),
            why,
        }
    }
}

fn tensor(value: Value) -> Result<Tensor, String> {
    let Value::FloatTensor(found) = value else {
        return Err(format!("is {:?}, expected float32", value.dtype()));
    };
    let shape = found.shape().to_vec();
    let value = found.into_data();
    match value.iter().position(|v| !v.is_finite()) {
        Some(at) => Err(format!(
            "has {} at {at}, expected finite numbers",
            value[at]
        )),
        None => Ok(Tensor { shape, value }),
    }
}
