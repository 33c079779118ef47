//! Regions that join greedily, those first between which the least share of votes parts them: average linkage on a graph.

use std::{
    cmp::Reverse,
    collections::{BTreeMap, BinaryHeap},
};

use crate::Splat;

/// Votes about two neighbours: those that part them, and all.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Votes {
    pub parted: f32,
    pub all: f32,
}

impl Votes {
    pub fn add(&mut self, other: Votes) {
        self.parted += other.parted;
        self.all += other.all;
    }

    pub fn height(self) -> f32 {
        self.parted / self.all.max(f32::MIN_POSITIVE)
    }
}

/// A distance that orders like its bits.
fn key(height: f32) -> u32 {
    height.max(0.0).to_bits()
}

/// Regions that join greedily, nearest first.
pub(crate) struct Linkage {
    /// The region that each became part of; itself for one that is left.
    into: Vec<u32>,
    size: Vec<usize>,
    /// Votes about every region's neighbours.
    links: Vec<BTreeMap<u32, Votes>>,
    /// What each region is known to belong to; -1 for nothing. Two that belong to different things never join.
    owner: Vec<i32>,
}

impl Linkage {
    pub fn new(count: usize, edges: &[(u32, u32, Votes)]) -> Self {
        let mut links = vec![BTreeMap::<u32, Votes>::new(); count];
        for &(a, b, votes) in edges {
            links[a as usize].entry(b).or_default().add(votes);
            links[b as usize].entry(a).or_default().add(votes);
        }
        Self {
            into: (0..count as u32).collect(),
            size: vec![1; count],
            links,
            owner: vec![-1; count],
        }
    }

    /// The same with regions of these sizes that belong to these things.
    pub fn owned(mut self, size: Vec<usize>, owner: Vec<i32>) -> Self {
        (self.size, self.owner) = (size, owner);
        self
    }

    /// What region `n` belongs to by now.
    pub fn owner_of(&self, n: u32) -> i32 {
        self.owner[self.find(n) as usize]
    }

    fn may_join(&self, a: u32, b: u32) -> bool {
        let (a, b) = (self.owner[a as usize], self.owner[b as usize]);
        a < 0 || b < 0 || a == b
    }

    pub fn find(&self, mut n: u32) -> u32 {
        while self.into[n as usize] != n {
            n = self.into[n as usize];
        }
        n
    }

    /// Makes one region of two; the one with more neighbours keeps its number.
    fn join(&mut self, a: u32, b: u32) -> u32 {
        let (kept, gone) = match self.links[a as usize].len() >= self.links[b as usize].len() {
            true => (a, b),
            false => (b, a),
        };
        self.into[gone as usize] = kept;
        self.size[kept as usize] += self.size[gone as usize];
        self.owner[kept as usize] = self.owner[kept as usize].max(self.owner[gone as usize]);
        for (other, votes) in std::mem::take(&mut self.links[gone as usize]) {
            self.links[other as usize].remove(&gone);
            if other != kept {
                self.links[kept as usize]
                    .entry(other)
                    .or_default()
                    .add(votes);
                self.links[other as usize]
                    .entry(kept)
                    .or_default()
                    .add(votes);
            }
        }
        kept
    }

    /// Joins the two regions with the least share of parting votes until none is below `stop`; says each join: the region
    /// that stays, the one that becomes part of it, and the share of votes that parted them.
    pub fn run(&mut self, stop: f32) -> Vec<(u32, u32, f32)> {
        let mut joins = Vec::new();
        let mut queue = BinaryHeap::new();
        let offer = |queue: &mut BinaryHeap<_>, a: u32, b: u32, votes: Votes| {
            if votes.height() < stop {
                queue.push(Reverse((key(votes.height()), a.min(b), a.max(b))));
            }
        };
        for (a, links) in self.links.iter().enumerate() {
            for (&b, &votes) in links.range(a as u32 + 1..) {
                offer(&mut queue, a as u32, b, votes);
            }
        }
        while let Some(Reverse((height, a, b))) = queue.pop() {
            let now = self.links[a as usize].get(&b);
            // Regions that have changed have been offered again.
            if now.is_none_or(|votes| key(votes.height()) != height) || !self.may_join(a, b) {
                continue;
            }
            let kept = self.join(a, b);
            joins.push((kept, a + b - kept, f32::from_bits(height)));
            for (&other, &votes) in &self.links[kept as usize] {
                offer(&mut queue, kept, other, votes);
            }
        }
        joins
    }

    /// Joins every region below `size` to the neighbour with the least share of parting votes, smallest first.
    pub fn absorb(&mut self, size: usize) {
        let mut small: Vec<(usize, u32)> = (0..self.into.len() as u32)
            .filter(|&n| self.into[n as usize] == n && self.size[n as usize] < size)
            .map(|n| (self.size[n as usize], n))
            .collect();
        small.sort_unstable();
        for (_, n) in small {
            if self.into[n as usize] != n || self.size[n as usize] >= size {
                continue;
            }
            let links = self.links[n as usize].iter();
            let nearest = links.min_by_key(|(other, votes)| (key(votes.height()), **other));
            if let Some(&other) = nearest.map(|(other, _)| other) {
                self.join(n, other);
            }
        }
    }

    /// Sizes of the regions that are left, descending.
    pub fn sizes(&self) -> Vec<usize> {
        let left = (0..self.into.len()).filter(|&n| self.into[n] == n as u32);
        let mut sizes: Vec<usize> = left.map(|n| self.size[n]).collect();
        sizes.sort_unstable_by(|a, b| b.cmp(a));
        sizes
    }

    /// The region of each member and the size of each region, numbered without gaps in the order of their first members.
    pub fn regions(&self) -> (Vec<u32>, Vec<usize>) {
        let mut number = BTreeMap::new();
        let mut region = Vec::with_capacity(self.into.len());
        for n in 0..self.into.len() as u32 {
            let next = number.len() as u32;
            region.push(*number.entry(self.find(n)).or_insert(next));
        }
        let mut size = vec![0; number.len()];
        region.iter().for_each(|r| size[*r as usize] += 1);
        (region, size)
    }
}

/// How unlike two Gaussians look by colour and normal, 0..=1.
pub(crate) fn unlike(splat: &Splat, a: usize, b: usize) -> f32 {
    let color = (splat.color[a] - splat.color[b]).length_squared();
    let turned = 1.0 - splat.normal[a].dot(splat.normal[b]).abs().min(1.0);
    1.0 - (-(10.0 * color + turned)).exp()
}
