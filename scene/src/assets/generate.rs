//! Generated splats: surfaces of simple solids as evenly spread flat discs. Everything stands along +y.

mod scatter;

pub use scatter::surface_mesh;

use glam::{DVec3, Quat, Vec3};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{AssetError, Gaussians, paint::Paint};

/// Standard deviation of a disc in its plane, as a fraction of the distance to its neighbours: neighbours
/// then cover each other's gaps down to 2 % of the background.
const SPREAD: f64 = 0.72;
/// Thickness of a disc as a fraction of its standard deviation in the plane.
const FLATNESS: f64 = 0.12;
const OPACITY: f32 = 0.97;
/// Part of the spacing by which discs of a rectangle are moved, so that no rows show.
const JITTER: f64 = 0.15;
/// Turn between successive discs on a surface of revolution: even for every radius, for it is the number that
/// is hardest to approximate by fractions.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// How a generated surface is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Distance between neighbouring Gaussians [m], > 0.
    pub spacing: f64,
    /// Colours.
    pub paint: Paint,
    /// Seed of jitter and grain.
    pub seed: u64,
}

struct Builder {
    out: Gaussians,
    style: Style,
    rng: Pcg64Mcg,
}

impl Builder {
    fn new(style: &Style) -> Self {
        let out = Gaussians {
            sh_degree: style.paint.sh_degree(),
            ..Gaussians::default()
        };
        Self {
            out,
            style: *style,
            rng: Pcg64Mcg::seed_from_u64(style.seed),
        }
    }

