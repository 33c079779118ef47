//! The preprocessing chain: opacity filter, rotations, simulated part, normalisation to `scale` about (1, 1, 1).

use cosplat_scene::assets::Gaussians;
use glam::{DQuat, DVec3};

use crate::{config::Config, notes::Notes};

/// Where the middle of the simulated part goes.
const CENTER: DVec3 = DVec3::ONE;

/// How the model gets into the space of the simulation, and which of its Gaussians are simulated.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub rotation: DQuat,
    pub scale: f64,
    pub translation: DVec3,
    /// Least opacity that stays.
    pub min_opacity: f64,
    pub part: Part,
    /// Positions of the simulated Gaussians in the space of the simulation.
    pub simulated: Vec<[f64; 3]>,
    /// Their indices in the model.
    pub chosen: Vec<usize>,
    /// Box of them.
    pub min: DVec3,
    /// Box of them.
    pub max: DVec3,
    /// Gaussians that stay at rest.
    pub static_count: usize,
    /// Gaussians left out for their opacity.
    pub transparent: usize,
}

/// The simulated part.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Part {
    All,
    /// A box in the space of the simulation holds exactly the right Gaussians.
    Box([f64; 3], [f64; 3]),
    /// Index ranges, where rounding would put a Gaussian on the wrong side of the box.
    Ranges(Vec<[u64; 2]>),
}

impl Place {
    /// Places a model; what makes that impossible is noted, and then there is none.
    pub fn new(config: &Config, model: &Gaussians, notes: &mut Notes) -> Option<Self> {
        let threshold = config.opacity_threshold;
        let visible = |i: usize| f64::from(model.opacity[i]) > threshold;
        let rotation = rotation(&config.rotations);
        let rotated = |i: usize| rotation * DVec3::from(model.position[i].map(f64::from));
        let inside = |p: DVec3| {
            config
                .sim_area
                .is_none_or(|area| (0..3).all(|a| area[2 * a] < p[a] && p[a] < area[2 * a + 1]))
        };
        let mask: Vec<bool> = (0..model.len())
            .map(|i| visible(i) && inside(rotated(i)))
            .collect();
        let chosen: Vec<usize> = (0..model.len()).filter(|i| mask[*i]).collect();
        let shown = (0..model.len()).filter(|i| visible(*i)).count();
        if chosen.is_empty() {
            let bounds = bounds((0..model.len()).filter(|i| visible(*i)).map(rotated));
            let place = bounds.map_or(String::new(), |(min, max)| {
                format!(", which fill {min:.4} to {max:.4} after the rotations")
            });
            notes.error(
                if shown == 0 {
                    "opacity_threshold"
                } else {
                    "sim_area"
                },
                format!(
                    "leaves none of the model's {} Gaussians{place}",
                    model.len()
                ),
            );
            return None;
        }
        let (min, max) = bounds(chosen.iter().map(|i| rotated(*i)))?;
        let longest = (max - min).max_element();
        if longest <= 0.0 {
            notes.error("sim_area", "holds a single point: nothing to scale");
            return None;
        }
        let scale = config.scale / longest;
        let translation = CENTER - 0.5 * (min + max) * scale;
        let to_space = |p: DVec3| p * scale + translation;
        let mut place = Self {
            rotation,
            scale,
            translation,
            min_opacity: min_opacity(model, threshold),
            part: Part::All,
            simulated: chosen
                .iter()
                .map(|i| to_space(rotated(*i)).to_array())
                .collect(),
            static_count: shown - chosen.len(),
            chosen,
            min: to_space(min),
            max: to_space(max),
            transparent: model.len() - shown,
        };
        if let Some(area) = config.sim_area {
            place.part = place.part(model, area, &mask, visible);
        }
        Some(place)
    }

    /// The area as a box, if that selects the same Gaussians once everything is rounded; else as index ranges.
    fn part(
        &self,
        model: &Gaussians,
        area: [f64; 6],
        mask: &[bool],
        visible: impl Fn(usize) -> bool,
    ) -> Part {
        let corner = |side: usize| {
            let p = DVec3::new(area[side], area[2 + side], area[4 + side]);
            (p * self.scale + self.translation).to_array()
        };
        let (min, max) = (corner(0), corner(1));
        let same = (0..model.len()).filter(|i| visible(*i)).all(|i| {
            let p = self.as_placed(model.position[i]);
            let inside = (0..3).all(|a| (min[a]..=max[a]).contains(&f64::from(p[a])));
            inside == mask[i]
        });
        if same {
            return Part::Box(min, max);
        }
        // Transparent Gaussians are left out anyhow, and may lie within a range.
        let mut ranges: Vec<[u64; 2]> = Vec::new();
        let mut open = false;
        for i in (0..model.len()).filter(|i| visible(*i)) {
            let index = i as u64;
            match (mask[i], open) {
                (true, true) => {
                    if let Some(last) = ranges.last_mut() {
                        last[1] = index + 1;
                    }
                }
                (true, false) => ranges.push([index, index + 1]),
                (false, _) => {}
            }
            open = mask[i];
        }
        Part::Ranges(ranges)
    }

