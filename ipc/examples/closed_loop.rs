//! A closed control loop: a force holds the first object at the height where it is, step by step.

use std::time::Duration;

use cosplat_ipc::{
    Client, Domain,
    schema::{COMMAND_FORCE, Command},
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let session = std::env::args().nth(1).unwrap_or("default".into());
    let patience = Duration::from_secs(60);
    let client = Client::connect(&Domain::from_env()?, &session, "example", patience)?;
    let gravity = client.scene(patience)?.header().gravity;
    let mut objects = client.objects(1)?;
    let mut robot = client.participate("robot", patience)?;

    let mut stepped = robot.step(1, &[])?;
    let mut goal = None;
    while !stepped.is_last() && stepped.done.sim_time < 2.0 {
        let Some(message) = objects.next(Duration::ZERO)? else {
            return Err("the objects of a step are there before its answer".into());
        };
        let block = message.items()[0];
        let goal = *goal.get_or_insert(block.com);
        let force = |a: usize| {
            let (off, speed) = (goal[a] - block.com[a], block.linear_velocity[a]);
            block.mass * (100.0 * off - 20.0 * speed - gravity[a])
        };
        let hold = Command {
            kind: COMMAND_FORCE,
            vector: [force(0), force(1), force(2)],
            ..Command::default()
        };
        stepped = robot.step(1, &[hold])?;
        println!("step {}: height {:.4} m", stepped.done.step, block.com[1]);
    }
    Ok(())
}
