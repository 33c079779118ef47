//! Taking all particles of one grid field out of an arrangement, and putting them back.

use std::ops::Range;

use super::{Block, Particles, Run};

/// Counts of runs, groups and shapes.
type Counts = [usize; 3];

impl Particles {
    /// Takes the particles of a field out; what is left, and what is returned, is arranged as before.
    pub fn take_field(&mut self, field: u32) -> Self {
        let first = self.blocks.partition_point(|b| b.field < field);
        let end = self.blocks.partition_point(|b| b.field <= field);
        let (from, to) = (self.before(first), self.before(end));
        let [runs, groups, shapes] = [0, 1, 2].map(|n| from[n]..to[n]);
        let mut taken = Self {
            blocks: self.blocks.drain(first..end).collect(),
            runs: self.runs.drain(runs.clone()).collect(),
            groups: self.groups.drain(groups.clone()).collect(),
            memory: self.memory.drain(groups.clone()).collect(),
            shapes: self.shapes.drain(shapes).collect(),
            motion: self.motion.drain(groups.clone()).collect(),
            fixed: self.fixed.drain(groups.clone()).collect(),
            flags: self.flags.drain(groups).collect(),
        };
        shift(&mut taken.blocks, &mut taken.runs, |n, by| n - by, from);
        let gap = [0, 1, 2].map(|n| to[n] - from[n]);
        shift(
            &mut self.blocks[first..],
            &mut self.runs[runs.start..],
            |n, by| n - by,
            gap,
        );
        taken
    }

    /// Adds blocks behind all others: a sort must follow.
    pub fn append(&mut self, mut other: Self) {
        let end = [self.runs.len(), self.groups.len(), self.shapes.len()];
        shift(&mut other.blocks, &mut other.runs, |n, by| n + by, end);
        self.blocks.extend(other.blocks);
        self.runs.extend(other.runs);
        self.groups.extend(other.groups);
        self.memory.extend(other.memory);
        self.shapes.extend(other.shapes);
        self.motion.extend(other.motion);
        self.fixed.extend(other.fixed);
        self.flags.extend(other.flags);
    }

    /// Puts the particles of a field back that has none here.
    pub fn put_field(&mut self, mut other: Self) {
        let Some(field) = other.blocks.first().map(|b| b.field) else {
            return;
        };
        let first = self.blocks.partition_point(|b| b.field < field);
        let at = self.before(first);
        let [runs, groups, shapes] = at;
        let added = [other.runs.len(), other.groups.len(), other.shapes.len()];
        shift(
            &mut self.blocks[first..],
            &mut self.runs[runs..],
            |n, by| n + by,
            added,
        );
        shift(&mut other.blocks, &mut other.runs, |n, by| n + by, at);
        self.blocks.splice(first..first, other.blocks);
        self.runs.splice(runs..runs, other.runs);
        self.groups.splice(groups..groups, other.groups);
        self.memory.splice(groups..groups, other.memory);
        self.shapes.splice(shapes..shapes, other.shapes);
        self.motion.splice(groups..groups, other.motion);
        self.fixed.splice(groups..groups, other.fixed);
        self.flags.splice(groups..groups, other.flags);
    }

    /// What the blocks before this one own.
    fn before(&self, block: usize) -> Counts {
        let last = block.checked_sub(1).map(|n| &self.blocks[n]);
        let end = |own: fn(&Block) -> &Range<usize>| last.map_or(0, |block| own(block).end);
        [end(|b| &b.runs), end(|b| &b.groups), end(|b| &b.shapes)]
    }
}

/// Moves where blocks and runs say that their own begins and ends.
fn shift(blocks: &mut [Block], runs: &mut [Run], add: fn(usize, usize) -> usize, by: Counts) {
    let moved = |range: &mut Range<usize>, n: usize| {
        *range = add(range.start, by[n])..add(range.end, by[n]);
    };
    for block in blocks {
        moved(&mut block.runs, 0);
        moved(&mut block.groups, 1);
        moved(&mut block.shapes, 2);
    }
    for run in runs {
        moved(&mut run.groups, 1);
        moved(&mut run.shapes, 2);
    }
}
