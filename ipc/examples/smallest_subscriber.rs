//! The smallest external subscriber: one line per frame of a session, read where the server wrote it.

use std::time::Duration;

use cosplat_ipc::{Client, Domain, schema::FRAME_FLAG_LAST};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let session = std::env::args().nth(1).unwrap_or("default".into());
    let patience = Duration::from_secs(10);
    let client = Client::connect(&Domain::from_env()?, &session, "example", patience)?;
    let scene = client.scene(patience)?;
    println!("{} objects", scene.objects().len());

    // A queue of one: always the newest frame. With 64 no step is lost.
    let mut frames = client.frames(1)?;
    while let Some(frame) = frames.next(patience)? {
        let header = frame.header();
        let heights = frame.gaussians().iter().map(|g| g.position[2]);
        let top = heights.fold(f32::NEG_INFINITY, f32::max);
        println!(
            "step {} at {:.3} s: {} Gaussians, the highest at {top} m, {} steps skipped",
            header.step,
            header.sim_time,
            header.count,
            frame.missed()
        );
        if header.flags & FRAME_FLAG_LAST != 0 {
            break;
        }
    }
    Ok(())
}
