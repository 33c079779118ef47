//! Laws of what is written: whatever is left out, readers have the whole frame, bit for bit.

use cosplat_ipc::{
    assembly::Assembly,
    schema::{
        CHANGE_FORM, CHANGE_GAUSSIANS, CHANGE_PLACED, ChangeSlot, ChangesHeader, GaussianState,
        row_slots,
    },
};
use cosplat_sim_core::{
    Action, Command, Scene, World,
    materials::{Law, Material},
    report::Level,
    scene::{
        BINDING_NEIGHBORS, Collider, ColliderShape, ContactMethod, Fidelity, Object, Pose, Surface,
    },
};

use super::Told;
use crate::gaussians::GaussianWriter;

/// Frame length [s].
const FRAME: f64 = 1.0 / 60.0;
/// Edge of the boxes [particles].
const EDGE: usize = 6;

fn material(law: Law) -> Material {
    let elastic = if law.is_rigid() { 0.0 } else { 3e4 };
    Material {
        name: "test".into(),
        law,
        youngs_modulus: elastic,
        poisson_ratio: if law.is_rigid() { 0.0 } else { 0.3 },
        density: 1000.0,
        loss: 0.0,
    }
}

/// Adds a box of particles with a Gaussian on each but the last few: groups of Gaussians then have several owners.
fn add_box(scene: &mut Scene, law: Law, corner: [f64; 3], fidelity: Fidelity) {
    let (first, h) = (scene.particles.position.len(), 0.025);
    for n in 0..EDGE.pow(3) {
        let lattice = [n / (EDGE * EDGE), n / EDGE % EDGE, n % EDGE];
        let x = std::array::from_fn(|a| corner[a] + (lattice[a] as f64 + 0.5) * h);
        scene.particles.position.push(x);
        scene.particles.volume.push(h * h * h);
    }
    let begin = scene.gaussians.len();
    let count = EDGE.pow(3) - 3;
    for p in first..first + count {
        let gaussians = &mut scene.gaussians;
        let x = scene.particles.position[p].map(|x| x as f32);
        gaussians.position.push(x);
        gaussians.scale.push([0.02, 0.01, 0.005]);
        gaussians.rotation.push([0.0, 0.6, 0.0, 0.8]);
        gaussians.opacity.push(0.5);
        gaussians.sh.extend([0.0, 0.1, 0.2]);
        scene.binding.particle.push([p as u32; BINDING_NEIGHBORS]);
        let still = fidelity == Fidelity::Static;
        let weight = if still { 0.0 } else { 1.0 };
        scene
            .binding
            .weight
            .push([weight, 0., 0., 0., 0., 0., 0., 0.]);
    }
    let name = format!("box{}", scene.objects.len());
    let particles = first..scene.particles.position.len();
    scene.objects.push(Object {
        gaussians: begin..begin + count,
        fidelity,
        ..Object::new(name, material(law), particles)
    });
}

