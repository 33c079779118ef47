//! The scene blocks: published once, kept for late joiners.

use std::fmt::Debug;

use bytemuck::Pod;
use iceoryx2::{node::Node, prelude::ZeroCopySend};

use super::{
    CreateError,
    monitor::Port,
    publish::{copy_and_send, publisher},
};
use crate::{
    Service,
    schema::{GaussianRest, ObjectInfo, SceneFile, SceneHeader},
    session::{self, SessionName, Stream},
};

/// Everything that stays constant, as it is published.
#[derive(Clone, Copy, Debug)]
pub struct SceneBlocks<'a> {
    /// Header of every block; `epoch`, `gaussian_count` and `object_count` are filled in.
    pub header: SceneHeader,
    /// Gaussians at rest.
    pub gaussians: &'a [GaussianRest],
    /// Spherical harmonics `[gaussian][coefficient][rgb]`, `(sh_degree + 1)^2` coefficients.
    pub sh: &'a [f32],
    /// Object table.
    pub objects: &'a [ObjectInfo],
    /// Semantic features `[gaussian][feature_dim]`; empty when `feature_dim` is 0.
    pub features: &'a [f32],
    /// Text of the scene file.
    pub source: &'a str,
    /// The files that were read beside it.
    pub files: &'a [SceneFile],
}

impl SceneBlocks<'_> {
    /// Bytes of all blocks.
    pub(super) fn bytes(&self) -> u64 {
        let parts = [
            size_of_val(self.gaussians),
            size_of_val(self.sh),
            size_of_val(self.objects),
            size_of_val(self.features),
            self.source.len(),
            size_of_val(self.files),
        ];
        parts.iter().sum::<usize>() as u64
    }

    /// Checks the lengths against the header.
    fn check(&self) -> Result<(), CreateError> {
        let count = self.gaussians.len();
        let expected = [
            (
                "spherical-harmonics values",
                self.sh.len(),
                count * (self.header.sh_degree as usize + 1).pow(2) * 3,
            ),
            (
                "feature values",
                self.features.len(),
                count * self.header.feature_dim as usize,
            ),
        ];
        for (what, actual, expected) in expected {
            if actual != expected {
                return Err(CreateError::Transport {
                    what: "publish the scene",
                    reason: format!("{actual} {what} for {count} Gaussians, expected {expected}"),
                });
            }
        }
        Ok(())
    }

    /// Publishes every block and returns the publishers, which hold the memory.
    pub(super) fn publish(
        &self,
        node: &Node<Service>,
        session: &SessionName,
        epoch: u64,
    ) -> Result<Vec<Port>, CreateError> {
        self.check()?;
        let header = SceneHeader {
            epoch,
            gaussian_count: self.gaussians.len() as u32,
            object_count: self.objects.len() as u32,
            reserved: 0,
            ..self.header
        };
        let mut ports = vec![
            block(
                node,
                session,
                session::SCENE_GAUSSIANS,
                header,
                self.gaussians,
            )?,
            block(node, session, session::SCENE_SH, header, self.sh)?,
            block(node, session, session::SCENE_OBJECTS, header, self.objects)?,
            block(
                node,
                session,
                session::SCENE_SOURCE,
                header,
                self.source.as_bytes(),
            )?,
            block(node, session, session::SCENE_FILES, header, self.files)?,
        ];
        if header.feature_dim > 0 {
            ports.push(block(
                node,
                session,
                session::SCENE_FEATURES,
                header,
                self.features,
            )?);
        }
        Ok(ports)
    }
}

/// One publisher per block and publication: its only chunk stays in the history.
fn block<T>(
    node: &Node<Service>,
    session: &SessionName,
    stream: Stream,
    header: SceneHeader,
    items: &[T],
) -> Result<Port, CreateError>
where
    T: Pod + Debug + ZeroCopySend + Send + Sync + 'static,
{
    let port = publisher::<T, SceneHeader>(node, session, stream, items.len(), 1, 1)?;
    copy_and_send(&port, stream.name, items.len(), header, items).map_err(|error| {
        CreateError::Transport {
            what: "publish the scene",
            reason: error.to_string(),
        }
    })?;
    Ok(port)
}
