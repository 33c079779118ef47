//! The fastest motion of a solid, measured: what bounds its substep.
//!
//! The bound that holds wherever boundaries cut, `4.5 M / dx^2` with `M = 3 lambda + 2 mu`, is one and a half times what solids have, and
//! light nodes that follow others may make it more. Matter that is deformed much somewhere has tangents there that its fastest motion,
//! elsewhere, does not feel: that bound is then two to eight times what is so. So the largest eigenvalue of `M^-1 K` is found by Lanczos's method
//! about where nodes are, with the kernel's own forces at small displacements.

use super::{
    kernel::{Moving, SolidLaw, Step, Tiles, substep, velocities_of},
    memory::BlockMemory,
    model::SolidModel,
    nodes::{Conditions, NodeBlock, NodeRow, Planes, slot},
    surface::SurfacePoint,
};
use crate::simd::{F32x16, Isa, LANES};

/// Largest displacement [cells]: strains of a few thousandths, of which single precision knows four digits.
const SIZE: f32 = 1e-3;
/// How exact the method is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Steps {
    /// For what is measured often.
    Few,
    /// For what contact adds, which is a part of the whole.
    Several,
    /// For what is measured once.
    Many,
}

impl Steps {
    /// How many, and how much larger the largest value may be than that found.
    fn count(self) -> (usize, f64) {
        match self {
            Self::Few => (8, 1.15),
            Self::Several => (8, 1.05),
            Self::Many => (24, 1.02),
        }
    }
}

/// The fastest motion of a solid about some place of its nodes.
#[derive(Clone, Debug)]
pub(super) struct Measured {
    /// Largest squared frequency there [1/s^2].
    pub squared: f64,
    /// Sums of tangents about nodes there [Pa].
    sums: Vec<[F32x16; 4]>,
    /// Largest growth of one of them since, at least 1: motions have hardly become faster by more.
    pub growth: f64,
    /// Substeps since.
    pub age: u64,
    /// Largest gradient of the velocity as of the latest comparison [1/s].
    pub rate: f32,
}

impl Measured {
    /// Compares sums of tangents with what they were.
    pub fn compare(&mut self, sums: &[[F32x16; 4]]) {
        let mut largest = [1.0_f32; LANES];
        let pairs = sums.as_flattened().iter().zip(self.sums.as_flattened());
        for (now, then) in pairs {
            for lane in 0..LANES {
                let (now, then) = (now.0[lane], then.0[lane]);
                let growth = if then > 0.0 { now / then } else { 1.0 };
                largest[lane] = largest[lane].max(growth);
            }
        }
        self.growth = f64::from(largest.into_iter().fold(1.0, f32::max));
    }
}

/// Points of a surface that springs hold where they are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pressed<'a> {
    pub points: &'a [SurfacePoint],
    /// Force per displacement and tangent [m].
    pub stiffness: &'a [f64],
    /// [Pa]
    pub tangent: f64,
}

/// A solid about a place of its nodes.
pub(super) struct Vibrating<'a> {
    pub isa: Isa,
    pub model: &'a SolidModel,
    /// What is taken for elastic.
    pub laws: &'a [SolidLaw],
    pub conditions: &'a mut Conditions,
    /// A surface that is pressed.
    pub pressed: Option<Pressed<'a>>,
    pub tiles: &'a mut Tiles,
    /// Where nodes are.
    pub about: &'a [NodeBlock],
}

/// Memory of the method: forces on nodes over the root of their mass. With `S` the root of the inverse masses, `K` the stiffness and `S (1 + B) S` the
/// inverse mass matrix, that of [`OffDiagonalMass`](super::off_diagonal::OffDiagonalMass), `S K S (1 + B)` is symmetric in the product `x^T (1 + B) y`.
#[derive(Clone, Debug, Default)]
pub(super) struct Lanczos {
    now: Vec<Planes>,
    before: Vec<Planes>,
    next: Vec<Planes>,
    /// `1 + B` times the vector at hand: displacements times the root of mass.
    moved: Vec<Planes>,
    scratch: Vec<Planes>,
    /// Forces over masses where nodes are.
    base: Vec<Planes>,
    nodes: Vec<NodeBlock>,
    /// What matter remembers: nothing, so that it is elastic, whatever it does beyond that.
    memory: Vec<BlockMemory>,
    /// Roots of cell size over mass, and one over these; 0 where nothing moves.
    roots: Vec<[[F32x16; 4]; 2]>,
}

