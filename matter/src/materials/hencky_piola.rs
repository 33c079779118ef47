//! First Piola-Kirchhoff stress of laws on Hencky strain, with what a point remembers of its plastic flow: of metals, foam and
//! plasticine on grids of their own.
//!
//! The deformation gradient over rest positions is `F = F_e F_p`. A point remembers `F_p^-1` and the law's own number. With
//! `F_e = F F_p^-1` the return mapping is that of [`hencky`](super::hencky), and `P = tau F^-T`. The flow moves `F_e` to `F_e'`, and
//! `F_p^-1` to `F^-1 F_e'`.
//!
//! Below a principal stretch of [`LINEAR_STRETCH`] the logarithm goes on along its tangent, so that energy and stress are finite for
//! every finite `F`. Such points do not flow for good: their stress is that of the flow, which is the slope of an energy, but they
//! remember nothing of it. So `det F_p` never changes its sign.

use super::{
    Coefficients, Family, Law, Trial,
    hencky::{Mapped, deviator_squared, energy_of_strain, flow, logarithm, return_mapping, share},
    limits::max_stretch_squared_of,
    piola::{Piola, PiolaLaw, energy_of_gradient, first_piola},
    strain::Strain,
    svd::{Svd, svd},
};
use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// Principal stretch below which the logarithm goes on along its tangent.
pub const LINEAR_STRETCH: f64 = 0.3;
/// Mean of `F_e F_e^T - I` from which on the series is taken: stretches of moderate shape are above [`LINEAR_STRETCH`] then.
const CRUSHED: f64 = -0.8;

/// What a point of matter remembers.
#[derive(Clone, Copy, Debug)]
pub struct Point<R> {
    /// Inverse of the plastic deformation gradient less the identity, `F_p^-1 - I`.
    pub plastic: Mat3<R>,
    /// The law's one number, see its file.
    pub memory: R,
}

/// Deformation gradient `F = Q + h` over the axes `Q` of a grid; `None` where these are those of the world.
#[derive(Clone, Copy, Debug)]
pub struct Deformation<'a, R> {
    /// The axes as columns.
    pub axes: Option<&'a Mat3<R>>,
    /// Gradient of the displacement over them.
    pub h: Mat3<R>,
}

/// What a law makes of a deformation.
#[derive(Clone, Copy, Debug)]
pub struct Answer<R: Real> {
    /// Stress and tangent over `F`.
    pub piola: Piola<R>,
    /// What the point remembers from now on.
    pub point: Point<R>,
    /// Lanes in which that has changed.
    pub flows: R::Mask,
}

impl<R: Real> Answer<R> {
    /// Whether anything flows.
    #[inline(always)]
    pub fn any_flows(&self) -> bool {
        R::any(self.flows)
    }
}

impl<R: Real> Point<R> {
    /// What has never flowed.
    #[inline(always)]
    pub fn rest() -> Self {
        let zero = R::splat(0.0);
        Self {
            plastic: Mat3([[zero; 3]; 3]),
            memory: zero,
        }
    }

    #[inline(always)]
    fn select(mask: R::Mask, a: &Self, b: &Self) -> Self {
        Self {
            plastic: Mat3::select(mask, &a.plastic, &b.plastic),
            memory: R::select(mask, a.memory, b.memory),
        }
    }
}

/// The elastic part of a deformation.
struct Elastic<R> {
    /// `F`.
    f: Mat3<R>,
    /// `F_e = F F_p^-1`.
    elastic: Mat3<R>,
    /// `F_e - Q`.
    h: Mat3<R>,
    /// `F_e F_e^T - I`.
    x: Sym3<R>,
}

