//! Scenes of known objects, composed of the captures in the folder of test data; everything touches something.

use std::path::{Path, PathBuf};

use cosplat_scene::assets::{self, Paint, generate};
use cosplat_semantics::{Splat, neighbours::Neighbours, neighbours::Tree};
use glam::Vec3;

/// A splat and the object of each Gaussian.
#[derive(Clone, Default)]
pub struct Known {
    pub splat: Splat,
    pub truth: Vec<i32>,
    pub objects: usize,
}

/// Where a capture goes: bottom centre, longest side, and whether it stands on its head.
struct Place(Vec3, f32, bool);

fn data(name: &str) -> Option<Splat> {
    let folder = std::env::var_os("COSPLAT_TEST_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(name);
    let Ok(bytes) = std::fs::read(&path) else {
        let sentence = format!(
            "SKIPPED: {} cannot be read; COSPLAT_TEST_DATA names the folder",
            path.display()
        );
        assert!(
            std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(),
            "{sentence}"
        );
        eprintln!("{sentence}");
        return None;
    };
    let (gaussians, _) = assets::read(name, &bytes).expect("a splat");
    Some(Splat::from(&gaussians))
}

impl Known {
    fn add(&mut self, part: &Splat, place: &Place) {
        let Place(at, side, is_turned) = *place;
        let turn = if is_turned {
            Vec3::new(1.0, -1.0, -1.0)
        } else {
            Vec3::ONE
        };
        let turned: Vec<Vec3> = part.position.iter().map(|p| *p * turn).collect();
        let [low, high] = Splat {
            position: turned.clone(),
            ..Splat::default()
        }
        .bounds();
        let scale = side / (high - low).max_element();
        let foot = Vec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z));
        let splat = &mut self.splat;
        splat
            .position
            .extend(turned.iter().map(|p| at + (*p - foot) * scale));
        splat.covariance.extend(part.covariance.iter().map(|c| {
            let [x, y, z] = turn.to_array();
            let signs = [1.0, x * y, x * z, 1.0, y * z, 1.0];
            std::array::from_fn(|k| c[k] * signs[k] * scale * scale)
        }));
        splat.opacity.extend(&part.opacity);
        splat.color.extend(&part.color);
        splat.normal.extend(part.normal.iter().map(|n| *n * turn));
        self.truth.resize(splat.len(), self.objects as i32);
        self.objects += 1;
    }

    /// A disc of 40,000 Gaussians.
    fn ground(radius: f32) -> Known {
        let spacing = (std::f32::consts::PI * radius * radius / 40_000.0).sqrt();
        let style = generate::Style {
            spacing: spacing.into(),
            paint: Paint::Plain([0.55, 0.5, 0.45]),
            seed: 1,
        };
        let disc = Splat::from(&generate::surface_disc(radius.into(), &style));
        let mut known = Known::default();
        known.add(&disc, &Place(Vec3::ZERO, 2.0 * radius, false));
        known
    }
}

/// Five toys of 10,000 Gaussians on a disc, one on another.
pub fn toys() -> Option<Known> {
    let mut known = Known::ground(1.0);
    for (name, place) in [
        (
            "spot_10k.splat",
            Place(Vec3::new(-0.4, 0.0, 0.1), 0.5, true),
        ),
        ("bob_10k.splat", Place(Vec3::new(0.4, 0.0, 0.1), 0.4, true)),
        (
            "cube_10k.splat",
            Place(Vec3::new(0.0, 0.0, -0.4), 0.3, false),
        ),
        (
            "ring_10k.splat",
            Place(Vec3::new(0.0, 0.3, -0.4), 0.25, false),
        ),
        (
            "cylinder_10k.splat",
            Place(Vec3::new(0.0, 0.0, 0.5), 0.3, false),
        ),
    ] {
        known.add(&data(name)?, &place);
    }
    Some(known)
}

/// A real plant on a disc, a cow that leans on its pot, and a cube.
pub fn plant() -> Option<Known> {
    let mut known = Known::ground(0.9);
    for (name, place) in [
        ("plant.splat", Place(Vec3::ZERO, 1.0, true)),
        (
            "spot_10k.splat",
            Place(Vec3::new(-0.32, 0.0, 0.0), 0.4, true),
        ),
        (
            "cube_10k.splat",
            Place(Vec3::new(0.4, 0.0, 0.2), 0.2, false),
        ),
    ] {
        known.add(&data(name)?, &place);
    }
    Some(known)
}

/// The robot's ground, body and hands: what hangs together, the rest by what is nearest.
pub fn playbot() -> Option<Known> {
    let splat = data("playbot_lod3.ply")?;
    let [low, high] = splat.bounds();
    let link = (high - low).max_element() / 50.0;
    let near = Neighbours::new(&splat.position, 24);
    let mut part = vec![usize::MAX; splat.len()];
    let mut sizes = Vec::new();
    for first in 0..splat.len() {
        if part[first] != usize::MAX {
            continue;
        }
        part[first] = sizes.len();
        let (mut open, mut size) = (vec![first], 0);
        while let Some(n) = open.pop() {
            size += 1;
            for (m, distance) in near.of(n) {
                if distance < link && part[m] == usize::MAX {
                    part[m] = sizes.len();
                    open.push(m);
                }
            }
        }
        sizes.push(size);
    }
    let mut large: Vec<usize> = (0..sizes.len()).filter(|p| sizes[*p] >= 200).collect();
    large.sort_by_key(|p| std::cmp::Reverse(sizes[*p]));
    let number = |p: usize| large.iter().position(|l| *l == p);
    let kept: Vec<usize> = (0..splat.len())
        .filter(|n| number(part[*n]).is_some())
        .collect();
    let points: Vec<Vec3> = kept.iter().map(|n| splat.position[*n]).collect();
    let tree = Tree::new(&points);
    let truth = (0..splat.len()).map(|n| {
        let nearest = kept[tree.nearest(splat.position[n], 1, &|_| true)[0].1 as usize];
        number(part[nearest]).expect("a large part") as i32
    });
    Some(Known {
        truth: truth.collect(),
        objects: large.len(),
        splat,
    })
}

/// The robot's finer tier, labelled by the nearest Gaussian of `tier`: its pictures do not come from the splat that they label.
pub fn finer(tier: &Known) -> Option<Known> {
    let splat = data("playbot_lod2.ply")?;
    let tree = Tree::new(&tier.splat.position);
    let of = |p: &Vec3| tier.truth[tree.nearest(*p, 1, &|_| true)[0].1 as usize];
    let truth = splat.position.iter().map(of).collect();
    Some(Known {
        truth,
        objects: tier.objects,
        splat,
    })
}
