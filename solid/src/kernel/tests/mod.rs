//! The kernel computes what the equations say, the same bits everywhere, and keeps energy.

mod flow;
mod frequencies;

use super::*;
use crate::{
    basis::weights_f64,
    extension::Extension,
    frequency::{Lanczos, Measured, Steps, Vibrating},
    held::HELD_PART,
    lattice::Seed,
    mat3::Mat3,
    materials::{
        Family, hencky_piola, laws::elastic_laws, piola::piola_energy, polar::rotation,
        testing::Random,
    },
    model::{gauss_point, stencil},
    nodes::{read, write},
    simd::LANES,
};

const LAMBDA: f64 = 2e5;
const MU: f64 = 1.5e5;
const DENSITY: f64 = 1000.0;

fn solid_law(law: Law) -> SolidLaw {
    SolidLaw {
        law,
        lambda: LAMBDA,
        mu: MU,
        density: DENSITY,
        loss: 0.0,
    }
}

/// A solid of unit cells with all that a substep reads.
#[derive(Clone)]
struct Solid {
    model: SolidModel,
    laws: Vec<SolidLaw>,
    conditions: Conditions,
    nodes: Vec<NodeBlock>,
    memory: Vec<BlockMemory>,
    tiles: Tiles,
}

impl Solid {
    /// A box of cells at any place in their blocks; points have the volume that `volume` makes of their number, of the part that
    /// `part` makes of their cell.
    fn new(
        laws: &[Law],
        cells: [usize; 3],
        mut volume: impl FnMut() -> f64,
        part: impl Fn([usize; 3]) -> u16,
    ) -> Self {
        let mut seeds = vec![];
        for n in 0..8 * cells.iter().product::<usize>() {
            let at = [
                n / (4 * cells[1] * cells[2]),
                n / (2 * cells[2]) % (2 * cells[1]),
                n % (2 * cells[2]),
            ];
            seeds.push(Seed {
                position: at.map(|n| 0.5 * (n as f64 + 0.5)),
                volume: volume(),
                density: DENSITY,
                part: part(at.map(|n| n / 2)),
            });
        }
        let model = SolidModel::new(1.0, &seeds);
        let blocks = model.node_blocks.len();
        let mut conditions = Conditions {
            w: vec![[F32x16::ZERO; 4]; blocks],
            force: vec![[0.0; 4]; NODES * blocks],
            forced: vec![false; blocks],
            follows: vec![true; model.extension.outer.len()],
        };
        for n in model.nodes().filter(|&n| model.mass[n] > 0.0) {
            conditions.w[n / NODES][n / LANES % 4].0[n % LANES] = (1.0 / model.mass[n]) as f32;
        }
        Self {
            laws: laws.iter().map(|&law| solid_law(law)).collect(),
            tiles: Tiles::new(&model),
            nodes: vec![NodeBlock::REST; blocks],
            memory: vec![vec![]; model.point_blocks.len()],
            conditions,
            model,
        }
    }

    /// Full cells of one law.
    fn full(law: Law, cells: [usize; 3]) -> Self {
        Self::new(&[law], cells, || 0.125, |_| 0)
    }

    /// Gives every node with matter a displacement by its rest position.
    fn displace(&mut self, u: impl Fn([f64; 3]) -> [f64; 3]) {
        for n in self.model.nodes().collect::<Vec<_>>() {
            let u = u(self.model.node_position(n)).map(|u| u as f32);
            write(&mut self.nodes[n / NODES].u, n, u);
        }
    }

    /// The fastest motion about a place of the nodes, as it is measured.
    fn fastest(&self, about: &[NodeBlock], steps: Steps) -> Measured {
        let mut vibrating = Vibrating {
            isa: Isa::detect(),
            model: &self.model,
            laws: &self.laws,
            conditions: &mut self.conditions.clone(),
            pressed: None,
            tiles: &mut self.tiles.clone(),
            about,
        };
        vibrating.fastest(&mut Lanczos::default(), steps)
    }

    /// Largest squared frequency about rest, as it is measured [1/s^2].
    fn squared_frequency(&self) -> f64 {
        let rest = vec![NodeBlock::REST; self.nodes.len()];
        self.fastest(&rest, Steps::Many).squared
    }

    /// Largest mean tangent over density of the points of a node, as of the latest look [m^2/s^2].
    fn largest_tangent(&self) -> f64 {
        let sums = self.tiles.sums.as_flattened().iter();
        let means = sums.zip(self.conditions.w.as_flattened()).map(|(sum, w)| {
            let lanes = sum.0.iter().zip(&w.0);
            lanes.fold(0.0, |most, (sum, w)| sum.mul_add(*w, 0.0).max(most))
        });
        f64::from(means.fold(0.0, f32::max)) * self.model.dx.powi(2)
    }

