//! Draws what cannot be seen in a scene as Gaussians: boxes, pinned regions, domain, colliders.

use cosplat_sim_core::scene::{Aabb, ColliderShape, Pose, Scene};
use glam::{DQuat, DVec3};

use crate::{
    assets::{Gaussians, SH_C0},
    bounds::bounds_of,
    scene_file::append,
};

/// Strokes per line.
const STROKES: usize = 24;
/// Discs along one side of a collider's patch.
const PATCH: usize = 24;
/// Colours of object boxes, in turn: easy to tell apart, also for the colour-blind.
const PALETTE: [[f32; 3]; 6] = [
    [0.90, 0.62, 0.00],
    [0.34, 0.71, 0.91],
    [0.00, 0.62, 0.45],
    [0.94, 0.89, 0.26],
    [0.80, 0.47, 0.65],
    [0.00, 0.45, 0.70],
];
const DOMAIN: [f32; 3] = [0.6, 0.6, 0.6];
const PINNED: [f32; 3] = [0.9, 0.1, 0.1];
const COLLIDER: [f32; 3] = [0.3, 0.5, 0.9];

/// The scene's Gaussians, and its invisible parts as coloured ones: a box around each object, in turn orange,
/// light blue, green, yellow, pink, blue; pinned regions red; the domain grey; half-spaces as bluish patches with
/// their normal, other colliders as bluish boxes around them.
pub fn diagram(scene: &Scene) -> Gaussians {
    let mut pen = Pen {
        out: scene.gaussians.clone(),
    };
    let mut everything = Vec::new();
    for (i, object) in scene.objects.iter().enumerate() {
        let centers = &scene.gaussians.position[object.gaussians.clone()];
        let particles = &scene.particles.position[object.particles.clone()];
        let points = centers.iter().map(|p| p.map(f64::from));
        if let Some(b) = bounds_of(points.chain(particles.iter().copied())) {
            pen.frame(&b, PALETTE[i % PALETTE.len()]);
            everything.extend([b.min, b.max]);
        }
    }
    for region in &scene.pinned_regions {
        let (pose, around) = (region.bounds.pose(), region.bounds.around());
        pen.frame_at(&pose, &region.bounds.bounds, PINNED);
        everything.extend([around.min, around.max]);
    }
    pen.frame(&scene.domain, DOMAIN);
    let Some(seen) = bounds_of(everything.into_iter()) else {
        return pen.out;
    };
    for collider in &scene.colliders {
        let pose = &collider.pose;
        match local_box(&collider.shape) {
            Ok(b) => pen.frame_at(pose, &b, COLLIDER),
            Err(normal) => pen.half_space(pose.translation.into(), normal.into(), &seen),
        }
    }
    pen.out
}

/// Box of a shape in its own frame, or the normal of a half-space.
fn local_box(shape: &ColliderShape) -> Result<Aabb, [f64; 3]> {
    let half = match shape {
        ColliderShape::HalfSpace { normal } => return Err(*normal),
        ColliderShape::Box { half_extents } => *half_extents,
        ColliderShape::Sphere { radius } => [*radius; 3],
        ColliderShape::Cylinder {
            radius,
            half_height,
        } => [*radius, *half_height, *radius],
        ColliderShape::Capsule {
            radius,
            half_height,
        } => [*radius, half_height + radius, *radius],
        ColliderShape::Mesh(mesh) => {
            let points = bounds_of(mesh.points.iter().copied());
            return Ok(points.unwrap_or(Aabb {
                min: [0.0; 3],
                max: [0.0; 3],
            }));
        }
    };
    Ok(Aabb {
        min: half.map(|h| -h),
        max: half,
    })
}

struct Pen {
    out: Gaussians,
}

impl Pen {
    fn push(&mut self, center: DVec3, sigma: [f64; 3], rotation: DQuat, rgb: [f32; 3], alpha: f32) {
        append(
            &mut self.out,
            &Gaussians {
                position: vec![center.as_vec3().to_array()],
                scale: vec![sigma.map(|s| s as f32)],
                rotation: vec![rotation.normalize().as_quat().to_array()],
                opacity: vec![alpha],
                sh: rgb.map(|c| (c - 0.5) / SH_C0).to_vec(),
                sh_degree: 0,
                feature: Vec::new(),
                feature_dim: 0,
            },
        );
    }

