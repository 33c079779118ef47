//! Sixteen Gaussians at a time: interpolation, polar rotation, covariance.

use super::{GaussianPose, MAX_ASPECT, limited, multiply, quaternion_from_matrix};
use crate::{
    mat3::Mat3,
    materials::polar::rotation,
    scene::BINDING_NEIGHBORS,
    simd::{F32x16, Isa, LANES, Lanes, on_isa},
};

/// Sixteen Gaussians at rest.
#[derive(Clone, Debug)]
pub(super) struct RestGroup {
    /// Centre relative to the anchor of its object [m].
    pub offset: [F32x16; 3],
    /// `R diag(scale)`, row-major: columns are the axes of the ellipsoid [m].
    pub axes: [F32x16; 9],
    /// Labels, as bits.
    pub labels: [F32x16; 3],
    /// Particles to follow.
    pub particle: [[u32; BINDING_NEIGHBORS]; LANES],
    /// And how much.
    pub weight: [[f32; BINDING_NEIGHBORS]; LANES],
    /// World-from-asset rotations of their objects, a position in [`Shared::placements`].
    pub placement: usize,
    /// One bit per lane that ever leaves its rest pose.
    pub moving: u32,
}

impl RestGroup {
    /// A group of nothing.
    pub const EMPTY: Self = Self {
        offset: [F32x16::ZERO; 3],
        axes: [F32x16::ZERO; 9],
        labels: [F32x16::ZERO; 3],
        particle: [[0; BINDING_NEIGHBORS]; LANES],
        weight: [[0.0; BINDING_NEIGHBORS]; LANES],
        placement: 0,
        moving: 0,
    };
}

/// What all groups of a frame read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shared<'a> {
    /// Particles' shares.
    pub carriers: &'a [F32x16],
    /// The particle that the first of them belongs to.
    pub first: u32,
    /// Rotations, xyzw.
    pub placements: &'a [[F32x16; 4]],
    /// Whether poses are written past the caches.
    pub streamed: bool,
}

/// Writes the poses of groups that follow one another; `rest` and `out` are of the same Gaussians.
pub(super) fn follow(
    isa: Isa,
    shared: &Shared<'_>,
    groups: &[RestGroup],
    rest: &[GaussianPose],
    out: &mut [GaussianPose],
) {
    let out = bytemuck::cast_slice_mut(out);
    all_with_isa(isa, shared, groups, rest, out)
}

