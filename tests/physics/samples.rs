//! The six sample scenes of PhysGaussian: their published settings, and geometry that stands in for their captures.

use cosplat_scene::assets::{Gaussians, Paint, generate, generate::Style};
use glam::{DQuat, DVec3};
use serde_json::Value;

/// A sample scene.
pub struct Sample {
    pub name: &'static str,
    /// Its JSON configuration: numbers of the material, the grid and the steps as published, boundaries of the same
    /// kinds, placed to fit the stand-in.
    pub config: &'static str,
    parts: fn() -> Parts,
}

/// All of them.
pub const SAMPLES: [Sample; 6] = [
    Sample {
        name: "ficus",
        config: include_str!("../../scenes/physgaussian/ficus.json"),
        parts: ficus,
    },
    Sample {
        name: "pillow2sofa",
        config: include_str!("../../scenes/physgaussian/pillow2sofa.json"),
        parts: pillow2sofa,
    },
    Sample {
        name: "plane",
        config: include_str!("../../scenes/physgaussian/plane.json"),
        parts: plane,
    },
    Sample {
        name: "tear_bread",
        config: include_str!("../../scenes/physgaussian/tear_bread.json"),
        parts: tear_bread,
    },
    Sample {
        name: "vasedeck",
        config: include_str!("../../scenes/physgaussian/vasedeck.json"),
        parts: vasedeck,
    },
    Sample {
        name: "wolf",
        config: include_str!("../../scenes/physgaussian/wolf.json"),
        parts: wolf,
    },
];

/// A model: its longest side is 1, its middle the origin, its axes those of the simulation.
struct Parts {
    solids: Vec<Gaussians>,
    /// Units of the capture per unit here, and where the origin is after the capture's rotations.
    capture: (f64, [f64; 3]),
}

impl Sample {
    /// The model as its capture would have it: turned back, in other units, elsewhere.
    pub fn model(&self) -> Gaussians {
        let config: Value = serde_json::from_str(self.config).expect("JSON");
        let list = |key: &str| {
            let values = config[key].as_array().into_iter().flatten();
            values.filter_map(Value::as_f64).collect::<Vec<_>>()
        };
        let steps = list("rotation_degree")
            .into_iter()
            .zip(list("rotation_axis"));
        let rotation = steps.fold(DQuat::IDENTITY, |all, (degrees, axis)| {
            DQuat::from_axis_angle(DVec3::AXES[axis as usize], degrees.to_radians()) * all
        });
        let Parts { solids, capture } = (self.parts)();
        let mut model = Gaussians::default();
        for solid in &solids {
            append(&mut model, solid);
        }
        let (factor, origin) = capture;
        let back = rotation.inverse();
        moved(model, back, factor, back * DVec3::from(origin))
    }
}

const fn style(spacing: f64, color: [f32; 3]) -> Style {
    Style {
        spacing,
        paint: Paint::Plain(color),
        seed: 1,
    }
}

fn append(all: &mut Gaussians, more: &Gaussians) {
    all.position.extend(&more.position);
    all.scale.extend(&more.scale);
    all.rotation.extend(&more.rotation);
    all.opacity.extend(&more.opacity);
    all.sh.extend(&more.sh);
}

/// Scaled, turned, moved.
fn moved(mut g: Gaussians, rotation: DQuat, factor: f64, translation: DVec3) -> Gaussians {
    for p in &mut g.position {
        let to = rotation * DVec3::from(p.map(f64::from)) * factor + translation;
        *p = to.as_vec3().to_array();
    }
    for s in &mut g.scale {
        *s = s.map(|s| (f64::from(s) * factor) as f32);
    }
    for q in &mut g.rotation {
        let to = rotation * DQuat::from_array(q.map(f64::from));
        *q = to.normalize().as_quat().to_array();
    }
    g
}

/// Upright along z.
fn z_up() -> DQuat {
    DQuat::from_rotation_arc(DVec3::Y, DVec3::Z)
}

/// Along x.
fn along_x() -> DQuat {
    DQuat::from_rotation_arc(DVec3::Y, DVec3::X)
}

fn at(g: Gaussians, rotation: DQuat, center: [f64; 3]) -> Gaussians {
    moved(g, rotation, 1.0, center.into())
}

/// An ellipsoid of revolution about y, radius and half height.
fn spheroid(radius: f64, half_height: f64, style: &Style) -> Gaussians {
    let steps = 64;
    let profile: Vec<[f64; 2]> = (0..=steps)
        .map(|i| {
            let angle = std::f64::consts::PI * f64::from(i) / f64::from(steps);
            [radius * angle.sin(), -half_height * angle.cos()]
        })
        .collect();
    generate::surface_of_revolution(&profile, style)
}

