//! When the next step of a session is made: of whoever pauses it ([`steering`]), of all participants ([`lockstep`], and
//! what happened in a step that they wait for: [`outcome`]), and of the clock ([`pace`]). What waits meanwhile: answers to
//! commands ([`late`]), requests beyond their share of the time ([`allowance`]), and whatever was ordered for a step to come
//! ([`waiting`]).
//!
//! It names wire types, and neither the solver nor a service, so that its laws are tested on a clock of the tests; a
//! replay, which has no solver, steps by the same rules.

pub mod allowance;
pub mod late;
pub mod lockstep;
pub mod outcome;
pub mod pace;
pub mod steering;
pub mod waiting;
