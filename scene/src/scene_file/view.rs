//! `[view]`: how a scene is shown. The solver does not read it.

use super::{
    limits as l,
    reader::{Bounds, Table},
};

/// Where a scene is looked at from, for how long, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Point looked at [m], world frame.
    pub target: [f64; 3],
    /// From there to the camera [m], > 0.
    pub distance: f64,
    /// Angle around the vertical [degrees].
    pub azimuth: f64,
    /// Angle above the horizon [degrees], -90 to 90.
    pub elevation: f64,
    /// Simulated time in which it shows what it is about [s], > 0.
    pub duration: f64,
    /// Moments of its pictures as shares of that time, 0 to 1.
    pub moments: [f64; 4],
}

const ELEVATION: Bounds = l::bounds(-90.0, 90.0, "degrees");
const DURATION: Bounds = l::bounds(1e-6, 1e6, "s");
const MOMENT: Bounds = l::bounds(0.0, 1.0, "of the duration");

/// Reads `[view]`; none where there is none, or where a required key is missing.
pub(super) fn read(root: &Table) -> Option<View> {
    let table = root.get("view").and_then(|e| e.table())?;
    let target = table.required("target");
    let target = target.and_then(|e| e.numbers(l::POSITION));
    let required = |key, bounds| table.required(key).and_then(|e| e.number(bounds));
    let distance = required("distance", l::LENGTH);
    let duration = required("duration", DURATION);
    let number = |key, bounds| table.get(key).and_then(|e| e.number(bounds));
    let azimuth = number("azimuth_deg", l::ANGLE);
    let elevation = number("elevation_deg", ELEVATION);
    let moments = table.get("moments").and_then(|e| e.numbers(MOMENT));
    table.finish();
    Some(View {
        target: target?,
        distance: distance?,
        azimuth: azimuth.unwrap_or(0.0),
        elevation: elevation.unwrap_or(0.0),
        duration: duration?,
        moments: moments.unwrap_or([0.0, 0.25, 0.5, 1.0]),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::SceneFile;

    fn parsed(view: &str) -> Result<Option<View>, String> {
        let text = format!(
            "version = 1\ndx = 0.1\n[[objects]]\nname = \"ball\"\nmaterial = \"jelly\"\n\
             shape = {{ kind = \"sphere\", radius = 0.2 }}\n{view}"
        );
        let file = SceneFile::parse(&text).map_err(|e| e.to_string())?;
        Ok(file.view)
    }

    #[test]
    fn a_view_says_where_from_how_long_and_when() {
        assert_eq!(parsed(""), Ok(None));
        let given = "[view]\ntarget = [1, 2, 3]\ndistance = 0.5\nduration = 2\nelevation_deg = 14\n\
                     moments = [0, 0.1, 0.4, 1]\n";
        let expected = View {
            target: [1.0, 2.0, 3.0],
            distance: 0.5,
            azimuth: 0.0,
            elevation: 14.0,
            duration: 2.0,
            moments: [0.0, 0.1, 0.4, 1.0],
        };
        assert_eq!(parsed(given), Ok(Some(expected)));
    }

    #[test]
    fn a_view_that_shows_nothing_is_refused() {
        let whole = "target = [0, 0, 0]\ndistance = 1\nduration = 1\n";
        for (view, words) in [
            ("target = [0, 0, 0]\nduration = 1\n".into(), "distance"),
            (format!("{whole}elevation_deg = 91\n"), "90"),
            (format!("{whole}moments = [0, 0.5, 1]\n"), "moments"),
            (format!("{whole}zoom = 2\n"), "zoom"),
        ] {
            let error = parsed(&format!("[view]\n{view}")).expect_err(words);
            assert!(error.contains(words), "{words:?} not in {error}");
        }
    }
}
