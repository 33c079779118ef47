//! How near matter is to an obstacle at the nodes that it reaches: its nearest particle tells, as in front of colliders.
//!
//! A particle that is away from the obstacle is not looked at until both may have come nearer by as much.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::{
    CouplingInput,
    obstacle::{GAP_LOOKAHEAD, NearParticle, Obstacle, Towards},
    radii::{LARGEST_RADIUS, Radii},
};
use crate::{
    bodies::vector::Vec3,
    grid::{Grid, NODES},
    mat3::length,
    particles::{BLOCK, Block, Particles},
    simd::LANES,
    solid::{inverse::SURE, outline::Unseen},
};

/// How far particles may be outside of their block [cells].
const DRIFT: f64 = 1.0;
/// None near a node.
const NOBODY: u32 = u32::MAX;

/// What is known of how near particles are to an obstacle since a segment of substeps began: its particles stay where they are listed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    /// By how much both have come nearer at most since then, and how far the obstacle has come [m].
    ways: [f64; 2],
    /// The latest substep [s], and how fast the obstacle was in it at most [m/s].
    latest: Option<[f64; 2]>,
    /// Per block of particles.
    blocks: Vec<WatchedBlock>,
}

#[derive(Clone, Debug, Default)]
struct WatchedBlock {
    /// Way at which something of it may touch the obstacle [m].
    until: f64,
    /// Once that came near.
    groups: Vec<WatchedGroup>,
}

#[derive(Clone, Debug)]
struct WatchedGroup {
    /// As of its block.
    until: f64,
    lanes: [WatchedParticle; LANES],
}

#[derive(Clone, Copy, Debug)]
struct WatchedParticle {
    /// Where it was when it was looked at, in its block [cells].
    at: [f32; 3],
    /// Way of the obstacle after which it might touch that there [m].
    until: f64,
    /// What is outside has to come by the surface to be inside.
    is_outside: bool,
}

impl WatchedGroup {
    const NEW: Self = Self {
        until: 0.0,
        lanes: [WatchedParticle {
            at: [0.0; 3],
            until: f64::NEG_INFINITY,
            is_outside: false,
        }; LANES],
    };
}

impl Watch {
    /// Forgets everything: particles are listed anew, or were put back.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Goes on to a substep [s] of an obstacle that moves at most at `speed` [m/s], before which particles moved at most at `fastest`.
    fn go_on(&mut self, dt: f64, speed: f64, fastest: f64) {
        if let Some([passed, before]) = self.latest.replace([dt, speed]) {
            let speed = speed.max(before);
            self.ways[0] += passed * (fastest + speed);
            self.ways[1] += passed * speed;
        }
    }
}

/// The nearest particles of the nodes of some blocks.
pub(super) struct ClosestParticles {
    /// Per node block where its nodes are.
    at: BTreeMap<u32, usize>,
    /// Nodes of a block, z fastest: which particle is nearest.
    nodes: Vec<[u32; NODES]>,
    particles: Vec<NearParticle>,
}

impl ClosestParticles {
    /// Node blocks of which some nodes are reached by particles that may touch the obstacle, in ascending order.
    pub fn blocks(&self) -> impl Iterator<Item = usize> {
        self.at.keys().map(|&block| block as usize)
    }

    /// Of the nodes of a block, if any of them is reached by a particle that may touch the obstacle.
    pub fn get(&self, block: usize) -> Option<[Option<&NearParticle>; NODES]> {
        let nodes = &self.nodes[*self.at.get(&(block as u32))?];
        Some(nodes.map(|n| self.particles.get(n as usize)))
    }
}

