//! Hencky elasticity with isotropic plastic flow: what von Mises, sand, foam and plasticine have in common.
//!
//! Strain is the Hencky strain `eps = ln V` of the elastic stretch `V` (`F = V R`), stress
//! `tau = 2 mu dev eps + K tr(eps) I` with `K = lambda + 2 mu / 3`. An isotropic flow rule moves `tr eps` and
//! `|dev eps|` and keeps the principal directions, so a law is a function of two scalars; the flow is carried
//! back by `F <- exp(eps_new - eps) F`.
//!
//! No law here needs eigenvectors as long as the elastic change of shape is moderate: logarithm and exponential come from
//! [`series`](super::series). Lanes beyond that bound, crushed and inverted ones among them, take the singular
//! value decomposition; a lane's result never depends on what its neighbours do.

use super::{
    Coefficients, Law, Response, Trial, drucker_prager, foam,
    limits::max_stretch_squared_of,
    plasticine,
    series::{LOG_BOUND, TRACE_BOUND, exp_minus_identity, half_log},
    strain::{Flow, STRETCH_MIN, Strain, bulk_modulus},
    svd::svd,
    von_mises,
};
use crate::{
    mat3::{Mat3, Sym3},
    num::Real,
};

/// The law's rule; laws without one, or with one of another kind, stay elastic.
#[inline(always)]
pub(super) fn flow<R: Real>(law: Law, strain: &Strain<R>, k: &Coefficients<R>) -> Flow<R> {
    match law {
        Law::DruckerPrager { .. } => drucker_prager::flow(strain, k),
        Law::Foam { exponent, .. } => foam::flow(strain, k, exponent),
        Law::Plasticine { .. } => plasticine::flow(strain, k),
        Law::VonMises { .. } => von_mises::flow(strain, k),
        Law::Hencky
        | Law::FixedCorotated
        | Law::NeoHookean
        | Law::Snow { .. }
        | Law::Fluid { .. }
        | Law::Rigid => Flow {
            trace: strain.trace,
            deviator: strain.deviator,
            memory: strain.memory,
            mean: bulk_modulus(k) * strain.trace,
            flows: strain.trace.lt(strain.trace),
        },
    }
}

/// What a law makes of a strain that the series of [`logarithm`] reach.
pub(super) struct Mapped<R: Real> {
    /// Strain after the flow.
    eps: Sym3<R>,
    /// Strain before the flow, as flow rules see it.
    pub strain: Strain<R>,
    /// Its flow.
    pub flow: Flow<R>,
    /// Change of strain in lanes that flow; of no meaning where none does.
    pub change: Sym3<R>,
    /// Lanes in which all of this is right.
    pub near: R::Mask,
}

/// Return mapping of `trial`, with `x = F F^T - I`.
#[inline(always)]
pub(super) fn return_mapping<R: Real>(
    law: Law,
    x: &Sym3<R>,
    trial: &Trial<R>,
    k: &Coefficients<R>,
) -> Mapped<R> {
    let (eps, near) = logarithm(x, &trial.f);
    let strain = measure(&eps, trial);
    let flow = flow(law, &strain, k);
    let leap = (flow.trace - strain.trace).abs();
    let near = near & leap.lt(R::splat(TRACE_BOUND));
    let (mut new, mut change) = (eps, eps);
    if R::any(near & flow.flows) {
        new = moved(&eps, &strain, &flow);
        for n in 0..6 {
            change[n] = new[n] - eps[n];
            new[n] = R::select(flow.flows, new[n], eps[n]);
        }
    }
    Mapped {
        eps: new,
        strain,
        flow,
        change,
        near,
    }
}

impl<R: Real> Mapped<R> {
    /// Kirchhoff stress [Pa].
    #[inline(always)]
    pub fn kirchhoff_stress(&self, k: &Coefficients<R>) -> Sym3<R> {
        let (new, flow) = (&self.eps, &self.flow);
        let mean_strain = flow.trace * R::splat(1.0 / 3.0);
        let two_mu = k.mu + k.mu;
        [
            (new[0] - mean_strain).mul_add(two_mu, flow.mean),
            new[1] * two_mu,
            new[2] * two_mu,
            (new[3] - mean_strain).mul_add(two_mu, flow.mean),
            new[4] * two_mu,
            (new[5] - mean_strain).mul_add(two_mu, flow.mean),
        ]
    }

