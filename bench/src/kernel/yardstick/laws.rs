//! Constitutive laws of the yardstick, one particle at a time.

use super::linear::{
    IDENTITY, Matrix, Symmetric, add_product, cofactor, determinant, eigen, product, spectral,
    symmetric_product,
};

/// Steps of the polar decomposition at most.
const POLAR_STEPS: usize = 12;

/// A law with its parameters.
pub trait Law: Copy {
    /// What it remembers of a particle.
    type State: Copy;
    /// At rest.
    const REST: Self::State;
    /// Deforms with the velocity gradient `c` [1/s] for `dt` [s].
    fn deform(state: &mut Self::State, c: &Matrix, dt: f32);
    /// Return mapping; the Kirchhoff stress [Pa]. `c` is the velocity gradient [1/s].
    fn respond(&self, state: &mut Self::State, c: &Matrix) -> Symmetric;
}

/// `F <- (I + A) F` with `A = dt C`.
#[inline(always)]
fn flow(f: &mut Matrix, c: &Matrix, dt: f32) {
    let growth = product(c, f);
    for n in 0..9 {
        f[n] = dt.mul_add(growth[n], f[n]);
    }
}

/// `s t + p I`.
#[inline(always)]
fn scaled_plus(t: &Symmetric, s: f32, p: f32) -> Symmetric {
    [
        s.mul_add(t[0], p),
        s * t[1],
        s * t[2],
        s.mul_add(t[3], p),
        s * t[4],
        s.mul_add(t[5], p),
    ]
}

/// Fixed corotated elasticity.
#[derive(Clone, Copy, Debug)]
pub struct FixedCorotated {
    /// Lamé's first parameter [Pa].
    pub lambda: f32,
    /// Shear modulus [Pa].
    pub mu: f32,
}

impl Law for FixedCorotated {
    type State = Matrix;
    const REST: Matrix = IDENTITY;

    #[inline(always)]
    fn deform(state: &mut Matrix, c: &Matrix, dt: f32) {
        flow(state, c, dt);
    }

    #[inline(always)]
    fn respond(&self, state: &mut Matrix, _c: &Matrix) -> Symmetric {
        let f = *state;
        let mut minors = cofactor(&f);
        let j = determinant(&f, &minors);
        // Newton's iteration for the rotation, three steps near rest.
        let (mut r, mut det) = (f, j);
        for _ in 0..POLAR_STEPS {
            let scale = 0.5 / det;
            let mut change = 0.0;
            for n in 0..9 {
                let next = 0.5f32.mul_add(r[n], scale * minors[n]);
                change += (next - r[n]) * (next - r[n]);
                r[n] = next;
            }
            // The error after this step is about the square of the step.
            if change < 1e-6 {
                break;
            }
            minors = cofactor(&r);
            det = determinant(&r, &minors);
        }
        let e = add_product(&f, -1.0, &r);
        let t = symmetric_product(&e, &f);
        scaled_plus(&t, 2.0 * self.mu, self.lambda * (j - 1.0) * j)
    }
}

/// Neo-Hookean elasticity.
#[derive(Clone, Copy, Debug)]
pub struct NeoHookean {
    /// Lamé's first parameter [Pa].
    pub lambda: f32,
    /// Shear modulus [Pa].
    pub mu: f32,
}

impl Law for NeoHookean {
    type State = Matrix;
    const REST: Matrix = IDENTITY;

    #[inline(always)]
    fn deform(state: &mut Matrix, c: &Matrix, dt: f32) {
        flow(state, c, dt);
    }

    #[inline(always)]
    fn respond(&self, state: &mut Matrix, _c: &Matrix) -> Symmetric {
        let f = *state;
        let j = determinant(&f, &cofactor(&f));
        let b = symmetric_product(&f, &f);
        scaled_plus(&b, self.mu, self.lambda * j.ln() - self.mu)
    }
}