/// The nearest particles of nodes, of all those that may touch an obstacle within the substep, which moves at most
/// at `speed` [m/s].
pub(super) fn near<O: Obstacle>(
    input: &CouplingInput<'_>,
    grid: &Grid,
    obstacle: &O,
    speed: f64,
    watch: &mut Watch,
) -> ClosestParticles {
    let (particles, dx) = (input.particles, input.dx);
    watch.go_on(input.dt, speed, input.fastest);
    watch
        .blocks
        .resize_with(particles.blocks.len(), WatchedBlock::default);
    let search = CandidateSearch {
        particles,
        cells_per_mass: input.fields.cells_per_mass,
        obstacle,
        dx,
        most: GAP_LOOKAHEAD * dx + input.dt * (input.fastest + speed),
        ways: watch.ways,
    };
    let blocks = particles.blocks.par_iter().zip(&grid.nodes_of);
    let of_block = |((block, nodes_of), watched): (_, &mut WatchedBlock)| {
        let found = search.block(block, watched);
        (!found.is_empty()).then_some((found, nodes_of))
    };
    let blocks = blocks.zip(&mut watch.blocks).filter_map(of_block);
    let blocks: Vec<(Vec<NearParticle>, &[u32; 27])> = blocks.collect();
    let mut closest = ClosestParticles {
        at: BTreeMap::new(),
        nodes: vec![],
        particles: vec![],
    };
    let ClosestParticles {
        at,
        nodes,
        particles,
    } = &mut closest;
    for (found, nodes_of) in blocks {
        let mut known = [None; 27];
        for one in found {
            reached(one.inner, |offset, node| {
                let place = *known[offset].get_or_insert_with(|| {
                    *at.entry(nodes_of[offset]).or_insert_with(|| {
                        nodes.push([NOBODY; NODES]);
                        nodes.len() - 1
                    })
                });
                let nearest = &mut nodes[place][node];
                let before = particles.get(*nearest as usize);
                if before.is_none_or(|before| one.gap < before.gap) {
                    *nearest = particles.len() as u32;
                }
            });
            particles.push(one);
        }
    }
    closest
}

/// A search for the particles that may touch an obstacle.
struct CandidateSearch<'a, O> {
    particles: &'a Particles,
    cells_per_mass: &'a [f64],
    obstacle: &'a O,
    dx: f64,
    /// Largest gap [m].
    most: f64,
    /// As of the [watch](Watch::ways) [m].
    ways: [f64; 2],
}

