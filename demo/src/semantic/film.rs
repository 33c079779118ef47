//! The collision, drawn twice: objects in colours, then as they are.

use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

use anyhow::{Context, bail};
use cosplat_ipc::schema::GaussianState;
use cosplat_renderer::{Camera, Image, drawing::BACKGROUND, mp4::Mp4Writer, picture};
use cosplat_scene::load::load_text;
use cosplat_semantics::show;
use cosplat_server::publish::Output;
use cosplat_sim_core::{Interruption, World};
use glam::Vec3;
use serde::Serialize;

use crate::Progress;

/// Frames per second of the video; a scene at 60 is shown at half its speed.
const VIDEO_RATE: f64 = 30.0;
/// Share of an object's colour in what is drawn.
const TINT: f32 = 0.7;

/// What an object did.
#[derive(Clone, Debug, Serialize)]
pub struct Moved {
    /// Its name.
    pub name: String,
    /// Its material.
    pub material: String,
    /// Velocity of the centre of mass before and after [m/s].
    pub velocity: [[f64; 3]; 2],
    /// How far the centre of mass came [m].
    pub distance: f64,
}

/// A contact of two of them, from the first touch to the parting or to the end of the run.
#[derive(Clone, Debug, Serialize)]
pub struct Impact {
    /// Their names.
    pub names: [String; 2],
    /// Impulse that the second received [N s].
    pub impulse: f64,
    /// Speed at which they approached and parted [m/s].
    pub speed: [f64; 2],
}

/// What came of the collision.
#[derive(Clone, Debug, Serialize)]
pub struct Collision {
    /// Simulated seconds.
    pub sim_seconds: f64,
    /// Moving objects.
    pub objects: Vec<Moved>,
    /// Contacts between them.
    pub impacts: Vec<Impact>,
    /// State hash of the last frame.
    pub state_hash: String,
}

/// Colours of the moving objects over what they look like; what rests is grey.
fn tinted(slots: &[GaussianState], number: &[Option<i32>]) -> Vec<GaussianState> {
    let tint = |state: &GaussianState| {
        let own = state.color;
        let light = own[..3].iter().map(|c| f32::from(*c)).sum::<f32>() / 765.0;
        let of = number.get(state.object as usize).copied().flatten();
        let mixed = TINT * show::color(of.unwrap_or(-1)) + Vec3::splat((1.0 - TINT) * light);
        let [r, g, b] = (mixed * 255.0).to_array().map(|c| c as u8);
        GaussianState {
            color: [r, g, b, own[3]],
            ..*state
        }
    };
    slots.iter().map(tint).collect()
}

/// Simulates the scene of a text for `duration` [s] and films it; the pictures are of the beginning, the middle and the end, in colours
/// and as they are.
pub(super) fn collide(
    text: String,
    scene: &Path,
    video: &Path,
    camera: &Camera,
    duration: f64,
    stop: &AtomicBool,
    progress: &Progress,
) -> anyhow::Result<(Collision, Vec<[Image; 2]>)> {
    cosplat_files::write(scene, &text)
        .with_context(|| format!("cannot write {}", scene.display()))?;
    let scene = load_text(text, scene)?.scene;
    let rate = scene.frame_rate;
    let output = Output::new(&scene);
    let mut slots = vec![GaussianState::default(); scene.gaussians.len()];
    let mut world = World::new(scene)?;
    let states = &world.report().objects;
    let moving: Vec<usize> = (0..states.len())
        .filter(|n| states[*n].mass > 0.0)
        .collect();
    let number: Vec<Option<i32>> = (0..states.len())
        .map(|n| moving.iter().position(|m| *m == n).map(|m| m as i32))
        .collect();
    let begin = states.clone();
    let mut impacts = Vec::new();
    let frames = (duration * rate).round().max(1.0) as u64;
    let mut writer = Mp4Writer::create(video, camera.width, camera.height, VIDEO_RATE)?;
    let (mut own, mut shown) = (Vec::new(), Vec::new());
    for frame in 0..=frames {
        if stop.load(Ordering::Relaxed) {
            bail!("interrupted");
        }
        output.write_frame(&world, &mut slots);
        let colored = picture(&tinted(&slots, &number), None, camera, BACKGROUND);
        let plain = picture(&slots, None, camera, BACKGROUND);
        writer.add(&colored)?;
        if [0, frames / 3, frames].contains(&frame) {
            shown.push([colored, plain.clone()]);
        }
        own.push(plain);
        if frame < frames {
            let asks = || stop.load(Ordering::Relaxed);
            let interruption = Interruption::when(&asks);
            let report = world.step_unless(&interruption, 1.0 / rate, &[]);
            let report = report.context("interrupted")?;
            impacts.extend(report.contacts.clone());
        }
        progress("frames", frame, frames, "");
    }
    for image in &own {
        writer.add(image)?;
    }
    writer.finish()?;
    let report = world.report();
    let moved = |&n: &usize| {
        let (a, b) = (&begin[n], &report.objects[n]);
        let apart = (0..3).map(|k| (b.com[k] - a.com[k]).powi(2)).sum::<f64>();
        let object = &world.scene().objects[n];
        Moved {
            name: object.name.clone(),
            material: object.material.name.clone(),
            velocity: [a.linear_velocity, b.linear_velocity],
            distance: apart.sqrt(),
        }
    };
    let name = |n: usize| world.scene().objects[n].name.clone();
    let impacts = impacts.iter().map(|episode| Impact {
        names: episode.objects.map(name),
        impulse: episode.impulse.iter().map(|i| i * i).sum::<f64>().sqrt(),
        speed: [episode.speed_before, episode.speed_after],
    });
    let collision = Collision {
        sim_seconds: frames as f64 / rate,
        objects: moving.iter().map(moved).collect(),
        impacts: impacts.collect(),
        state_hash: format!("{:016x}", report.state_hash),
    };
    Ok((collision, shown))
}