/// Snow after Stomakhin et al. 2013.
#[derive(Clone, Copy, Debug)]
pub struct Snow {
    /// Lamé's first parameter [Pa].
    pub lambda: f32,
    /// Shear modulus [Pa].
    pub mu: f32,
    /// Smallest and largest principal elastic stretch.
    pub stretch: [f32; 2],
    /// Hardening exponent.
    pub hardening: f32,
}

impl Law for Snow {
    type State = (Matrix, f32);
    const REST: Self::State = (IDENTITY, 1.0);

    #[inline(always)]
    fn deform((f, _): &mut Self::State, c: &Matrix, dt: f32) {
        flow(f, c, dt);
    }

    #[inline(always)]
    fn respond(&self, (f, plastic_j): &mut Self::State, _c: &Matrix) -> Symmetric {
        let trial = *f;
        let (squares, u) = eigen(&symmetric_product(&trial, &trial));
        let [low, high] = self.stretch;
        let mut sigma = [0.0; 3];
        let mut change = [0.0; 3];
        for n in 0..3 {
            let s = squares[n].sqrt();
            sigma[n] = s.max(low).min(high);
            change[n] = sigma[n] / s;
        }
        if change != [1.0; 3] {
            map_back(f, &u, change);
            *plastic_j /= change[0] * change[1] * change[2];
        }
        let hardening = (self.hardening * (1.0 - *plastic_j)).exp();
        let j = sigma[0] * sigma[1] * sigma[2];
        let pressure = self.lambda * (j - 1.0) * j;
        let two_mu = 2.0 * self.mu;
        let mut t = [0.0; 3];
        for n in 0..3 {
            t[n] = hardening * (two_mu * (sigma[n] - 1.0)).mul_add(sigma[n], pressure);
        }
        spectral(&u, t)
    }
}

/// `F <- U diag(change) U^T F`: the return mapping of an isotropic law.
#[inline(always)]
fn map_back(f: &mut Matrix, u: &Matrix, change: [f32; 3]) {
    let t = spectral(u, change);
    *f = product(&[t[0], t[1], t[2], t[1], t[3], t[4], t[2], t[4], t[5]], f);
}

/// Hencky strain: its trace, its deviator's principal values, their norm, and the principal directions.
#[inline(always)]
fn hencky(f: &Matrix) -> (f32, [f32; 3], f32, Matrix) {
    let (squares, u) = eigen(&symmetric_product(f, f));
    let mut dev = squares.map(|s| 0.5 * s.ln());
    let trace = dev[0] + dev[1] + dev[2];
    for e in &mut dev {
        *e -= trace / 3.0;
    }
    let norm = (dev[0] * dev[0] + dev[1] * dev[1] + dev[2] * dev[2]).sqrt();
    (trace, dev, norm, u)
}

/// Metal: Hencky elasticity, von Mises yield, linear hardening.
#[derive(Clone, Copy, Debug)]
pub struct VonMises {
    /// Lamé's first parameter [Pa].
    pub lambda: f32,
    /// Shear modulus [Pa].
    pub mu: f32,
    /// Yield stress in a tension test [Pa].
    pub yield_stress: f32,
    /// Its growth per equivalent plastic strain [Pa].
    pub hardening: f32,
}

/// `sqrt(2/3)`: from `|dev|` to the equivalent of a tension test.
const EQUIVALENT: f32 = 0.816_496_6;

impl Law for VonMises {
    type State = (Matrix, f32);
    const REST: Self::State = (IDENTITY, 0.0);

    #[inline(always)]
    fn deform((f, _): &mut Self::State, c: &Matrix, dt: f32) {
        flow(f, c, dt);
    }

