//! A made-up run: every byte of every frame is a function of the step.

use std::path::Path;

use cosplat_ipc::schema::{
    AppliedCommand, COMMAND_IMPULSE, Command, FRAME_FLAG_LAST, FrameHeader, GaussianRest,
    GaussianState, ObjectInfo, ObjectState, ObjectsHeader, SceneHeader, Status, padded,
};
use cosplat_ipc::server::SceneBlocks;
use cosplat_recorder::messages::JournalEntry;
use cosplat_recorder::reader::{Event, Recording};
use cosplat_recorder::writer::{RecordingWriter, WriterOptions};
use rand_core::Rng;
use rand_pcg::Pcg32;

/// A run of `steps` frames of `gaussians` Gaussians.
#[derive(Clone, Copy)]
pub struct Run {
    pub steps: u64,
    pub gaussians: usize,
    pub epoch: u64,
}

pub const SCENE_SOURCE: &str = "version = 1\n# made up\n";
const OBJECTS: u32 = 3;
const FRAME_RATE: f64 = 60.0;

impl Run {
    pub fn header(&self, step: u64) -> FrameHeader {
        FrameHeader {
            step,
            sim_time: step as f64 / FRAME_RATE,
            dt: 1e-4,
            epoch: self.epoch,
            state_hash: step.wrapping_mul(0x9e37_79b9_7f4a_7c15),
            publish_ns: 1_000 + step,
            count: self.gaussians as u32,
            substeps: 167,
            flags: if step + 1 == self.steps {
                FRAME_FLAG_LAST
            } else {
                0
            },
            ..Default::default()
        }
    }

    /// Random finite positions; the other fields are random bits, NaN included.
    pub fn frame(&self, step: u64) -> Vec<GaussianState> {
        let mut rng = Pcg32::new(step, self.epoch);
        let mut frame = vec![GaussianState::default(); self.gaussians];
        rng.fill_bytes(bytemuck::cast_slice_mut(&mut frame));
        for gaussian in &mut frame {
            gaussian.position = std::array::from_fn(|_| rng.next_u32() as f32 / 1e9 - 2.0);
        }
        frame
    }

    pub fn objects(&self, step: u64) -> (ObjectsHeader, Vec<ObjectState>) {
        let header = ObjectsHeader {
            step,
            sim_time: step as f64 / FRAME_RATE,
            epoch: self.epoch,
            count: OBJECTS,
            state_hash: self.header(step).state_hash,
            ..Default::default()
        };
        let states = (0..OBJECTS)
            .map(|id| ObjectState {
                id,
                fidelity: 2,
                mass: 1.0 / 3.0,
                com: [step as f64 * 0.1, f64::from(id), -0.7],
                rotation: [0.0, 0.0, 0.6, 0.8],
                ..Default::default()
            })
            .collect();
        (header, states)
    }

    /// One command takes effect every 7 steps.
    pub fn command(&self, step: u64) -> Option<AppliedCommand> {
        (step % 7 == 3).then(|| AppliedCommand {
            step,
            client: u64::MAX - step,
            command: Command {
                kind: COMMAND_IMPULSE,
                object: 1,
                sequence: step / 7,
                vector: [0.1 * step as f64, 0.0, 1.0],
                ..Default::default()
            },
        })
    }

    pub fn scene_header(&self) -> SceneHeader {
        SceneHeader {
            epoch: self.epoch,
            scene_hash: 42,
            frame_rate: FRAME_RATE,
            dx: 0.01,
            gravity: [0.0, 0.0, -9.81],
            gaussian_count: self.gaussians as u32,
            object_count: OBJECTS,
            ..Default::default()
        }
    }

    pub fn rest(&self) -> Vec<GaussianRest> {
        (0..self.gaussians)
            .map(|i| GaussianRest {
                position: [i as f32, 0.5, -1.0],
                opacity: 0.5,
                scale: [0.01; 3],
                object: i as u32 % OBJECTS,
                rotation: [0.0, 0.0, 0.0, 1.0],
            })
            .collect()
    }

    pub fn sh(&self) -> Vec<f32> {
        (0..3 * self.gaussians).map(|i| (i as f32).sin()).collect()
    }

    pub fn object_table(&self) -> Vec<ObjectInfo> {
        (0..OBJECTS)
            .map(|id| ObjectInfo {
                id,
                fidelity: 2,
                particle_count: 10,
                gaussian_first: 0,
                gaussian_count: 0,
                law: 1,
                youngs_modulus: 1e5,
                poisson_ratio: 0.3,
                density: 1000.0,
                name: padded("vase"),
                material: padded("clay"),
            })
            .collect()
    }

    pub fn begin(&self, writer: &mut RecordingWriter) {
        let (rest, sh, objects) = (self.rest(), self.sh(), self.object_table());
        let scene = SceneBlocks {
            header: self.scene_header(),
            gaussians: &rest,
            sh: &sh,
            features: &[],
            objects: &objects,
            source: SCENE_SOURCE,
            files: &[],
        };
        writer.begin_epoch("test", &scene).unwrap();
    }

    pub fn step(&self, writer: &mut RecordingWriter, step: u64) {
        if let Some(command) = self.command(step) {
            let entry = JournalEntry {
                applied: command,
                epoch: Some(self.epoch),
                index: Some(step / 7),
            };
            writer.journal(&entry).unwrap();
        }
        let (header, objects) = self.objects(step);
        writer.objects(&header, &objects).unwrap();
        let status = Status {
            step,
            kinetic_energy: 0.1 * step as f64,
            ..Default::default()
        };
        writer
            .frame(&self.header(step), &self.frame(step), Some(&status))
            .unwrap();
    }

    /// The whole run as a file.
    pub fn write(&self, path: &Path, options: &WriterOptions) {
        let mut writer = RecordingWriter::create(path, options).unwrap();
        self.begin(&mut writer);
        (0..self.steps).for_each(|step| self.step(&mut writer, step));
        writer.finish().unwrap();
    }

    /// Steps of a recording, after a check that each frame is bit for bit the one published.
    pub fn checked_steps(&self, path: &Path) -> Vec<u64> {
        let mut steps = Vec::new();
        for event in Recording::open(path).unwrap() {
            if let Event::Frame(frame) = event.unwrap() {
                let step = frame.header.step;
                let header = FrameHeader {
                    // A live server fills in its own.
                    publish_ns: frame.header.publish_ns,
                    ..self.header(step)
                };
                assert_eq!(frame.header, header);
                assert!(
                    bytemuck::cast_slice::<_, u8>(&frame.gaussians)
                        == bytemuck::cast_slice::<_, u8>(&self.frame(step)),
                    "Gaussians of step {step} differ"
                );
                steps.push(step);
            }
        }
        steps
    }
}
