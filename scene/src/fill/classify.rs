//! Which voxels are surface, outside and inside.

use super::{FillReport, grid::Grid, surfels::MAX_HOLE};

/// A voxel is surface when the opacity density in it exceeds this: about half of the light is stopped.
const SURFACE: f32 = 0.5;

/// Rounds of neighbourhood majority after the vote.
const SMOOTHING: usize = 4;

/// What a voxel is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    Outside,
    Surface,
    Inside,
}

/// Sorts all voxels.
///
/// Voxels that a flood from the border cannot reach are inside. Voxels that a ball as wide as the widest hole
/// can touch without crossing the surface are outside. The rest lies behind a small hole, in a crevice, in a
/// bottle with a narrow neck, or above a hidden underside: there, axis rays in six directions decide.
pub fn classify(
    grid: &Grid,
    density: &[f32],
    closed_below: bool,
    report: &mut FillReport,
) -> Vec<Class> {
    let n = grid.len();
    let surface = density.iter().map(|d| *d > SURFACE).collect::<Vec<_>>();
    let open = surface.iter().map(|s| !s).collect::<Vec<_>>();
    let leaking = grid.flood(&open);

    // The ball: shrink the free space by its radius, flood, grow back.
    let longest = longest_side(grid, &surface);
    let radius = (1.5 * MAX_HOLE * longest).clamp(6.0, 250.0) as u8;
    let floor = if closed_below {
        lowest_layer(grid, &surface)
    } else {
        None
    };
    let below = |i: usize| floor.is_some_and(|floor| grid.coordinates(i)[1] <= floor);
    let to_surface = grid.distance(|i| surface[i] || below(i));
    let passable = to_surface.iter().map(|d| *d > radius).collect::<Vec<_>>();
    let reached = grid.flood(&passable);
    let to_reached = grid.distance(|i| reached[i]);

    let votes = votes(grid, &surface, floor);
    let mut class = (0..n)
        .map(|i| {
            if surface[i] {
                Class::Surface
            } else if !leaking[i] {
                Class::Inside
            } else if to_reached[i] <= radius || !votes[i].inside() {
                Class::Outside
            } else {
                Class::Inside
            }
        })
        .collect::<Vec<_>>();
    // Rays that graze an edge or meet a leaf miscount: the neighbours decide.
    let voted = (0..n)
        .filter(|&i| !surface[i] && leaking[i] && to_reached[i] > radius)
        .collect::<Vec<_>>();
    for _ in 0..SMOOTHING {
        let smoothed = voted
            .iter()
            .map(|&i| majority(grid, &class, i))
            .collect::<Vec<_>>();
        for (&i, value) in voted.iter().zip(smoothed) {
            class[i] = value;
        }
    }
    report.operations += 60 * n as u64;
    class
}

/// Longest side of the box around the surface [voxels].
fn longest_side(grid: &Grid, surface: &[bool]) -> f64 {
    let mut low = grid.size;
    let mut high = [0; 3];
    for i in (0..surface.len()).filter(|&i| surface[i]) {
        let p = grid.coordinates(i);
        for a in 0..3 {
            low[a] = low[a].min(p[a]);
            high[a] = high[a].max(p[a] + 1);
        }
    }
    (0..3)
        .map(|a| high[a].saturating_sub(low[a]))
        .max()
        .unwrap_or(0) as f64
}

/// Layer on which the object stands: below it is less than 1 % of the surface.
fn lowest_layer(grid: &Grid, surface: &[bool]) -> Option<usize> {
    let mut count = vec![0usize; grid.size[1]];
    for i in (0..surface.len()).filter(|&i| surface[i]) {
        count[grid.coordinates(i)[1]] += 1;
    }
    let total = count.iter().sum::<usize>();
    let mut sum = 0;
    count.iter().position(|c| {
        sum += c;
        sum * 100 > total
    })
}

/// What the six axis rays of a voxel meet.
#[derive(Clone, Copy, Default)]
struct Votes {
    /// Rays that cross the surface at all.
    blocked: u8,
    /// Rays that cross it an odd number of times.
    odd: u8,
}

impl Votes {
    /// Shut in on five sides, and not by two surfaces everywhere, as the cavity of a thick-walled bottle is. In
    /// captures the parity alone means little: leaves in front and stray Gaussians within count as crossings.
    fn inside(self) -> bool {
        self.blocked >= 5 && self.odd >= 2
    }
}

fn votes(grid: &Grid, surface: &[bool], floor: Option<usize>) -> Vec<Votes> {
    let mut votes = vec![Votes::default(); surface.len()];
    let strides = grid.strides();
    for axis in 0..3 {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        for u in 0..grid.size[b] {
            for v in 0..grid.size[c] {
                let start = u * strides[b] + v * strides[c];
                let line = (0..grid.size[axis]).map(|t| start + t * strides[axis]);
                let is_entry = |i: usize, before: &mut bool| {
                    let entry = surface[i] && !*before;
                    *before = surface[i];
                    entry
                };
                let mut before = false;
                let total = line.clone().filter(|&i| is_entry(i, &mut before)).count();
                let mut crossed = 0;
                before = false;
                for (t, i) in line.enumerate() {
                    crossed += usize::from(is_entry(i, &mut before));
                    let stands = axis == 1 && floor.is_some_and(|floor| t > floor);
                    let left = total - crossed;
                    votes[i].blocked += u8::from(crossed > 0 || stands) + u8::from(left > 0);
                    votes[i].odd += (crossed % 2 + left % 2) as u8;
                }
            }
        }
    }
    votes
}

/// Inside or outside, as most neighbours are; surface neighbours abstain.
fn majority(grid: &Grid, class: &[Class], i: usize) -> Class {
    let p = grid.coordinates(i);
    let range = |a: usize| p[a].saturating_sub(1)..=(p[a] + 1).min(grid.size[a] - 1);
    let mut balance = 0;
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                balance += match class[grid.index([x, y, z])] {
                    Class::Inside => 1,
                    Class::Outside => -1,
                    Class::Surface => 0,
                };
            }
        }
    }
    match balance {
        0 => class[i],
        1.. => Class::Inside,
        _ => Class::Outside,
    }
}
