//! A frame under construction, in the memory that readers will map.

use std::sync::Arc;

use bytemuck::Zeroable;
use iceoryx2::{port::LoanError, port::notifier::Notifier, sample_mut::SampleMut};

use super::{CreateError, LoanRefused, PublishError, notify, publish::Publisher};
use crate::{
    Service, monotonic_ns,
    schema::{FrameHeader, GaussianState},
    session,
};

/// Memory of one frame. Dropping it gives the memory back unpublished.
pub struct FrameLoan {
    sample: SampleMut<Service, [GaussianState], FrameHeader>,
    notifier: Arc<Notifier<Service>>,
    epoch: u64,
}

impl FrameLoan {
    pub(super) fn new(
        publisher: &Publisher<GaussianState, FrameHeader>,
        notifier: &Arc<Notifier<Service>>,
        count: usize,
        epoch: u64,
        slots: usize,
    ) -> Result<Self, LoanRefused> {
        let sample = publisher
            .loan_slice_uninit(count)
            .map_err(|error| match error {
                LoanError::OutOfMemory | LoanError::ExceedsMaxLoans => {
                    LoanRefused::PoolInUse { slots }
                }
                other => LoanRefused::Transport(other),
            })?;
        // SAFETY: `touch_every_page` and `pool::reserve` ran on this publisher, so every byte of the pool was
        // zeroed by the system or written by a former frame, and every bit pattern is a `GaussianState`.
        let sample = unsafe { sample.assume_init() };
        Ok(Self {
            sample,
            notifier: notifier.clone(),
            epoch,
        })
    }

    /// The Gaussians, one cache line each, 64-byte aligned. They hold leftovers of an older frame: write all.
    pub fn gaussians_mut(&mut self) -> &mut [GaussianState] {
        self.sample.payload_mut()
    }

    /// Tells the slots of the pool apart: what was written into one is there when it is loaned again.
    pub fn slot(&self) -> usize {
        self.sample.payload().as_ptr() as usize
    }

    /// Publishes the frame and wakes readers; `epoch`, `count` and `publish_ns` are filled in. Returns the
    /// number of readers.
    pub fn send(mut self, header: &FrameHeader) -> Result<usize, PublishError> {
        *self.sample.user_header_mut() = FrameHeader {
            epoch: self.epoch,
            count: self.sample.payload().len() as u32,
            publish_ns: monotonic_ns(),
            reserved: [0; 5],
            ..*header
        };
        let readers = self
            .sample
            .send()
            .map_err(|error| PublishError::Transport {
                stream: session::FRAME.name,
                reason: error.to_string(),
            })?;
        notify(&self.notifier);
        Ok(readers)
    }
}

/// Maps the whole pool into this process, so that no step pays for it.
pub(super) fn touch_every_page(
    publisher: &Publisher<GaussianState, FrameHeader>,
    count: usize,
    slots: usize,
) -> Result<(), CreateError> {
    const PER_PAGE: usize = 4096 / size_of::<GaussianState>();
    let mut loans = Vec::with_capacity(slots);
    for _ in 0..slots {
        let mut loan =
            publisher
                .loan_slice_uninit(count)
                .map_err(|error| CreateError::Transport {
                    what: "prepare the frame pool",
                    reason: error.to_string(),
                })?;
        for slot in loan.payload_mut().iter_mut().step_by(PER_PAGE) {
            slot.write(GaussianState::zeroed());
        }
        loans.push(loan);
    }
    Ok(())
}
