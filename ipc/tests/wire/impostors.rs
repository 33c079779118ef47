//! Programs of the same user that publish where a server does.

use std::{fmt::Debug, time::Duration};

use bytemuck::Zeroable;
use cosplat_ipc::{
    Client,
    client::ReadError,
    schema::{FrameHeader, GaussianRest, GaussianState, Hello, SceneHeader, Status},
};
use iceoryx2::{
    port::{publisher::Publisher, update_connections::UpdateConnections},
    prelude::*,
};

use super::{
    refusals::{Stranger, foreign_node},
    support::{COUNT, PATIENCE, TestDomain, send_frame, serve},
};

/// A publisher on a stream of the session `captured` that somebody else serves.
fn impostor<T, H>(node: &Node<ipc::Service>, stream: &str) -> Publisher<ipc::Service, [T], H>
where
    T: Debug + ZeroCopySend + 'static,
    H: Debug + Default + ZeroCopySend + 'static,
{
    let name = format!("cosplat/captured/v1/{stream}");
    node.service_builder(&name.as_str().try_into().expect("a name"))
        .publish_subscribe::<[T]>()
        .user_header::<H>()
        .open()
        .expect("a service")
        .publisher_builder()
        .initial_max_slice_len(COUNT)
        .create()
        .expect("a publisher")
}

/// Sends one message of zeros.
fn send<T, H>(publisher: &Publisher<ipc::Service, [T], H>, header: H, count: usize)
where
    T: Debug + Zeroable + ZeroCopySend + 'static,
    H: Debug + Default + ZeroCopySend + 'static,
{
    let mut sample = publisher.loan_slice_uninit(count).expect("memory");
    *sample.user_header_mut() = header;
    let sample = sample.write_from_fn(|_| T::zeroed());
    sample.send().expect("sent");
}

#[test]
fn a_second_publisher_does_not_capture_readers() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "captured");
    let client = Client::connect(&domain, "captured", "test", PATIENCE).expect("attached");
    let mut attached = client.frames(64).expect("a reader");
    send_frame(&ports, 1);
    let frame = attached.next(PATIENCE).expect("readable").expect("a frame");
    assert_eq!(frame.header().step, 1);

    let node = foreign_node(&domain);
    let rogue = impostor::<GaussianState, FrameHeader>(&node, "frame");
    // Of a later run, and of the server's own.
    for epoch in [ports.epoch() + 1_000_000_000, ports.epoch()] {
        let header = FrameHeader {
            step: 1000,
            epoch,
            count: 3,
            ..FrameHeader::default()
        };
        send(&rogue, header, 3);
    }
    let mut late = client.frames(64).expect("another reader");
    rogue.update_connections().expect("updated");
    send_frame(&ports, 2);
    let frame = attached.next(PATIENCE).expect("readable").expect("a frame");
    assert_eq!((frame.header().step, frame.missed()), (2, 0));
    assert_eq!(frame.gaussians().len(), COUNT);
    assert!(attached.next(Duration::ZERO).expect("readable").is_none());
    assert_eq!((attached.runs(), attached.missed()), (1, 0));
    while let Some(frame) = late.next(Duration::ZERO).expect("readable") {
        assert_eq!(frame.header().epoch, ports.epoch());
        assert!(frame.header().step <= 2);
    }
}

#[test]
fn a_second_publisher_cannot_fake_a_heartbeat_or_a_scene() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "captured");
    let client = Client::connect(&domain, "captured", "test", PATIENCE).expect("attached");
    let node = foreign_node(&domain);
    let beat = impostor::<Status, ()>(&node, "status");
    let scene = impostor::<GaussianRest, SceneHeader>(&node, "scene/gaussians");
    let mut status = client.status().expect("a reader");
    ports.update_status(&Status::default()).expect("published");
    send(&beat, (), 1);
    let newest = status.next(PATIENCE).expect("readable").expect("a status");
    assert_eq!(newest.pid, std::process::id());
    send(&beat, (), 1);
    assert_eq!(status.newest().expect("readable"), Some(newest));

    let header = SceneHeader {
        epoch: u64::MAX,
        gaussian_count: 1,
        ..SceneHeader::default()
    };
    // Kept for late joiners, like the server's.
    send(&scene, header, 1);
    let looked = std::thread::scope(|scope| {
        let looking = scope.spawn(|| client.scene(PATIENCE));
        while !looking.is_finished() {
            scene.update_connections().expect("updated");
            std::thread::sleep(Duration::from_millis(1));
        }
        looking.join().expect("a thread")
    });
    let looked = looked.expect("a scene");
    assert_eq!(looked.header().epoch, ports.epoch());
    assert_eq!(looked.gaussians().len(), COUNT);
}

#[test]
fn messages_that_contradict_themselves_are_reported_and_skipped() {
    let domain = TestDomain::new();
    // A server that makes mistakes: `hello` names it, so that readers listen.
    let stranger = Stranger::start(&domain, Hello::of_this_program(5));
    let client = Client::connect(&domain, "other", "test", PATIENCE).expect("attached");
    let mut reader = client.frames(64).expect("a reader");
    let header = |step, count| FrameHeader {
        step,
        epoch: 5,
        count,
        ..FrameHeader::default()
    };
    send(&stranger.frame, header(1, 3), 3);
    assert!(reader.next(PATIENCE).expect("readable").is_some());
    send(&stranger.frame, header(2, u32::MAX), 3);
    let expected = ReadError::Malformed {
        stream: "frame",
        announced: u32::MAX as usize,
        actual: 3,
    };
    assert_eq!(reader.next(PATIENCE).err(), Some(expected));
    send(&stranger.frame, header(2, 3), 3);
    let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
    assert_eq!((frame.header().step, frame.missed()), (2, 0));
}
