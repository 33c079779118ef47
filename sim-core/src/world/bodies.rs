//! Rigid matter in the world: one body per object, made from its particles, moved in every substep, written back to
//! its particles once per frame.

use serde::{Deserialize, Serialize};

use super::{World, frame::Frame};
use crate::{
    bodies::{
        body::Body,
        engine::{Actor, Drive, Outcome, Setting, step},
        near::Fields,
        nodes::{Wader, Water, wade},
        shape::{Grain, Shape, frame as frame_of, of_cubes},
    },
    colliders::Substep,
    grid::anchors::Anchors,
    mat3::{Mat3, cross},
    particles::{BLOCK, Block},
    report::ObjectState,
    scene::{Fidelity, Part},
};

/// The rigid particles of an object as one body.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Rigid {
    pub body: Body,
    /// Inertia per mass beside that of its particles' places [m^2].
    own: f64,
    pub members: Vec<Member>,
}

impl Rigid {
    /// Whether it has particles, in places, and a rotation.
    pub fn is_sound(&self) -> bool {
        let finite = |x: &[f64; 3]| x.iter().all(|x| x.is_finite());
        let turn = self.body.rotation.iter().map(|x| x * x).sum::<f64>();
        !self.members.is_empty()
            && self.members.iter().all(|member| finite(&member.place))
            && (turn - 1.0).abs() < 1e-6
            && self.own.is_finite()
    }
}

/// A particle of a body.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Member {
    /// Index into the scene's particles.
    pub id: u32,
    /// Place in the body's frame [m].
    pub place: [f64; 3],
    /// Visible and elastic deformation, turned into the body's frame, row-major.
    pub visible: [f32; 9],
    pub elastic: [f32; 9],
    pub memory: f32,
}

/// A particle on its way into a body or out of it, in the world [m, s].
#[derive(Clone, Copy, Debug)]
pub(super) struct Loose {
    pub id: u32,
    pub x: [f64; 3],
    pub v: [f64; 3],
    pub c: [f64; 9],
    pub visible: [f32; 9],
    pub elastic: [f32; 9],
    pub memory: f32,
}

/// `r m` for a rotation and a row-major matrix.
pub(super) fn turned(r: &Mat3<f64>, m: &[f32; 9]) -> [f32; 9] {
    let m = Mat3(std::array::from_fn(|i| {
        std::array::from_fn(|j| f64::from(m[3 * i + j]))
    }));
    let product = r.mul(&m);
    std::array::from_fn(|n| product.0[n / 3][n % 3] as f32)
}

/// Rotation matrix of a body.
pub(super) fn attitude(body: &Body) -> Mat3<f64> {
    let column = |a: usize| {
        let mut axis = [0.0; 3];
        axis[a] = 1.0;
        crate::colliders::pose::rotate(body.rotation, axis)
    };
    Mat3::from_columns(column(0), column(1), column(2))
}

impl World {
    /// Mass and volume of a particle at a place.
    pub(super) fn grain(&self, object: usize, id: u32, x: [f64; 3]) -> Grain {
        let volume = self.scene.particles.volume[id as usize];
        let density = self.scene.objects[object].density_of(id as usize);
        Grain {
            x,
            mass: density * volume,
            volume,
        }
    }

    /// The shape of an object's body, from its members alone: the same whenever it is made.
    fn shape_of(&self, object: usize, rigid: &Rigid) -> Shape {
        let grains = rigid.members.iter();
        let grains: Vec<Grain> = grains
            .map(|member| self.grain(object, member.id, member.place))
            .collect();
        Shape::new(&grains, rigid.own)
    }

    /// Makes the shapes of all bodies anew.
    pub(super) fn reshape(&mut self) {
        let objects = 0..self.scene.objects.len();
        let shape = |id: usize| Some(self.shape_of(id, self.state.rigid[id].as_ref()?));
        self.shapes = objects.map(shape).collect();
    }

