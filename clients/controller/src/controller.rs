//! A controller attached to a session: resolves names, sends orders, reads the answers.

use std::time::Duration;

use cosplat_ipc::{
    Domain,
    client::{Client, CommandSender, ConnectError, SendError},
    schema::{self as wire, MAX_COMMANDS, SceneHeader, str_from_padded},
};
use serde::Deserialize;

use crate::{
    order::{Lookup, Materials, Order, OrderError},
    script::{Script, step_at},
};

/// Why orders were not carried out.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// Not attached.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// A name is unknown.
    #[error(transparent)]
    Order(#[from] OrderError),
    /// No answer.
    #[error(transparent)]
    Send(#[from] SendError),
    /// A checkpoint is not there yet.
    #[error(
        "no checkpoint was written within {seconds:.1} s, and none was refused: the server writes it when its step comes; wait longer with a larger timeout"
    )]
    Unwritten {
        /// How long [s].
        seconds: f64,
    },
}

/// The answer to one order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Step at whose start it takes effect.
    pub applied_at_step: u64,
    /// Why it was refused, if it was.
    pub refused: Option<String>,
    /// File that the server has written, for checkpoints.
    pub file: Option<String>,
}

/// A process that gives orders.
pub struct Controller {
    // Keeps the node alive for as long as the sender is in use.
    _client: Client,
    sender: CommandSender,
    header: SceneHeader,
    objects: Vec<String>,
    colliders: Vec<String>,
    timeout: Duration,
}

impl Controller {
    /// Attaches to `session`; `timeout` bounds the attaching and every answer.
    ///
    /// # Errors
    /// When there is no server, or one that does not speak this wire version.
    pub fn connect(
        domain: &Domain,
        session: &str,
        timeout: Duration,
    ) -> Result<Controller, ControlError> {
        Self::attach(domain, session, timeout, None)
    }

    /// Attaches under a client number of the caller's choice: what it grabs, others of that number can drag and let go.
    ///
    /// # Errors
    /// As for [`connect`](Self::connect).
    pub fn connect_as(
        domain: &Domain,
        session: &str,
        timeout: Duration,
        number: u64,
    ) -> Result<Controller, ControlError> {
        Self::attach(domain, session, timeout, Some(number))
    }

    fn attach(
        domain: &Domain,
        session: &str,
        timeout: Duration,
        number: Option<u64>,
    ) -> Result<Controller, ControlError> {
        let client = Client::connect(domain, session, "controller", timeout)?;
        let scene = client.scene(timeout)?;
        let objects = scene
            .objects()
            .iter()
            .map(|info| str_from_padded(&info.name).unwrap_or_default().to_owned())
            .collect();
        Ok(Controller {
            sender: match number {
                None => client.commands()?,
                Some(number) => client.commands_as(number)?,
            },
            header: *scene.header(),
            objects,
            colliders: collider_names(&scene.source()),
            timeout,
            _client: client,
        })
    }

    /// Names of the scene's objects, by id.
    pub fn objects(&self) -> &[String] {
        &self.objects
    }

    /// Sends orders, each to take effect at its step (0 = the next one), and waits for the answers; for checkpoints
    /// until they are written.
    ///
    /// # Errors
    /// When a name is unknown (then nothing is sent) or no answer comes. A refusal is an answer.
    pub fn send(
        &mut self,
        orders: &[(u64, Order)],
        materials: Materials<'_>,
    ) -> Result<Vec<Answer>, ControlError> {
        let lookup = Lookup {
            objects: &self.objects,
            colliders: &self.colliders,
            materials,
        };
        let commands = orders
            .iter()
            .map(|(step, order)| {
                let command = order.to_wire(&lookup)?;
                Ok(wire::Command {
                    apply_at_step: *step,
                    ..command
                })
            })
            .collect::<Result<Vec<_>, OrderError>>()?;
        // Answers to checkpoints take as long as their steps: they are ordered first and waited for last, so that
        // nothing else waits for them.
        let is_late = |i: &usize| commands[*i].kind == wire::COMMAND_CHECKPOINT;
        let (late, prompt): (Vec<_>, Vec<_>) = (0..commands.len()).partition(is_late);
        let chunk = |indices: &[usize]| indices.iter().map(|&i| commands[i]).collect::<Vec<_>>();
        let mut answers = vec![None; commands.len()];
        let mut unwritten = Vec::new();
        for indices in late.chunks(MAX_COMMANDS) {
            let sent = self.sender.submit(&chunk(indices), self.timeout)?;
            unwritten.push((indices, sent));
        }
        for indices in prompt.chunks(MAX_COMMANDS) {
            let acks = self.sender.send(&chunk(indices), self.timeout)?;
            fill(&mut answers, indices, &acks);
        }
        for (indices, sent) in unwritten {
            let acks = self.sender.answers(sent, self.timeout);
            let acks = acks.map_err(|error| match error {
                SendError::Timeout { seconds } => ControlError::Unwritten { seconds },
                other => other.into(),
            })?;
            fill(&mut answers, indices, &acks);
        }
        Ok(answers.into_iter().flatten().collect())
    }

    /// Sends a whole script at once: the server keeps each order until its step.
    ///
    /// # Errors
    /// As for [`send`](Self::send).
    pub fn run(
        &mut self,
        script: &Script,
        materials: Materials<'_>,
    ) -> Result<Vec<Answer>, ControlError> {
        let orders: Vec<_> = script
            .order
            .iter()
            .map(|timed| {
                let step = match timed.time {
                    0.0 => 0,
                    time => step_at(time, self.header.frame_rate),
                };
                (step, timed.order.clone())
            })
            .collect();
        self.send(&orders, materials)
    }
}

/// Names of the colliders in the text of a scene file, in their order; none when it cannot be read.
fn collider_names(source: &str) -> Vec<String> {
    #[derive(Default, Deserialize)]
    struct Names {
        #[serde(default)]
        colliders: Vec<Named>,
    }
    #[derive(Deserialize)]
    struct Named {
        name: String,
    }
    let names: Names = toml::from_str(source).unwrap_or_default();
    names.colliders.into_iter().map(|c| c.name).collect()
}

/// Puts the answers to the orders at `indices` in their places.
fn fill(answers: &mut [Option<Answer>], indices: &[usize], acks: &[wire::Ack]) {
    for (&index, ack) in indices.iter().zip(acks) {
        answers[index] = Some(answer(ack));
    }
}

fn answer(ack: &wire::Ack) -> Answer {
    let reason = str_from_padded(&ack.reason).unwrap_or("no reason given");
    let accepted = ack.status == wire::ACK_ACCEPTED;
    Answer {
        applied_at_step: ack.applied_at_step,
        refused: (!accepted).then(|| reason.to_owned()),
        file: (accepted && !reason.is_empty()).then(|| reason.to_owned()),
    }
}
