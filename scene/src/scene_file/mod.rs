//! `scene.toml`: text to [`SceneFile`], and with the assets it names to a [`Scene`](cosplat_sim_core::Scene).
//!
//! `docs/scene.md` is the reference of the format. Every error of a file is reported at once.

mod assembly;
mod boundaries;
mod build;
mod captures;
mod cells;
mod checks;
mod clones;
mod contact;
mod drop;
mod edit;
mod error;
mod formed;
mod ids;
mod limits;
mod materials;
mod objects;
mod parse;
mod placement;
mod places;
mod probes;
mod quality;
mod reader;
mod regions;
mod report;
mod restitution;
mod sampling;
mod select;
mod shapes;
mod solids;
mod solver;
mod spec;
mod support;
mod view;
mod words;

pub(crate) use edit::append;

pub use build::{Load, LoadMesh, LoadObjects, build, build_with_files};
pub use contact::ContactSpec;
pub use drop::{DropOptions, drop_scene, guess_up};
pub use error::{At, Finding, SceneErrors, count_of_errors};
pub use quality::{Quality, QualityNumbers};
pub use report::{AssetReport, BuildReport};
pub use spec::*;
pub use view::View;
pub use words::{WORDS, WordTable, keeps_shape, material_text};

impl SceneFile {
    /// Parses the text of a scene file and checks everything that can be checked without its assets.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with line and field.
    pub fn parse(text: &str) -> Result<Self, SceneErrors> {
        parse::parse(text)
    }
}

impl ObjectSpec {
    /// Whether this entry makes several objects, named `NAME_0`, `NAME_1`, ...
    pub fn is_split(&self) -> bool {
        let Geometry::Asset { split, .. } = &self.geometry else {
            return false;
        };
        split.is_some()
    }
}

#[cfg(test)]
mod boundary_tests;
#[cfg(test)]
mod capture_tests;
#[cfg(test)]
mod formula_tests;
#[cfg(test)]
mod grouping_tests;
#[cfg(test)]
mod scale_tests;
#[cfg(test)]
mod tests;
