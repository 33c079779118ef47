//! Distances from many boxes at once: what a search for contact asks of every point.

use crate::{
    search::Bounds,
    simd::{F32x16, Isa, LANES, Lanes, on_isa},
};

/// How far a place of a surface may be from the boxes around its points [cells]: they are half a cell apart at rest.
pub(super) const COVER: f64 = 0.5;

/// How much larger a distance may be than what single precision makes of it.
pub(super) const ROUNDING: f64 = 1e-5;

/// Smallest and largest coordinates of sixteen boxes, which are near each other [m]. Where there are fewer the others are nowhere.
#[derive(Clone, Debug)]
pub(super) struct Boxes {
    min: [F32x16; 3],
    max: [F32x16; 3],
}

impl Boxes {
    /// Some boxes in their order.
    pub fn of(all: impl Iterator<Item = Bounds>) -> Vec<Self> {
        let mut out: Vec<Self> = vec![];
        for (n, [min, max]) in all.enumerate() {
            if n % LANES == 0 {
                out.push(Self {
                    min: [F32x16::splat(f32::INFINITY); 3],
                    max: [F32x16::splat(f32::NEG_INFINITY); 3],
                });
            }
            let Some(group) = out.last_mut() else {
                continue;
            };
            for a in 0..3 {
                group.min[a].0[n % LANES] = min[a] as f32;
                group.max[a].0[n % LANES] = max[a] as f32;
            }
        }
        out
    }
}

on_isa! {
    /// Squared distance of a place [m] from the nearest box [m^2]; groups with a box nearer than either of two distances [m] are added
    /// to a list each, by their places.
    fn nearest_with_isa = nearest(
        boxes: &[Boxes],
        place: [f32; 3],
        within: [f32; 2],
        lists: [&mut Vec<u32>; 2],
    ) -> f32
}

on_isa! {
    /// Squared distances of places from the nearest box of some groups, or `most` where that is less [m^2], and which that is.
    fn distances_with_isa = distances(
        boxes: &[Boxes],
        groups: &[u32],
        places: &[[f32; 3]],
        most: f32,
        out: &mut [(f32, u32)],
    )
}

#[inline(always)]
fn squared<V: Lanes>(group: &Boxes, place: &[V; 3]) -> V {
    let zero = V::splat(0.0);
    let mut sum = zero;
    for a in 0..3 {
        let (min, max) = (V::load(&group.min[a]), V::load(&group.max[a]));
        let beyond = (min - place[a]).max(place[a] - max).max(zero);
        sum = beyond.mul_add(beyond, sum);
    }
    sum
}

#[inline(always)]
fn smallest<V: Lanes>(of: V) -> f32 {
    let mut lanes = F32x16::ZERO;
    of.store(&mut lanes);
    lanes.0.into_iter().fold(f32::INFINITY, f32::min)
}

#[inline(always)]
fn nearest<V: Lanes>(
    boxes: &[Boxes],
    place: [f32; 3],
    within: [f32; 2],
    mut lists: [&mut Vec<u32>; 2],
) -> f32 {
    let place = place.map(V::broadcast);
    let within = within.map(|reach| V::broadcast(reach * reach));
    let mut least = V::broadcast(f32::INFINITY);
    for (n, group) in boxes.iter().enumerate() {
        let squared = squared(group, &place);
        least = least.min(squared);
        for (list, within) in lists.iter_mut().zip(within) {
            if V::any(squared.lt(within)) {
                list.push(n as u32);
            }
        }
    }
    smallest(least)
}

