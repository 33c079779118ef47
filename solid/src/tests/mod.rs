//! Laws of solids on a grid of their own.

mod bars;
mod flow;
mod lattices;
mod losses;
mod motion;

use super::{
    advance::{Outside, Scratch, Shares, Solid},
    kernel::SolidLaw,
    lattice::Seed,
    model::SolidModel,
    state::{SolidState, Sums},
};
use crate::{
    materials::{Coefficients, Law, Material},
    simd::Isa,
};
use cosplat_matter::test_scenes;

/// Density of all test matter [kg/m^3].
pub(crate) const DENSITY: f64 = 1000.0;

/// A lattice of eight pieces per cell in a box [m], as far as `inside` says.
pub fn lattice(
    dx: f64,
    min: [f64; 3],
    cells: [usize; 3],
    inside: impl Fn([f64; 3]) -> bool,
) -> Vec<Seed> {
    let mut seeds = vec![];
    for x in 0..2 * cells[0] {
        for y in 0..2 * cells[1] {
            for z in 0..2 * cells[2] {
                let n = [x, y, z];
                let position = std::array::from_fn(|a| min[a] + 0.5 * dx * (n[a] as f64 + 0.5));
                if inside(position) {
                    seeds.push(Seed {
                        position,
                        volume: (0.5 * dx).powi(3),
                        density: DENSITY,
                        part: 0,
                    });
                }
            }
        }
    }
    seeds
}

/// A ball [m] of a lattice of eight pieces per cell, cut ones with their volume and centroid by sampling.
pub(crate) fn ball(dx: f64, center: [f64; 3], radius: f64) -> Vec<Seed> {
    let pieces = test_scenes::ball(dx, center, radius).into_iter();
    let seed = |(position, volume)| Seed {
        position,
        volume,
        density: DENSITY,
        part: 0,
    };
    pieces.map(seed).collect()
}

/// The numbers of a law.
pub(super) fn law(law: Law, youngs_modulus: f64, poisson_ratio: f64, density: f64) -> SolidLaw {
    let k = Coefficients::new(&Material {
        name: "tested".into(),
        law,
        youngs_modulus,
        poisson_ratio,
        density,
        loss: 0.0,
    });
    SolidLaw {
        law,
        lambda: k.lambda,
        mu: k.mu,
        density,
        loss: 0.0,
    }
}

/// A solid that owns all of it.
#[derive(Clone)]
pub(super) struct Owned {
    pub model: SolidModel,
    pub laws: Vec<SolidLaw>,
    pub state: SolidState,
    pub scratch: Scratch,
    pub outside: Outside,
}

impl Owned {
    pub fn new(dx: f64, seeds: &[Seed], law: SolidLaw) -> Self {
        let model = SolidModel::new(dx, seeds);
        Self {
            state: SolidState::new(&model, 0, |_| [0.0; 3]),
            scratch: Scratch::new(&model),
            model,
            laws: vec![law],
            outside: Outside {
                isa: Isa::detect(),
                gravity: [0.0; 3],
                damping: 0.0,
                cfl: 0.8,
            },
        }
    }

    pub fn solid(&mut self) -> Solid<'_> {
        Solid {
            model: &self.model,
            laws: &self.laws,
            state: &mut self.state,
            scratch: &mut self.scratch,
        }
    }

    pub fn advance(&mut self, length: f64) {
        let outside = self.outside;
        assert!(advance_alone(&mut self.solid(), &outside, length, &[]));
    }

    pub fn sums(&self) -> Sums {
        self.state.sums(Isa::detect(), &self.model, &self.laws)
    }
}

/// Moves a solid that touches nothing through a span [s] > 0, held nodes with velocities [m/s], or none; whether it is still somewhere.
pub(super) fn advance_alone(
    solid: &mut Solid<'_>,
    outside: &Outside,
    length: f64,
    given: &[[f64; 3]],
) -> bool {
    let velocity = |n: usize| given.get(n).copied().unwrap_or_default();
    solid.begin(outside, (&[], &[]), true, velocity);
    let mut shares = Shares::first(length, solid.limit(outside.cfl, 0.0));
    let mut kick = 0.5 * shares.dt;
    let mut bad = false;
    loop {
        let found = solid.substep(outside, [kick, shares.dt], &shares, false);
        bad |= found.bad;
        solid.book_loss(kick);
        let last = 0.5 * shares.dt;
        match shares.next(solid.limit(outside.cfl, 0.0)) {
            Some(next) => kick = next,
            None => {
                let found = solid.substep(outside, [last, 0.0], &shares, false);
                bad |= found.bad;
                solid.book_loss(last);
                return !bad;
            }
        }
    }
}

/// Numbers of the nodes of a model that a test of their rest position [m] picks.
pub(super) fn nodes_where(model: &SolidModel, test: impl Fn([f64; 3]) -> bool) -> Vec<usize> {
    let nodes = model.nodes();
    nodes.filter(|&n| test(model.node_in_world(n))).collect()
}