    fn substep(&mut self, isa: Isa, step: &Step) -> Extremes {
        substep(
            isa,
            &self.model,
            &self.laws,
            &self.conditions,
            Moving {
                nodes: &mut self.nodes,
                memory: &mut self.memory,
                relaxing: None,
            },
            &mut self.tiles,
            step,
        )
    }

    /// The same without nodes that follow others, and without mass between nodes.
    fn unbound(mut self) -> Self {
        let model = &mut self.model;
        for n in model.nodes().collect::<Vec<_>>() {
            model.mass[n] = f64::from(model.spread[n / NODES][n / LANES % 4].0[n % LANES]).recip();
            self.conditions.w[n / NODES][n / LANES % 4].0[n % LANES] = (1.0 / model.mass[n]) as f32;
        }
        let (mut mass, none) = (model.mass.clone(), vec![0.0; model.mass.len()]);
        model.extension = Extension::new(&model.node_blocks, &mut mass, &none);
        self.conditions.follows.clear();
        for edges in &mut model.off_diagonal.pairs {
            *edges = [[F32x16::ZERO; 4]; 3];
        }
        self.tiles = Tiles::new(&self.model);
        self
    }

    /// Forces on all nodes [Pa cells^2], none of which follows others, by a substep of 1 s from rest with masses of 1, and what else
    /// was found.
    fn forces(&mut self, isa: Isa, viscosity: f32) -> (Vec<[f32; 3]>, [f64; 2]) {
        let mut unit = self.clone().unbound();
        unit.model.spread.fill([F32x16::splat(1.0); 4]);
        for w in &mut unit.conditions.w {
            *w = [F32x16::splat(1.0); 4];
        }
        let before = unit.nodes.clone();
        let step = Step {
            kick: 1.0,
            drift: 0.0,
            viscosity,
            wants_extremes: true,
            wants_rate: true,
            knows_forces: false,
            ..PLAIN
        };
        let found = unit.substep(isa, &step);
        assert!(!found.bad);
        let force = |n: usize| {
            let after = read(&unit.nodes[n / NODES].p, n);
            let before = read(&before[n / NODES].p, n);
            std::array::from_fn(|a| after[a] - before[a])
        };
        let forces = (0..self.model.mass.len()).map(force).collect();
        (forces, [unit.largest_tangent(), f64::from(found.rate)])
    }

    /// The same in double precision, 27 nodes at a time.
    fn exact_forces(&self, viscosity: f64) -> (Vec<[f64; 3]>, [f64; 2]) {
        let mut forces = vec![[0.0; 3]; self.model.mass.len()];
        let mut tangents = vec![0.0; self.model.mass.len()];
        let mut largest = 0.0_f64;
        self.each_point(|law, volume, nodes, f, rate| {
            let answer = hencky_piola::elastic_piola(law.law, &f, law.lambda, law.mu);
            largest = largest.max(rate.norm_squared().sqrt());
            let stretch = (f.norm_squared() - 2.0).max(1.0);
            let at_rest = 3.0 * law.lambda + 2.0 * law.mu;
            let share = (answer.tangent / (at_rest * stretch * stretch)).min(1.0);
            let viscosity = viscosity * share;
            let e = f.transpose().mul(&rate);
            let e = e.blend(0.5, &e.transpose(), 0.5);
            let trace = e.0[0][0] + e.0[1][1] + e.0[2][2];
            let pressure = Mat3::diagonal([viscosity * law.lambda * trace; 3]);
            let s = e.blend(2.0 * viscosity * law.mu, &pressure, 1.0);
            let p = answer.stress.blend(1.0, &f.mul(&s), 1.0);
            for (n, slopes, weight) in nodes {
                let force = p.mul_vec(*slopes);
                for a in 0..3 {
                    forces[*n][a] -= volume * force[a];
                }
                tangents[*n] += weight * volume * answer.tangent;
            }
        });
        (forces, [tangents.into_iter().fold(0.0, f64::max), largest])
    }