    /// Uniform in -1..=1.
    fn noise(&mut self) -> f64 {
        f64::from(self.rng.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    fn disc(&mut self, position: DVec3, normal: DVec3, spacing: f64) {
        let sigma = (SPREAD * spacing) as f32;
        let n = normal.as_vec3();
        let noise = self.noise() as f32;
        self.out.position.push(position.as_vec3().to_array());
        self.out.scale.push([sigma, sigma, sigma * FLATNESS as f32]);
        self.out
            .rotation
            .push(Quat::from_rotation_arc(Vec3::Z, n).normalize().to_array());
        self.out.opacity.push(OPACITY);
        let p = position.as_vec3().to_array();
        self.style
            .paint
            .coefficients(p, n.to_array(), noise, &mut self.out.sh);
    }

    /// A rectangle of discs, rows and columns fitted to its edges.
    fn rectangle(&mut self, center: DVec3, u: DVec3, v: DVec3) {
        let (wide, high) = (u.length(), v.length());
        let normal = u.cross(v).normalize();
        let fit = |length: f64| (length / self.style.spacing).round().max(1.0);
        let (columns, rows) = (fit(wide), fit(high));
        let spacing = ((wide / columns) * (high / rows)).sqrt();
        for row in 0..rows as usize {
            for column in 0..columns as usize {
                let a = (column as f64 + 0.5 + JITTER * self.noise()) / columns - 0.5;
                let b = (row as f64 + 0.5 + JITTER * self.noise()) / rows - 0.5;
                self.disc(center + u * a + v * b, normal, spacing);
            }
        }
    }

    /// A profile turned about the y axis; see [`surface_of_revolution`].
    fn revolve(&mut self, profile: &[[f64; 2]]) {
        use std::f64::consts::PI;
        // Area of each frustum, Pappus.
        let areas = profile
            .windows(2)
            .map(|w| PI * (w[0][0] + w[1][0]) * (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1]))
            .collect::<Vec<_>>();
        let total = areas.iter().sum::<f64>();
        let cell = self.style.spacing * self.style.spacing;
        let count = (total / cell).round().max(1.0);
        let spacing = (total / count).sqrt();
        let (mut segment, mut before) = (0, 0.0);
        for i in 0..count as usize {
            let target = (i as f64 + 0.5) / count * total;
            while segment + 1 < areas.len() && before + areas[segment] < target {
                before += areas[segment];
                segment += 1;
            }
            let ([r0, y0], [r1, y1]) = (profile[segment], profile[segment + 1]);
            // Area grows as r0 t + (r1 - r0) t^2 / 2 along the segment.
            let part = ((target - before) / areas[segment]).clamp(0.0, 1.0);
            let (a, b) = (r1 - r0, r0 + r1);
            let t = if a.abs() < 1e-9 * b {
                part
            } else {
                ((r0 * r0 + part * a * b).max(0.0).sqrt() - r0) / a
            };
            let (r, y) = (r0 + t * a, y0 + t * (y1 - y0));
            let (sin, cos) = (i as f64 * GOLDEN_ANGLE).sin_cos();
            let length = a.hypot(y1 - y0);
            let (nr, ny) = ((y1 - y0) / length, -a / length);
            let normal = DVec3::new(nr * cos, ny, nr * sin);
            self.disc(DVec3::new(r * cos, y, r * sin), normal, spacing);
        }
    }
}

/// The six faces of a box with full edge lengths `size` [m], centred at the origin.
pub fn surface_box(size: [f64; 3], style: &Style) -> Gaussians {
    let mut builder = Builder::new(style);
    let [x, y, z] = [DVec3::X * size[0], DVec3::Y * size[1], DVec3::Z * size[2]];
    for (n, u, v) in [(x, y, z), (y, z, x), (z, x, y)] {
        builder.rectangle(n * 0.5, u, v);
        builder.rectangle(n * -0.5, v, u);
    }
    builder.out
}

/// A flat box with edge lengths `size` along x and z and the top face in the plane y = 0 [m].
pub fn surface_slab(size: [f64; 2], thickness: f64, style: &Style) -> Gaussians {
    let mut slab = surface_box([size[0], thickness, size[1]], style);
    for p in &mut slab.position {
        p[1] -= (0.5 * thickness) as f32;
    }
    slab
}

/// A sphere around the origin, radius in metres.
pub fn surface_sphere(radius: f64, style: &Style) -> Gaussians {
    let steps = 128;
    let profile = (0..=steps)
        .map(|i| {
            let angle = std::f64::consts::PI * f64::from(i) / f64::from(steps);
            [radius * angle.sin(), -radius * angle.cos()]
        })
        .collect::<Vec<_>>();
    surface_of_revolution(&profile, style)
}

/// A closed cylinder around the y axis, centred at the origin, lengths in metres.
pub fn surface_cylinder(radius: f64, height: f64, style: &Style) -> Gaussians {
    let half = 0.5 * height;
    surface_of_revolution(
        &[[0.0, -half], [radius, -half], [radius, half], [0.0, half]],
        style,
    )
}

/// A disc in the plane y = 0, facing +y: ground without thickness.
pub fn surface_disc(radius: f64, style: &Style) -> Gaussians {
    surface_of_revolution(&[[radius, 0.0], [0.0, 0.0]], style)
}

/// A profile of points (distance from the axis, height) [m] turned about the y axis. Walking along the profile
/// with y up and r to the right, the outside lies on the right-hand side.
pub fn surface_of_revolution(profile: &[[f64; 2]], style: &Style) -> Gaussians {
    let mut builder = Builder::new(style);
    if profile.len() >= 2 {
        builder.revolve(profile);
    }
    builder.out
}

/// Volume inside a profile that starts and ends on the axis, exact for the polygon [m^3].
pub fn revolution_volume(profile: &[[f64; 2]]) -> f64 {
    let frustum = |w: &[[f64; 2]]| {
        let ([r0, y0], [r1, y1]) = (w[0], w[1]);
        (y1 - y0) * (r0 * r0 + r0 * r1 + r1 * r1)
    };
    std::f64::consts::PI / 3.0 * profile.windows(2).map(frustum).sum::<f64>()
}

/// A vessel open at the top: foot, belly, neck and lip, walls of even thickness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vessel {
    /// Height [m].
    pub height: f64,
    /// Outer radius at evenly spaced heights from foot to lip [m].
    pub radii: [f64; 6],
    /// Thickness of wall and bottom [m].
    pub wall: f64,
}

/// A round vase, 0.24 m tall.
pub const VASE: Vessel = Vessel {
    height: 0.24,
    radii: [0.046, 0.076, 0.083, 0.058, 0.035, 0.049],
    wall: 0.012,
};
/// A slender vase, 0.28 m tall.
pub const VASE_SLENDER: Vessel = Vessel {
    height: 0.28,
    radii: [0.042, 0.050, 0.062, 0.066, 0.046, 0.044],
    wall: 0.012,
};

/// A vase with thick walls, 0.24 m tall: for matter that crumbles, which needs several cells across.
pub const VASE_THICK: Vessel = Vessel {
    height: 0.24,
    radii: [0.056, 0.085, 0.090, 0.066, 0.050, 0.062],
    wall: 0.026,
};

