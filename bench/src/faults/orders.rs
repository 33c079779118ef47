//! Commands that no client should send.

use std::time::Duration;

use anyhow::Context;
use cosplat_ipc::{
    Client,
    client::SendError,
    schema::{self as wire, Ack, Command, CommandHeader},
};
use iceoryx2::prelude::*;
use rand_core::Rng;

use super::troupe::{SESSION, Stage};

/// Numbers that no field takes.
const BAD: [f64; 4] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300];
/// Commands of a request that is too long: many times what is allowed.
const TOO_MANY: usize = 64 * wire::MAX_COMMANDS;
/// Longest wait for an answer that is not asked for.
const SOON: Duration = Duration::from_millis(20);

/// A command that must be refused, whatever the state of the world.
fn malformed(rng: &mut impl Rng) -> Command {
    let bad = BAD[rng.next_u32() as usize % BAD.len()];
    let mut vector = [0.0; 3];
    vector[rng.next_u32() as usize % 3] = bad;
    let of = |kind| Command {
        kind,
        vector,
        ..Default::default()
    };
    match rng.next_u32() % 13 {
        0 => of(wire::COMMAND_IMPULSE),
        1 => of(wire::COMMAND_SET_VELOCITY),
        2 => of(wire::COMMAND_SET_GRAVITY),
        3 => of(wire::COMMAND_MOVE_COLLIDER),
        4 => of(wire::COMMAND_FORCE),
        5 => of(wire::COMMAND_COLLIDER_VELOCITY),
        6 => Command {
            radius: bad,
            ..of(wire::COMMAND_IMPULSE_AT)
        },
        7 => Command {
            object: u32::MAX - rng.next_u32() % 100,
            ..of(wire::COMMAND_RELEASE)
        },
        8 => Command {
            material: wire::MaterialSpec {
                law: 11 + rng.next_u32() % 1000,
                youngs_modulus: bad,
                ..Default::default()
            },
            ..of(wire::COMMAND_SET_MATERIAL)
        },
        9 => Command {
            apply_at_step: u64::MAX - u64::from(rng.next_u32()),
            vector: [0.0; 3],
            ..of(wire::COMMAND_SET_GRAVITY)
        },
        10 => of(wire::COMMAND_DRAG),
        11 => Command {
            object: 4_000_000 + rng.next_u32() % 1000,
            ..of(wire::COMMAND_STEP)
        },
        _ => of(wire::COMMAND_CANCEL + 1 + rng.next_u32() % (u32::MAX - 100)),
    }
}

/// Sends malformed commands, and counts those that are taken.
pub fn send_malformed(
    client: &Client,
    rng: &mut impl Rng,
    patience: Duration,
) -> anyhow::Result<usize> {
    let mut sender = client.commands()?;
    let count = 1 + rng.next_u32() as usize % wire::MAX_COMMANDS;
    let commands: Vec<Command> = (0..count).map(|_| malformed(rng)).collect();
    let acks = sender.send(&commands, patience)?;
    Ok(acks.iter().filter(|ack| ack.is_accepted()).count())
}

/// Sends as many commands as a sender can, and looks at no answer.
pub fn flood(client: &Client, rng: &mut impl Rng) -> anyhow::Result<()> {
    let mut sender = client.commands()?;
    let gravity = Command {
        kind: wire::COMMAND_SET_GRAVITY,
        vector: [0.0, -9.81, 0.0],
        ..Default::default()
    };
    let commands = [gravity; wire::MAX_COMMANDS];
    let mut unanswered = Vec::new();
    for _ in 0..20 + rng.next_u32() % 80 {
        match sender.submit(&commands, Duration::from_millis(1)) {
            Ok(sent) => unanswered.push(sent),
            // The queue is full: that is its answer to a flood.
            Err(SendError::Transport(words)) => anyhow::bail!(words),
            Err(_) => unanswered.clear(),
        }
    }
    Ok(())
}

/// A node of a program that is not ours.
fn foreign(stage: &Stage) -> anyhow::Result<Node<ipc::Service>> {
    let node = NodeBuilder::new()
        .config(&stage.domain.config())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create();
    node.context("a foreign node")
}

fn service(stream: &str) -> anyhow::Result<ServiceName> {
    let name = format!("cosplat/{SESSION}/v{}/{stream}", wire::WIRE_VERSION);
    Ok(name.as_str().try_into()?)
}

/// Sends a request of many times the commands that one may have, with a count of its own.
pub fn send_oversized(stage: &Stage, rng: &mut impl Rng) -> anyhow::Result<()> {
    let node = foreign(stage)?;
    let service = node
        .service_builder(&service("command")?)
        .request_response::<[Command], [Ack]>()
        .request_user_header::<CommandHeader>()
        .open()?;
    let client = service
        .client_builder()
        .initial_max_slice_len(TOO_MANY)
        .create()?;
    let length = wire::MAX_COMMANDS + 1 + rng.next_u32() as usize % (TOO_MANY - wire::MAX_COMMANDS);
    let mut request = client.loan_slice_uninit(length)?;
    *request.user_header_mut() = CommandHeader {
        client: rng.next_u64(),
        pid: std::process::id(),
        count: match rng.next_u32() % 3 {
            0 => length as u32,
            1 => 1,
            _ => u32::MAX,
        },
    };
    let commands = vec![malformed(rng); length];
    let _pending = request.write_from_slice(&commands).send()?;
    std::thread::sleep(SOON);
    Ok(())
}

/// Comes with types of another version, and with services that nobody else has; whether it was let in where it must not be.
pub fn skewed(stage: &Stage, rng: &mut impl Rng) -> anyhow::Result<bool> {
    let node = foreign(stage)?;
    let other = node
        .service_builder(&service("frame")?)
        .publish_subscribe::<[u64]>()
        .open();
    let other_commands = node
        .service_builder(&service("command")?)
        .request_response::<[u8], [u8]>()
        .open();
    let name = format!("cosplat/{SESSION}/v{}/frame", 2 + rng.next_u32() % 9);
    let newer: ServiceName = name.as_str().try_into()?;
    let newer = node
        .service_builder(&newer)
        .publish_subscribe::<[u64]>()
        .open_or_create()?;
    let publisher = newer
        .publisher_builder()
        .initial_max_slice_len(64)
        .create()?;
    publisher
        .loan_slice_uninit(64)?
        .write_from_slice(&[u64::MAX; 64])
        .send()?;
    Ok(other.is_ok() || other_commands.is_ok())
}