impl Vibrating<'_> {
    /// Its fastest motion there.
    pub fn fastest(&mut self, memory: &mut Lanczos, steps: Steps) -> Measured {
        let (steps, missed) = steps.count();
        memory.restart(&self.conditions.w, self.model.point_blocks.len());
        self.accelerate(memory, None);
        let sums = self.tiles.sums.clone();
        for (base, node) in memory.base.iter_mut().zip(&memory.nodes) {
            *base = node.p;
        }
        self.begin(&mut memory.next);
        let size = self.lift(memory);
        scale(&mut memory.next, size.recip());
        scale(&mut memory.moved, size.recip());
        std::mem::swap(&mut memory.now, &mut memory.next);
        let (mut diagonal, mut beside) = (vec![], vec![]);
        for step in 0..steps {
            self.apply(memory);
            let alpha = dot(&memory.moved, &memory.next);
            let beta = beside.last().copied().unwrap_or(0.0);
            let parts = [(alpha, &memory.now[..]), (beta, &memory.before[..])];
            subtract(&mut memory.next, parts);
            diagonal.push(alpha);
            let norm = self.lift(memory);
            // Nothing is left to look at, but for round-off.
            if step + 1 == steps || norm <= 1e-6 * alpha.abs() {
                break;
            }
            beside.push(norm);
            scale(&mut memory.next, norm.recip());
            scale(&mut memory.moved, norm.recip());
            std::mem::swap(&mut memory.before, &mut memory.now);
            std::mem::swap(&mut memory.now, &mut memory.next);
        }
        Measured {
            squared: missed * largest_eigenvalue(&diagonal, &beside),
            sums,
            growth: 1.0,
            age: 0,
            rate: f32::INFINITY,
        }
    }

    /// Neighbours move against each other, and not all by as much.
    fn begin(&self, out: &mut [Planes]) {
        for (block, out) in out.iter_mut().enumerate() {
            for x in 0..4 {
                for lane in 0..LANES {
                    if self.conditions.w[block][x].0[lane] == 0.0 {
                        continue;
                    }
                    let at = self.model.node_position(slot(block, [x, lane]));
                    let odd = at.iter().sum::<f64>().rem_euclid(2.0) >= 0.5;
                    let phase = at[0] + 1.7 * at[1] + 2.3 * at[2];
                    for (a, out) in out.iter_mut().enumerate() {
                        let size = 1.0 + 0.5 * (phase + a as f64).sin();
                        out[x].0[lane] = if odd { -size } else { size } as f32;
                    }
                }
            }
        }
    }

    /// `1 + B` times the next vector; the size of that.
    fn lift(&self, memory: &mut Lanczos) -> f64 {
        let Lanczos {
            next,
            moved,
            scratch,
            roots,
            ..
        } = memory;
        let times = |out: &mut Planes, of: &Planes, by: &[F32x16; 4]| {
            for (out, of) in out.iter_mut().zip(of) {
                for (x, out) in out.iter_mut().enumerate() {
                    for lane in 0..LANES {
                        out.0[lane] = by[x].0[lane] * of[x].0[lane];
                    }
                }
            }
        };
        for ((out, of), [root, _]) in scratch.iter_mut().zip(&*next).zip(&*roots) {
            times(out, of, root);
        }
        let of_nodes = (
            &self.model.off_diagonal,
            &self.conditions.w[..],
            &scratch[..],
        );
        velocities_of(self.isa, of_nodes, moved);
        for ((out, of), [_, back]) in scratch.iter_mut().zip(&*moved).zip(&*roots) {
            times(out, of, back);
        }
        std::mem::swap(moved, scratch);
        dot(next, moved).sqrt()
    }

    /// `S K S (1 + B) y` of inner nodes.
    fn apply(&mut self, memory: &mut Lanczos) {
        let mut largest = [0.0_f32; LANES];
        for ([root, _], y) in memory.roots.iter().zip(&memory.moved) {
            for plane in y {
                for (y, root) in plane.iter().zip(root) {
                    for lane in 0..LANES {
                        largest[lane] = largest[lane].max((root.0[lane] * y.0[lane]).abs());
                    }
                }
            }
        }
        let size = SIZE / largest.into_iter().fold(f32::MIN_POSITIVE, f32::max);
        self.accelerate(memory, Some(size));
        let answers = memory.base.iter().zip(&memory.nodes).zip(&memory.roots);
        for (out, ((base, node), [_, back])) in memory.next.iter_mut().zip(answers) {
            for a in 0..3 {
                for x in 0..4 {
                    let (base, p, back) = (&base[a][x].0, &node.p[a][x].0, &back[x].0);
                    for lane in 0..LANES {
                        out[a][x].0[lane] = back[lane] / size * (base[lane] - p[lane]);
                    }
                }
            }
        }
    }

    /// Forces of springs on points where nodes are.
    fn press(&mut self, surface: &Pressed<'_>) {
        self.conditions.clear_forces();
        for (point, stiffness) in surface.points.iter().zip(surface.stiffness) {
            let [x, y, z, _] = NodeRow::about(&self.tiles.rows, &point.bears);
            let pressure = (-surface.tangent * stiffness / self.model.dx) as f32;
            let force = [x, y, z].map(|u| pressure * u);
            self.conditions.share_force(&point.bears, force);
        }
    }

    /// Forces on nodes over masses, as momenta, where they are or displaced by so much of the vector at hand.
    fn accelerate(&mut self, memory: &mut Lanczos, displaced: Option<f32>) {
        let Lanczos {
            moved,
            nodes,
            roots,
            memory,
            ..
        } = memory;
        for (node, about) in nodes.iter_mut().zip(self.about) {
            *node = NodeBlock {
                u: about.u,
                ..NodeBlock::REST
            };
        }
        if let Some(size) = displaced {
            for ((node, y), [root, _]) in nodes.iter_mut().zip(&*moved).zip(&*roots) {
                for a in 0..3 {
                    for x in 0..4 {
                        let (u, y, root) = (&mut node.u[a][x].0, &y[a][x].0, &root[x].0);
                        for lane in 0..LANES {
                            u[lane] += size * root[lane] * y[lane];
                        }
                    }
                }
            }
            self.tiles.look_at(nodes);
            let extension = &self.model.extension;
            extension.follow_rows(nodes, &self.tiles.rows);
        }
        if let Some(surface) = self.pressed {
            self.tiles.look_at(nodes);
            self.press(&surface);
        }
        let step = Step {
            kick: 1.0,
            drift: 0.0,
            keep: 1.0,
            gravity: [0.0; 3],
            viscosity: 0.0,
            wants_extremes: displaced.is_none(),
            wants_rate: false,
            knows_forces: false,
        };
        let moving = Moving {
            nodes,
            memory,
            relaxing: None,
        };
        let conditions = &*self.conditions;
        substep(
            self.isa, self.model, self.laws, conditions, moving, self.tiles, &step,
        );
    }
}

