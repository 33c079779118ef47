//! Attaching to a server: early, late, deep, shallow.

use cosplat_ipc::Client;

use super::support::{COUNT, PATIENCE, SOURCE, TestDomain, send_frame, serve};

#[test]
fn a_late_joiner_on_an_idle_server_gets_the_scene_and_the_newest_frame() {
    let domain = TestDomain::new();
    let ports = serve(&domain, "late");
    for step in 1..=5 {
        send_frame(&ports, step);
    }
    // From here on the server's thread does nothing at all.
    let client = Client::connect(&domain, "late", "test", PATIENCE).expect("attached");
    let scene = client.scene(PATIENCE).expect("a scene");
    assert_eq!(scene.gaussians().len(), COUNT);
    assert_eq!(scene.sh()[7], 7.0);
    assert_eq!(scene.features()[3], -3.0);
    assert_eq!(scene.objects()[0].name(), Ok("vase"));
    assert_eq!(scene.source(), SOURCE);
    assert_eq!(scene.header().scene_hash, 7);
    assert_eq!(scene.header().epoch, ports.epoch());

    let mut reader = client.frames(1).expect("a reader");
    let frame = reader.next(PATIENCE).expect("readable").expect("a frame");
    assert_eq!(frame.header().step, 5);
    assert_eq!(frame.header().epoch, ports.epoch());
    assert_eq!(frame.gaussians().len(), COUNT);
    assert_eq!(frame.gaussians()[9].position, [5.0, 9.0, 0.0]);
    assert_eq!(frame.gaussians().as_ptr() as usize % 64, 0);
}
