//! The splat of the demo: things of known kinds that touch, in one file, as a capture of a table would have them.

use cosplat_scene::assets::{self, Gaussians, Paint, SH_C0, generate};
use cosplat_semantics::Splat;
use glam::{Quat, Vec3};

use crate::paper::nearby;

/// Gaussians and the thing that each is of.
#[derive(Default)]
pub struct Composed {
    /// As in a file, y up.
    pub gaussians: Gaussians,
    /// Number of the thing, by Gaussian.
    pub truth: Vec<i32>,
    /// Words for the things.
    pub words: Vec<&'static str>,
    /// The two that a text asks for: the first is thrown at the second.
    pub asked: [&'static str; 2],
    /// Whether captures are in it, or generated things alone.
    pub captured: bool,
}

/// Radius of the disc that all stand on [m].
const GROUND: f64 = 0.9;
/// Distance of its Gaussians [m].
const SPACING: f64 = 0.011;

/// A thing and where it goes: word, bottom centre, longest side [m], and what its colour is multiplied by.
struct Place(&'static str, Vec3, f32, [f32; 3]);

/// As it is.
const PLAIN: [f32; 3] = [1.0; 3];

/// Box of the centres [m].
fn bounds(gaussians: &Gaussians) -> [Vec3; 2] {
    Splat {
        position: gaussians.position.iter().copied().map(Vec3::from).collect(),
        ..Splat::default()
    }
    .bounds()
}

/// Upside down, as captures mostly are.
fn turned(mut gaussians: Gaussians) -> Gaussians {
    let half = Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    for p in &mut gaussians.position {
        *p = (half * Vec3::from(*p)).to_array();
    }
    for r in &mut gaussians.rotation {
        *r = (half * Quat::from_array(*r)).to_array();
    }
    gaussians
}

impl Composed {
    /// Adds a thing; what it is like from other sides is left out.
    fn add(&mut self, part: &Gaussians, &Place(word, at, side, tint): &Place) {
        let [low, high] = bounds(part);
        let scale = side / (high - low).max_element();
        let foot = Vec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z));
        let all = &mut self.gaussians;
        let place = |p: &[f32; 3]| (at + (Vec3::from(*p) - foot) * scale).to_array();
        all.position.extend(part.position.iter().map(place));
        all.scale
            .extend(part.scale.iter().map(|s| s.map(|s| s * scale)));
        all.rotation.extend(&part.rotation);
        all.opacity.extend(&part.opacity);
        let tinted = |(c, sh): (usize, &f32)| ((0.5 + SH_C0 * sh) * tint[c] - 0.5) / SH_C0;
        let bases = part.sh.chunks(part.sh_stride());
        let bases = bases.flat_map(|sh| sh[..3].iter().enumerate().map(tinted));
        all.sh.extend(bases);
        self.truth.resize(all.len(), self.words.len() as i32);
        self.words.push(word);
    }

    fn on_ground() -> Self {
        let style = generate::Style {
            spacing: SPACING,
            paint: Paint::Plain([0.62, 0.60, 0.56]),
            seed: 1,
        };
        let mut composed = Self::default();
        let disc = generate::surface_disc(GROUND, &style);
        composed.add(
            &disc,
            &Place("ground", Vec3::ZERO, 2.0 * GROUND as f32, PLAIN),
        );
        composed
    }

    /// The splat at hand: coarser than what the pictures show, as a splat is coarser than what it is of. Every second Gaussian, with
    /// twice the area.
    pub fn coarse(&self) -> Gaussians {
        let all = &self.gaussians;
        let kept = || (0..all.len()).step_by(2);
        Gaussians {
            position: kept().map(|n| all.position[n]).collect(),
            scale: kept()
                .map(|n| all.scale[n].map(|s| s * std::f32::consts::SQRT_2))
                .collect(),
            rotation: kept().map(|n| all.rotation[n]).collect(),
            opacity: kept().map(|n| all.opacity[n]).collect(),
            sh: kept()
                .flat_map(|n| all.sh[3 * n..3 * n + 3].iter().copied())
                .collect(),
            ..Gaussians::default()
        }
    }

    /// The captured plant on a disc, a cow that leans on its pot, a cube: the scene `plant` of `docs/semantics.md`. None where the
    /// captures are not found.
    pub fn plant() -> Option<Self> {
        let mut composed = Self::on_ground();
        let [plant, cow] = ["plant.splat", "spot_10k.splat"].map(capture);
        let (plant, cow) = (turned(plant?), turned(cow?));
        composed.add(&plant, &Place("plant", Vec3::ZERO, 1.0, PLAIN));
        let at = Vec3::new(-0.32, 0.0, 0.0);
        composed.add(&cow, &Place("cow", at, 0.4, PLAIN));
        let cube = capture("cube_10k.splat")?;
        let at = Vec3::new(0.4, 0.0, 0.2);
        composed.add(&cube, &Place("cube", at, 0.2, PLAIN));
        Some(composed)
    }