    /// Calls `visit` with law, volume, nodes with slopes and weights, deformation gradient and rate of all points with matter.
    fn each_point(
        &self,
        mut visit: impl FnMut(&SolidLaw, f64, &[(usize, [f64; 3], f64)], Mat3<f64>, Mat3<f64>),
    ) {
        for block in &self.model.point_blocks {
            for cell in &self.model.cells[block.cells.clone()] {
                for (point, &volume) in cell.volumes.iter().enumerate() {
                    let axes = gauss_point(point).map(weights_f64);
                    let mut nodes = vec![];
                    for (n, (slot, weight)) in
                        stencil(&block.nodes, cell.number, gauss_point(point))
                            .into_iter()
                            .enumerate()
                    {
                        let o = [n / 9, n / 3 % 3, n % 3];
                        let slope = |along: usize| -> f64 {
                            let along = |a: usize| {
                                if a == along {
                                    axes[a].1[o[a]]
                                } else {
                                    axes[a].0[o[a]]
                                }
                            };
                            along(0) * along(1) * along(2)
                        };
                        nodes.push((slot, [slope(0), slope(1), slope(2)], weight));
                    }
                    let mut f = Mat3::identity();
                    let mut rate = f.sub(&f);
                    for (n, slopes, _) in &nodes {
                        let (u, v) = (
                            read(&self.nodes[n / NODES].u, *n),
                            read(&self.nodes[n / NODES].v, *n),
                        );
                        for a in 0..3 {
                            for b in 0..3 {
                                f.0[a][b] += f64::from(u[a]) * slopes[b];
                                rate.0[a][b] += f64::from(v[a]) * slopes[b];
                            }
                        }
                    }
                    if volume > 0.0 {
                        visit(
                            &self.laws[usize::from(cell.part)],
                            f64::from(volume),
                            &nodes,
                            f,
                            rate,
                        );
                    }
                }
            }
        }
    }

    /// Elastic and kinetic energy.
    fn energy(&self) -> f64 {
        let mut energy = 0.0;
        self.each_point(|law, volume, _, f, _| {
            energy += volume * density_of(law, &f);
        });
        for n in self.model.nodes() {
            let block = &self.nodes[n / NODES];
            let [p, v] = [&block.p, &block.v].map(|of| read(of, n).map(f64::from));
            energy += 0.5 * self.model.mass[n] * crate::mat3::dot(p, v);
        }
        energy
    }
}

/// Elastic energy per rest volume [J/m^3].
fn density_of(law: &SolidLaw, f: &Mat3<f64>) -> f64 {
    match law.law.family() {
        Family::Piola(piola) => piola_energy(piola, f, law.lambda, law.mu),
        Family::Hencky | Family::Spatial | Family::Rigid => {
            let h = f.sub(&Mat3::identity());
            hencky_piola::elastic_energy(law.law, &h, law.lambda, law.mu)
        }
    }
}

/// A law that the kernel did not know was computed as Hencky's.
#[test]
fn no_elastic_law_is_computed_as_another() {
    let energies = elastic_laws().map(|law| {
        let mut solid = Solid::full(law, [4, 3, 2]);
        solid.displace(bent);
        let (model, laws) = (&solid.model, &solid.laws);
        elastic_energy(Isa::detect(), model, laws, &solid.nodes, &solid.memory)
    });
    let energies: Vec<f64> = energies.collect();
    for (n, one) in energies.iter().enumerate() {
        for other in &energies[..n] {
            assert!((one / other - 1.0).abs() > 1e-4, "{energies:?}");
        }
    }
}

#[test]
fn elastic_energy_is_that_of_every_point() {
    for law in elastic_laws() {
        let mut solid = Solid::new(&[law], [5, 4, 6], random_volumes(3), |_| 0);
        solid.displace(bent);
        let expected = solid.energy();
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let energy =
                elastic_energy(isa, &solid.model, &solid.laws, &solid.nodes, &solid.memory);
            // Single precision of each point.
            assert!(
                (energy / expected - 1.0).abs() < 1e-6,
                "{energy} {expected}"
            );
        }
    }
}

/// A block all of whose cells are held had the forces of the block before it, at some ends of a solid and not at others.
#[test]
fn what_is_held_has_no_stress_at_any_end() {
    for end in 0..6 {
        let (axis, high) = (end / 2, end % 2 == 1);
        let is_held = |cell: [usize; 3]| (cell[axis] >= 4) == high;
        let part = |cell| if is_held(cell) { HELD_PART } else { 0 };
        let mut solid = Solid::new(&[Law::NeoHookean], [8; 3], || 0.125, part);
        solid.displace(bent);
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let (forces, [tangent, _]) = solid.forces(isa, 0.0);
            let of_held = solid.model.nodes().filter(|&n| {
                // A cell has the nodes from its own number on, three along each axis.
                let at = solid.model.node_position(n)[axis];
                if high { at > 5.5 } else { at < 3.5 }
            });
            let held: Vec<usize> = of_held.collect();
            for &n in &held {
                assert_eq!(forces[n], [0.0; 3], "end {end}, {isa:?}");
            }
            assert!(held.len() >= 100 && tangent > 0.0);
            assert!(forces.iter().any(|f| *f != [0.0; 3]));
        }
    }
}

