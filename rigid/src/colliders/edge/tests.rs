//! Heights told by masses, against shapes whose surface is known.

use std::collections::BTreeMap;

use super::*;
use crate::{
    colliders::{Boundaries, Nodes, Substep},
    scene::Surface,
    test_scenes::{add_plane, empty},
};

/// Mass of nodes by place.
struct Masses(BTreeMap<[i32; 3], f64>);

impl Nodes for Masses {
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
        Some((*self.0.get(&index)?, [0.0; 3]))
    }

    fn gap(&self, _: [i32; 3], _: usize) -> f64 {
        f64::INFINITY
    }

    fn reconstructs_surface(&self) -> bool {
        true
    }
}

fn spline(d: f64) -> f64 {
    let d = d.abs();
    if d < 0.5 {
        0.75 - d * d
    } else {
        0.5 * (1.5 - d).max(0.0).powi(2)
    }
}

/// A lattice of eight particles per cell, `shift` off the nodes' own, where `is_inside` says so.
fn lattice(shift: [f64; 3], is_inside: impl Fn([f64; 3]) -> bool) -> Masses {
    let mut masses = BTreeMap::new();
    let n = 24;
    for i in -n..n {
        for j in -n..n {
            for k in -n..n {
                let x = [i, j, k].map(|i| 0.5 * f64::from(i) + 0.25);
                let x: [f64; 3] = std::array::from_fn(|a| x[a] + shift[a]);
                if !is_inside(x) {
                    continue;
                }
                let near = x.map(|x| x.round() as i32);
                for m in 0..27 {
                    let at: [i32; 3] =
                        std::array::from_fn(|a| near[a] + [m / 9, m / 3 % 3, m % 3][a] - 1);
                    let weight: f64 = (0..3).map(|a| spline(f64::from(at[a]) - x[a])).product();
                    *masses.entry(at).or_insert(0.0) += 0.125 * weight;
                }
            }
        }
    }
    Masses(masses)
}

#[test]
fn share_of_mass_and_surface_height_are_inverse() {
    for n in -150..=150 {
        let h = 0.01 * f64::from(n);
        // Midpoint rule with 3000 points: an error of 1e-7.
        let points = (0..3000).map(|m| h + (1.5 - h) * (f64::from(m) + 0.5) / 3000.0);
        let share: f64 = points.map(spline).sum::<f64>() * (1.5 - h) / 3000.0;
        let share = share.min(1.0);
        // Near the ends the share hardly changes with the height, by the square of the distance: 1e-7 of it is 0.008.
        let slack = if h.abs() > 1.49 { 0.01 } else { 2e-4 };
        assert!((height(share) - h).abs() < slack, "{h}: {}", height(share));
    }
}

#[test]
fn a_flat_bottom_is_found_wherever_its_lattice_lies() {
    let mut worst = 0.0_f64;
    for n in 0..20 {
        let shift = [0.13, 0.31, 0.05 * f64::from(n)];
        // The lowest particles fill the half cell around them.
        let bottom = shift[2];
        let matter = lattice(shift, |x| x[2] > bottom);
        let base = [0, 0, bottom.round() as i32];
        let found = line(base, [0.0, 0.0, 1.0], f64::from(base[2]) - bottom, |at| {
            matter.matter(at)
        });
        worst = worst.max(found.abs());
    }
    // What the sum over a lattice of half a cell makes of the integral: measured, 0.0213.
    assert!(worst < 0.022, "{worst}");
}

/// And not a cell and a half beside it.
#[test]
fn a_slanting_bottom_is_found_at_the_node() {
    // 24 degrees; surfaces like those of a ball one third of its radius off its lowest point.
    let (sin, cos) = 24f64.to_radians().sin_cos();
    let mut worst = 0.0_f64;
    for n in 0..20 {
        let shift = [0.13, 0.31, 0.05 * f64::from(n)];
        let above = |x: [f64; 3]| cos * (x[2] - 0.3) - sin * x[0] > 0.0;
        let matter = lattice(shift, above);
        // Height of matter above the plane z = 0 at the node, the mean over the spline being that in its middle.
        let found = line([0; 3], [0.0, 0.0, 1.0], 0.0, |at| matter.matter(at));
        worst = worst.max((found - 0.3).abs());
        // The same surface and a plane parallel to it.
        let found = line([0; 3], [-sin, 0.0, cos], 0.3 * cos, |at| matter.matter(at));
        worst = worst.max((found - 0.6 * cos).abs());
    }
    // Steps of half a cell, averaged. The nearest particle is 1.5 tan 24 = 0.67 cells lower.
    assert!(worst < 0.12, "{worst}");
}

/// Nodes that know how far away they were asked for.
struct Asked(std::cell::Cell<i32>);

impl Nodes for Asked {
    fn node(&self, index: [i32; 3]) -> Option<(f64, [f64; 3])> {
        let far = index.map(i32::abs).into_iter().max();
        self.0.set(self.0.get().max(far.unwrap_or(0)));
        Some((1.0, [0.0; 3]))
    }

    fn gap(&self, _: [i32; 3], _: usize) -> f64 {
        f64::INFINITY
    }

    fn reconstructs_surface(&self) -> bool {
        true
    }
}

#[test]
fn no_node_is_looked_at_beyond_the_reach() {
    let nodes = Asked(std::cell::Cell::new(0));
    for across in 0..18 {
        let (sin, cos) = (f64::from(across) * 0.35).sin_cos();
        let (s, c) = (f64::from(across) * 0.11).sin_cos();
        for off in -30..=30 {
            let mut scene = empty(1.0);
            let normal = [c * cos, s, c * sin];
            let point = normal.map(|n| 0.1 * f64::from(off) * n);
            add_plane(&mut scene, point, normal, Surface::Separate, 0.0);
            let boundaries = Boundaries::new(&scene, 1.0);
            let now = Substep {
                time: 0.0,
                dt: 1e-3,
                kick: 1e-3,
                frame_start: 0.0,
                frame_length: 1.0,
            };
            let conditions = boundaries.on_nodes(&vec![], &now);
            let body = conditions.bodies().iter().find(|body| !body.holds());
            body.expect("the plane").edge([0; 3], &nodes, 1.0);
        }
    }
    assert_eq!(f64::from(nodes.0.get()), REACH);
}

#[test]
fn what_is_too_thin_to_tell_leaves_it_to_the_nearest_particle() {
    let film = lattice([0.0; 3], |x| x[2] > 0.0 && x[2] < 0.5);
    let found = line([0; 3], [0.0, 0.0, 1.0], 0.0, |at| film.matter(at));
    assert_eq!(gap(-0.02, found), -0.02);
    let nothing = Masses(BTreeMap::new());
    assert_eq!(
        line([0; 3], [0.0, 0.0, 1.0], 0.0, |at| nothing.matter(at)),
        f64::INFINITY
    );
}

#[test]
fn only_solids_of_one_density_tell_their_edges() {
    let (elastic, loose) = (
        Law::FixedCorotated,
        Law::Fluid {
            bulk_modulus: 1e5,
            viscosity: 0.0,
        },
    );
    let parts = [
        (0, 1e3, elastic),
        (0, 1e3, elastic),
        (1, 1e3, elastic),
        (1, 2e3, elastic),
        (2, 1e3, loose),
        (3, 2e3, Law::Rigid),
        (3, 1e3, elastic),
    ];
    let tell = reconstructs_surface(4, parts.into_iter());
    assert_eq!(tell, [true, false, false, true]);
}
