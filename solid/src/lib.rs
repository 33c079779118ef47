//! Solids on a grid of their own: total-Lagrangian matter with persistent nodes, of which nothing is ever transferred.
//!
//! Nodes `X_i` sit on a grid in the object's rest frame; unknowns are their displacements `u_i` and velocities `v_i`.
//! With quadratic B-splines `N_i` and Gauss points `p` in every cell, cut ones with the volumes that are there:
//!
//! - `m_i = sum_p N_i(X_p) rho V_p`, `F_p = I + sum_i u_i (x) grad N_i(X_p)` ([`model`]),
//! - `f_i = -sum_p V_p P(F_p) grad N_i(X_p)`, `p += dt f / m`, `v = p + W C p`, `u += dt v` ([`kernel`], [`off_diagonal`]),
//! - substeps by the largest tangent `dP/dF` of the moment ([`advance`]).
//!
//! Points of matter that flows remember it ([`memory`]); those of elastic matter remember nothing.
//!
//! Mass and stiffness are sums over the same points with weights that are not negative, so that the stable substep never depends
//! on where the boundary cuts. Points of the surface ([`surface`]) meet colliders ([`contact`]), and other solids ([`pairs`]) by the
//! depth in them ([`depth`]), and rigid bodies ([`rigid`]). Those that may meet share their substeps
//! ([`group`]).
//!
//! Knows laws, scenes, colliders and rigid bodies, and neither particles nor the world.

#![allow(unsafe_code, reason = "vector instructions")]

pub mod advance;
mod basis;
pub mod bonds;
mod boxes;
mod cells;
pub mod clusters;
pub mod contact;
pub mod depth;
pub mod dissipation;
mod ended;
pub mod expected;
mod extension;
mod facets;
pub mod first_mode;
mod frequency;
pub mod grip;
pub mod group;
mod held;
pub mod inverse;
pub mod kernel;
pub mod lattice;
mod limit;
mod meeting;
mod members;
pub mod memory;
pub mod model;
pub mod mover;
pub mod nodes;
pub mod object;
pub mod off_diagonal;
pub mod outline;
mod overlap;
pub mod overlaps;
pub mod pairs;
mod penalty;
pub mod rigid;
pub mod sampling;
pub mod search;
mod skyline;
pub mod springs;
pub mod stand;
pub mod state;
pub mod surface;
pub mod vibrating;
pub mod volumes;
pub mod walls;

use cosplat_matter::{mat3, materials, rotation, scene, simd, timed::timed};
use cosplat_rigid::{bodies, colliders, episodes, interruption, ledger, motion};

#[cfg(test)]
mod tests;
