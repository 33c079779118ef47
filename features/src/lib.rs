//! Networks that a user brings, as ONNX files: pictures to maps of features and to masks, words to vectors.
//!
//! In reading order: [`config`] says what a network takes and gives, in a TOML file beside it; [`network`] runs it; [`picture`]
//! is what it is shown. [`encoder`] makes a map of features, [`proposals`] masks with a vector for each, [`words`] a vector for
//! each word. [`job`] goes through many pictures, in parallel, and goes on where it was ended.
//!
//! The networks run by `rten`, on one thread per picture: the same files come out on any number of threads.

pub mod config;
pub mod encoder;
mod error;
pub mod job;
pub mod network;
pub mod picture;
pub mod proposals;
pub mod words;

pub use error::FeaturesError;