#[inline(always)]
fn distances<V: Lanes>(
    boxes: &[Boxes],
    groups: &[u32],
    places: &[[f32; 3]],
    most: f32,
    out: &mut [(f32, u32)],
) {
    for (place, out) in places.iter().zip(out) {
        let place = place.map(V::broadcast);
        let (mut least, mut which) = (V::broadcast(most), V::splat(0.0));
        for &n in groups {
            let squared = squared(&boxes[n as usize], &place);
            let is_less = squared.lt(least);
            least = V::select(is_less, squared, least);
            which = V::select(is_less, V::broadcast(n as f32), which);
        }
        let (mut lanes, mut groups) = (F32x16::ZERO, F32x16::ZERO);
        least.store(&mut lanes);
        which.store(&mut groups);
        *out = (most, 0);
        for lane in 0..LANES {
            if lanes.0[lane] < out.0 {
                *out = (
                    lanes.0[lane],
                    LANES as u32 * groups.0[lane] as u32 + lane as u32,
                );
            }
        }
    }
}

/// The nearest of some boxes.
pub(super) struct NearBoxes<'a> {
    isa: Isa,
    boxes: &'a [Boxes],
    /// Groups that are near, and of these those that places asked for may be near.
    pub groups: Vec<u32>,
    close: Vec<u32>,
    /// Distance from the nearest of all [m].
    pub clear: f64,
}

impl<'a> NearBoxes<'a> {
    /// Of a place [m], so far away at most, the second time for places asked for [m].
    pub fn new(isa: Isa, boxes: &'a [Boxes], place: [f64; 3], within: [f64; 2]) -> Self {
        let (mut groups, mut close) = (vec![], vec![]);
        let (place, within) = (place.map(|x| x as f32), within.map(|x| x as f32));
        let squared = nearest_with_isa(isa, boxes, place, within, [&mut groups, &mut close]);
        Self {
            isa,
            boxes,
            groups,
            close,
            clear: f64::from(squared).sqrt(),
        }
    }

    /// Distances of places from the nearest box, or `most` where that is less [m], and which box that is. Their distance from that place
    /// and `most` come to no more than what was asked for.
    pub fn distances(&self, places: &[[f32; 3]], most: f64, out: &mut [(f32, u32)]) {
        let squared = (most * most) as f32;
        distances_with_isa(self.isa, self.boxes, &self.close, places, squared, out);
        for (distance, _) in out {
            *distance = distance.sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squared distance of a place from a box; 0 inside [m^2].
    fn squared_distance([min, max]: &Bounds, x: [f64; 3]) -> f64 {
        let beyond = |a: usize| (min[a] - x[a]).max(x[a] - max[a]).max(0.0);
        (0..3).map(|a| beyond(a).powi(2)).sum()
    }

    #[test]
    fn many_boxes_are_as_far_as_one_by_one() {
        let place = |n: usize| [n, 7 * n, 3 * n].map(|k| (k as f64 * 0.61).sin() * 2.0);
        let bounds = |n: usize| -> Bounds {
            let min = place(5 * n + 1);
            [min, min.map(|x| x + 0.1 + 0.01 * (n % 7) as f64)]
        };
        let all: Vec<Bounds> = (0..37).map(bounds).collect();
        let boxes = Boxes::of(all.iter().copied());
        let least = |x: [f64; 3], far: f64| {
            let distances = all.iter().map(|one| squared_distance(one, x).sqrt());
            distances.fold(far, f64::min)
        };
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            for n in 0..50 {
                let (centre, most) = (place(100 + n), 0.7);
                let near = NearBoxes::new(isa, &boxes, centre, [most + 0.9, most + 0.3]);
                // Single precision of coordinates of a few metres.
                assert!((near.clear - least(centre, f64::INFINITY)).abs() < 1e-6);
                let x = centre.map(|x| x + 0.1);
                let mut out = [(0.0, 0)];
                near.distances(&[x.map(|x| x as f32)], most, &mut out);
                let [(distance, which)] = out;
                assert!((f64::from(distance) - least(x, most)).abs() < 1e-6);
                if f64::from(distance) < most - 1e-6 {
                    let nearest = squared_distance(&all[which as usize], x).sqrt();
                    assert!((f64::from(distance) - nearest).abs() < 1e-6);
                }
            }
        }
    }
}