impl Vessel {
    /// Outer radius at height `y` and its slope: Catmull-Rom spline through the radii.
    fn outer(&self, y: f64) -> (f64, f64) {
        let spans = (self.radii.len() - 1) as f64;
        let at = (y / self.height * spans).clamp(0.0, spans);
        let i = (at as usize).min(self.radii.len() - 2);
        let t = at - i as f64;
        let r = |k: isize| {
            let k = (i as isize + k).clamp(0, self.radii.len() as isize - 1);
            self.radii[k as usize]
        };
        let (p0, p1, p2, p3) = (r(-1), r(0), r(1), r(2));
        let (b, c, d) = (
            0.5 * (p2 - p0),
            p0 - 2.5 * p1 + 2.0 * p2 - 0.5 * p3,
            0.5 * (p3 - p0) + 1.5 * (p1 - p2),
        );
        let radius = p1 + t * (b + t * (c + t * d));
        (
            radius,
            (b + t * (2.0 * c + t * 3.0 * d)) * spans / self.height,
        )
    }

    /// Inner radius at height `y`: the wall is measured across, so a slanted one is wider along r.
    fn inner(&self, y: f64) -> f64 {
        let (radius, slope) = self.outer(y);
        (radius - self.wall * slope.hypot(1.0)).max(0.0)
    }

    /// Outer surface from the axis up to the lip, then the inner one down to the axis; lip and foot are rounded.
    pub fn profile(&self) -> Vec<[f64; 2]> {
        const STEPS: i32 = 96;
        const ARC: i32 = 12;
        let round = 0.5 * self.wall;
        let (lip, foot) = (self.height - round, round);
        let between =
            |from: f64, to: f64, i: i32| from + (to - from) * f64::from(i) / f64::from(STEPS);
        let arc = |i: i32, angle: f64| (angle * f64::from(i) / f64::from(ARC)).sin_cos();
        let mut profile = vec![[0.0, 0.0]];
        let edge = self.outer(foot).0 - round;
        profile.extend((0..ARC).map(|i| {
            let (sin, cos) = arc(i, std::f64::consts::FRAC_PI_2);
            [edge + round * sin, foot - round * cos]
        }));
        profile.extend(
            (0..=STEPS)
                .map(|i| between(foot, lip, i))
                .map(|y| [self.outer(y).0, y]),
        );
        let (outer, inner) = (self.outer(lip).0, self.inner(lip));
        profile.extend((1..ARC).map(|i| {
            let (sin, cos) = arc(i, std::f64::consts::PI);
            [
                0.5 * (outer + inner + (outer - inner) * cos),
                lip + round * sin,
            ]
        }));
        profile.extend(
            (0..=STEPS)
                .map(|i| between(lip, self.wall, i))
                .map(|y| [self.inner(y), y]),
        );
        profile.push([0.0, self.wall]);
        profile
    }
}

/// Names that [`builtin`] knows.
pub const BUILTINS: [&str; 5] = ["vase", "vase_slender", "vase_thick", "table", "ground"];