/// Nothing but elasticity.
const PLAIN: Step = Step {
    kick: 0.0,
    drift: 0.0,
    keep: 1.0,
    gravity: [0.0; 3],
    viscosity: 0.0,
    wants_extremes: false,
    wants_rate: false,
    knows_forces: false,
};

/// Volumes over four decades, a quarter of them none.
fn random_volumes(seed: u64) -> impl FnMut() -> f64 {
    let mut random = Random::new(seed);
    move || {
        let exponent = random.uniform(-4.0, 0.0);
        if random.uniform(0.0, 1.0) < 0.25 {
            0.0
        } else {
            0.125 * 10.0_f64.powf(exponent)
        }
    }
}

/// A smooth displacement with gradients of about a quarter.
fn bent(x: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| {
        let phase = a as f64;
        0.3 * (0.5 * x[0] + phase).sin() * (0.4 * x[1]).cos() + 0.4 * (0.45 * x[2] - phase).sin()
    })
}

fn largest<T: Copy + Into<f64>>(forces: &[[T; 3]]) -> f64 {
    let all = forces.as_flattened().iter();
    all.map(|&f| f.into().abs()).fold(0.0, f64::max)
}

/// Solids of every kind of block: full ones, partial ones, cut ones, mixed ones.
fn solids() -> Vec<Solid> {
    let mut out = vec![];
    for law in elastic_laws() {
        out.push(Solid::full(law, [13, 9, 10]));
        out.push(Solid::new(&[law], [6, 7, 5], random_volumes(3), |_| 0));
    }
    let laws: Vec<Law> = elastic_laws().collect();
    out.push(Solid::new(&laws, [6, 5, 7], random_volumes(5), |c| {
        ((c[0] + c[1]) % 3) as u16
    }));
    for solid in &mut out {
        solid.displace(bent);
        for n in 0..solid.model.mass.len() {
            let v = bent(solid.model.node_position(n).map(|x| x + 1.0)).map(|v| v as f32);
            write(&mut solid.nodes[n / NODES].v, n, v);
        }
    }
    out
}

#[test]
fn forces_are_those_of_a_scalar_loop_over_nodes() {
    for (n, mut solid) in solids().into_iter().enumerate() {
        for viscosity in [0.0, 0.1] {
            let (forces, found) = solid.forces(Isa::detect(), viscosity);
            let (exact, [tangent, rate]) = solid.exact_forces(f64::from(viscosity));
            let scale = largest(&exact);
            for (node, (force, exact)) in forces.iter().zip(&exact).enumerate() {
                for a in 0..3 {
                    let error = (f64::from(force[a]) - exact[a]).abs() / scale;
                    // Single precision: rounding of F near 1 and of sums of some tens of forces, 6e-8 each.
                    assert!(error < 5e-6, "solid {n}, node {node}: {error:e}");
                }
            }
            // F to 1e-7, squared and cubed. With masses of 1 the mean is a sum.
            assert!((found[0] / tangent - 1.0).abs() < 1e-5);
            assert!((found[1] - rate).abs() <= 1e-5 * rate);
        }
    }
}

#[test]
fn forces_sum_to_nothing() {
    for mut solid in solids() {
        let (forces, _) = solid.forces(Isa::detect(), 0.0);
        for a in 0..3 {
            let sum: f64 = forces.iter().map(|f| f64::from(f[a])).sum();
            let all: f64 = forces.iter().map(|f| f64::from(f[a]).abs()).sum();
            // Round-off of single forces, 6e-8, which mostly cancels.
            assert!(sum.abs() < 1e-6 * all, "{sum:e} of {all:e}");
        }
    }
}

#[test]
fn turned_solids_bear_no_force() {
    let turn = rotation(&Mat3([[0.4, -1.0, 0.3], [1.0, 0.6, -0.5], [0.2, 0.4, 1.1]]));
    for law in elastic_laws() {
        let mut solid = Solid::full(law, [9, 6, 5]);
        solid.displace(|x| {
            let y = turn.mul_vec(x);
            std::array::from_fn(|a| y[a] - x[a])
        });
        let (forces, _) = solid.forces(Isa::detect(), 0.0);
        // Displacements of up to 8 cells round to 5e-7, a strain that 3 lambda + 2 mu make a stress on a face of a cell.
        let bound = 4.0 * 5e-7 * (3.0 * LAMBDA + 2.0 * MU);
        assert!(largest(&forces) < bound, "{:e} {bound:e}", largest(&forces));
    }
}

