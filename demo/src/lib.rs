//! The main job in one go, as four processes ([`run`]); a scene under several contact methods, side by side ([`compare`]); or
//! the paper's way from pictures of a splat to a collision of its objects ([`semantic`]).
//!
//! The processes are this very program with other arguments, so whoever calls [`run()`] must be `cosplat`. Errors are for
//! the person who asked for a demo, with all that led to them.

mod children;
pub mod compare;
pub mod outcome;
pub mod paper;
pub mod run;
mod scene;
pub mod semantic;

/// Hears how far the work is: the name of its present part, what of it is done, of how much (0 where nobody knows), and
/// what else there is to say.
pub type Progress<'a> = dyn Fn(&'static str, u64, u64, &str) + 'a;
