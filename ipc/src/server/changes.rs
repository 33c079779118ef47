//! `changes`: made when somebody first reads it, complete for whoever joins.

use std::sync::Arc;

use bytemuck::Zeroable;
use iceoryx2::{
    identifiers::UniqueSubscriberId,
    node::Node,
    port::{LoanError, update_connections::UpdateConnections},
    prelude::{CallbackProgression, PortFactory},
    sample_mut::SampleMut,
};

use super::{CreateError, LoanRefused, PublishError, monitor::Port, publish::Publisher};
use crate::{
    Service, monotonic_ns,
    schema::{ChangeSlot, ChangesHeader, GaussianState, ObjectChange, row_slots},
    server::publish::publisher,
    session::{self, CHANGES, PubSub, SessionName},
    shm,
};

/// Messages that are worth having: one being written, and some for a recorder's queue.
const FEWEST_SLOTS: usize = 4;
/// Memory that is left to others [byte].
const SPARE_BYTES: u64 = 16 << 20;

/// Who reads `changes`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangesReaders {
    /// Nobody.
    None,
    /// Those of before.
    Same,
    /// Somebody who needs a complete message.
    New,
}

/// The publishing end of `changes`.
pub(super) struct ChangesPort {
    service: PubSub<ChangeSlot, ChangesHeader>,
    readers: Vec<UniqueSubscriberId>,
    publisher: Option<Arc<Publisher<ChangeSlot, ChangesHeader>>>,
    /// Whether there was no memory; it was told.
    has_failed: bool,
    /// Slots of a message at most.
    max_len: usize,
    /// Messages in the pool at most.
    slots: usize,
}

impl ChangesPort {
    pub fn create(
        node: &Node<Service>,
        session: &SessionName,
        (objects, gaussians): (usize, usize),
        slots: usize,
    ) -> Result<Self, CreateError> {
        let service = session::pub_sub(node, session, CHANGES, true)
            .map_err(|error| CreateError::open(session.as_str(), "make a service", error))?;
        Ok(Self {
            service,
            readers: vec![],
            publisher: None,
            has_failed: false,
            max_len: row_slots(objects) + gaussians,
            slots,
        })
    }

    /// Who reads now.
    pub fn readers(&mut self) -> ChangesReaders {
        let mut now = Vec::new();
        self.service.dynamic_config().list_subscribers(|reader| {
            now.push(reader.subscriber_id);
            CallbackProgression::Continue
        });
        let is_new = now.iter().any(|reader| !self.readers.contains(reader));
        self.readers = now;
        match (self.readers.is_empty(), is_new) {
            (true, _) => ChangesReaders::None,
            (false, true) => ChangesReaders::New,
            (false, false) => ChangesReaders::Same,
        }
    }

    /// Sets memory aside, unless there is some already; a new publisher is to be looked after.
    pub fn open(
        &mut self,
        node: &Node<Service>,
        session: &SessionName,
    ) -> Result<Option<Port>, CreateError> {
        if self.publisher.is_some() {
            return Ok(None);
        }
        let bytes = (self.max_len * size_of::<ChangeSlot>()) as u64 + 256;
        let available = shm::available_bytes().saturating_sub(SPARE_BYTES);
        let possible = (available / bytes) as usize;
        if possible < FEWEST_SLOTS {
            return Err(CreateError::ShmTooSmall {
                required: FEWEST_SLOTS as u64 * bytes + SPARE_BYTES,
                available: available + SPARE_BYTES,
            });
        }
        let slots = possible.min(self.slots.max(FEWEST_SLOTS));
        let port = publisher(node, session, CHANGES, self.max_len, slots, 1)?;
        self.slots = slots;
        self.publisher = Some(port.clone());
        Ok(Some(port))
    }

    /// Whether there was no memory for a publisher.
    pub fn has_failed(&self) -> bool {
        self.has_failed
    }

    /// Says once that there is no memory for a publisher.
    pub fn fail(&mut self, error: &CreateError) {
        if !std::mem::replace(&mut self.has_failed, true) {
            tracing::warn!("readers of changes get nothing: {error}");
        }
    }

    /// Memory for a message.
    pub fn loan(
        &self,
        objects: usize,
        gaussians: usize,
        epoch: u64,
    ) -> Result<ChangesLoan, LoanRefused> {
        let count = row_slots(objects) + gaussians;
        let in_use = LoanRefused::PoolInUse { slots: self.slots };
        let Some(publisher) = &self.publisher else {
            return Err(in_use);
        };
        if count > self.max_len {
            return Err(LoanRefused::TooLarge {
                count,
                max: self.max_len,
            });
        }
        let loan = || publisher.loan_slice_uninit(count);
        let sample = loan().or_else(|_| {
            // Readers that left give back what they held when connections are looked at.
            let _ = publisher.update_connections();
            loan()
        });
        let sample = sample.map_err(|error| match error {
            LoanError::OutOfMemory | LoanError::ExceedsMaxLoans => in_use,
            other => LoanRefused::Transport(other),
        })?;
        // SAFETY: `publisher` had the system set all of the pool aside, zeroed, and a message of before was written whole.
        // Every bit pattern is a `ChangeSlot`.
        let sample = unsafe { sample.assume_init() };
        Ok(ChangesLoan {
            sample,
            objects,
            epoch,
        })
    }
}

/// Memory of one `changes` message. Dropping it gives the memory back unpublished.
pub struct ChangesLoan {
    sample: SampleMut<Service, [ChangeSlot], ChangesHeader>,
    objects: usize,
    epoch: u64,
}

impl ChangesLoan {
    /// Rows and Gaussians. They hold leftovers of an older message: write all.
    pub fn parts_mut(&mut self) -> (&mut [ObjectChange], &mut [GaussianState]) {
        let slots = self.sample.payload_mut();
        let (rows, gaussians) = slots.split_at_mut(row_slots(self.objects));
        rows.fill(ChangeSlot::zeroed());
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(rows);
        let rows = &mut bytes[..self.objects * size_of::<ObjectChange>()];
        (
            bytemuck::cast_slice_mut(rows),
            bytemuck::cast_slice_mut(gaussians),
        )
    }

    /// Publishes the message; `epoch`, `count`, `objects` and `publish_ns` are filled in.
    pub(super) fn send(mut self, header: &ChangesHeader) -> Result<(), PublishError> {
        *self.sample.user_header_mut() = ChangesHeader {
            epoch: self.epoch,
            count: self.sample.payload().len() as u32,
            objects: self.objects as u32,
            publish_ns: monotonic_ns(),
            reserved: 0,
            ..*header
        };
        let sent = self.sample.send().map(|_| ());
        sent.map_err(|error| PublishError::Transport {
            stream: CHANGES.name,
            reason: error.to_string(),
        })
    }
}