    /// What the flow adds to the elastic deformation gradient `f`, in lanes that flow.
    #[inline(always)]
    pub fn change_of(&self, f: &Mat3<R>) -> Mat3<R> {
        let e = exp_minus_identity(&self.change);
        Mat3([[e[0], e[1], e[2]], [e[1], e[3], e[4]], [e[2], e[4], e[5]]]).mul(f)
    }
}

/// Return mapping and stress.
#[inline(always)]
pub fn respond<R: Real>(law: Law, trial: &Trial<R>, k: &Coefficients<R>) -> Response<R> {
    let x = stretch_minus_identity(&trial.f);
    let mapped = return_mapping(law, &x, trial, k);
    let (flow, near) = (&mapped.flow, mapped.near);
    let mut f = trial.f;
    if R::any(near & flow.flows) {
        let change = mapped.change_of(&trial.f);
        let changed = trial.f.blend(R::splat(1.0), &change, R::splat(1.0));
        f = Mat3::select(flow.flows, &changed, &trial.f);
    }
    let mut response = Response {
        f,
        memory: flow.memory,
        tau: mapped.kirchhoff_stress(k),
        stretch_squared: max_stretch_squared_of(&x) + R::splat(1.0),
        j: f.det(),
        stiffness: R::splat(1.0),
    };
    // Written so that NaN counts as far.
    if R::any(!near) {
        response = Response::select(near, &response, &respond_by_svd(law, trial, k));
    }
    response
}

/// As [`respond`], by principal strains: any size of strain, inverted states included.
#[inline(always)]
pub fn respond_by_svd<R: Real>(law: Law, trial: &Trial<R>, k: &Coefficients<R>) -> Response<R> {
    let d = svd(&trial.f);
    let floor = R::splat(STRETCH_MIN);
    let third = R::splat(1.0 / 3.0);
    let mut crushed = d.sigma[0].lt(floor);
    let mut eps = d.sigma;
    for n in 0..3 {
        let below = d.sigma[n].lt(floor);
        crushed = crushed | below;
        eps[n] = R::select(below, floor, d.sigma[n]).ln();
    }
    let (strain, dev) = Strain::of_principal(eps, trial.memory, trial.dt);
    let flow = flow(law, &strain, k);
    let ratio = share(&strain, &flow);
    let mean = flow.trace * third;
    let two_mu = k.mu + k.mu;
    let mut stretch = eps;
    let mut tau = eps;
    for n in 0..3 {
        let dev = R::select(flow.flows, dev[n] * ratio, dev[n]);
        stretch[n] = (dev + mean).exp();
        tau[n] = dev.mul_add(two_mu, flow.mean);
    }
    let mapped = d.u.mul(&Mat3::diagonal(stretch)).mul_transposed(&d.v);
    let f = Mat3::select(flow.flows | crushed, &mapped, &trial.f);
    let largest = stretch[0].max(stretch[1]).max(stretch[2]);
    Response {
        f,
        memory: flow.memory,
        tau: d.u.mul(&Mat3::diagonal(tau)).mul_transposed_sym(&d.u),
        stretch_squared: largest * largest,
        j: f.det(),
        stiffness: R::splat(1.0),
    }
}

/// Elastic energy per rest volume `mu |dev eps|^2 + K / 2 tr(eps)^2` [J/m^3]; of plasticine less in tension.
#[inline(always)]
pub fn energy_density<R: Real>(law: Law, f: &Mat3<R>, memory: R, k: &Coefficients<R>) -> R {
    let x = stretch_minus_identity(f);
    let (eps, near) = logarithm(&x, f);
    let mut trace = eps[0] + (eps[3] + eps[5]);
    let mut squared = deviator_squared(&eps, trace);
    if R::any(!near) {
        let sigma = svd(f).sigma;
        let floor = R::splat(STRETCH_MIN);
        let mut d = sigma;
        for n in 0..3 {
            d[n] = R::select(sigma[n].lt(floor), floor, sigma[n]).ln();
        }
        let far_trace = d[0] + (d[1] + d[2]);
        let o = R::splat(0.0);
        let far_squared = deviator_squared(&[d[0], o, o, d[1], o, d[2]], far_trace);
        trace = R::select(near, trace, far_trace);
        squared = R::select(near, squared, far_squared);
    }
    energy_of_strain(law, [trace, squared], memory, k)
}