on_isa! {
    fn all_with_isa = all(shared: &Shared<'_>, groups: &[RestGroup], rest: &[GaussianPose], out: &mut [F32x16])
}

/// Group by group; lanes whose deformation needs limiting, and those that stay at rest, are done one by one.
#[inline(always)]
fn all<V: Lanes>(
    shared: &Shared<'_>,
    groups: &[RestGroup],
    rest: &[GaussianPose],
    out: &mut [F32x16],
) {
    let places = rest.chunks(LANES).zip(out.chunks_mut(LANES));
    for (group, (rest, out)) in groups.iter().zip(places) {
        let mut rows = [F32x16::ZERO; LANES];
        if group.moving != 0 {
            let mut deformation = [F32x16::ZERO; LANES];
            let fine = kernel::<V>(group, shared, &mut deformation, &mut rows);
            let placement = &shared.placements[group.placement];
            for lane in 0..LANES {
                if (group.moving & !fine) >> lane & 1 == 1 {
                    limit(
                        group,
                        placement,
                        lane,
                        &deformation[lane].0,
                        &mut rows[lane],
                    );
                }
            }
        }
        if group.moving != u32::from(u16::MAX) {
            stay(group.moving, rest, &mut rows);
        }
        for (row, slot) in rows.iter().zip(out) {
            if shared.streamed {
                // SAFETY: the fence below comes before this function ends, and nothing reads `out` in it.
                unsafe { V::load(row).stream(slot) };
            } else {
                *slot = *row;
            }
        }
    }
    if shared.streamed {
        V::fence();
    }
}

/// Copies the poses of lanes that never leave them.
#[inline(never)]
fn stay(moving: u32, rest: &[GaussianPose], rows: &mut [F32x16; LANES]) {
    for (lane, pose) in rest.iter().enumerate() {
        if moving >> lane & 1 == 0 {
            rows[lane] = bytemuck::cast(*pose);
        }
    }
}

/// One row per Gaussian: what it gathered in `deformation` (`F` from the fourth float), its [`GaussianPose`] in `out`.
/// Returns one bit per lane whose shape follows `F` as it is.
#[inline(always)]
fn kernel<V: Lanes>(
    group: &RestGroup,
    shared: &Shared<'_>,
    deformation: &mut [F32x16; LANES],
    out: &mut [F32x16; LANES],
) -> u32 {
    let carriers = shared.carriers;
    for lane in 0..LANES {
        let mut sum = V::broadcast(0.0);
        for k in 0..BINDING_NEIGHBORS {
            // Lanes of other objects follow particles that are not here; nobody reads them.
            let particle = group.particle[lane][k].wrapping_sub(shared.first);
            let carrier = V::load(carriers.get(particle as usize).unwrap_or(&F32x16::ZERO));
            sum = carrier.mul_add(V::broadcast(group.weight[lane][k]), sum);
        }
        sum.store(&mut deformation[lane]);
    }
    let g = V::transpose(deformation);
    let f = Mat3([[g[3], g[4], g[5]], [g[6], g[7], g[8]], [g[9], g[10], g[11]]]);

    let offset = [
        V::load(&group.offset[0]),
        V::load(&group.offset[1]),
        V::load(&group.offset[2]),
    ];
    let moved = f.mul_vec(offset);

    let a = &group.axes;
    let axes = f.mul(&Mat3([
        [V::load(&a[0]), V::load(&a[1]), V::load(&a[2])],
        [V::load(&a[3]), V::load(&a[4]), V::load(&a[5])],
        [V::load(&a[6]), V::load(&a[7]), V::load(&a[8])],
    ]));
    let c = axes.mul_transposed_sym(&axes);

    let p = &shared.placements[group.placement];
    let placement = [
        V::load(&p[0]),
        V::load(&p[1]),
        V::load(&p[2]),
        V::load(&p[3]),
    ];
    let q = multiply(quaternion_from_matrix(&rotation(&f)), placement);

    // s1 s2 <= |F|^2 / 2 gives s3 >= 2 J / |F|^2, and s1 <= |F|: a cheap bound of s1 / s3, 2.6 at rest.
    let norm_squared = f.norm_squared();
    let bound = norm_squared * norm_squared.sqrt();
    let fine = bound.lt(f.det() * V::splat(2.0 * f64::from(MAX_ASPECT)));

    let labels = &group.labels;
    let columns = [
        g[0] + moved[0],
        g[1] + moved[1],
        g[2] + moved[2],
        V::load(&labels[0]),
        c[0],
        c[1],
        c[2],
        c[3],
        c[4],
        c[5],
        V::load(&labels[1]),
        V::load(&labels[2]),
        q[0],
        q[1],
        q[2],
        q[3],
    ];
    let mut stored = [F32x16::ZERO; LANES];
    for i in 0..LANES {
        columns[i].store(&mut stored[i]);
    }
    let rows = V::transpose(&stored);
    for i in 0..LANES {
        rows[i].store(&mut out[i]);
    }
    V::mask_bits(fine)
}

/// The rare case: strongly deformed, flat or inside out.
#[cold]
fn limit(
    group: &RestGroup,
    placement: &[F32x16; 4],
    lane: usize,
    gathered: &[f32; LANES],
    row: &mut F32x16,
) {
    let at = |v: &F32x16| v.0[lane];
    let f = Mat3([
        [gathered[3], gathered[4], gathered[5]],
        [gathered[6], gathered[7], gathered[8]],
        [gathered[9], gathered[10], gathered[11]],
    ]);
    let (r, shape) = limited(&f);
    let a = &group.axes;
    let axes = shape.mul(&Mat3([
        [at(&a[0]), at(&a[1]), at(&a[2])],
        [at(&a[3]), at(&a[4]), at(&a[5])],
        [at(&a[6]), at(&a[7]), at(&a[8])],
    ]));
    let p = placement;
    let placement = [at(&p[0]), at(&p[1]), at(&p[2]), at(&p[3])];
    let pose: &mut GaussianPose = bytemuck::cast_mut(row);
    pose.covariance = axes.mul_transposed_sym(&axes);
    pose.rotation = multiply(quaternion_from_matrix(&r), placement);
}
