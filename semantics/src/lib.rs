//! From views and masks to the objects of a splat.
//!
//! In reading order: [`views`] says where pictures were taken from, read by [`transforms`] and [`colmap`]; [`splat`] is what
//! was in them, [`masks`] what their pixels belong to, [`evidence`] what that says about each Gaussian; [`lift`] makes labels
//! of it over the [`neighbours`] of each, [`grouping`] where masks have no names; [`tree`] finds objects in nothing but the
//! splat, on its [`ground`], and [`strokes`] part them; [`dense`] brings vectors of an image encoder to them, [`query`] says
//! which of them a word means; [`refine`](mod@refine) makes splat and labels better by gradient; [`objects`] keeps them in a
//! file, and [`show`] draws them. [`stand_in`] makes masks where no network does. Nothing here knows a solver or a transport.

pub mod colmap;
pub mod dense;
mod error;
pub mod evidence;
pub mod ground;
pub mod grouping;
pub mod lift;
mod linkage;
pub mod masks;
pub use cosplat_scene::{assets::objects, neighbours};
pub mod npy;
pub mod query;
pub mod refine;
pub mod show;
pub mod splat;
pub mod stand_in;
pub mod strokes;
pub mod transforms;
pub mod tree;
mod tree_file;
pub mod views;

pub use error::SemanticsError;
pub use evidence::{Evidence, MaskMap, evidence};
pub use refine::refine;
pub use splat::Splat;
pub use views::View;