/// A pot, a stem, and a crown of leaves that are lumps.
fn ficus() -> Parts {
    let (clay, wood) = (
        style(0.012, [0.6, 0.35, 0.25]),
        style(0.012, [0.4, 0.3, 0.2]),
    );
    let leaf = style(0.012, [0.2, 0.5, 0.2]);
    let mut solids = vec![
        at(
            generate::surface_cylinder(0.16, 0.26, &clay),
            z_up(),
            [0.0, 0.0, -0.37],
        ),
        at(
            generate::surface_cylinder(0.05, 0.5, &wood),
            z_up(),
            [0.0, 0.0, 0.0],
        ),
    ];
    for (turn, height, reach) in [
        (0.0, 0.4, 0.0),
        (0.3, 0.25, 0.15),
        (1.5, 0.28, 0.15),
        (2.8, 0.22, 0.15),
        (4.0, 0.3, 0.15),
        (5.2, 0.2, 0.15),
    ] {
        let (sin, cos) = f64::sin_cos(turn);
        let center = [reach * cos, reach * sin, height];
        solids.push(at(generate::surface_sphere(0.1, &leaf), z_up(), center));
    }
    Parts {
        solids,
        capture: (2.0, [0.3, -0.2, 0.1]),
    }
}

/// A pillow above a seat, and a floor that is not simulated.
fn pillow2sofa() -> Parts {
    let (cloth, linen) = (
        style(0.015, [0.5, 0.4, 0.35]),
        style(0.012, [0.8, 0.8, 0.75]),
    );
    let floor = style(0.05, [0.5, 0.5, 0.5]);
    Parts {
        solids: vec![
            at(
                generate::surface_box([1.0, 0.7, 0.26], &cloth),
                DQuat::IDENTITY,
                [0.0, 0.0, -0.25],
            ),
            at(spheroid(0.25, 0.08, &linen), z_up(), [0.0, 0.0, 0.3]),
            at(
                generate::surface_disc(2.0, &floor),
                z_up(),
                [0.0, 0.0, -1.2],
            ),
        ],
        capture: (1.2, [0.0; 3]),
    }
}

/// Fuselage, wings, tail, wheels' struts and a nose that is turned.
fn plane() -> Parts {
    let (metal, red) = (
        style(0.012, [0.7, 0.7, 0.75]),
        style(0.012, [0.7, 0.2, 0.2]),
    );
    Parts {
        solids: vec![
            at(
                generate::surface_cylinder(0.08, 1.0, &metal),
                along_x(),
                [0.0; 3],
            ),
            at(
                generate::surface_box([0.2, 0.06, 0.9], &red),
                DQuat::IDENTITY,
                [0.1, 0.0, 0.0],
            ),
            at(
                generate::surface_box([0.1, 0.05, 0.4], &red),
                DQuat::IDENTITY,
                [0.43, 0.0, 0.0],
            ),
            at(
                generate::surface_box([0.06, 0.4, 0.08], &metal),
                DQuat::IDENTITY,
                [-0.4, 0.0, 0.0],
            ),
        ],
        capture: (1.7, [-1.1, 0.0, 0.0]),
    }
}

/// A loaf along y.
fn tear_bread() -> Parts {
    let crust = style(0.016, [0.75, 0.55, 0.3]);
    Parts {
        solids: vec![spheroid(0.28, 0.5, &crust)],
        capture: (3.0, [0.5, 1.0, -0.4]),
    }
}

/// A vase with a flower on a deck, y downwards, and ground that is not simulated.
fn vasedeck() -> Parts {
    let (glaze, petal) = (style(0.012, [0.3, 0.4, 0.6]), style(0.012, [0.8, 0.4, 0.5]));
    let (stem, deck) = (
        style(0.012, [0.3, 0.5, 0.25]),
        style(0.015, [0.55, 0.4, 0.3]),
    );
    let ground = style(0.05, [0.5, 0.5, 0.45]);
    Parts {
        solids: vec![
            at(
                spheroid(0.14, 0.22, &glaze),
                DQuat::IDENTITY,
                [0.0, 0.23, 0.0],
            ),
            at(
                generate::surface_cylinder(0.03, 0.4, &stem),
                DQuat::IDENTITY,
                [0.0, -0.15, 0.0],
            ),
            at(
                spheroid(0.13, 0.12, &petal),
                DQuat::IDENTITY,
                [0.0, -0.38, 0.0],
            ),
            at(
                generate::surface_box([0.9, 0.06, 0.9], &deck),
                DQuat::IDENTITY,
                [0.0, 0.47, 0.0],
            ),
            at(
                generate::surface_disc(2.0, &ground),
                DQuat::IDENTITY,
                [0.0, 1.5, 0.0],
            ),
        ],
        capture: (3.5, [0.0, -2.9, 0.25]),
    }
}

/// Four legs, a trunk along x, a head, a tail.
fn wolf() -> Parts {
    let fur = style(0.007, [0.45, 0.42, 0.4]);
    let mut solids = vec![
        at(spheroid(0.06, 0.33, &fur), along_x(), [0.0; 3]),
        at(spheroid(0.04, 0.14, &fur), along_x(), [0.36, 0.0, 0.05]),
        at(
            generate::surface_cylinder(0.015, 0.22, &fur),
            along_x(),
            [-0.39, 0.0, 0.03],
        ),
    ];
    for (x, y) in [(-0.2, -0.04), (-0.2, 0.04), (0.2, -0.04), (0.2, 0.04)] {
        let leg = generate::surface_cylinder(0.02, 0.3, &fur);
        solids.push(at(leg, z_up(), [x, y, -0.17]));
    }
    Parts {
        solids,
        capture: (1.0, [0.0; 3]),
    }
}