    fn line(&mut self, from: DVec3, to: DVec3, width: f64, rgb: [f32; 3]) {
        let Some(direction) = (to - from).try_normalize() else {
            return;
        };
        let rotation = DQuat::from_rotation_arc(DVec3::X, direction);
        let step = from.distance(to) / STROKES as f64;
        for i in 0..STROKES {
            let center = from.lerp(to, (i as f64 + 0.5) / STROKES as f64);
            self.push(center, [0.6 * step, width, width], rotation, rgb, 0.95);
        }
    }

    fn frame(&mut self, b: &Aabb, rgb: [f32; 3]) {
        self.frame_at(&Pose::IDENTITY, b, rgb);
    }

    fn frame_at(&mut self, pose: &Pose, b: &Aabb, rgb: [f32; 3]) {
        let (min, max) = (DVec3::from(b.min), DVec3::from(b.max));
        let width = 0.002 * min.distance(max);
        let corner = |i: usize| {
            let pick = |a: usize| if i >> a & 1 == 0 { min[a] } else { max[a] };
            DVec3::from(pose.point([pick(0), pick(1), pick(2)]))
        };
        for i in 0..8usize {
            for a in 0..3 {
                if i >> a & 1 == 0 {
                    self.line(corner(i), corner(i | 1 << a), width, rgb);
                }
            }
        }
    }

    /// A patch under everything seen, and the normal in its middle.
    fn half_space(&mut self, point: DVec3, normal: DVec3, seen: &Aabb) {
        let (min, max) = (DVec3::from(seen.min), DVec3::from(seen.max));
        let center = (min + max) * 0.5;
        let foot = center - normal * (center - point).dot(normal);
        let side = 1.2 * min.distance(max);
        let rotation = DQuat::from_rotation_arc(DVec3::Z, normal);
        let step = side / PATCH as f64;
        for i in 0..PATCH * PATCH {
            let at = |k: usize| (k as f64 + 0.5) * step - 0.5 * side;
            let offset = rotation * DVec3::new(at(i % PATCH), at(i / PATCH), 0.0);
            let sigma = [0.6 * step, 0.6 * step, 0.01 * step];
            self.push(foot + offset, sigma, rotation, COLLIDER, 0.25);
        }
        self.line(foot, foot + normal * 0.2 * side, 0.003 * side, COLLIDER);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::{SceneFile, build};

    #[test]
    fn boxes_and_colliders_become_gaussians_in_their_place() {
        let text = r#"version = 1
[[objects]]
name = "ball"
builtin = "vase"
fidelity = "static"
[[colliders]]
name = "floor"
normal = [0, 1, 0]
[domain]
min = [-1, -1, -1]
max = [1, 2, 1]
[[pinned_regions]]
min = [-0.1, -0.1, -0.1]
max = [0.1, 0, 0.1]
"#;
        let file = SceneFile::parse(text).expect("valid");
        let (scene, _) = build(&file, &mut |_| unreachable!("no files")).expect("builds");
        let drawn = diagram(&scene);
        let lines = 3 * 12 + 1;
        let count = scene.gaussians.len() + lines * STROKES + PATCH * PATCH;
        assert_eq!(drawn.len(), count);
        assert_eq!(drawn.sh.len(), drawn.len() * drawn.sh_stride());
        let added = &drawn.position[scene.gaussians.len()..];
        let b = bounds_of(added.iter().map(|p| p.map(f64::from))).expect("lines");
        for a in 0..3 {
            assert!((b.min[a] - scene.domain.min[a]).abs() < 1e-6);
            assert!((b.max[a] - scene.domain.max[a]).abs() < 1e-6);
        }
        let flat =
            |i: &usize| drawn.scale[*i][2] < 0.1 * drawn.scale[*i][0] && drawn.opacity[*i] < 0.5;
        let patch: Vec<usize> = (scene.gaussians.len()..drawn.len()).filter(flat).collect();
        assert_eq!(patch.len(), PATCH * PATCH);
        assert!(patch.iter().all(|&i| drawn.position[i][1].abs() < 1e-6));
    }
}
