//! Publishers with memory that is really there.

use std::{fmt::Debug, sync::Arc};

use bytemuck::Pod;
use iceoryx2::{node::Node, prelude::ZeroCopySend};

use super::{CreateError, PublishError, pool};
use crate::{
    Service,
    session::{self, SessionName, Stream},
};

pub(super) type Publisher<T, H> = iceoryx2::port::publisher::Publisher<Service, [T], H>;

/// A publisher of slices of up to `max_len` on `stream` with exactly `slots` chunks, all backed by memory.
pub(super) fn publisher<T, H>(
    node: &Node<Service>,
    session: &SessionName,
    stream: Stream,
    max_len: usize,
    slots: usize,
    loans: usize,
) -> Result<Arc<Publisher<T, H>>, CreateError>
where
    T: Debug + ZeroCopySend + 'static,
    H: Debug + ZeroCopySend + 'static,
{
    let service = session::pub_sub::<T, H>(node, session, stream, true)
        .map_err(|error| CreateError::open(session.as_str(), "make a service", error))?;
    let publisher = service
        .publisher_builder()
        .initial_max_slice_len(max_len.max(1))
        .max_loaned_samples(loans)
        .override_sample_preallocation(move |_| slots)
        .create()
        .map_err(|error| CreateError::Transport {
            what: "make a publisher",
            reason: format!("{}: {error}", stream.name),
        })?;
    pool::reserve(publisher.id().value())?;
    Ok(Arc::new(publisher))
}

/// Publishes a copy of `items`.
pub(super) fn copy_and_send<T, H>(
    publisher: &Publisher<T, H>,
    stream: &'static str,
    max: usize,
    header: H,
    items: &[T],
) -> Result<(), PublishError>
where
    T: Pod + Debug + ZeroCopySend,
    H: Debug + Default + ZeroCopySend,
{
    if items.len() > max {
        return Err(PublishError::TooMany {
            stream,
            count: items.len(),
            max,
        });
    }
    let failed = |reason: String| PublishError::Transport { stream, reason };
    let mut sample = publisher
        .loan_slice_uninit(items.len())
        .map_err(|error| failed(error.to_string()))?;
    *sample.user_header_mut() = header;
    sample
        .write_from_slice(items)
        .send()
        .map_err(|error| failed(error.to_string()))?;
    Ok(())
}