    /// The captures where they lie as `cosplat demo --scene` looks for them, else generated things.
    pub fn new() -> Self {
        captured().unwrap_or_else(generated)
    }
}

fn capture(name: &str) -> Option<Gaussians> {
    let path = nearby(name)?;
    let bytes = std::fs::read(path).ok()?;
    Some(assets::read(name, &bytes).ok()?.0)
}

/// A cow whose back touches a block, a ring on the block, a duck, a can.
fn captured() -> Option<Composed> {
    let mut composed = Composed {
        asked: ["cow", "duck"],
        captured: true,
        ..Composed::on_ground()
    };
    let [cow, duck] = ["spot_10k.splat", "bob_10k.splat"].map(capture);
    let (cow, duck) = (turned(cow?), turned(duck?));
    let side = 0.45;
    let [low, high] = bounds(&cow);
    let reach = 0.5 * side * (high.x - low.x) / (high - low).max_element();
    let at = Vec3::new(-0.3, 0.0, 0.0);
    // Captures of shapes are grey; things have colours of their own.
    composed.add(&cow, &Place("cow", at, side, [1.0, 0.85, 0.7]));
    let behind = at - Vec3::X * (reach + 0.13);
    let block = capture("cube_10k.splat")?;
    composed.add(&block, &Place("block", behind, 0.26, [0.7, 0.4, 0.2]));
    let top = behind + 0.26 * Vec3::Y;
    let ring = capture("ring_10k.splat")?;
    composed.add(&ring, &Place("ring", top, 0.22, [0.3, 0.5, 0.9]));
    let at = Vec3::new(0.3, 0.0, 0.03);
    composed.add(&duck, &Place("duck", at, 0.36, [1.0, 0.8, 0.2]));
    let can = capture("cylinder_10k.splat")?;
    let aside = Vec3::new(0.05, 0.0, -0.4);
    composed.add(&can, &Place("can", aside, 0.24, [0.4, 0.7, 0.5]));
    Some(composed)
}

/// A ball that touches a block, a vase on the block, a cushion, a can.
fn generated() -> Composed {
    let style = |paint, seed| generate::Style {
        spacing: 0.009,
        paint: Paint::Plain(paint),
        seed,
    };
    let mut composed = Composed {
        asked: ["ball", "cushion"],
        ..Composed::on_ground()
    };
    let ball = generate::surface_sphere(0.16, &style([0.85, 0.25, 0.2], 2));
    let at = Vec3::new(-0.3, 0.0, 0.0);
    composed.add(&ball, &Place("ball", at, 0.32, PLAIN));
    let block = generate::surface_box([0.26, 0.26, 0.26], &style([0.75, 0.55, 0.3], 3));
    let behind = at - Vec3::X * 0.29;
    composed.add(&block, &Place("block", behind, 0.26, PLAIN));
    if let Ok(vase) = generate::builtin("vase") {
        composed.add(&vase, &Place("vase", behind + 0.26 * Vec3::Y, 0.24, PLAIN));
    }
    let cushion = generate::surface_box([0.16, 0.36, 0.36], &style([0.3, 0.6, 0.4], 4));
    composed.add(&cushion, &Place("cushion", Vec3::X * 0.25, 0.36, PLAIN));
    let can = generate::surface_cylinder(0.08, 0.24, &style([0.3, 0.4, 0.75], 5));
    composed.add(&can, &Place("can", Vec3::new(0.05, 0.0, -0.4), 0.24, PLAIN));
    composed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generated_things_touch_and_are_asked_for_by_word() {
        let composed = generated();
        assert_eq!(composed.truth.len(), composed.gaussians.len());
        assert!(composed.asked.iter().all(|w| composed.words.contains(w)));
        let of = |word: &str| {
            let n = composed.words.iter().position(|w| *w == word);
            let n = n.expect("there") as i32;
            let pairs = composed.gaussians.position.iter().zip(&composed.truth);
            let mine = pairs.filter(|(_, t)| **t == n).map(|(p, _)| Vec3::from(*p));
            mine.collect::<Vec<_>>()
        };
        let ends = |word: &str, axis: usize| {
            let values = of(word).into_iter().map(|p| p[axis]);
            values.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], x| {
                [a.min(x), b.max(x)]
            })
        };
        // Gaussians lie up to their spacing from where surfaces meet.
        assert!((ends("ball", 0)[0] - ends("block", 0)[1]).abs() < 0.01);
        assert!((ends("vase", 1)[0] - ends("block", 1)[1]).abs() < 0.01);
        assert!(ends("cushion", 1)[0].abs() < 0.01);
    }
}