impl<O: Obstacle> CandidateSearch<'_, O> {
    /// Whether what waits until a way [m] need not be looked at.
    fn waits(&self, until: f64) -> bool {
        until > self.ways[0] + self.most
    }

    /// The particles of a block with a gap of at most the largest.
    fn block(&self, block: &Block, watched: &mut WatchedBlock) -> Vec<NearParticle> {
        let mut found = vec![];
        if self.waits(watched.until) {
            return found;
        }
        let (center, radius) = self.obstacle.ball();
        let beyond = block.distance(center.map(|x| x / self.dx), DRIFT) - LARGEST_RADIUS;
        watched.until = self.ways[0] + self.dx * beyond - radius;
        if self.waits(watched.until) {
            return found;
        }
        watched.until = f64::INFINITY;
        let start: Vec3 = block.index.map(|i| f64::from(BLOCK * i));
        let mut at = 0;
        for run in &self.particles.runs[block.runs.clone()] {
            let mut radii = Radii::new(self.cells_per_mass[run.part]);
            for g in run.groups.clone() {
                if watched.groups.len() == at {
                    watched.groups.push(WatchedGroup::NEW);
                }
                let group = &mut watched.groups[at];
                if !self.waits(group.until) {
                    self.group(g, (start, &mut radii), group, &mut found);
                }
                watched.until = watched.until.min(group.until);
                at += 1;
            }
        }
        found
    }

    /// Those of a group, of a block whose first node is at `start` [cells].
    fn group(
        &self,
        g: usize,
        (start, radii): (Vec3, &mut Radii),
        watched: &mut WatchedGroup,
        found: &mut Vec<NearParticle>,
    ) {
        let (mass, x) = (&self.particles.fixed[g].mass.0, &self.particles.groups[g].x);
        let lanes = || (0..LANES).filter(|&lane| mass[lane] > 0.0);
        let Some(first) = lanes().next() else {
            watched.until = f64::INFINITY;
            return;
        };
        let inner: [Vec3; LANES] = std::array::from_fn(|lane| {
            // Where there is no particle the first one stands in.
            let lane = if mass[lane] > 0.0 { lane } else { first };
            [0, 1, 2].map(|a| f64::from(x[a].0[lane]) + 1.5)
        });
        let places = inner.map(|inner| [0, 1, 2].map(|a| self.dx * (start[a] + inner[a])));
        let most = self.most + LARGEST_RADIUS * self.dx;
        let mut beyond = [0.0; LANES];
        let around = self.obstacle.around(&places, most, &mut beyond);
        let is_away = beyond.iter().all(|&beyond| beyond > most);
        let is_known = watched.lanes.iter().all(|one| one.is_outside);
        if is_away && !is_known && self.obstacle.is_outside(places[first]) {
            // No surface is between them.
            watched
                .lanes
                .iter_mut()
                .for_each(|one| one.is_outside = true);
        }
        let mut known = around;
        watched.until = f64::INFINITY;
        for lane in lanes() {
            let radius = self.dx * radii.of(mass[lane]);
            let at = [0, 1, 2].map(|a| x[a].0[lane]);
            let one = &mut watched.lanes[lane];
            let moved = length([0, 1, 2].map(|a| f64::from(at[a] - one.at[a])));
            let mut clear = one.until - self.ways[1] - self.dx * moved;
            if one.is_outside {
                clear = clear.max(beyond[lane] - radius);
            }
            if clear <= self.most {
                let mut seen = self.obstacle.towards(places[lane], most, known);
                if matches!(seen, Err(Unseen::Lost)) && known != around {
                    // What was known of another led astray.
                    seen = self.obstacle.towards(places[lane], most, around);
                }
                one.is_outside = match &seen {
                    Ok(towards) => towards.distance > 0.0,
                    Err(unseen) => *unseen != Unseen::Lost,
                };
                clear = match seen {
                    Ok(towards) => {
                        known = Some(towards.known);
                        self.note(inner[lane], towards, radius, found)
                    }
                    Err(Unseen::Beyond(beyond) | Unseen::NoMatter(beyond)) => beyond - radius,
                    Err(Unseen::Lost) => 0.0,
                };
                (one.at, one.until) = (at, self.ways[1] + clear);
            }
            watched.until = watched.until.min(self.ways[0] + clear);
        }
    }

    /// Takes note of a particle of a radius [m] if its gap is at most the largest; returns the gap, as far as it is sure [m].
    fn note(
        &self,
        inner: Vec3,
        towards: Towards,
        radius: f64,
        found: &mut Vec<NearParticle>,
    ) -> f64 {
        let gap = towards.distance - radius;
        if gap <= self.most {
            found.push(NearParticle {
                inner,
                towards,
                gap,
            });
        }
        SURE * towards.distance - radius
    }
}

/// The node nearest to a place on an axis [nodes], the one farther from 0 of two: a call of the library per axis and node otherwise,
/// where the processor need not round.
#[inline(always)]
fn nearest_node(x: f64) -> i32 {
    (x + 0.5_f64.copysign(x)) as i32
}