#[test]
fn bits_do_not_depend_on_instruction_set_or_threads() {
    for solid in solids() {
        let run = |isa: Isa, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let mut solid = solid.clone();
            pool.expect("threads").install(|| {
                for n in 0..12 {
                    let step = Step {
                        kick: 1e-2,
                        drift: 1e-2,
                        keep: 0.99,
                        gravity: [0.1, -0.2, -9.81],
                        viscosity: if n % 3 == 2 { 1e-3 } else { 0.0 },
                        wants_extremes: n % 4 == 0,
                        wants_rate: n % 2 == 0,
                        knows_forces: false,
                    };
                    solid.substep(isa, &step);
                }
            });
            let lanes = |planes: &Planes| {
                let lanes = planes.as_flattened().iter().flat_map(|v| v.0);
                lanes.map(f32::to_bits).collect::<Vec<_>>()
            };
            let blocks = solid.nodes.iter();
            blocks
                .map(|block| [lanes(&block.u), lanes(&block.v)])
                .collect::<Vec<_>>()
        };
        let expected = run(Isa::Portable, 1);
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            for threads in [1, 2, 3, 8] {
                assert!(run(isa, threads) == expected, "{isa} {threads}");
            }
        }
    }
}

#[test]
fn asking_for_extremes_changes_nothing() {
    for solid in solids() {
        let run = |wants_extremes: bool| {
            let mut solid = solid.clone();
            let step = Step {
                kick: 1e-2,
                drift: 1e-2,
                wants_extremes,
                wants_rate: wants_extremes,
                knows_forces: false,
                ..PLAIN
            };
            solid.substep(Isa::detect(), &step);
            solid.nodes
        };
        assert!(run(true) == run(false));
    }
}

#[test]
fn matter_inside_out_bears_finite_forces() {
    for law in elastic_laws() {
        let mut solid = Solid::new(&[law], [5, 4, 3], random_volumes(7), |_| 0);
        solid.displace(|x| [-2.0 * x[0], 0.0, 3.0 * (7.0 * x[1]).sin()]);
        let (forces, [tangent, _]) = solid.forces(Isa::detect(), 0.0);
        assert!(forces.as_flattened().iter().all(|f| f.is_finite()));
        assert!(tangent.is_finite() && tangent > 0.0);
    }
}

#[test]
fn nodes_that_are_nowhere_are_reported() {
    let mut solid = Solid::full(Law::NeoHookean, [3, 3, 3]);
    solid.nodes[0].u[1][2].0[5] = f32::NAN;
    let step = Step {
        kick: 1e-3,
        ..PLAIN
    };
    assert!(solid.substep(Isa::detect(), &step).bad);
}

#[test]
fn outer_forces_push_and_nodes_without_inverse_mass_keep_going() {
    let mut solid = Solid::full(Law::NeoHookean, [3, 3, 3]);
    let at = |solid: &Solid, x: [f64; 3]| {
        let mut nodes = solid.model.nodes();
        nodes
            .find(|&n| solid.model.node_position(n) == x)
            .expect("a node")
    };
    let slot = at(&solid, [2.0, 2.0, 2.0]);
    solid.conditions.add_force(slot, [3.0, 0.0, 0.0]);
    let held = at(&solid, [1.0, 2.0, 2.0]);
    let w = std::mem::take(&mut solid.conditions.w[held / NODES][held / LANES % 4].0[held % LANES]);
    assert!(w > 0.0);
    write(&mut solid.nodes[held / NODES].p, held, [0.0, 5.0, 0.0]);
    let step = Step {
        kick: 0.1,
        drift: 0.1,
        gravity: [0.0, 0.0, -10.0],
        ..PLAIN
    };
    solid.substep(Isa::detect(), &step);
    let p = read(&solid.nodes[slot / NODES].p, slot);
    let pushed = (0.1 * 3.0 / solid.model.mass[slot]) as f32;
    assert!((p[0] - pushed).abs() < 1e-6 * pushed && p[2] == -1.0);
    assert_eq!(read(&solid.nodes[held / NODES].v, held), [0.0, 5.0, 0.0]);
    assert_eq!(read(&solid.nodes[held / NODES].u, held), [0.0, 0.5, 0.0]);
}
