//! A solid as matter around it sees it: where its surface is from places near it.

use super::{
    boxes::{Boxes, COVER, NearBoxes, ROUNDING},
    clusters::{bounds_of, middle},
    contact::ContactSurface,
    inverse::{HALF_SURE, Known, LocalInverse, Missing, SURE, SeenSurface},
    search::{Bounds, PARTS, Search},
};
use crate::{
    mat3::length,
    simd::{Isa, LANES},
};

/// A solid where it is, after a look at where its clusters are.
pub struct Outline<'a> {
    /// Tells where its surface is from any place.
    pub inverse: LocalInverse<'a>,
    surface: &'a ContactSurface,
    search: &'a Search,
    isa: Isa,
    /// Around parts of its clusters, from its frame.
    boxes: Vec<Boxes>,
    bounds: Bounds,
}

/// Why a surface is not seen from a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unseen {
    /// It is farther away than this at least [m].
    Beyond(f64),
    /// The same, if the search did not go astray.
    NoMatter(f64),
    /// It was not found.
    Lost,
}

impl<'a> Outline<'a> {
    /// Of a solid, its surface, what is known of where that is, and a box that it is in [m].
    pub fn new(
        inverse: LocalInverse<'a>,
        (surface, search): (&'a ContactSurface, &'a Search),
        bounds: Bounds,
        isa: Isa,
    ) -> Self {
        Self {
            boxes: Boxes::of(search.grown()),
            bounds,
            inverse,
            surface,
            search,
            isa,
        }
    }

    /// A box that its surface is in [m].
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// How far some places near each other are from its surface at least, those of all that are within `most` of it one by one [m]; and
    /// the part of its surface that is nearest to their middle, if it is that near to any.
    pub fn around(
        &self,
        places: &[[f64; 3]; LANES],
        most: f64,
        beyond: &mut [f64; LANES],
    ) -> Option<Known> {
        let [min, max] = self.bounds;
        let shift = self.inverse.state.shift;
        let [low, high] = bounds_of(places, |x| *x);
        let half: [f64; 3] = std::array::from_fn(|a| 0.5 * (high[a] - low[a]));
        let centre: [f64; 3] = std::array::from_fn(|a| low[a] + half[a]);
        let (radius, cover) = (length(half), self.cover());
        let clear = (0..3).map(|a| (min[a] - high[a]).max(low[a] - max[a]));
        let clear = clear.fold(f64::NEG_INFINITY, f64::max) - cover;
        if clear > most {
            *beyond = [clear; LANES];
            return None;
        }
        let from_frame = |x: &[f64; 3]| [0, 1, 2].map(|a| x[a] - shift[a]);
        // With room for the rounding of coordinates to single precision.
        let within = (most + cover + radius) * (1.0 + ROUNDING);
        let near = NearBoxes::new(self.isa, &self.boxes, from_frame(&centre), [within; 2]);
        let clear = near.clear - cover - radius;
        if clear > most {
            *beyond = [clear; LANES];
            return None;
        }
        let mut at = [[0.0; 3]; LANES + 1];
        for (at, x) in at.iter_mut().zip(places.iter().chain([&centre])) {
            *at = from_frame(x).map(|x| x as f32);
        }
        let mut found = [(0.0, 0); LANES + 1];
        near.distances(&at, within, &mut found);
        for (beyond, (distance, _)) in beyond.iter_mut().zip(found) {
            *beyond = f64::from(distance) - cover;
        }
        let nearest = found[LANES].1 as usize;
        let (cluster, part) = (nearest / PARTS, nearest % PARTS);
        let now = middle(self.search.boxes[cluster].parts[part]);
        let now = std::array::from_fn(|a| now[a] + shift[a]);
        let rest = self.surface.clusters[cluster].middles[part];
        Some(self.inverse.known(now, rest))
    }

    /// Whether a place is outside for sure [m].
    pub fn is_outside(&self, x: [f64; 3]) -> bool {
        match self.inverse.surface(x, None) {
            Err(Missing::NoMatter(_)) => true,
            Err(Missing::Lost) => false,
            Ok(seen) => seen.distance > 0.0,
        }
    }

    fn cover(&self) -> f64 {
        COVER * self.inverse.model.dx
    }

    /// The surface as seen from a place, if that is nearer to it than `most` [m]; searched for from a place and a material point on.
    #[inline(always)]
    pub fn within(
        &self,
        x: [f64; 3],
        most: f64,
        known: Option<Known>,
    ) -> Result<SeenSurface, Unseen> {
        match self.inverse.surface_within(x, most, known) {
            Ok(seen) if seen.distance <= most => Ok(seen),
            Ok(seen) => Err(Unseen::Beyond(SURE * seen.distance)),
            Err(Missing::NoMatter(distance)) => Err(Unseen::NoMatter(HALF_SURE * distance)),
            Err(Missing::Lost) => Err(Unseen::Lost),
        }
    }
}