    #[inline(always)]
    fn respond(&self, (f, plastic): &mut Self::State, _c: &Matrix) -> Symmetric {
        let (trace, mut dev, norm, u) = hencky(f);
        let two_mu = 2.0 * self.mu;
        let limit = EQUIVALENT * self.hardening.mul_add(*plastic, self.yield_stress) / two_mu;
        if norm > limit {
            let amount = (norm - limit) / (1.0 + self.hardening / (3.0 * self.mu));
            let share = -amount / norm;
            map_back(f, &u, dev.map(|e| (share * e).exp()));
            dev = dev.map(|e| e + share * e);
            *plastic += EQUIVALENT * amount;
        }
        let mean = (self.lambda + two_mu / 3.0) * trace;
        spectral(&u, dev.map(|e| two_mu.mul_add(e, mean)))
    }
}

/// Dry sand: Hencky elasticity, Drucker-Prager yield, volume correction.
#[derive(Clone, Copy, Debug)]
pub struct Sand {
    /// Lamé's first parameter [Pa].
    pub lambda: f32,
    /// Shear modulus [Pa].
    pub mu: f32,
    /// Slope of the cone: largest `|dev eps|` per `-tr eps`.
    pub slope: f32,
}

impl Law for Sand {
    type State = (Matrix, f32);
    const REST: Self::State = (IDENTITY, 0.0);

    #[inline(always)]
    fn deform((f, _): &mut Self::State, c: &Matrix, dt: f32) {
        flow(f, c, dt);
    }

    #[inline(always)]
    fn respond(&self, (f, gain): &mut Self::State, _c: &Matrix) -> Symmetric {
        let (before, mut dev, norm, u) = hencky(f);
        // Volume gained while the grains were apart is given back first.
        let trace = before + *gain;
        if trace > 0.0 {
            map_back(f, &u, dev.map(|e| (-e - before / 3.0).exp()));
            *gain = trace.min(1.0);
            return [0.0; 6];
        }
        let limit = -self.slope * trace;
        let share = if norm > limit { limit / norm } else { 1.0 };
        if norm > limit || *gain > 0.0 {
            let grown = *gain / 3.0;
            map_back(f, &u, dev.map(|e| (share - 1.0).mul_add(e, grown).exp()));
            dev = dev.map(|e| share * e);
            *gain = 0.0;
        }
        let two_mu = 2.0 * self.mu;
        let mean = (self.lambda + two_mu / 3.0) * trace;
        spectral(&u, dev.map(|e| two_mu.mul_add(e, mean)))
    }
}

/// Weakly compressible fluid: Tait's equation with exponent 7 and Newtonian viscosity; remembers `J - 1`.
#[derive(Clone, Copy, Debug)]
pub struct Fluid {
    /// A seventh of the bulk modulus [Pa].
    pub modulus: f32,
    /// Viscosity [Pa s].
    pub viscosity: f32,
}

impl Law for Fluid {
    type State = f32;
    const REST: f32 = 0.0;

    #[inline(always)]
    fn deform(state: &mut f32, c: &Matrix, dt: f32) {
        let mut a = *c;
        for n in 0..9 {
            a[n] *= dt;
        }
        let minors = cofactor(&a);
        // det(I + A) - 1
        let growth =
            a[0] + a[4] + a[8] + (minors[0] + minors[4] + minors[8]) + determinant(&a, &minors);
        *state = (1.0 + *state).mul_add(growth, *state).clamp(-0.75, 1.0);
    }

    #[inline(always)]
    fn respond(&self, state: &mut f32, c: &Matrix) -> Symmetric {
        let j = 1.0 + *state;
        let mut pressure = 0.0;
        if j < 1.0 {
            let cube = j * j * j;
            pressure = self.modulus * (1.0 / (cube * cube) - j);
        }
        let eta = self.viscosity * j;
        let mean = -pressure - 2.0 / 3.0 * eta * (c[0] + c[4] + c[8]);
        [
            (2.0 * eta).mul_add(c[0], mean),
            eta * (c[1] + c[3]),
            eta * (c[2] + c[6]),
            (2.0 * eta).mul_add(c[4], mean),
            eta * (c[5] + c[7]),
            (2.0 * eta).mul_add(c[8], mean),
        ]
    }
}