impl<R: Real> Elastic<R> {
    #[inline(always)]
    fn new(deformation: &Deformation<'_, R>, point: &Point<R>) -> Self {
        let one = R::splat(1.0);
        let identity = Mat3::identity();
        let axes = deformation.axes.unwrap_or(&identity);
        let f = deformation.h.blend(one, axes, one);
        let h = deformation.h.blend(one, &f.mul(&point.plastic), one);
        let turned = match deformation.axes {
            Some(axes) => h.mul_transposed(axes),
            None => h,
        };
        let p = h.mul_transposed_sym(&h);
        let [a, b, c] = turned.0;
        Self {
            f,
            elastic: h.blend(one, axes, one),
            h: turned,
            x: [
                p[0] + (a[0] + a[0]),
                p[1] + (a[1] + b[0]),
                p[2] + (a[2] + c[0]),
                p[3] + (b[1] + b[1]),
                p[4] + (b[2] + c[1]),
                p[5] + (c[2] + c[2]),
            ],
        }
    }

    /// Lanes whose stretches are above [`LINEAR_STRETCH`] if their shape is moderate.
    #[inline(always)]
    fn is_not_crushed(&self) -> R::Mask {
        let mean = (self.x[0] + (self.x[3] + self.x[5])) * R::splat(1.0 / 3.0);
        R::splat(CRUSHED).lt(mean)
    }
}

/// Stress, tangent and flow of a law at a deformation after `dt` [s]; laws without flow keep what the point remembers. The tangent is 0
/// where it is not asked for.
#[inline(always)]
pub fn respond<R: Real>(
    law: Law,
    deformation: &Deformation<'_, R>,
    point: &Point<R>,
    (dt, wants_tangent): (R, bool),
    k: &Coefficients<R>,
) -> Answer<R> {
    let at = Elastic::new(deformation, point);
    if let Family::Piola(law) = law.family() {
        return elastic(law, &at, point, k);
    }
    let one = R::splat(1.0);
    let trial = Trial {
        f: at.elastic,
        memory: point.memory,
        gradient: Mat3([[R::splat(0.0); 3]; 3]),
        dt,
    };
    let mapped = return_mapping(law, &at.x, &trial, k);
    let near = mapped.near & at.is_not_crushed();
    let cofactor = at.f.cofactor();
    let j = crate::mat3::dot(at.f.0[0], cofactor.0[0]);
    let inverse_transposed = scaled(&cofactor, one / j);
    let tau = mapped.kirchhoff_stress(k);
    let mut new = *point;
    if R::any(near & mapped.flow.flows) {
        let change = inverse_transposed
            .transpose()
            .mul(&mapped.change_of(&at.elastic));
        let changed = Point {
            plastic: point.plastic.blend(one, &change, one),
            memory: mapped.flow.memory,
        };
        new = Point::select(mapped.flow.flows, &changed, point);
    }
    let mut tangent = R::splat(0.0);
    if wants_tangent {
        tangent = near_tangent(&mapped, &tau, &inverse_transposed, k);
    }
    let mut answer = Answer {
        piola: Piola {
            stress: full(&tau).mul(&inverse_transposed),
            tangent,
            j,
        },
        point: new,
        flows: near & mapped.flow.flows,
    };
    // Written so that NaN counts as far.
    if R::any(!near) {
        let far = respond_by_svd(law, &at, &inverse_transposed, (point, dt), k);
        answer = Answer {
            piola: Piola {
                stress: Mat3::select(near, &answer.piola.stress, &far.piola.stress),
                tangent: R::select(near, answer.piola.tangent, far.piola.tangent),
                j,
            },
            point: Point::select(near, &answer.point, &far.point),
            flows: answer.flows | (far.flows & !near),
        };
    }
    answer
}

/// Bound of the tangent over `F` where the series are right.
#[inline(always)]
fn near_tangent<R: Real>(
    mapped: &Mapped<R>,
    tau: &Sym3<R>,
    inverse_transposed: &Mat3<R>,
    k: &Coefficients<R>,
) -> R {
    let squared = mapped.strain.deviator * mapped.strain.deviator;
    let turning = squared.mul_add(R::splat(2.0 / 3.0), R::splat(1.0));
    let shortest = inverse_transposed.mul_transposed_sym(inverse_transposed);
    (bound(k, tau, turning) * max_stretch_squared_of(&shortest)).max(at_rest(k))
}

