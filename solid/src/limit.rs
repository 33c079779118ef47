//! The largest substep of a solid: by its fastest motion, which is measured about rest, and about where it is when that saves more than
//! it takes.

use super::{
    frequency::{Lanczos, Measured, Pressed, Steps, Vibrating},
    grip::ContactWith,
    kernel::{Extremes, SolidLaw},
    model::SolidModel,
};
use crate::simd::F32x16;

/// Share of the stable substep that one may have at the largest tangent of the moment, and where it may touch something. In a chain of
/// five cells between two walls contact makes no energy up to that, and does at 0.85.
const STABLE: f64 = 0.8;
/// Largest squared frequency over the tangent per density and squared cell size, wherever the boundary cuts, with the masses of nodes alone:
/// 4 / 0.943^2.
pub(super) const FASTEST: f64 = 4.5;
/// What that frequency of much deformed matter is taken for over the bound: more than 1, as nodes follow others and have mass between them.
const DEFORMED: f64 = 1.9;
/// One over the stiffening from which on it is taken for that.
const ONSET: f64 = 1.5;
/// Time of the viscous stress over the substep, where matter is deformed most: what keeps violent release from inverting it.
pub(super) const VISCOSITY: f64 = 0.1;
/// Tangents over that at rest between which viscosity sets in: bending and falling matter stays below.
const VISCOUS: [f64; 2] = [2.5, 5.0];
/// Largest change of the deformation gradient in a substep of matter that is deformed much, or fast: what crushes it within one is not
/// seen in time.
const CHANGE: f64 = 0.2;
/// The same of matter that was measured where it is: with 0.2 a crushed plate gained a tenth of its energy, and with `cfl` 0.4 blocks
/// that met at 40 m/s sixty times theirs.
const MEASURED_CHANGE: f64 = 0.1;
/// Growth of a tangent anywhere since a measurement from which on another is made.
const GROWN: f64 = 1.2;
/// Substeps after which another may be made, and is.
const AGE: [u64; 2] = [16, 64];
/// Substeps that a measurement has to save at best: it takes as long as nine.
const MIN_SAVED: f64 = 18.0;
/// Smallest substep over that at rest: a solid whose matter needs less fails, and one that is too fast for it is in what it meets deeper
/// than it should.
const SMALLEST: f64 = 1.0 / 1024.0;

/// A solid as it is deformed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Deformed<'a> {
    pub model: &'a SolidModel,
    pub laws: &'a [SolidLaw],
    /// Largest tangent over density [m^2/s^2].
    pub tangent: f64,
    /// Largest gradient of the velocity, where matter is deformed so much, or so fast, that this counts [1/s].
    pub rate: f64,
    /// Stiffness at once over that at rest, at least 1: what relaxes has not done so yet.
    pub at_once: f64,
}

impl Deformed<'_> {
    /// Tangent over density at rest [m^2/s^2].
    pub fn tangent_at_rest(&self) -> f64 {
        let laws = self.laws.iter();
        laws.map(|law| law.tangent_at_rest() / law.density)
            .fold(0.0, f64::max)
    }

    /// Present tangent over that at rest, at least 1.
    pub fn stiffening(&self) -> f64 {
        (self.tangent / self.tangent_at_rest()).max(1.0)
    }

    /// Share of the largest viscosity that it has at present.
    pub fn viscous_share(&self) -> f64 {
        let beyond = (self.stiffening() - VISCOUS[0]) / (VISCOUS[1] - VISCOUS[0]);
        beyond.clamp(0.0, 1.0)
    }
}

/// What is known of how fast a solid's motions are.
#[derive(Clone, Debug, Default)]
pub(super) struct Motions {
    /// The fastest about rest, with these laws.
    at_rest: Option<(Vec<SolidLaw>, Measured)>,
    /// What contact adds to its squared frequency, for all of [`ContactWith`] [1/s^2].
    pressed: [f64; 3],
    /// The fastest about where it was in this frame.
    now: Option<Measured>,
    lanczos: Lanczos,
}

impl Motions {
    /// Forgets what no other frame may depend on.
    pub fn restart(&mut self) {
        self.now = None;
    }

    /// Whether the fastest motion about rest is known with these laws.
    pub fn knows(&self, laws: &[SolidLaw]) -> bool {
        let known = self.at_rest.as_ref();
        known.is_some_and(|known| known.0 == laws)
    }