    /// The simulated Gaussians, placed, without colours.
    pub fn simulated_gaussians(&self, model: &Gaussians) -> Gaussians {
        let rotate = |q: [f32; 4]| {
            let local = DQuat::from_array(q.map(f64::from));
            (self.rotation * local).normalize().as_quat().to_array()
        };
        let scaled = |s: [f32; 3]| s.map(|s| (f64::from(s) * self.scale) as f32);
        Gaussians {
            position: self.simulated.iter().map(|p| p.map(|x| x as f32)).collect(),
            scale: self
                .chosen
                .iter()
                .map(|&i| scaled(model.scale[i]))
                .collect(),
            rotation: self
                .chosen
                .iter()
                .map(|&i| rotate(model.rotation[i]))
                .collect(),
            opacity: self.chosen.iter().map(|&i| model.opacity[i]).collect(),
            sh: vec![0.0; 3 * self.chosen.len()],
            ..Gaussians::default()
        }
    }

    /// A position as a scene file's placement computes it, with its two roundings.
    fn as_placed(&self, position: [f32; 3]) -> [f32; 3] {
        let scaled = (DVec3::from(position.map(f64::from)) * self.scale).as_vec3();
        (self.rotation * scaled.as_dvec3() + self.translation)
            .as_vec3()
            .to_array()
    }
}

/// The rotations one after the other, each about an axis of the world.
fn rotation(steps: &[(f64, usize)]) -> DQuat {
    let one = |(degrees, axis): &(f64, usize)| {
        DQuat::from_axis_angle(DVec3::AXES[*axis], degrees.to_radians())
    };
    let all = steps
        .iter()
        .fold(DQuat::IDENTITY, |all, step| one(step) * all);
    all.normalize()
}

/// The original keeps what is above the threshold, a scene file also what is at it.
fn min_opacity(model: &Gaussians, threshold: f64) -> f64 {
    let at = |o: &f32| f64::from(*o) == threshold;
    if model.opacity.iter().any(at) {
        threshold.next_up().min(1.0)
    } else {
        threshold
    }
}

fn bounds(points: impl Iterator<Item = DVec3>) -> Option<(DVec3, DVec3)> {
    points.fold(None, |found, p| {
        let (min, max) = found.unwrap_or((p, p));
        Some((min.min(p), max.max(p)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five Gaussians on a diagonal, the second one nearly transparent.
    fn model() -> Gaussians {
        let position = [-2.0f32, -1.0, 0.0, 1.0, 4.0].map(|x| [x, 2.0 * x, -x]);
        Gaussians {
            position: position.to_vec(),
            scale: vec![[0.1; 3]; 5],
            rotation: vec![[0.0, 0.0, 0.0, 1.0]; 5],
            opacity: vec![1.0, 0.01, 0.5, 0.02, 0.9],
            sh: vec![0.0; 15],
            ..Gaussians::default()
        }
    }

    fn place(json: &str) -> (Option<Place>, Notes) {
        let mut notes = Notes::default();
        let json = serde_json::from_str(json).expect("JSON");
        let config = Config::read(&json, &mut notes).expect("a configuration");
        let place = Place::new(&config, &model(), &mut notes);
        (place, notes)
    }

    #[test]
    fn the_simulated_part_gets_its_longest_side_and_centre() {
        let (place, _) = place(r#"{"g": [0, 0, 0], "scale": 0.6}"#);
        let place = place.expect("placed");
        // The opacity of the fourth is 0.02 rounded to f32, which is below 0.02.
        assert_eq!((place.simulated.len(), place.transparent), (3, 2));
        let side = place.max - place.min;
        assert!(
            (side - DVec3::new(0.3, 0.6, 0.3)).length() < 1e-12,
            "{side}"
        );
        assert!((0.5 * (place.min + place.max) - DVec3::ONE).length() < 1e-12);
        assert_eq!(place.part, Part::All);
    }

    #[test]
    fn rotations_act_one_after_the_other_about_fixed_axes() {
        let (place, _) =
            place(r#"{"g": [0, 0, 0], "rotation_degree": [90, 90], "rotation_axis": [0, 2]}"#);
        // y -> z -> z and z -> -y -> x.
        let r = place.expect("placed").rotation;
        assert!((r * DVec3::Y - DVec3::Z).length() < 1e-12);
        assert!((r * DVec3::Z - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn the_area_is_open_at_its_faces() {
        // The second face passes through the last Gaussian and the first one lies outside: only 0 and 1 remain, of
        // which the latter is too transparent with this threshold.
        let (place, notes) = place(
            r#"{"g": [0, 0, 0], "opacity_threshold": 0.005, "sim_area": [-1.5, 4, -9, 9, -9, 9]}"#,
        );
        let place = place.unwrap_or_else(|| panic!("{notes:?}"));
        assert_eq!((place.simulated.len(), place.static_count), (3, 2));
        // A closed box with the same faces would hold the last Gaussian too.
        assert_eq!(place.part, Part::Ranges(vec![[1, 4]]));
    }

    #[test]
    fn an_empty_area_is_an_error_that_says_where_the_model_is() {
        let (place, notes) = place(r#"{"g": [0, 0, 0], "sim_area": [8, 9, 8, 9, 8, 9]}"#);
        assert!(place.is_none());
        let error = notes.errors.join("\n");
        assert!(
            error.contains("sim_area: leaves none of the model's 5"),
            "{error}"
        );
        assert!(error.contains("[-2.0000, -4.0000, -4.0000]"), "{error}");
    }

    #[test]
    fn a_threshold_that_a_gaussian_has_is_raised() {
        let mut model = model();
        model.opacity[2] = 0.5;
        assert_eq!(min_opacity(&model, 0.02), 0.02);
        assert!(min_opacity(&model, 0.5) > 0.5);
    }
}