impl Lanczos {
    /// For nodes with these cell sizes over mass [m/kg], and so many blocks of points.
    fn restart(&mut self, w: &[[F32x16; 4]], point_blocks: usize) {
        let Self {
            now,
            before,
            next,
            moved,
            scratch,
            base,
            nodes,
            memory,
            roots,
        } = self;
        memory.resize_with(point_blocks, Vec::new);
        for vectors in [now, before, next, moved, scratch, base] {
            vectors.clear();
            vectors.resize(w.len(), [[F32x16::ZERO; 4]; 3]);
        }
        nodes.clear();
        nodes.resize(w.len(), NodeBlock::REST);
        let back = |root: f32| if root > 0.0 { root.recip() } else { 0.0 };
        roots.clear();
        roots.extend(w.iter().map(|w| {
            let root = w.map(|w| F32x16(w.0.map(f32::sqrt)));
            [root, root.map(|root| F32x16(root.0.map(back)))]
        }));
    }
}

fn flat(of: &[Planes]) -> &[F32x16] {
    of.as_flattened().as_flattened()
}

fn dot(a: &[Planes], b: &[Planes]) -> f64 {
    let blocks = a.iter().zip(b).map(|(a, b)| {
        let mut sums = [0.0_f32; LANES];
        for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
            for lane in 0..LANES {
                sums[lane] += a.0[lane] * b.0[lane];
            }
        }
        f64::from(sums.iter().sum::<f32>())
    });
    blocks.sum()
}

fn scale(of: &mut [Planes], by: f64) {
    let by = by as f32;
    for of in of.as_flattened_mut().as_flattened_mut() {
        of.0.iter_mut().for_each(|x| *x *= by);
    }
}

fn subtract(from: &mut [Planes], parts: [(f64, &[Planes]); 2]) {
    for (times, what) in parts {
        let times = times as f32;
        let from = from.as_flattened_mut().as_flattened_mut();
        for (from, what) in from.iter_mut().zip(flat(what)) {
            for lane in 0..LANES {
                from.0[lane] -= times * what.0[lane];
            }
        }
    }
}

/// Largest eigenvalue of a symmetric tridiagonal matrix, by bisection with Sturm's sequence.
fn largest_eigenvalue(diagonal: &[f64], beside: &[f64]) -> f64 {
    let at = |n: usize| beside.get(n).map_or(0.0, |b| b.abs());
    let reach = |n: usize| at(n) + if n > 0 { at(n - 1) } else { 0.0 };
    let bounds = diagonal.iter().enumerate();
    let mut high = bounds.fold(0.0_f64, |most, (n, d)| most.max(d + reach(n)));
    let mut low = diagonal.iter().copied().fold(0.0, f64::max);
    // Whether all eigenvalues are below a value: all pivots of the matrix less that are negative.
    let all_below = |value: f64| {
        let mut pivot = -1.0;
        diagonal.iter().enumerate().all(|(n, d)| {
            let before = if n > 0 {
                beside[n - 1].powi(2) / pivot
            } else {
                0.0
            };
            pivot = d - value - before;
            pivot < 0.0
        })
    };
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match all_below(middle) {
            true => high = middle,
            false => low = middle,
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_eigenvalue_of_a_chain_is_known() {
        // 2 - 2 cos(k pi / (n + 1)), the largest at k = n.
        let n = 12;
        let exact = 2.0 - 2.0 * (std::f64::consts::PI * n as f64 / (n + 1) as f64).cos();
        let found = largest_eigenvalue(&vec![2.0; n], &vec![-1.0; n - 1]);
        assert!((found - exact).abs() < 1e-12, "{found} {exact}");
    }
}
