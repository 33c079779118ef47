//! The thread that sends orders of pages to the session and waits for their answers.

use std::num::NonZeroU64;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use cosplat_controller::{
    Answer, ControlError, Controller,
    order::{MaterialValue, Order},
};
use cosplat_ipc::{Domain, client::SendError, schema::MaterialSpec};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::oneshot;

/// Orders that wait for those before them, of all pages together.
const QUEUE: usize = 16;
/// Pages that stay attached to the session; of more, who gave the oldest order attaches again for its next one.
const ATTACHED: usize = 8;

/// What makes a material of words, whoever knows the table of laws; the error is a sentence.
pub type Materials = Box<dyn Fn(&MaterialValue) -> Result<MaterialSpec, String> + Send + Sync>;

/// An order of a page.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ordered {
    /// What.
    pub order: Order,
    /// Step at whose start it takes effect; 0 for the next one.
    #[serde(default)]
    pub step: u64,
    /// Number of the page, of its own choice: what it holds is held under that number. `cosplat ctl` has 0.
    pub page: Option<NonZeroU64>,
}

/// Why there is no answer to an order.
#[derive(Debug, thiserror::Error)]
pub enum Unsent {
    /// Too many wait.
    #[error("{QUEUE} orders wait for an answer already: send it again")]
    Full,
    /// The thread is gone.
    #[error("no more orders are taken: this process ends")]
    Ended,
}

/// An order, and who waits for its answer.
type Waiting = (Ordered, oneshot::Sender<Value>);

/// Where orders are handed in.
#[derive(Clone)]
pub struct Orders(SyncSender<Waiting>);

impl Orders {
    /// The counter and the thread's end of it.
    pub fn new() -> (Orders, Receiver<Waiting>) {
        let (sender, receiver) = sync_channel(QUEUE);
        (Orders(sender), receiver)
    }

    /// Hands in an order; its answer comes as JSON.
    ///
    /// # Errors
    /// When too many wait, or the thread has ended.
    pub fn hand_in(&self, ordered: Ordered) -> Result<oneshot::Receiver<Value>, Unsent> {
        let (answer, receiver) = oneshot::channel();
        match self.0.try_send((ordered, answer)) {
            Ok(()) => Ok(receiver),
            Err(TrySendError::Full(_)) => Err(Unsent::Full),
            Err(TrySendError::Disconnected(_)) => Err(Unsent::Ended),
        }
    }
}

/// Sends orders one after the other until all [`Orders`] are gone.
pub fn run(
    waiting: &Receiver<Waiting>,
    domain: &Domain,
    session: &str,
    timeout: Duration,
    materials: &Materials,
) {
    let mut attached: Vec<(Option<NonZeroU64>, Controller)> = Vec::new();
    for (Ordered { order, step, page }, answer) in waiting {
        let former = attached.iter().position(|(number, _)| *number == page);
        let controller = match (former, page) {
            (Some(place), _) => Ok(attached.remove(place).1),
            (None, None) => Controller::connect(domain, session, timeout),
            (None, Some(page)) => Controller::connect_as(domain, session, timeout, page.get()),
        };
        let outcome = controller.and_then(|mut controller| {
            let sent = controller.send(&[(step, order)], materials);
            // Of a server that is gone, or was started anew with other names, nothing is kept.
            match &sent {
                Err(ControlError::Send(_) | ControlError::Connect(_)) => attached.clear(),
                _ => attached.push((page, controller)),
            }
            sent
        });
        if attached.len() > ATTACHED {
            attached.remove(0);
        }
        // A page that waits no more is no failure.
        let _ = answer.send(told(outcome));
    }
}

fn told(outcome: Result<Vec<Answer>, ControlError>) -> Value {
    match outcome.as_deref() {
        Ok([answer]) => json!({
            "step": answer.applied_at_step,
            "refused": answer.refused,
            "file": answer.file,
        }),
        Ok(_) => json!({ "refused": "no answer came" }),
        Err(error) => {
            let unknown = matches!(error, ControlError::Send(SendError::Timeout { .. }));
            json!({ "refused": error.to_string(), "unknown": unknown })
        }
    }
}
