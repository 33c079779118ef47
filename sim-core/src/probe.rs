//! Probes: small measurements that a batch run reports each frame.

use std::f64::consts::PI;

use crate::{
    expression::VectorField,
    mat3::Mat3,
    materials::{Coefficients, Material, Trial},
    moments::ParticleArrays,
    scene::{ProbeKind, Region, Scene},
};

/// What a probe measured; `None` from [`Probes::measure`] when no particle was there.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(untagged)]
pub enum Measured {
    /// Box of an object's particles.
    Extent {
        /// Smallest corner [m].
        min: [f64; 3],
        /// Largest corner [m].
        max: [f64; 3],
    },
    /// Mean over the particles around a fixed point.
    Point {
        /// Mass-weighted mean velocity [m/s].
        velocity: [f64; 3],
        /// Mass of these particles over the volume of the ball [kg/m^3].
        density: f64,
        /// How many.
        particles: usize,
    },
    /// One particle.
    MaterialPoint {
        /// Position [m].
        position: [f64; 3],
        /// Velocity [m/s].
        velocity: [f64; 3],
        /// Deformation gradient, row-major.
        deformation: [[f64; 3]; 3],
        /// Cauchy stress [Pa], row-major.
        stress: [[f64; 3]; 3],
    },
    /// Distances from where the particles should be.
    Deviation {
        /// Root of the mean square [m].
        rms: f64,
        /// Largest [m].
        largest: f64,
        /// How many particles.
        particles: usize,
    },
}

/// The probes of a scene, ready to measure.
#[derive(Clone, Debug)]
pub struct Probes {
    probes: Vec<Ready>,
    /// Ends of the parts and their densities at rest [kg/m^3].
    density: Vec<(usize, f64)>,
    radius: f64,
}

#[derive(Clone, Debug)]
struct Ready {
    name: String,
    what: What,
}

#[derive(Clone, Debug)]
enum What {
    /// With the part of the volume that is not beyond a face.
    Extent(std::ops::Range<usize>, f64),
    Point([f64; 3]),
    Particle(Option<(usize, Box<Material>)>),
    Deviation {
        /// Particles with their positions at rest [m].
        particles: Vec<(usize, [f64; 3])>,
        position: VectorField,
    },
}

impl Probes {
    /// Looks up what the probes need; material points stick to the particle nearest at rest.
    pub fn new(scene: &Scene) -> Self {
        let probes = scene.probes.iter().map(|probe| Ready {
            name: probe.name.clone(),
            what: match probe.kind {
                ProbeKind::Extent { object, share } => {
                    What::Extent(particles_of(scene, object), share)
                }
                ProbeKind::Point { position } => What::Point(position),
                ProbeKind::MaterialPoint { object, position } => {
                    let distance =
                        |p: &usize| distance_squared(scene.particles.position[*p], position);
                    let range = particles_of(scene, object);
                    let nearest = range.min_by(|a, b| distance(a).total_cmp(&distance(b)));
                    What::Particle(nearest.and_then(|p| {
                        let parts = scene.parts();
                        let part = parts.iter().find(|part| part.particles.contains(&p))?;
                        Some((p, Box::new(part.material.clone())))
                    }))
                }
                ProbeKind::Deviation {
                    object,
                    ref position,
                    bounds,
                } => {
                    let region = bounds.map(Region::Box);
                    let rest = &scene.particles.position;
                    let particles = particles_of(scene, object).map(|p| (p, rest[p]));
                    What::Deviation {
                        particles: particles
                            .filter(|(_, x)| region.is_none_or(|region| region.contains(*x)))
                            .collect(),
                        position: position.clone(),
                    }
                }
            },
        });
        Self {
            probes: probes.collect(),
            density: scene
                .parts()
                .iter()
                .map(|part| (part.particles.end, part.material.density))
                .collect(),
            radius: scene.dx,
        }
    }

    /// Names and values at the simulated time `time` [s], in the order of the scene.
    pub fn measure<T: Copy + Into<f64>>(
        &self,
        particles: &ParticleArrays<'_, T>,
        time: f64,
    ) -> Vec<(&str, Option<Measured>)> {
        let measured = self.probes.iter().map(|probe| {
            let value = match &probe.what {
                What::Extent(range, share) => extent(particles, range.clone(), *share),
                What::Point(position) => self.around(particles, *position),
                What::Particle(found) => found
                    .as_ref()
                    .filter(|(p, _)| particles.volume[*p] > 0.0)
                    .map(|(p, material)| material_point(particles, *p, material)),
                What::Deviation {
                    particles: chosen,
                    position,
                } => deviation(particles, chosen, |x| position.at(x, time)),
            };
            (probe.name.as_str(), value)
        });
        measured.collect()
    }