    /// Joins particles of an object to one body. `own` as in [`Shape::new`]; none for cubes. Linear and angular momentum
    /// are those of the particles, the affine part included.
    pub(super) fn form_body(&mut self, object: usize, loose: &[Loose], own: Option<f64>) {
        let grains: Vec<Grain> = loose
            .iter()
            .map(|p| self.grain(object, p.id, p.x))
            .collect();
        let hint = self.scene.objects[object].world_from_asset.map(f64::from);
        let size = hint.iter().map(|x| x * x).sum::<f64>().sqrt();
        let hint = match size > 0.5 {
            true => hint.map(|x| x / size),
            false => [0.0, 0.0, 0.0, 1.0],
        };
        let Some(mut body) = frame_of(&grains, hint) else {
            return;
        };
        let mass: f64 = grains.iter().map(|g| g.mass).sum();
        let d_p = 0.25 * self.scene.dx * self.scene.dx;
        let back = attitude(&body).transpose();
        let mut members = Vec::with_capacity(loose.len());
        for (p, grain) in loose.iter().zip(&grains) {
            let r: [f64; 3] = std::array::from_fn(|a| p.x[a] - body.com[a]);
            let orbit = cross(r, p.v);
            let c = &p.c;
            let axial = [c[7] - c[5], c[2] - c[6], c[3] - c[1]];
            for a in 0..3 {
                body.velocity[a] += grain.mass / mass * p.v[a];
                body.angular_momentum[a] += grain.mass * (orbit[a] + d_p * axial[a]);
            }
            members.push(Member {
                id: p.id,
                place: body.inverse_point(p.x),
                visible: turned(&back, &p.visible),
                elastic: turned(&back, &p.elastic),
                memory: p.memory,
            });
        }
        let rigid = Rigid {
            body,
            own: own.unwrap_or_else(|| of_cubes(&grains)),
            members,
        };
        self.shapes[object] = Some(self.shape_of(object, &rigid));
        self.state.rigid[object] = Some(rigid);
    }

    /// The particles of a body, with its momentum and angular momentum.
    pub(super) fn loosened(&self, object: usize, rigid: &Rigid) -> Vec<Loose> {
        let r = attitude(&rigid.body);
        let grains = rigid.members.iter();
        let grains: Vec<Grain> = grains
            .map(|member| self.grain(object, member.id, member.place))
            .collect();
        // As particles they carry 2 D_p per mass in their affine part.
        let own = 0.5 * self.scene.dx * self.scene.dx;
        let momentum = r.transpose().mul_vec(rigid.body.angular_momentum);
        let spin = r.mul_vec(Shape::spin(&grains, own, momentum));
        let [x, y, z] = spin;
        let member = |member: &Member| {
            let arm = r.mul_vec(member.place);
            let orbit = cross(spin, arm);
            Loose {
                id: member.id,
                x: std::array::from_fn(|a| rigid.body.com[a] + arm[a]),
                v: std::array::from_fn(|a| rigid.body.velocity[a] + orbit[a]),
                c: [0.0, -z, y, z, 0.0, -x, -y, x, 0.0],
                visible: turned(&r, &member.visible),
                elastic: turned(&r, &member.elastic),
                memory: member.memory,
            }
        };
        rigid.members.iter().map(member).collect()
    }

    /// Bodies of all objects that are rigid at rest.
    pub(super) fn form_bodies(&mut self) {
        let count = self.scene.objects.len();
        self.state.rigid = vec![None; count];
        self.state.pressing.clear();
        self.shapes = vec![None; count];
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        for object in 0..count {
            if self.scene.objects[object].fidelity == Fidelity::Static {
                continue;
            }
            let parts = self.parts.iter();
            let rigid = parts.enumerate();
            let rigid = rigid.filter(|(n, p)| p.object == object && self.is_joined(*n));
            let ids: Vec<usize> = rigid.flat_map(|(_, part)| part.particles.clone()).collect();
            let (inside, outside): (Vec<usize>, Vec<usize>) = ids
                .into_iter()
                .partition(|&p| self.is_inside(self.scene.particles.position[p]));
            for p in outside {
                self.published.freeze(p as u32);
                self.state.removed.push(p as u32);
            }
            let loose: Vec<Loose> = inside
                .into_iter()
                .map(|p| Loose {
                    id: p as u32,
                    x: self.scene.particles.position[p],
                    v: [0.0; 3],
                    c: [0.0; 9],
                    visible: identity,
                    elastic: identity,
                    memory: 0.0,
                })
                .collect();
            self.form_body(object, &loose, None);
            self.start_body(object);
        }
    }