/// A generated asset by name, in metres, y up, standing on (or, for table and ground, ending at) y = 0.
///
/// # Errors
/// [`AssetError::UnknownBuiltin`] lists the names that exist.
pub fn builtin(name: &str) -> Result<Gaussians, AssetError> {
    let vase = |vessel: Vessel, body: [f32; 3], band: [f32; 3], seed| {
        let paint = Paint::Glaze {
            body,
            band,
            height: vessel.height as f32,
        };
        let style = Style {
            spacing: 0.0035,
            paint,
            seed,
        };
        surface_of_revolution(&vessel.profile(), &style)
    };
    Ok(match name {
        "vase" => vase(VASE, [0.16, 0.36, 0.62], [0.93, 0.90, 0.80], 1),
        "vase_slender" => vase(VASE_SLENDER, [0.74, 0.33, 0.20], [0.13, 0.20, 0.22], 2),
        "vase_thick" => vase(VASE_THICK, [0.88, 0.92, 0.97], [0.55, 0.68, 0.84], 5),
        "table" => surface_slab(
            [0.8, 0.55],
            0.03,
            &Style {
                spacing: 0.008,
                paint: Paint::Wood,
                seed: 3,
            },
        ),
        "ground" => {
            let paint = Paint::Plain([0.55, 0.56, 0.53]);
            surface_disc(
                2.0,
                &Style {
                    spacing: 0.04,
                    paint,
                    seed: 4,
                },
            )
        }
        _ => {
            return Err(AssetError::UnknownBuiltin {
                name: name.into(),
                known: BUILTINS.join(", "),
            });
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn style(spacing: f64) -> Style {
        Style {
            spacing,
            paint: Paint::Plain([0.5; 3]),
            seed: 1,
        }
    }

    fn normal(g: &Gaussians, i: usize) -> Vec3 {
        Quat::from_array(g.rotation[i]) * Vec3::Z
    }

    /// Area that the discs stand for.
    fn area(g: &Gaussians) -> f64 {
        g.scale
            .iter()
            .map(|s| (f64::from(s[0]) / SPREAD).powi(2))
            .sum()
    }

    #[test]
    fn discs_lie_on_the_surface_and_face_outwards() {
        let sphere = surface_sphere(0.5, &style(0.02));
        for (i, p) in sphere.position.iter().enumerate() {
            let p = Vec3::from_array(*p);
            // The profile is a 128-gon: sagitta r (1 - cos(pi/256)) = 4e-5, slope pi/256 off.
            assert!((p.length() - 0.5).abs() < 1e-4);
            assert!(normal(&sphere, i).dot(p / 0.5) > 0.999);
        }
        let cube = surface_box([1.0, 2.0, 3.0], &style(0.05));
        let half = Vec3::new(0.5, 1.0, 1.5);
        for (i, p) in cube.position.iter().enumerate() {
            let (n, p) = (normal(&cube, i), Vec3::from_array(*p));
            assert!((n.dot(p) - n.abs().dot(half)).abs() < 1e-5, "{p} {n}");
        }
        let slab = surface_slab([1.0, 0.5], 0.1, &style(0.05));
        assert!(
            slab.position
                .iter()
                .all(|p| (-0.1001..=1e-6).contains(&p[1]))
        );
    }

    #[test]
    fn discs_stand_for_the_exact_area_and_keep_their_distance() {
        use std::f64::consts::PI;
        let (a, b) = (
            surface_sphere(0.5, &style(0.02)),
            surface_cylinder(0.2, 0.6, &style(0.02)),
        );
        // The 128-gon is short by (pi/128)^2/4 = 1.5e-4.
        assert!((area(&a) / PI - 1.0).abs() < 3e-4);
        assert!((area(&b) / (PI * 0.4 * 0.8) - 1.0).abs() < 1e-5);
        for g in [a, b] {
            let mut worst = f32::MAX;
            for i in 0..g.len() {
                for j in 0..i {
                    worst = worst.min(Vec3::from(g.position[i]).distance(g.position[j].into()));
                }
            }
            // A golden-angle lattice keeps at least 0.87 sqrt(area per point) but where the radius changes
            // quickly: at the poles and rims neighbours may come closer.
            assert!(worst > 0.3 * 0.02, "closest pair {worst}");
        }
    }

    #[test]
    fn profile_volume_is_exact_for_cones_and_cylinders() {
        let cone = [[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]];
        assert!((revolution_volume(&cone) - 4.0 * std::f64::consts::PI).abs() < 1e-12);
        let pipe_with_floor = [
            [0.0, 0.0],
            [2.0, 0.0],
            [2.0, 5.0],
            [1.0, 5.0],
            [1.0, 1.0],
            [0.0, 1.0],
        ];
        let expected = std::f64::consts::PI * (4.0 * 5.0 - 4.0);
        assert!((revolution_volume(&pipe_with_floor) - expected).abs() < 1e-12);
    }

    #[test]
    fn vases_are_open_shells_of_the_stated_wall() {
        for vessel in [VASE, VASE_SLENDER, VASE_THICK] {
            let profile = vessel.profile();
            let top = profile.iter().map(|p| p[1]).fold(0.0, f64::max);
            assert!((top - vessel.height).abs() < 1e-12);
            let lip = profile
                .iter()
                .position(|p| p[1] == top)
                .expect("it is one of them");
            let (outer, inner) = profile.split_at(lip);
            let middle = vessel.wall * 1.5..vessel.height - vessel.wall;
            for [r, y] in inner
                .iter()
                .filter(|p| p[0] > 0.0 && middle.contains(&p[1]))
            {
                let nearest = outer
                    .iter()
                    .map(|[ro, yo]| (ro - r).hypot(yo - y))
                    .fold(f64::MAX, f64::min);
                // Even where the wall bends, it is neither much thinner nor much thicker.
                assert!(
                    (0.85..1.1).contains(&(nearest / vessel.wall)),
                    "{nearest} at {y}"
                );
            }
            assert!(inner[12][0] > 0.02, "the mouth is open");
        }
    }

    #[test]
    fn builtins_are_repeatable_and_of_the_size_that_the_demo_wants() {
        for name in BUILTINS {
            let g = builtin(name).expect("listed");
            assert_eq!(g, builtin(name).expect("listed"));
            assert_eq!(g.sh.len(), g.len() * g.sh_stride());
            let expected = if name.starts_with("vase") {
                10_000..20_000
            } else {
                4_000..16_000
            };
            assert!(expected.contains(&g.len()), "{name}: {}", g.len());
        }
        let error = builtin("vas").expect_err("not a name").to_string();
        assert!(
            error.contains("vase, vase_slender, vase_thick, table, ground"),
            "{error}"
        );
    }
}
