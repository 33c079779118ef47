//! Contact and prescribed motion of the particles of one block, lane by lane.
//!
//! Scalar on purpose: only blocks that a collider or a rule reaches come here, and what happens to a particle must
//! not depend on the instruction set.

use std::cell::RefCell;

use crate::{
    colliders::{
        VelocityChange,
        sweep::Way,
        touch::{ANCHOR, ParticleConditions},
    },
    grid::Tile,
    ledger::ColliderImpulses,
    particles::{BLOCK, Block, Motion, NO_PARTICLE, position_in_cells},
    simd::{F32x16, LANES},
};

/// Quadratic B-spline.
fn spline(r: f64) -> f64 {
    if r.abs() < 0.5 {
        0.75 - r * r
    } else {
        0.5 * (1.5 - r.abs()).max(0.0).powi(2)
    }
}

/// What acts on the particles of one block.
#[derive(Clone, Debug)]
pub(crate) struct LaneConditions<'a> {
    touch: ParticleConditions<'a>,
    block: [i32; 3],
    centre: [f64; 3],
    /// Velocity that those of particles are relative to, before and after the next transfer [cells/s].
    frame_velocity: [[f64; 3]; 2],
    /// What damping leaves of relative velocities in the next transfer.
    keep: f64,
    /// What colliders give to its particles [mass units, cells, s].
    given: RefCell<ColliderImpulses>,
}

/// Particles of a group, lane by lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaneIds<'a> {
    /// Their numbers in the scene, or [`NO_PARTICLE`].
    pub ids: &'a [u32; LANES],
    /// Their masses.
    pub mass: &'a F32x16,
}

/// Makes the lanes that are held as heavy as they must be, and free of stress; returns the masses.
#[inline(never)]
pub(super) fn anchor(
    held: u16,
    mass: &F32x16,
    motion: &Motion,
    affine: &mut [F32x16; 9],
) -> F32x16 {
    let mut heavy = *mass;
    for lane in (0..LANES).filter(|lane| held >> lane & 1 == 1) {
        heavy.0[lane] *= ANCHOR as f32;
        for n in 0..9 {
            affine[n].0[lane] = motion.c[n].0[lane];
        }
    }
    heavy
}

impl<'a> LaneConditions<'a> {
    /// What acts on a block, if anything does; `concerned` says whether a rule names one of its particles.
    pub fn new(
        touch: &ParticleConditions<'a>,
        block: &Block,
        concerned: bool,
        frame_velocity: [[f64; 3]; 2],
        keep: f64,
    ) -> Option<Self> {
        let first = block.index.map(|i| f64::from(BLOCK * i));
        // Cells of the block, and as far as particles may drift and travel.
        let min = first.map(|x| x - 2.5);
        let max = first.map(|x| x + f64::from(BLOCK) + 1.5);
        Some(Self {
            touch: touch.near(block.field, min, max, concerned)?,
            block: block.index,
            centre: first.map(|x| x + 1.5),
            frame_velocity,
            keep: keep.max(f64::MIN_POSITIVE),
            given: RefCell::default(),
        })
    }

    /// What colliders gave to the particles.
    pub fn given(self) -> ColliderImpulses {
        self.given.into_inner()
    }

    /// Corrects what sixteen particles gathered, [`Motion::v`] and [`Motion::c`], where a thin wall parts them from some
    /// of their nodes.
    #[inline(never)]
    pub fn shield(
        &self,
        LaneIds { ids, mass }: LaneIds<'_>,
        x: &[F32x16; 3],
        tile: &Tile,
        gathered: &mut Motion,
    ) {
        let mut given = self.given.borrow_mut();
        for lane in (0..LANES).filter(|&lane| ids[lane] != NO_PARTICLE) {
            let local = [x[0].0[lane], x[1].0[lane], x[2].0[lane]];
            let at = position_in_cells(self.block, local);
            let v = self.velocity(gathered, lane);
            if !v.iter().all(|v| v.is_finite()) {
                continue;
            }
            let ghosts = self.touch.ghosts(at, v);
            if ghosts.is_empty() {
                continue;
            }
            // Nodes of the tile run from -2 to 5, the block's centre is at 1.5.
            let cell = local.map(|x| (f64::from(x) + 1.5).round().clamp(-1.0, 4.0) as i32);
            let (mut v, mut c) = ([0.0; 3], [0.0; 9]);
            let mut changes: Vec<VelocityChange> =
                ghosts.iter().map(|ghost| ghost.changed([0.0; 3])).collect();
            for n in 0..27 {
                let node = [n / 9, n / 3 % 3, n % 3];
                let node: [i32; 3] = std::array::from_fn(|a| cell[a] + node[a] - 1);
                let r: [f64; 3] =
                    std::array::from_fn(|a| f64::from(node[a]) - (f64::from(local[a]) + 1.5));
                let weight: f64 = r.iter().map(|r| spline(*r)).product();
                let first = Tile::at(
                    (node[0] + 2) as usize,
                    (node[1] + 2) as usize,
                    (node[2] + 2) as usize,
                );
                let there = std::array::from_fn(|a| at[a] + r[a]);
                let mut u = std::array::from_fn(|a| {
                    f64::from(tile.0[first + a]) + self.frame_velocity[0][a]
                });
                for (ghost, of_ghost) in ghosts.iter().zip(&mut changes) {
                    let seen = ghost.seen(there, u);
                    for a in 0..3 {
                        of_ghost.change[a] += weight * (seen[a] - u[a]);
                    }
                    u = seen;
                }
                for a in 0..3 {
                    let u = u[a] - self.frame_velocity[0][a];
                    v[a] += weight * u;
                    for b in 0..3 {
                        c[3 * a + b] += 4.0 * weight * u * r[b];
                    }
                }
            }
            for change in changes.iter().filter(|change| change.change != [0.0; 3]) {
                given.add(mass.0[lane].into(), change);
            }
            for a in 0..3 {
                gathered.v[a].0[lane] = v[a] as f32;
            }
            for n in 0..9 {
                gathered.c[n].0[lane] = c[n] as f32;
            }
        }
    }

