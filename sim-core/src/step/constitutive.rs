//! Constitutive phase: return mapping and stress, two groups at a time to hide the latency of the law.

use crate::{
    mat3::Mat3,
    materials::{Coefficients, Law, Trial},
    num::Real,
    particles::Motion,
    simd::{F32x16, Lanes, Pair, Portable},
};

#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};

/// Law and numbers of one part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PartLaw {
    /// Constitutive law.
    pub law: Law,
    /// Its numbers.
    pub coefficients: Coefficients<f64>,
    /// `rho0 dx^2` [kg/m], see [`stress_scale`](Self::stress_scale); infinite where stress does nothing.
    pub inertia: f64,
    /// One over the mass that fills a cell at rest, in the solver's unit.
    pub cells_per_rest_mass: f64,
    /// Whether Gaussians follow the deformation, which a fluid need not know otherwise.
    pub visible: bool,
}

impl PartLaw {
    /// `4 kick / (rho0 dx^2)` of a substep in which forces act for `kick` [s]: Kirchhoff stress [Pa] to affine velocity
    /// [1/s].
    pub fn stress_scale(&self, kick: f64) -> f32 {
        (4.0 * kick / self.inertia) as f32
    }
}

/// What a law reads of two groups.
pub(crate) struct Deformed<'a> {
    /// Trial deformation gradients, row-major.
    pub f: [&'a [F32x16; 9]; 2],
    /// The law's own numbers before the substep.
    pub memory: [&'a F32x16; 2],
    /// Velocities.
    pub motion: &'a [Motion; 2],
    /// Substep of each lane [s], 0 where there is no particle.
    pub dt: [F32x16; 2],
    /// See [`PartLaw::stress_scale`].
    pub stress_scale: f32,
}

/// What a law makes of two groups.
pub(crate) struct Answer {
    /// `A = C - 4 kick / (rho0 dx^2) tau`: what particles carry to the grid besides velocity (MLS-MPM, Hu et al.
    /// 2018).
    pub affine: [[F32x16; 9]; 2],
    /// Elastic deformation gradients; left alone by laws that are not plastic.
    pub f: [[F32x16; 9]; 2],
    /// The law's own numbers; left alone by laws that remember nothing.
    pub memory: [F32x16; 2],
    /// Bound of the largest squared principal stretch.
    pub stretch_squared: [F32x16; 2],
    /// Volume ratio.
    pub j: [F32x16; 2],
    /// Hardening.
    pub stiffness: [F32x16; 2],
}

impl Answer {
    /// To be overwritten.
    pub const EMPTY: Self = {
        const O: F32x16 = F32x16::ZERO;
        Self {
            affine: [[O; 9]; 2],
            f: [[O; 9]; 2],
            memory: [O; 2],
            stretch_squared: [O; 2],
            j: [O; 2],
            stiffness: [O; 2],
        }
    };
}

/// Lanes on which laws run, each compiled once per instruction set and not once per stage of a pass.
pub(crate) trait Constitutive: Lanes {
    /// Return mapping and stress of two groups.
    fn respond(law: &PartLaw, of: &Deformed<'_>, answer: &mut Answer);
}

#[cfg(target_arch = "x86_64")]
impl Constitutive for Avx512 {
    #[inline(always)]
    fn respond(law: &PartLaw, of: &Deformed<'_>, answer: &mut Answer) {
        #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,fma")]
        #[inline(never)]
        fn with_features(law: &PartLaw, of: &Deformed<'_>, answer: &mut Answer) {
            respond::<Avx512>(law, of, answer);
        }
        // SAFETY: this type is only named under entry points that checked for the instruction set.
        unsafe { with_features(law, of, answer) }
    }
}

#[cfg(target_arch = "x86_64")]
impl Constitutive for Avx2 {
    #[inline(always)]
    fn respond(law: &PartLaw, of: &Deformed<'_>, answer: &mut Answer) {
        #[target_feature(enable = "avx2,fma")]
        #[inline(never)]
        fn with_features(law: &PartLaw, of: &Deformed<'_>, answer: &mut Answer) {
            respond::<Avx2>(law, of, answer);
        }
        // SAFETY: this type is only named under entry points that checked for the instruction set.
        unsafe { with_features(law, of, answer) }
    }
}

impl Constitutive for Portable {
    #[inline(never)]
    fn respond(law: &PartLaw, of: &Deformed<'_>, answer: &mut Answer) {
        respond::<Self>(law, of, answer);
    }
}

#[inline(always)]
fn pair<V: Lanes>(one: &F32x16, two: &F32x16) -> Pair<V> {
    Pair(V::load(one), V::load(two))
}

#[inline(always)]
fn put<V: Lanes>(value: Pair<V>, to: &mut [F32x16; 2]) {
    let Pair(one, two) = value;
    one.store(&mut to[0]);
    two.store(&mut to[1]);
}

#[inline(always)]
fn respond<V: Lanes>(law: &PartLaw, of: &Deformed<'_>, answer: &mut Answer) {
    let zero = Pair(V::broadcast(0.0), V::broadcast(0.0));
    let (mut f, mut gradient) = (Mat3([[zero; 3]; 3]), Mat3([[zero; 3]; 3]));
    let fluid = law.law.is_fluid();
    for i in 0..3 {
        for j in 0..3 {
            let n = 3 * i + j;
            // Each law loads what it reads: the rest would wait for memory, or in vain on the stack.
            if fluid {
                gradient.0[i][j] = pair(&of.motion[0].c[n], &of.motion[1].c[n]);
            } else {
                f.0[i][j] = pair(&of.f[0][n], &of.f[1][n]);
            }
        }
    }
    let trial = Trial {
        f,
        memory: pair(of.memory[0], of.memory[1]),
        gradient,
        dt: pair(&of.dt[0], &of.dt[1]),
    };
    let response = law.law.respond(&trial, &law.coefficients.splat());
    let t = response.tau;
    let t = [t[0], t[1], t[2], t[1], t[3], t[4], t[2], t[4], t[5]];
    let scale = Pair(
        V::broadcast(-of.stress_scale),
        V::broadcast(-of.stress_scale),
    );
    for n in 0..9 {
        let c = pair(&of.motion[0].c[n], &of.motion[1].c[n]);
        let Pair(one, two) = scale.mul_add(t[n], c);
        one.store(&mut answer.affine[0][n]);
        two.store(&mut answer.affine[1][n]);
    }
    if law.law.is_plastic() {
        for n in 0..9 {
            let Pair(one, two) = response.f.0[n / 3][n % 3];
            one.store(&mut answer.f[0][n]);
            two.store(&mut answer.f[1][n]);
        }
    }
    if law.law.is_plastic() || law.law.is_fluid() {
        put(response.memory, &mut answer.memory);
    }
    put(response.stretch_squared, &mut answer.stretch_squared);
    put(response.j, &mut answer.j);
    put(response.stiffness, &mut answer.stiffness);
}