/// An elastic law of matter that has flowed under another.
#[inline(always)]
fn elastic<R: Real>(
    law: PiolaLaw,
    at: &Elastic<R>,
    point: &Point<R>,
    k: &Coefficients<R>,
) -> Answer<R> {
    let one = R::splat(1.0);
    let piola = first_piola(law, &at.elastic, k.lambda, k.mu);
    let by_flow = piola.stress.mul_transposed(&point.plastic);
    Answer {
        piola: Piola {
            stress: piola.stress.blend(one, &by_flow, one),
            tangent: piola.tangent * shortened(point).max(one),
            j: piola.j,
        },
        point: *point,
        flows: one.lt(one),
    }
}

/// Largest eigenvalue of `F_p^-1 F_p^-T`, or an upper bound.
#[inline(always)]
fn shortened<R: Real>(point: &Point<R>) -> R {
    let one = R::splat(1.0);
    let plastic = point.plastic.blend(one, &Mat3::identity(), one);
    max_stretch_squared_of(&plastic.mul_transposed_sym(&plastic))
}

/// Principal strains, the slope of each over its stretch, and the lanes in which a stretch is below [`LINEAR_STRETCH`].
#[inline(always)]
fn principal_strains<R: Real>(sigma: [R; 3]) -> ([R; 3], [R; 3], R::Mask) {
    let least = R::splat(LINEAR_STRETCH);
    let (mut eps, mut slopes) = (sigma, sigma);
    let mut crushed = sigma[0].lt(least);
    for n in 0..3 {
        crushed = crushed | sigma[n].lt(least);
        let at = sigma[n].max(least);
        slopes[n] = R::splat(1.0) / at;
        eps[n] = (sigma[n].min(least) - least).mul_add(slopes[n], at.ln());
    }
    (eps, slopes, crushed)
}

/// As [`respond`], by principal strains: any size of strain, inverted states included.
#[inline(always)]
fn respond_by_svd<R: Real>(
    law: Law,
    at: &Elastic<R>,
    inverse_transposed: &Mat3<R>,
    (point, dt): (&Point<R>, R),
    k: &Coefficients<R>,
) -> Answer<R> {
    let (one, third) = (R::splat(1.0), R::splat(1.0 / 3.0));
    let Svd { u, sigma, v } = svd(&at.elastic);
    let (eps, slopes, crushed) = principal_strains(sigma);
    let (strain, dev) = Strain::of_principal(eps, point.memory, dt);
    let flow = flow(law, &strain, k);
    let ratio = share(&strain, &flow);
    let (mean, two_mu) = (flow.trace * third, k.mu + k.mu);
    let (mut stretch, mut stress) = (eps, eps);
    let (mut largest, mut steepest) = (R::splat(0.0), slopes[0]);
    for n in 0..3 {
        let dev = R::select(flow.flows, dev[n] * ratio, dev[n]);
        let tau = dev.mul_add(two_mu, flow.mean);
        stretch[n] = (dev + mean).exp();
        stress[n] = tau * slopes[n];
        largest = largest.max(tau.abs());
        steepest = steepest.max(slopes[n]);
    }
    let flows = flow.flows & !crushed;
    let mapped = u.mul(&Mat3::diagonal(stretch)).mul_transposed(&v);
    let plastic = inverse_transposed.transpose().mul(&mapped);
    let changed = Point {
        plastic: plastic.sub(&Mat3::identity()),
        memory: flow.memory,
    };
    let stress = u.mul(&Mat3::diagonal(stress)).mul_transposed(&v);
    // Where matter is inside out a turn of its axes follows F the faster.
    let stiffest = (at_rest(k) + largest) * steepest * steepest;
    let inverted = sigma[2].lt(R::splat(0.0));
    let stiffest = R::select(inverted, stiffest + stiffest, stiffest);
    Answer {
        piola: Piola {
            stress: stress.blend(one, &stress.mul_transposed(&point.plastic), one),
            tangent: (stiffest * shortened(point)).max(at_rest(k)),
            j: at.f.det(),
        },
        point: Point::select(flows, &changed, point),
        flows,
    }
}