    fn around<T: Copy + Into<f64>>(
        &self,
        particles: &ParticleArrays<'_, T>,
        center: [f64; 3],
    ) -> Option<Measured> {
        let (mut mass, mut momentum, mut count) = (0.0, [0.0; 3], 0);
        let mut first = 0;
        for &(end, density) in &self.density {
            for p in first..end {
                let near = distance_squared(wide(particles.position[p]), center)
                    <= self.radius * self.radius;
                if !near || particles.volume[p] <= 0.0 {
                    continue;
                }
                let m = density * particles.volume[p];
                let v = wide(particles.velocity[p]);
                mass += m;
                momentum = std::array::from_fn(|a| momentum[a] + m * v[a]);
                count += 1;
            }
            first = end;
        }
        (count > 0).then(|| Measured::Point {
            velocity: momentum.map(|p| p / mass),
            density: mass / (4.0 / 3.0 * PI * self.radius.powi(3)),
            particles: count,
        })
    }
}

/// Particles of an object; none for a number that is not in the scene.
fn particles_of(scene: &Scene, object: usize) -> std::ops::Range<usize> {
    scene
        .objects
        .get(object)
        .map_or(0..0, |o| o.particles.clone())
}

fn wide<T: Copy + Into<f64>>(v: [T; 3]) -> [f64; 3] {
    v.map(Into::into)
}

fn distance_squared(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
}

fn material_point<T: Copy + Into<f64>>(
    particles: &ParticleArrays<'_, T>,
    p: usize,
    material: &Material,
) -> Measured {
    let state = Trial {
        f: Mat3(particles.elastic[p].map(wide)),
        memory: particles.memory[p].into(),
        gradient: Mat3(particles.affine[p].map(wide)),
        dt: 0.0,
    };
    let response = material.law.respond(&state, &Coefficients::new(material));
    let [xx, xy, xz, yy, yz, zz] = response.tau.map(|tau| tau / response.j);
    Measured::MaterialPoint {
        position: wide(particles.position[p]),
        velocity: wide(particles.velocity[p]),
        deformation: particles.deformation[p].map(wide),
        stress: [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]],
    }
}

fn deviation<T: Copy + Into<f64>>(
    particles: &ParticleArrays<'_, T>,
    chosen: &[(usize, [f64; 3])],
    expected: impl Fn([f64; 3]) -> [f64; 3],
) -> Option<Measured> {
    let (mut sum, mut largest, mut count) = (0.0, 0.0, 0);
    for &(p, rest) in chosen.iter().filter(|(p, _)| particles.volume[*p] > 0.0) {
        let squared = distance_squared(wide(particles.position[p]), expected(rest));
        sum += squared;
        // NaN stays.
        largest = if squared > largest || squared.is_nan() {
            squared
        } else {
            largest
        };
        count += 1;
    }
    (count > 0).then(|| Measured::Deviation {
        rms: (sum / count as f64).sqrt(),
        largest: largest.sqrt(),
        particles: count,
    })
}

fn extent<T: Copy + Into<f64>>(
    particles: &ParticleArrays<'_, T>,
    range: std::ops::Range<usize>,
    share: f64,
) -> Option<Measured> {
    let present = range.filter(|&p| particles.volume[p] > 0.0);
    let mut places: Vec<([f64; 3], f64)> = present
        .map(|p| (wide(particles.position[p]), particles.volume[p]))
        .collect();
    let beyond = (1.0 - share) * places.iter().map(|p| p.1).sum::<f64>();
    let (mut min, mut max) = (places.first()?.0, places.first()?.0);
    for a in 0..3 {
        if beyond > 0.0 {
            places.sort_unstable_by(|p, q| p.0[a].total_cmp(&q.0[a]).then(p.1.total_cmp(&q.1)));
            min[a] = first_within(places.iter(), beyond, a)?;
            max[a] = first_within(places.iter().rev(), beyond, a)?;
            continue;
        }
        for (x, _) in &places {
            (min[a], max[a]) = (min[a].min(x[a]), max[a].max(x[a]));
        }
    }
    Some(Measured::Extent { min, max })
}

