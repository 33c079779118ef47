//! RigidBody matter in the world: one body per object, made from its particles, moved in every substep, written back to
//! its particles once per frame.

use super::{World, frame::Frame};
use crate::{
    bodies::{
        body::Body,
        grain::{Grain, of_cubes},
        shape::{Shape, frame as frame_of},
    },
    mat3::{Mat3, cross},
    particles::{BLOCK, Block},
    report::ObjectState,
    scene::{Fidelity, Part},
    state::{
        RigidBodies,
        away::Loose,
        rigid::{Member, RigidBody},
    },
};

/// Deformation gradient of what keeps its shape, row-major.
pub(super) const IDENTITY: [f32; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

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
        crate::rotation::rotate(body.rotation, axis)
    };
    Mat3::from_columns(column(0), column(1), column(2))
}

impl World {
    /// The shape of an object's body, from its members alone: the same whenever it is made.
    pub(super) fn shape_of(&self, object: usize, rigid: &RigidBody) -> Shape {
        let grains = rigid.members.iter();
        let grains: Vec<Grain> = grains
            .map(|member| self.model.grain(object, member.id, member.place))
            .collect();
        Shape::new(&grains, rigid.own)
    }

    /// Makes the shapes of all bodies, or takes those that the same particles had before: whoever goes back and forth
    /// between states of a run need not wait for distances.
    pub(super) fn reshape(&mut self, mut before: RigidBodies) {
        let objects = 0..self.model.scene.objects.len();
        let shape = |id: usize| {
            let rigid = self.state.bodies.of[id].as_ref()?;
            let is_same = |old: &RigidBody| old.has_shape_of(rigid);
            let is_same = before
                .of
                .get(id)
                .is_some_and(|old| old.as_ref().is_some_and(is_same));
            let known = before
                .shapes
                .get_mut(id)
                .and_then(Option::take)
                .filter(|_| is_same);
            Some(known.unwrap_or_else(|| self.shape_of(id, rigid)))
        };
        self.state.bodies.shapes = objects.map(shape).collect();
    }

    /// Joins particles of an object to one body. `own` as in [`Shape::new`]; none for cubes. Linear and angular momentum
    /// are those of the particles, the affine part included.
    pub(super) fn form_body(&mut self, object: usize, loose: &[Loose], own: Option<f64>) {
        let grains: Vec<Grain> = loose
            .iter()
            .map(|p| self.model.grain(object, p.id, p.x))
            .collect();
        let hint = self.model.scene.objects[object]
            .world_from_asset
            .map(f64::from);
        let size = hint.iter().map(|x| x * x).sum::<f64>().sqrt();
        let hint = match size > 0.5 {
            true => hint.map(|x| x / size),
            false => [0.0, 0.0, 0.0, 1.0],
        };
        let Some(mut body) = frame_of(&grains, hint) else {
            return;
        };
        let mass: f64 = grains.iter().map(|g| g.mass).sum();
        let d_p = 0.25 * self.model.scene.dx * self.model.scene.dx;
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
        let rigid = RigidBody {
            body,
            own: own.unwrap_or_else(|| of_cubes(&grains)),
            members,
        };
        self.state.bodies.shapes[object] = Some(self.shape_of(object, &rigid));
        self.state.bodies.of[object] = Some(rigid);
        self.sight.formed(object);
    }

    /// The particles of a body, with its momentum and angular momentum.
    pub(super) fn loosened(&self, object: usize, rigid: &RigidBody) -> Vec<Loose> {
        let r = attitude(&rigid.body);
        let grains = rigid.members.iter();
        let grains: Vec<Grain> = grains
            .map(|member| self.model.grain(object, member.id, member.place))
            .collect();
        // As particles they carry 2 D_p per mass in their affine part.
        let own = 0.5 * self.model.scene.dx * self.model.scene.dx;
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
        let count = self.model.scene.objects.len();
        self.state.bodies.of = vec![None; count];
        self.state.bodies.warm_start.clear();
        self.state.bodies.shapes = vec![None; count];
        for object in 0..count {
            if self.model.scene.objects[object].fidelity == Fidelity::Static {
                continue;
            }
            let parts = self.model.parts.iter();
            let rigid = parts.enumerate();
            let rigid = rigid.filter(|(n, p)| p.object == object && self.given().is_joined(*n));
            let ids: Vec<usize> = rigid.flat_map(|(_, part)| part.particles.clone()).collect();
            let (inside, outside): (Vec<usize>, Vec<usize>) = ids
                .into_iter()
                .partition(|&p| self.model.is_inside(self.model.scene.particles.position[p]));
            for p in outside {
                self.published.freeze(p as u32);
                self.state.matter.removed.push(p as u32);
            }
            let loose: Vec<Loose> = inside
                .into_iter()
                .map(|p| Loose {
                    id: p as u32,
                    x: self.model.scene.particles.position[p],
                    v: [0.0; 3],
                    c: [0.0; 9],
                    visible: IDENTITY,
                    elastic: IDENTITY,
                    memory: 0.0,
                })
                .collect();
            self.form_body(object, &loose, None);
            self.start_body(object);
        }
    }