/// The nodes that a particle reaches, given where it is from the first node of its block [cells]: which of the 27 blocks around
/// that, and which node of it.
fn reached(x: Vec3, mut node: impl FnMut(usize, usize)) {
    let [i, j, k] = x.map(|x| nearest_node(x) - 1);
    for i in i..i + 3 {
        for j in j..j + 3 {
            for k in k..k + 3 {
                let [a, b, c] = [i, j, k].map(|n| (n.div_euclid(BLOCK) + 1).clamp(0, 2) as usize);
                let [u, v, w] = [i, j, k].map(|n| n.rem_euclid(BLOCK) as usize);
                node(9 * a + 3 * b + c, 16 * u + 4 * v + w);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        bodies::vector::sub,
        coupling::obstacle::Facing,
        mat3::Mat3,
        particles::{Fixed, Group, Run},
        solid::inverse::Known,
        test_scenes::random,
    };

    const DX: f64 = 0.1;

    /// A ball that tells no more than it is asked for.
    struct Ball {
        centre: Vec3,
        radius: f64,
    }

    impl Ball {
        fn distance(&self, x: Vec3) -> f64 {
            length(sub(x, self.centre)) - self.radius
        }
    }

    impl Obstacle for Ball {
        type Place = ();

        fn ball(&self) -> (Vec3, f64) {
            (self.centre, self.radius)
        }

        fn around(
            &self,
            places: &[Vec3; LANES],
            _: f64,
            beyond: &mut [f64; LANES],
        ) -> Option<Known> {
            // No more than a solid's boxes tell.
            *beyond = places.map(|x| self.distance(x) - 0.5 * DX);
            None
        }

        fn is_outside(&self, x: Vec3) -> bool {
            self.distance(x) > 0.0
        }

        fn towards(&self, x: Vec3, most: f64, _: Option<Known>) -> Result<Towards, Unseen> {
            let distance = self.distance(x);
            if distance > most {
                return Err(Unseen::Beyond(SURE * distance));
            }
            Ok(Towards {
                distance,
                normal: sub(x, self.centre).map(|n| n / (distance + self.radius)),
                known: Known {
                    now: x,
                    rest: x,
                    back: Mat3::identity(),
                },
            })
        }

        fn facing(&self, _: Vec3, _: Known) -> Option<Facing<()>> {
            None
        }
    }

    /// Particles all over a block.
    fn filled(groups: usize, seed: &mut u64) -> Particles {
        let mut particles = Particles {
            groups: vec![Group::REST; groups],
            fixed: vec![Fixed::EMPTY; groups],
            ..Particles::default()
        };
        for (group, fixed) in particles.groups.iter_mut().zip(&mut particles.fixed) {
            for lane in 0..LANES {
                // Some are gone.
                fixed.mass.0[lane] = f32::from(u8::from(random(seed) > -0.8));
                for x in &mut group.x {
                    x.0[lane] = (2.0 * random(seed)) as f32;
                }
            }
        }
        particles.runs.push(Run {
            part: 0,
            groups: 0..groups,
            shapes: 0..0,
            extremes: crate::particles::Extremes::NONE,
        });
        particles.blocks.push(Block {
            field: 0,
            index: [0; 3],
            runs: 0..1,
            groups: 0..groups,
            shapes: 0..0,
        });
        particles
    }

    #[test]
    fn what_waits_is_not_missed() {
        let mut seed = 5;
        let mut particles = filled(12, &mut seed);
        let mut watch = Watch::default();
        watch.blocks.push(WatchedBlock::default());
        let (mut touched, mut looked) = (0, 0);
        for substep in 0..400 {
            // It goes through them and back, and all move by themselves.
            let phase = 0.02 * f64::from(substep);
            let obstacle = Ball {
                centre: [0.25 + 0.45 * phase.cos(), 0.3, 0.25],
                radius: 0.12,
            };
            let (dt, speed, fastest) = (0.02, 0.45, 0.06);
            for group in &mut particles.groups {
                for x in &mut group.x {
                    for x in &mut x.0 {
                        *x += (0.5 * fastest * dt / DX * random(&mut seed)) as f32;
                    }
                }
            }
            watch.go_on(dt, speed, fastest);
            let search = CandidateSearch {
                particles: &particles,
                cells_per_mass: &[0.125],
                obstacle: &obstacle,
                dx: DX,
                most: GAP_LOOKAHEAD * DX + dt * (fastest + speed),
                ways: watch.ways,
            };
            let places = |found: Vec<NearParticle>| -> Vec<(Vec3, f64)> {
                found.iter().map(|one| (one.inner, one.gap)).collect()
            };
            let block = &particles.blocks[0];
            let before = watch.blocks[0].clone();
            let known = places(search.block(block, &mut watch.blocks[0]));
            let anew = places(search.block(block, &mut WatchedBlock::default()));
            assert_eq!(known, anew, "{substep}");
            touched += anew.len();
            let all = before.groups.iter().zip(&watch.blocks[0].groups);
            let moved = all.flat_map(|(a, b)| a.lanes.iter().zip(&b.lanes));
            looked += moved.filter(|(a, b)| a.at != b.at).count();
        }
        assert!(touched > 1000, "{touched}");
        // Few but those that touch it are looked at in any substep.
        assert!(looked < 3 * touched, "{looked} {touched}");
    }
}