    /// Gives a body the velocity and spin that it begins with.
    pub(super) fn start_body(&mut self, object: usize) {
        let o = &self.scene.objects[object];
        let (linear, g) = (o.linear_velocity, o.velocity_gradient);
        let spin = [g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]];
        self.set_body_velocity(object, linear, spin.map(|w| 0.5 * w));
    }

    /// Whether a point [m] is in the domain.
    fn is_inside(&self, x: [f64; 3]) -> bool {
        let domain = &self.scene.domain;
        (0..3).all(|a| (domain.min[a]..=domain.max[a]).contains(&x[a]))
    }

    /// Gives a body a velocity [m/s] and an angular velocity [rad/s].
    pub(super) fn set_body_velocity(&mut self, object: usize, linear: [f64; 3], spin: [f64; 3]) {
        if let (Some(rigid), Some(shape)) = (&mut self.state.rigid[object], &self.shapes[object]) {
            rigid.body.velocity = linear;
            rigid.body.set_spin(&shape.inertia, spin);
        }
    }

    /// Changes the velocity of some particles of a body, or all, by `change` [m/s], as far as one body can.
    pub(super) fn push_body(&mut self, object: usize, change: [f64; 3], ids: Option<&[u32]>) {
        let Some(mut rigid) = self.state.rigid[object].take() else {
            return;
        };
        let touched = |id: u32| ids.is_none_or(|list| list.binary_search(&id).is_ok());
        let (mass, moment) = self.moment(object, &rigid, touched);
        if let Some(shape) = &self.shapes[object] {
            let turn = cross(moment, change);
            for a in 0..3 {
                rigid.body.velocity[a] += mass / shape.inertia.mass * change[a];
                rigid.body.angular_momentum[a] += turn[a];
            }
        }
        self.state.rigid[object] = Some(rigid);
    }

    /// Mass of some members, and first moment about the centre of mass.
    fn moment(&self, object: usize, rigid: &Rigid, which: impl Fn(u32) -> bool) -> (f64, [f64; 3]) {
        let (mut mass, mut moment) = (0.0, [0.0; 3]);
        for member in rigid.members.iter().filter(|m| which(m.id)) {
            let m = self.grain(object, member.id, member.place).mass;
            let x = rigid.body.point(member.place);
            mass += m;
            for a in 0..3 {
                moment[a] += m * (x[a] - rigid.body.com[a]);
            }
        }
        (mass, moment)
    }

    /// Where all bodies are.
    pub(super) fn bodies(&self) -> Vec<Option<Body>> {
        let rigid = self.state.rigid.iter();
        rigid.map(|rigid| rigid.as_ref().map(|r| r.body)).collect()
    }

    /// Whether there is any body.
    pub(super) fn has_bodies(&self) -> bool {
        self.state.rigid.iter().any(Option::is_some)
    }

    /// What moves a body in a substep besides contact and gravity.
    fn drive(&self, object: usize, rigid: &Rigid, substep: &Substep) -> Drive {
        if self.state.sleeps(object) {
            return Drive::Held {
                velocity: [0.0; 3],
                spin: [0.0; 3],
            };
        }
        let dx = self.scene.dx;
        if self.rules.hold_in(&self.state.pins, substep) {
            let mut members = rigid.members.iter();
            let field = members.find_map(|m| self.rules.field(&self.state.pins, substep, m.id));
            if let Some(field) = field {
                let com = rigid.body.com.map(|x| x / dx);
                let [_, a, b, c, _, d, e, f, _] = field.gradient();
                return Drive::Held {
                    velocity: field.velocity(com).map(|v| v * dx),
                    spin: [0.5 * (f - d), 0.5 * (b - e), 0.5 * (c - a)],
                };
            }
        }
        let (mut force, mut torque) = ([0.0; 3], [0.0; 3]);
        if self.rules.push_in(substep) {
            let pushes = self.rules.pushes(substep);
            for member in &rigid.members {
                let change = pushes.on(member.id);
                if change == [0.0; 3] {
                    continue;
                }
                let mass = self.grain(object, member.id, member.place).mass;
                let x = rigid.body.point(member.place);
                let f = change.map(|v| mass * v * dx / substep.dt);
                let turn = cross(std::array::from_fn(|a| x[a] - rigid.body.com[a]), f);
                for a in 0..3 {
                    force[a] += f[a];
                    torque[a] += turn[a];
                }
            }
        }
        Drive::Free { force, torque }
    }

    /// Bodies meet the nodes of the grid, then each other and colliders, and move by a substep of `dt` [s]; returns the
    /// largest velocity component given to a node [cells/s].
    pub(super) fn move_bodies(&mut self, substep: &Substep, fields: Fields<'_>) -> f32 {
        if !self.has_bodies() {
            return 0.0;
        }
        // Their velocities are those of now, and they move along the mean one: no half substep is missing.
        let substep = &Substep {
            kick: substep.dt,
            ..*substep
        };
        let mut objects = Vec::new();
        let mut waders = Vec::new();
        for (object, rigid) in self.state.rigid.iter().enumerate() {
            if let (Some(rigid), Some(shape)) = (rigid, &self.shapes[object]) {
                objects.push(object);
                waders.push(Wader {
                    object,
                    shape,
                    body: rigid.body,
                    drive: self.drive(object, rigid, substep),
                });
            }
        }
        let scene = &self.scene;
        let single = (0..self.parts.len()).all(|part| self.field_of(part) == 0);
        let friction = |object: usize, field: u32| match single {
            true => scene.objects[object].surface.friction_to_objects(),
            false => scene.surface_between(object, field as usize).friction,
        };
        let anchors = Anchors::new(
            &self.state.particles,
            &self.rules,
            &self.state.pins,
            *substep,
            &self.workspace.concerned,
            self.workspace.grid.nodes.len(),
        );
        let water = Water {
            particles: &self.state.particles,
            fields,
            anchors: &anchors,
            fastest: 3.0_f64.sqrt() * self.state.grid_speed * scene.dx,
            dx: scene.dx,
            mass_unit: self.mass_unit,
            carrier: self.state.carrier,
            gravity: self.state.gravity,
            dt: substep.dt,
            friction: &friction,
            bonded: &|object, field| !single && object == field as usize,
        };
        let (loads, largest) = match self.state.particles.groups.is_empty() {
            true => (vec![([0.0; 3], [0.0; 3]); waders.len()], 0.0),
            false => wade(&mut self.workspace.grid, &waders, &water),
        };
        let mut actors: Vec<Actor<'_>> = Vec::with_capacity(waders.len());
        for (wader, load) in waders.iter().zip(loads) {
            actors.push(Actor {
                shape: wader.shape,
                body: wader.body,
                drive: wader.drive.with(load),
            });
        }
        let (solids, paths) = (&self.solids, &self.state.paths);
        let walls = |from: f64, length: f64| {
            let part = Substep {
                time: substep.time + from,
                dt: length,
                ..*substep
            };
            solids.all(paths, &part)
        };
        let surface = |a: usize, b: usize| {
            let surface = scene.surface_between(objects[a], objects[b]);
            (surface.restitution.unwrap_or(0.0), surface.friction)
        };
        let setting = Setting {
            gravity: self.state.gravity,
            dx: scene.dx,
            damping: scene.conditions.damping,
            walls: &walls,
            surface: &surface,
            friction: &|body| solids.friction_of(objects[body]),
        };
        let outcome: Outcome = step(&mut actors, &mut self.state.pressing, &setting, substep.dt);
        self.workspace.body_pairs = outcome.pairs;
        for (object, actor) in objects.iter().zip(&actors) {
            if let Some(rigid) = &mut self.state.rigid[*object] {
                rigid.body = actor.body;
            }
        }
        largest
    }

    /// Brings a body to rest, for good of those that look at its particles too.
    pub(super) fn stop_body(&mut self, object: usize) {
        let Some(rigid) = &mut self.state.rigid[object] else {
            return;
        };
        (rigid.body.velocity, rigid.body.angular_momentum) = ([0.0; 3], [0.0; 3]);
        self.publish_body(object);
    }

    /// The blocks of cells that a body may reach into, sorted.
    pub(super) fn blocks_of_body(&self, object: usize) -> Option<Vec<Block>> {
        let (rigid, shape) = (
            self.state.rigid[object].as_ref()?,
            self.shapes[object].as_ref()?,
        );
        let edge = f64::from(BLOCK) * self.scene.dx;
        let at = |a: usize, sign: f64| {
            let x = (rigid.body.com[a] + sign * shape.radius) / edge;
            x.floor().clamp(-1e6, 1e6) as i32
        };
        let mut blocks = Vec::new();
        for i in at(0, -1.0)..=at(0, 1.0) {
            for j in at(1, -1.0)..=at(1, 1.0) {
                for k in at(2, -1.0)..=at(2, 1.0) {
                    blocks.push(Block {
                        field: object as u32,
                        index: [i, j, k],
                        runs: 0..0,
                        groups: 0..0,
                        shapes: 0..0,
                    });
                }
            }
        }
        Some(blocks)
    }

    /// Takes bodies out whose centre of mass has left the domain, or is nowhere.
    pub(super) fn take_out_bodies(&mut self, frame: &mut Frame) {
        for object in 0..self.state.rigid.len() {
            let Some(rigid) = &self.state.rigid[object] else {
                continue;
            };
            let Body {
                com,
                velocity,
                angular_momentum,
                ..
            } = rigid.body;
            let all = com.iter().chain(&velocity).chain(&angular_momentum);
            let finite = all.into_iter().all(|x| x.is_finite());
            if finite && self.is_inside(com) {
                continue;
            }
            if finite {
                self.publish_body(object);
            }
            let Some(rigid) = self.state.rigid[object].take() else {
                continue;
            };
            let mut ids: Vec<u32> = rigid.members.iter().map(|m| m.id).collect();
            ids.sort_unstable();
            for &id in &ids {
                self.published.freeze(id);
            }
            self.state.removed.extend(&ids);
            frame.lose_body(ids, finite);
        }
    }

    /// Writes the particles of an object's body.
    fn publish_body(&mut self, object: usize) {
        if let (Some(rigid), Some(shape)) = (&self.state.rigid[object], &self.shapes[object]) {
            let spin = rigid.body.spin(&shape.inertia);
            self.published.update_body(rigid, spin, self.scene.dx);
        }
    }

    /// Writes the particles of all bodies that are awake.
    pub(super) fn publish_bodies(&mut self) {
        for object in 0..self.state.rigid.len() {
            self.publish_body(object);
        }
    }

    /// Whether an object is a body and nothing else.
    pub(super) fn is_one_body(&self, object: usize) -> bool {
        let apart = |(n, part): (usize, &Part)| {
            part.object == object && !self.is_joined(n) && !part.particles.is_empty()
        };
        self.state.rigid[object].is_some() && !self.parts.iter().enumerate().any(apart)
    }

    /// Mass of an object's body [kg]; 0 without one.
    pub(super) fn mass_of_body(&self, object: usize) -> f64 {
        match (&self.state.rigid[object], &self.shapes[object]) {
            (Some(_), Some(shape)) => shape.inertia.mass,
            _ => 0.0,
        }
    }

    /// Moments of an object that is one body, in full.
    pub(super) fn body_state(&self, object: usize) -> Option<ObjectState> {
        let (rigid, shape) = (
            self.state.rigid[object].as_ref()?,
            self.shapes[object].as_ref()?,
        );
        if !self.is_one_body(object) {
            return None;
        }
        let Body {
            com,
            velocity,
            angular_momentum,
            ..
        } = rigid.body;
        let r = attitude(&rigid.body);
        let (mass, own) = (shape.inertia.mass, rigid.own * shape.inertia.mass);
        let moments = shape.inertia.moments.map(|i| i - own);
        let inertia = r.mul(&Mat3::diagonal(moments)).mul_transposed(&r).0;
        let spread = 0.5 * (moments[0] + moments[1] + moments[2]);
        // The mean rotation since rest, as of other objects.
        let mut mean = [0.0; 9];
        for member in &rigid.members {
            let m = self.grain(object, member.id, member.place).mass / mass;
            for n in 0..9 {
                mean[n] += m * f64::from(member.visible[n]);
            }
        }
        let mean = r.mul(&Mat3(std::array::from_fn(|i| {
            std::array::from_fn(|j| mean[3 * i + j])
        })));
        Some(ObjectState {
            mass,
            com,
            linear_velocity: velocity,
            angular_momentum,
            angular_velocity: rigid.body.spin(&shape.inertia),
            inertia: [
                inertia[0][0],
                inertia[0][1],
                inertia[0][2],
                inertia[1][1],
                inertia[1][2],
                inertia[2][2],
            ],
            rotation: crate::moments::quaternion(&crate::materials::polar::rotation(&mean)),
            radius: (5.0 / 3.0 * spread / mass).max(0.0).sqrt(),
            kinetic_energy: rigid.body.kinetic_energy(&shape.inertia),
            elastic_energy: self.state.standing[object].stored_energy(),
            ..ObjectState::default()
        })
    }
}