    /// Gives a body the velocity and spin that it begins with.
    pub(super) fn start_body(&mut self, object: usize) {
        let o = &self.model.scene.objects[object];
        let (linear, g) = (o.linear_velocity, o.velocity_gradient);
        let spin = [g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]];
        self.set_body_velocity(object, linear, spin.map(|w| 0.5 * w));
    }

    /// Gives a body a velocity [m/s] and an angular velocity [rad/s].
    pub(super) fn set_body_velocity(&mut self, object: usize, linear: [f64; 3], spin: [f64; 3]) {
        if let (Some(rigid), Some(shape)) = (
            &mut self.state.bodies.of[object],
            &self.state.bodies.shapes[object],
        ) {
            rigid.body.velocity = linear;
            rigid.body.set_spin(&shape.inertia, spin);
        }
    }

    /// Changes the velocity of some particles of a body, or all, by `change` [m/s], as far as one body can.
    pub(super) fn push_body(&mut self, object: usize, change: [f64; 3], ids: Option<&[u32]>) {
        let Some(mut rigid) = self.state.bodies.of[object].take() else {
            return;
        };
        let touched = |id: u32| ids.is_none_or(|list| list.binary_search(&id).is_ok());
        let (mass, moment) = self.moment(object, &rigid, touched);
        if let Some(shape) = &self.state.bodies.shapes[object] {
            let turn = cross(moment, change);
            for a in 0..3 {
                rigid.body.velocity[a] += mass / shape.inertia.mass * change[a];
                rigid.body.angular_momentum[a] += turn[a];
            }
        }
        self.state.bodies.of[object] = Some(rigid);
    }

    /// Mass of some members, and first moment about the centre of mass.
    fn moment(
        &self,
        object: usize,
        rigid: &RigidBody,
        which: impl Fn(u32) -> bool,
    ) -> (f64, [f64; 3]) {
        let (mut mass, mut moment) = (0.0, [0.0; 3]);
        for member in rigid.members.iter().filter(|m| which(m.id)) {
            let m = self.model.grain(object, member.id, member.place).mass;
            let x = rigid.body.point(member.place);
            mass += m;
            for a in 0..3 {
                moment[a] += m * (x[a] - rigid.body.com[a]);
            }
        }
        (mass, moment)
    }

    /// Brings a body to rest, for good of those that look at its particles too.
    pub(super) fn stop_body(&mut self, object: usize) {
        let Some(rigid) = &mut self.state.bodies.of[object] else {
            return;
        };
        (rigid.body.velocity, rigid.body.angular_momentum) = ([0.0; 3], [0.0; 3]);
        self.publish_body(object);
    }

    /// Box around the ball that holds a body [m].
    pub(super) fn box_of_body(&self, object: usize) -> Option<[[f64; 3]; 2]> {
        let (rigid, shape) = self.state.bodies.get(object)?;
        let com = rigid.body.com;
        Some([com.map(|x| x - shape.radius), com.map(|x| x + shape.radius)])
    }

    /// The blocks of cells of an object in a box [m], sorted.
    pub(super) fn blocks_in(&self, object: usize, bounds: [[f64; 3]; 2]) -> Vec<Block> {
        let edge = f64::from(BLOCK) * self.model.scene.dx;
        let [low, high] = bounds.map(|x| x.map(|x| (x / edge).floor().clamp(-1e6, 1e6) as i32));
        let mut blocks = Vec::new();
        for i in low[0]..=high[0] {
            for j in low[1]..=high[1] {
                for k in low[2]..=high[2] {
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
        blocks
    }

    /// Takes bodies out whose centre of mass has left the domain, or is nowhere.
    pub(super) fn take_out_bodies(&mut self, frame: &mut Frame) {
        for object in 0..self.state.bodies.of.len() {
            let Some(rigid) = &self.state.bodies.of[object] else {
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
            if finite && self.model.is_inside(com) {
                continue;
            }
            if finite {
                self.publish_body(object);
            }
            let Some(rigid) = self.state.bodies.of[object].take() else {
                continue;
            };
            let mut ids: Vec<u32> = rigid.members.iter().map(|m| m.id).collect();
            ids.sort_unstable();
            for &id in &ids {
                self.published.freeze(id);
            }
            self.state.matter.removed.extend(&ids);
            frame.lose_body(ids, finite);
        }
    }

    /// Writes the particles of an object's body.
    fn publish_body(&mut self, object: usize) {
        if let (Some(rigid), Some(shape)) = (
            &self.state.bodies.of[object],
            &self.state.bodies.shapes[object],
        ) {
            let spin = rigid.body.spin(&shape.inertia);
            self.published.update_body(rigid, spin, self.model.scene.dx);
        }
    }

    /// Writes the particles of all bodies that are awake.
    pub(super) fn publish_bodies(&mut self) {
        for object in 0..self.state.bodies.of.len() {
            self.publish_body(object);
        }
    }

    /// Whether an object is a body and nothing else.
    pub(super) fn is_one_body(&self, object: usize) -> bool {
        let apart = |(n, part): (usize, &Part)| {
            let is_empty = self.model.particle_counts[n] == 0;
            part.object == object && !self.given().is_joined(n) && !is_empty
        };
        self.state.bodies.of[object].is_some() && !self.model.parts.iter().enumerate().any(apart)
    }

    /// Mass of an object's body [kg]; 0 without one.
    pub(super) fn mass_of_body(&self, object: usize) -> f64 {
        match (
            &self.state.bodies.of[object],
            &self.state.bodies.shapes[object],
        ) {
            (Some(_), Some(shape)) => shape.inertia.mass,
            _ => 0.0,
        }
    }

    /// Moments of an object that is one body, in full.
    pub(super) fn body_state(&self, object: usize) -> Option<ObjectState> {
        let (rigid, shape) = (
            self.state.bodies.of[object].as_ref()?,
            self.state.bodies.shapes[object].as_ref()?,
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
            let m = self.model.grain(object, member.id, member.place).mass / mass;
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
            rotation: crate::rotation::quaternion(&crate::materials::polar::rotation(&mean)),
            radius: (5.0 / 3.0 * spread / mass).max(0.0).sqrt(),
            kinetic_energy: rigid.body.kinetic_energy(&shape.inertia),
            elastic_energy: self.state.levels[object].stored_energy(),
            ..ObjectState::default()
        })
    }
}