/// On a floor: a soft box that will sleep, a rigid one that spins and falls, a soft one that flies as a rigid proxy, and
/// one that is only shown.
fn scene() -> Scene {
    let mut scene = Scene::empty("moved", 0.05);
    scene.gravity = [0.0, -9.81, 0.0];
    scene.contact.method = ContactMethod::MultiField;
    scene.colliders.push(Collider::fixed(
        "floor",
        ColliderShape::HalfSpace {
            normal: [0.0, 1.0, 0.0],
        },
        Pose::IDENTITY,
        Surface::Separate,
    ));
    let soft = Law::NeoHookean;
    add_box(&mut scene, soft, [0.0, 0.03, 0.0], Fidelity::Auto);
    add_box(&mut scene, Law::Rigid, [2.0, 0.3, 0.0], Fidelity::Mpm);
    add_box(&mut scene, soft, [4.0, 5.0, 0.0], Fidelity::Auto);
    add_box(&mut scene, soft, [6.0, 0.5, 0.0], Fidelity::Static);
    scene.objects[1].velocity_gradient = [[0.0, -3.0, 0.0], [3.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
    scene
}

/// Who writes, and what readers have.
struct Session {
    world: World,
    writer: GaussianWriter,
    told: Told,
    reader: Assembly,
    pool: Vec<Vec<GaussianState>>,
    frames: usize,
}

impl Session {
    fn new() -> Self {
        let scene = scene();
        let count = scene.gaussians.len();
        Self {
            writer: GaussianWriter::new(&scene),
            world: World::new(scene).expect("valid"),
            told: Told::default(),
            reader: Assembly::default(),
            pool: vec![vec![GaussianState::default(); count]; 3],
            frames: 0,
        }
    }

    /// Publishes as the server does, and compares with all of it written anew; returns objects and kinds that were told.
    fn publish(&mut self) -> Vec<(u32, u32)> {
        let mut expected = vec![GaussianState::default(); self.pool[0].len()];
        self.writer.write_all(&self.world, &mut expected);
        self.writer.prepare(&self.world);
        let slot = self.frames % self.pool.len();
        self.frames += 1;
        self.writer
            .update(&self.world, slot + 1, &mut self.pool[slot]);
        let bits = |g: &[GaussianState]| bytemuck::cast_slice::<_, u32>(g).to_vec();
        let step = self.world.report().step;
        assert!(bits(&self.pool[slot]) == bits(&expected), "step {step}");

        let plan = self.told.plan(&self.world, &self.writer);
        let begin = row_slots(plan.rows.len());
        let mut slots = vec![ChangeSlot::default(); begin + plan.gaussians];
        let (rows, gaussians) = slots.split_at_mut(begin);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(rows);
        let told: &[u8] = bytemuck::cast_slice(&plan.rows);
        bytes[..told.len()].copy_from_slice(told);
        // Every other message is made without a frame to copy from.
        let frame = step.is_multiple_of(2).then_some(&expected[..]);
        let gaussians = bytemuck::cast_slice_mut(gaussians);
        plan.write(&self.world, &self.writer, frame, gaussians);
        let header = ChangesHeader {
            step,
            since: plan.since,
            count: slots.len() as u32,
            objects: plan.rows.len() as u32,
            gaussians: expected.len() as u32,
            ..ChangesHeader::default()
        };
        self.reader.apply(&header, &slots).expect("it adds up");
        assert!(
            bits(self.reader.gaussians()) == bits(&expected),
            "step {step}"
        );
        self.told.sent(&self.world);
        plan.rows.iter().map(|row| (row.object, row.kind)).collect()
    }

    fn step(&mut self, actions: &[Action]) -> Vec<(u32, u32)> {
        let commands: Vec<Command> = actions.iter().zip(1..).map(command).collect();
        self.world.step(FRAME, &commands);
        self.publish()
    }

    /// Steps until the first object sleeps; the watchdog is some ten times what it takes.
    fn fall_asleep(&mut self) {
        for _ in 0..900 {
            self.step(&[]);
            if self.world.report().objects[0].level == Level::Asleep {
                return;
            }
        }
        panic!("awake: {:?}", self.world.report().objects[0]);
    }
}

fn command((action, sequence): (&Action, u64)) -> Command {
    Command {
        apply_at_step: 0,
        client: 1,
        sequence,
        action: action.clone(),
    }
}

#[test]
fn readers_have_the_whole_frame_whatever_is_left_out() {
    let mut session = Session::new();
    let all = session.publish();
    assert_eq!(
        all,
        [
            (0, CHANGE_GAUSSIANS),
            (1, CHANGE_FORM),
            (2, CHANGE_GAUSSIANS),
            (3, CHANGE_GAUSSIANS)
        ]
    );
    let moving = session.step(&[]);
    assert_eq!(
        moving,
        [
            (0, CHANGE_GAUSSIANS),
            (1, CHANGE_PLACED),
            (2, CHANGE_GAUSSIANS)
        ]
    );
    session.fall_asleep();
    let asleep = session.step(&[]);
    assert!(asleep.iter().all(|(object, _)| *object != 0), "{asleep:?}");
    let push = Action::Impulse {
        object: 0,
        impulse: [0.1, 0.0, 0.0],
    };
    let woken = session.step(&[Action::Save { snapshot: 1 }, push]);
    assert!(woken.contains(&(0, CHANGE_GAUSSIANS)), "{woken:?}");
    session.step(&[]);
    // All of it may be elsewhere.
    let back = session.step(&[Action::Restore { snapshot: 1 }]);
    assert_eq!(back.len(), 4, "{back:?}");
    let reset = session.step(&[Action::Reset]);
    assert_eq!(reset.len(), 4, "{reset:?}");
    session.step(&[]);
}

#[test]
fn a_rigid_proxy_is_told_as_a_form_and_then_as_places() {
    let mut session = Session::new();
    session.publish();
    let kinds: Vec<_> = (0..20)
        .flat_map(|_| session.step(&[]))
        .filter(|(object, _)| *object == 2)
        .map(|(_, kind)| kind)
        .collect();
    let forms = kinds.iter().filter(|kind| **kind == CHANGE_FORM).count();
    assert_eq!(
        (forms, kinds.last()),
        (1, Some(&CHANGE_PLACED)),
        "{kinds:?}"
    );
}

#[test]
fn a_placed_gaussian_is_where_its_particle_is() {
    let mut session = Session::new();
    for _ in 0..30 {
        session.step(&[]);
    }
    session.publish();
    assert!(session.world.visible(1).placed.is_some());
    let range = session.world.scene().objects[1].gaussians.clone();
    let particles = &session.world.scene().binding.particle;
    for g in range {
        let particle = session.world.positions()[particles[g][0] as usize];
        let gaussian = session.reader.gaussians()[g].position;
        for a in 0..3 {
            // Both are rounded to single precision, once and a few times, at two metres.
            assert!(
                (particle[a] - gaussian[a]).abs() < 2e-6,
                "{particle:?} {gaussian:?}"
            );
        }
    }
}

#[test]
fn a_step_that_is_sent_again_is_told_whole() {
    let mut session = Session::new();
    session.step(&[]);
    assert_eq!(session.publish().len(), 4);
    let next = session.step(&[]);
    assert_eq!(next.len(), 3, "{next:?}");
}