/// Elastic energy per rest volume of a point [J/m^3].
#[inline(always)]
pub fn energy<R: Real>(
    law: Law,
    deformation: &Deformation<'_, R>,
    point: &Point<R>,
    k: &Coefficients<R>,
) -> R {
    let at = Elastic::new(deformation, point);
    if let Family::Piola(law) = law.family() {
        return energy_of_gradient(law, &at.h, k.lambda, k.mu);
    }
    let (eps, near) = logarithm(&at.x, &at.elastic);
    let near = near & at.is_not_crushed();
    let mut trace = eps[0] + (eps[3] + eps[5]);
    let mut squared = deviator_squared(&eps, trace);
    if R::any(!near) {
        let (d, ..) = principal_strains(svd(&at.elastic).sigma);
        let (o, far_trace) = (R::splat(0.0), d[0] + (d[1] + d[2]));
        let far_squared = deviator_squared(&[d[0], o, o, d[1], o, d[2]], far_trace);
        trace = R::select(near, trace, far_trace);
        squared = R::select(near, squared, far_squared);
    }
    energy_of_strain(law, [trace, squared], point.memory, k)
}

/// Elastic stress and tangent of any law that solids may have, at `f`, of what has never flowed.
pub fn elastic_piola(law: Law, f: &Mat3<f64>, lambda: f64, mu: f64) -> Piola<f64> {
    let law = law.without_flow();
    let at = Deformation {
        axes: None,
        h: f.sub(&Mat3::identity()),
    };
    let k = Coefficients::of_law(law, lambda, mu);
    respond(law, &at, &Point::rest(), (0.0, true), &k).piola
}

/// Elastic energy per rest volume of any law that solids may have, at `F = I + h`, of what has never flowed [J/m^3].
pub fn elastic_energy<R: Real>(law: Law, h: &Mat3<R>, lambda: R, mu: R) -> R {
    let k = Coefficients {
        lambda,
        mu,
        parameters: [R::splat(0.0); 4],
    };
    energy(
        law.without_flow(),
        &Deformation { axes: None, h: *h },
        &Point::rest(),
        &k,
    )
}

/// `3 lambda + 2 mu` [Pa].
#[inline(always)]
fn at_rest<R: Real>(k: &Coefficients<R>) -> R {
    R::splat(3.0).mul_add(k.lambda, k.mu + k.mu)
}

/// Bound of the tangent over `grad v` in the world at the Kirchhoff stress `tau` [Pa]: shear between axes whose strains differ by `x`
/// turns them with `x coth(x) <= 1 + x^2 / 3`, which is given.
#[inline(always)]
fn bound<R: Real>(k: &Coefficients<R>, tau: &Sym3<R>, turning: R) -> R {
    let two = R::splat(2.0);
    let diagonal = crate::mat3::dot([tau[0], tau[3], tau[5]], [tau[0], tau[3], tau[5]]);
    let off = [tau[1], tau[2], tau[4]];
    let squared = crate::mat3::dot(off, off).mul_add(two, diagonal);
    R::splat(3.0).mul_add(k.lambda, (k.mu + k.mu).mul_add(turning, squared.sqrt()))
}

#[inline(always)]
fn full<R: Real>(t: &Sym3<R>) -> Mat3<R> {
    Mat3([[t[0], t[1], t[2]], [t[1], t[3], t[4]], [t[2], t[4], t[5]]])
}

#[inline(always)]
fn scaled<R: Real>(m: &Mat3<R>, by: R) -> Mat3<R> {
    let mut out = *m;
    for a in 0..3 {
        for b in 0..3 {
            out.0[a][b] = m.0[a][b] * by;
        }
    }
    out
}

#[cfg(test)]
mod tests;