/// The same at a strain, of which `tr eps` and `|dev eps|^2` are given.
#[inline(always)]
pub(super) fn energy_of_strain<R: Real>(
    law: Law,
    [trace, squared]: [R; 2],
    memory: R,
    k: &Coefficients<R>,
) -> R {
    let mean = match law {
        Law::Plasticine { .. } => plasticine::mean_stress(trace, memory, k),
        Law::Hencky
        | Law::VonMises { .. }
        | Law::DruckerPrager { .. }
        | Law::Foam { .. }
        | Law::FixedCorotated
        | Law::NeoHookean
        | Law::Snow { .. }
        | Law::Fluid { .. }
        | Law::Rigid => bulk_modulus(k) * trace,
    };
    k.mu.mul_add(squared, R::splat(0.5) * mean * trace)
}

/// `F F^T - I`, by way of `F - I` so that small strains keep their digits.
#[inline(always)]
fn stretch_minus_identity<R: Real>(f: &Mat3<R>) -> Sym3<R> {
    let h = f.sub(&Mat3::identity());
    let p = h.mul_transposed_sym(&h);
    let [a, b, c] = h.0;
    [
        p[0] + (a[0] + a[0]),
        p[1] + (a[1] + b[0]),
        p[2] + (a[2] + c[0]),
        p[3] + (b[1] + b[1]),
        p[4] + (b[2] + c[1]),
        p[5] + (c[2] + c[2]),
    ]
}

/// Mean of `F F^T - I` from which on the strain is taken about that mean instead of about 1.
const SWOLLEN: f64 = 0.1;

/// `ln(I + X) / 2` for `X = F F^T - I`, and the lanes where the series is exact to round-off: any volume, moderate
/// change of shape, and not inverted, which `X` does not show.
#[inline(always)]
pub(super) fn logarithm<R: Real>(x: &Sym3<R>, f: &Mat3<R>) -> (Sym3<R>, R::Mask) {
    let zero = R::splat(0.0);
    let mean = (x[0] + (x[3] + x[5])) * R::splat(1.0 / 3.0);
    let swollen = R::splat(SWOLLEN).lt(mean.abs());
    let mut about = *x;
    let mut half_ln = zero;
    if R::any(swollen) {
        // I + X = (1 + m) (I + X'); in the other lanes m is 0, which changes no bit.
        let m = R::select(swollen, mean, zero);
        let scale = R::splat(1.0) + m;
        half_ln = scale.ln() * R::splat(0.5);
        for n in 0..6 {
            let diagonal = n == 0 || n == 3 || n == 5;
            about[n] = (if diagonal { x[n] - m } else { x[n] }) / scale;
        }
    }
    let (mut eps, norm_squared) = half_log(&about);
    for n in [0, 3, 5] {
        eps[n] = eps[n] + half_ln;
    }
    let near = norm_squared.lt(R::splat(LOG_BOUND * LOG_BOUND));
    (eps, near & zero.lt(f.det()))
}

#[inline(always)]
pub(super) fn deviator_squared<R: Real>(eps: &Sym3<R>, trace: R) -> R {
    let mean = trace * R::splat(1.0 / 3.0);
    let d = [eps[0] - mean, eps[3] - mean, eps[5] - mean];
    let off = [eps[1], eps[2], eps[4]];
    crate::mat3::dot(off, off).mul_add(R::splat(2.0), crate::mat3::dot(d, d))
}

#[inline(always)]
fn measure<R: Real>(eps: &Sym3<R>, trial: &Trial<R>) -> Strain<R> {
    let trace = eps[0] + (eps[3] + eps[5]);
    Strain {
        trace,
        deviator: deviator_squared(eps, trace).sqrt(),
        memory: trial.memory,
        dt: trial.dt,
    }
}

/// `|dev eps|` after the flow as a share of that before.
#[inline(always)]
pub(super) fn share<R: Real>(before: &Strain<R>, after: &Flow<R>) -> R {
    let zero = R::splat(0.0);
    let defined = zero.lt(before.deviator);
    let divisor = R::select(defined, before.deviator, R::splat(1.0));
    R::select(defined, after.deviator / divisor, zero)
}

/// The strain after the flow.
#[inline(always)]
fn moved<R: Real>(eps: &Sym3<R>, before: &Strain<R>, after: &Flow<R>) -> Sym3<R> {
    let third = R::splat(1.0 / 3.0);
    let ratio = share(before, after);
    let (from, to) = (before.trace * third, after.trace * third);
    [
        (eps[0] - from).mul_add(ratio, to),
        eps[1] * ratio,
        eps[2] * ratio,
        (eps[3] - from).mul_add(ratio, to),
        eps[4] * ratio,
        (eps[5] - from).mul_add(ratio, to),
    ]
}