    /// Corrects sixteen particles that the grid moved from `before`; returns the largest squared speed of those
    /// touched [cells^2/s^2].
    #[inline(never)]
    pub fn after(
        &self,
        LaneIds { ids, mass }: LaneIds<'_>,
        before: &[F32x16; 3],
        x: &mut [F32x16; 3],
        motion: &mut Motion,
    ) -> f32 {
        let mut given = self.given.borrow_mut();
        let mut fastest = 0.0_f32;
        for lane in (0..LANES).filter(|&lane| ids[lane] != NO_PARTICLE) {
            let position = |x: &[F32x16; 3]| {
                position_in_cells(self.block, [x[0].0[lane], x[1].0[lane], x[2].0[lane]])
            };
            let way = Way {
                from: position(before),
                to: position(x),
                v: self.velocity(motion, lane),
            };
            // What is bad is left to the guard.
            if !way.to.iter().chain(&way.v).all(|value| value.is_finite()) {
                continue;
            }
            let mass = mass.0[lane].into();
            let touched = self
                .touch
                .after(ids[lane], way, &mut |change| given.add(mass, &change));
            let Some(touched) = touched else {
                continue;
            };
            for a in 0..3 {
                x[a].0[lane] = (touched.x[a] - self.centre[a]) as f32;
            }
            fastest = fastest.max(self.give(
                motion,
                lane,
                touched.v,
                touched.affine,
                self.frame_velocity[0],
            ));
        }
        fastest
    }

    /// Prepares sixteen particles for the next transfer; returns the lanes that are held.
    #[inline(never)]
    pub fn before(&self, ids: &[u32; LANES], x: &[F32x16; 3], motion: &mut Motion) -> u16 {
        let mut held = 0;
        for lane in (0..LANES).filter(|&lane| ids[lane] != NO_PARTICLE) {
            let at = position_in_cells(self.block, [x[0].0[lane], x[1].0[lane], x[2].0[lane]]);
            let v = self.velocity(motion, lane);
            if let Some(touched) = self.touch.before(ids[lane], at, v) {
                match touched.affine {
                    None => self.give(motion, lane, touched.v, None, self.frame_velocity[0]),
                    Some(_) => {
                        held |= 1 << lane;
                        // Gravity and damping are on their way: what is held must not feel them.
                        let after = self.frame_velocity[1];
                        let v = std::array::from_fn(|a| {
                            after[a] + (touched.v[a] - after[a]) / self.keep
                        });
                        self.give(motion, lane, v, touched.affine, after)
                    }
                };
            }
        }
        held
    }

    fn velocity(&self, motion: &Motion, lane: usize) -> [f64; 3] {
        std::array::from_fn(|a| f64::from(motion.v[a].0[lane]) + self.frame_velocity[0][a])
    }

    fn give(
        &self,
        motion: &mut Motion,
        lane: usize,
        v: [f64; 3],
        affine: Option<[f64; 9]>,
        frame_velocity: [f64; 3],
    ) -> f32 {
        for a in 0..3 {
            motion.v[a].0[lane] = (v[a] - frame_velocity[a]) as f32;
        }
        if let Some(affine) = affine {
            for n in 0..9 {
                motion.c[n].0[lane] = affine[n] as f32;
            }
        }
        v.iter().map(|v| (v * v) as f32).sum()
    }
}