/// Coordinate of the first of places in their order that more than a volume `beyond` lies up to.
fn first_within<'a>(
    mut places: impl Iterator<Item = &'a ([f64; 3], f64)>,
    mut beyond: f64,
    axis: usize,
) -> Option<f64> {
    let within = |(_, volume): &&([f64; 3], f64)| {
        beyond -= volume;
        beyond < 0.0
    };
    places.find(within).map(|(x, _)| x[axis])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        expression::Expression,
        materials::Law,
        scene::{Aabb, Probe, TurnedBox},
        test_scenes::{add_box, elastic, empty},
    };

    /// A box of 8^3 particles about the origin, and probes of every kind.
    fn scene() -> Scene {
        let mut scene = empty(0.1);
        let mut material = elastic(Law::NeoHookean, 1e5, 0.3);
        material.density = 500.0;
        add_box(&mut scene, material, [-0.2; 3], 0.05, [8; 3]);
        let field = |texts: [&str; 3]| {
            VectorField::new(texts.map(|text| Expression::parse(text).expect("a formula")))
        };
        let extent = |share| ProbeKind::Extent { object: 0, share };
        let deviation = |texts, bounds: Option<Aabb>| ProbeKind::Deviation {
            object: 0,
            position: field(texts),
            bounds: bounds.map(TurnedBox::from),
        };
        let half = Aabb {
            min: [0.0, -1.0, -1.0],
            max: [1.0; 3],
        };
        let corner = ProbeKind::MaterialPoint {
            object: 0,
            position: [1.0; 3],
        };
        let probes = [
            ("size", extent(1.0)),
            ("most", extent(0.8)),
            ("inside", ProbeKind::Point { position: [0.0; 3] }),
            ("nowhere", ProbeKind::Point { position: [5.0; 3] }),
            ("corner", corner),
            ("moved", deviation(["X + 0.03*t", "Y", "Z - 0.04*t"], None)),
            ("half", deviation(["X", "Y", "Z"], Some(half))),
        ];
        scene.probes = probes
            .map(|(name, kind)| Probe {
                name: name.into(),
                kind,
            })
            .into();
        scene
    }

    #[test]
    fn probes_measure_what_they_say() {
        let scene = scene();
        let count = scene.particles.position.len();
        let particles = ParticleArrays {
            volume: &scene.particles.volume,
            position: &scene.particles.position,
            velocity: &vec![[1.0, 2.0, 3.0]; count],
            affine: &vec![[[0.0; 3]; 3]; count],
            deformation: &vec![[[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]; count],
            elastic: &vec![[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]; count],
            memory: &vec![0.0; count],
        };
        let probes = Probes::new(&scene);
        let values = probes.measure(&particles, 2.0);
        let names: Vec<&str> = values.iter().map(|v| v.0).collect();
        assert_eq!(
            names,
            [
                "size", "most", "inside", "nowhere", "corner", "moved", "half"
            ]
        );
        // Particles sit half a spacing (0.025 m) inside the faces.
        let Some(Measured::Extent { min, max }) = values[0].1 else {
            panic!("{values:?}")
        };
        for a in 0..3 {
            assert!((min[a] + 0.175).abs() < 1e-12 && (max[a] - 0.175).abs() < 1e-12);
        }
        // A fifth is beyond each face: one of the eight layers and a part of the next.
        let Some(Measured::Extent { min, max }) = values[1].1 else {
            panic!("{values:?}")
        };
        for a in 0..3 {
            assert!((min[a] + 0.125).abs() < 1e-12 && (max[a] - 0.125).abs() < 1e-12);
        }
        let Some(Measured::Point {
            velocity, density, ..
        }) = values[2].1
        else {
            panic!("{values:?}")
        };
        // The mean of equal values, and the density up to the surface error of a ball of some 33 particles.
        assert!((velocity[2] - 3.0).abs() < 1e-12);
        assert!((density / 500.0 - 1.0).abs() < 0.2, "{density}");
        assert_eq!(values[3].1, None);
        let Some(Measured::MaterialPoint {
            position,
            deformation,
            stress,
            ..
        }) = values[4].1
        else {
            panic!("{values:?}")
        };
        assert!(
            position.iter().all(|x| (x - 0.175).abs() < 1e-12),
            "{position:?}"
        );
        assert_eq!(deformation[0][0], 2.0);
        // The elastic part is undeformed.
        assert_eq!(stress, [[0.0; 3]; 3]);
        // After 2 s 0.06 m and 0.08 m aside.
        let Some(Measured::Deviation { rms, largest, .. }) = values[5].1 else {
            panic!("{values:?}")
        };
        assert!((rms - 0.1).abs() < 1e-12 && (largest - 0.1).abs() < 1e-12);
        let expected = Measured::Deviation {
            rms: 0.0,
            largest: 0.0,
            particles: count / 2,
        };
        assert_eq!(values[6].1, Some(expected));
    }
}