    /// Measures the fastest motion about rest, where nothing is held; a surface is pressed where it is by
    /// springs of some tangent [Pa].
    pub fn measure_at_rest<'a>(&mut self, mut rest: Vibrating<'a>, surface: Pressed<'a>) {
        let found = rest.fastest(&mut self.lanczos, Steps::Many);
        // Two alike that press on each other, both with half of their springs, move as each does against a wall with twice its own.
        let pressed = [1.0, 2.0].map(|times| {
            rest.pressed = Some(Pressed {
                tangent: times * surface.tangent,
                ..surface
            });
            let fastest = rest.fastest(&mut self.lanczos, Steps::Several).squared;
            (fastest - found.squared).max(0.0)
        });
        self.pressed = [0.0, pressed[0], pressed[1]];
        self.at_rest = Some((rest.laws.to_vec(), found));
        self.now = None;
    }

    /// Largest squared frequency [1/s^2]: at rest, and a bound for now.
    fn frequencies(&self, of: &Deformed<'_>) -> [f64; 2] {
        let at_rest = FASTEST * of.tangent_at_rest() / (of.model.dx * of.model.dx);
        let measured = match &self.at_rest {
            Some((laws, measured)) if laws == of.laws => measured.squared,
            _ => at_rest,
        };
        // What was measured holds for matter that is near rest; the bound holds for what is not.
        let (share, stiffening) = (measured / at_rest, of.stiffening());
        let share = share + (DEFORMED - share).max(0.0) * (ONSET * (stiffening - 1.0)).min(1.0);
        [
            of.at_once * measured,
            of.at_once * at_rest * share * stiffening,
        ]
    }

    /// Largest substeps [s]: by what is known, and if motions were as fast as about rest.
    fn stable(&self, of: &Deformed<'_>, contact: ContactWith) -> [f64; 2] {
        let [at_rest, bound] = self.frequencies(of);
        // A viscous stress over a time `t` takes `t` times the substep from what is stable, `(omega dt)^2 / 4 + t omega^2 dt / 2 < 1`; its
        // tangent may be as large as any.
        let viscous = 2.0 * VISCOSITY * of.viscous_share() * bound;
        let besides = viscous + self.pressed[contact as usize];
        let stable = |fastest: f64| 2.0 * STABLE / (fastest + besides).sqrt();
        // What was measured holds for matter that is deformed little more in a substep.
        let by_now = |now: &Measured| {
            let slow = MEASURED_CHANGE / f64::from(now.rate);
            stable(of.at_once * now.squared * now.growth).min(slow)
        };
        let by_bound = stable(bound);
        let known = self.now.as_ref().map_or(by_bound, by_now).max(by_bound);
        [known, stable(at_rest)]
    }

    /// Largest substep [s]: that at rest by a power of the eighth root of one half, so that it seldom changes; and the smallest that
    /// anything makes it.
    pub fn limit(&self, of: &Deformed<'_>, contact: ContactWith, cfl: f64) -> [f64; 2] {
        let [at_rest, _] = self.frequencies(of);
        let rest = 2.0 * cfl / at_rest.sqrt();
        let [known, _] = self.stable(of, contact);
        let most = known.min(CHANGE / of.rate);
        let mut limit = rest;
        while limit > most && limit > SMALLEST * rest {
            limit *= 0.5_f64.powf(0.125);
        }
        [limit, limit.min(SMALLEST * rest)]
    }

    /// Measures the fastest motion about where it is, if that is due and worth it for what is left of a span [s]; whether it is known then.
    pub fn measure_now(
        &mut self,
        of: &Deformed<'_>,
        contact: ContactWith,
        remaining: f64,
        mut here: Vibrating<'_>,
    ) -> bool {
        let is_recent =
            |now: &Measured| now.age < AGE[0] || (now.growth <= GROWN && now.age < AGE[1]);
        let [known, best] = self.stable(of, contact);
        let saved = remaining / known - remaining / best;
        if saved > MIN_SAVED && !self.now.as_ref().is_some_and(is_recent) {
            let found = here.fastest(&mut self.lanczos, Steps::Few);
            self.now = Some(found).filter(|found| found.squared.is_finite());
        }
        self.now.is_some()
    }

    /// Takes note of what a substep found, and whether it looked at tangents: their largest growth from rest, if so.
    pub fn note(&mut self, sums: &[[F32x16; 4]], found: &Extremes, looked: bool) -> Option<f64> {
        if let Some(now) = &mut self.now {
            now.age += 1;
            if looked {
                now.compare(sums);
                now.rate = found.rate;
            }
        }
        let (_, at_rest) = self.at_rest.as_mut().filter(|_| looked)?;
        at_rest.compare(sums);
        Some(at_rest.growth)
    }
}
