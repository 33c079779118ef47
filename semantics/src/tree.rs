//! Objects from nothing but the splat: superpoints by geometry and colour, and a tree over them in which a person or a rule
//! picks.
//!
//! Neighbours that touch are linked, except across the ground plane. Average linkage by colour and normal makes superpoints,
//! then everything that hangs together, with the height of every join. What does not touch is never joined. No recipe finds
//! the objects of every scene; the tree has most of them as nodes.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::{
    Splat,
    ground::{Ground, ground},
    lift::{Labels, fill_from_nearest},
    linkage::{Linkage, Votes, unlike},
    neighbours::{Neighbours, TOUCHING},
};

/// Height up to which Gaussians join to superpoints.
const ALIKE: f32 = 0.2;
/// Least Gaussians of a superpoint where it touches another.
const MIN_SUPERPOINT: usize = 30;
/// Share of a superpoint that must lie in the ground's plane for it to be of the ground.
const FLAT: f32 = 0.9;
/// Height up to which flat superpoints are one ground.
const ONE_GROUND: f32 = 0.5;
/// Ground that is less sure does not part what stands on it.
pub const SURE: f32 = 0.5;
/// Least share of all Gaussians that is taken for an object of its own.
const MIN_SHARE: f32 = 0.004;

/// Superpoints and how they join.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tree {
    /// Superpoint of each Gaussian.
    pub superpoint: Vec<u32>,
    /// Gaussians of each superpoint.
    pub size: Vec<u32>,
    /// Superpoints that touch: their numbers, votes that part them, all votes.
    pub touch: Vec<(u32, u32, [f32; 2])>,
    /// Joins, lowest first: the two nodes. Nodes are superpoints, then joins in their order.
    pub join: Vec<[u32; 2]>,
    /// Height of each join, 0..=1, never below those under it.
    pub height: Vec<f32>,
    /// The ground.
    pub ground: Option<Ground>,
    /// Whether each superpoint is of the ground.
    pub is_ground: Vec<bool>,
}

/// Votes between superpoints that touch.
fn touching(edges: &[(u32, u32, Votes)], superpoint: &[u32]) -> Vec<(u32, u32, [f32; 2])> {
    let mut links = BTreeMap::<(u32, u32), Votes>::new();
    for &(a, b, votes) in edges {
        let (a, b) = (superpoint[a as usize], superpoint[b as usize]);
        if a != b {
            links.entry((a.min(b), a.max(b))).or_default().add(votes);
        }
    }
    links
        .iter()
        .map(|(&(a, b), v)| (a, b, [v.parted, v.all]))
        .collect()
}

impl Tree {
    /// The tree of a splat.
    pub fn new(splat: &Splat) -> Self {
        let near = Neighbours::new(&splat.position, TOUCHING);
        let ground = ground(splat, 0.5 * near.spacing());
        let votes = |&(a, b): &(u32, u32)| {
            let parted = unlike(splat, a as usize, b as usize);
            (a, b, Votes { parted, all: 1.0 })
        };
        let pairs = near.touching(&splat.position);
        let edges: Vec<_> = pairs.par_iter().map(votes).collect();
        let mut linkage = Linkage::new(splat.len(), &edges);
        linkage.run(ALIKE);
        linkage.absorb(MIN_SUPERPOINT);
        let (superpoint, size) = linkage.regions();
        let mut tree = Tree {
            touch: touching(&edges, &superpoint),
            superpoint,
            size: size.iter().map(|s| *s as u32).collect(),
            is_ground: vec![false; size.len()],
            ground,
            ..Tree::default()
        };
        if let Some(plane) = ground.filter(|g| g.confidence >= SURE) {
            tree.is_ground = tree.lies_in(splat, &plane);
            let is_ground = &tree.is_ground;
            tree.touch
                .retain(|&(a, b, _)| is_ground[a as usize] == is_ground[b as usize]);
        }
        tree.join_all();
        tree
    }

    /// Superpoints that are the ground: the largest group of alike ones that lie in its plane. What stands on it may have a
    /// flat bottom in the plane too.
    fn lies_in(&self, splat: &Splat, plane: &Ground) -> Vec<bool> {
        let mut inside = vec![0u32; self.size.len()];
        for (position, superpoint) in splat.position.iter().zip(&self.superpoint) {
            inside[*superpoint as usize] += u32::from(plane.holds(*position));
        }
        let is_flat: Vec<bool> = inside
            .iter()
            .zip(&self.size)
            .map(|(inside, all)| *inside as f32 >= FLAT * *all as f32)
            .collect();
        let flat = |&&(a, b, _): &&(u32, u32, Votes)| is_flat[a as usize] && is_flat[b as usize];
        let edges: Vec<_> = self.edges().iter().filter(flat).copied().collect();
        let mut linkage = Linkage::new(self.size.len(), &edges);
        linkage.run(ONE_GROUND);
        let group: Vec<u32> = (0..self.size.len() as u32)
            .map(|s| linkage.find(s))
            .collect();
        let mut size = vec![0u32; self.size.len()];
        for (s, of) in group.iter().enumerate().filter(|(s, _)| is_flat[*s]) {
            size[*of as usize] += self.size[s];
        }
        let largest = (0..size.len()).max_by_key(|&g| (size[g], std::cmp::Reverse(g)));
        (0..group.len())
            .map(|s| is_flat[s] && Some(group[s] as usize) == largest)
            .collect()
    }

    fn edges(&self) -> Vec<(u32, u32, Votes)> {
        let votes = |[parted, all]: [f32; 2]| Votes { parted, all };
        self.touch
            .iter()
            .map(|&(a, b, v)| (a, b, votes(v)))
            .collect()
    }

    /// Linkage over the superpoints.
    pub(crate) fn linkage(&self, owner: Vec<i32>) -> Linkage {
        let size = self.size.iter().map(|s| *s as usize).collect();
        Linkage::new(self.size.len(), &self.edges()).owned(size, owner)
    }

    pub(crate) fn join_all(&mut self) {
        let count = self.size.len();
        let joins = self.linkage(vec![-1; count]).run(f32::INFINITY);
        let mut node: Vec<u32> = (0..count as u32).collect();
        let mut height = vec![0.0f32; count];
        for (kept, gone, at) in joins {
            let mut pair = [node[kept as usize], node[gone as usize]];
            pair.sort_unstable();
            node[kept as usize] = (count + self.join.len()) as u32;
            // A join may lower the mean towards a third region: heights are those of the tree.
            let at = pair
                .map(|n| height[n as usize])
                .into_iter()
                .fold(at, f32::max);
            height.push(at);
            self.join.push(pair);
            self.height.push(at);
        }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.size.len() + self.join.len()
    }

    /// Height of a node; 0 for superpoints.
    pub fn height_of(&self, node: usize) -> f32 {
        node.checked_sub(self.size.len())
            .map_or(0.0, |join| self.height[join])
    }

    /// The two nodes that a node joins; none of superpoints.
    pub fn children(&self, node: usize) -> Option<[usize; 2]> {
        let join = node.checked_sub(self.size.len())?;
        Some(self.join[join].map(|n| n as usize))
    }

    /// The node that each node is joined into.
    pub fn parents(&self) -> Vec<Option<usize>> {
        let mut parent = vec![None; self.nodes()];
        for (join, pair) in self.join.iter().enumerate() {
            pair.iter()
                .for_each(|n| parent[*n as usize] = Some(self.size.len() + join));
        }
        parent
    }

    /// Gaussians of every node.
    pub fn sizes(&self) -> Vec<usize> {
        let mut size: Vec<usize> = self.size.iter().map(|s| *s as usize).collect();
        for [a, b] in &self.join {
            size.push(size[*a as usize] + size[*b as usize]);
        }
        size
    }

    /// The highest nodes below `height`.
    pub fn level(&self, height: f32) -> Vec<usize> {
        let parent = self.parents();
        let is_below = |n: usize| n < self.size.len() || self.height_of(n) < height;
        (0..self.nodes())
            .filter(|&n| is_below(n) && parent[n].is_none_or(|p| !is_below(p)))
            .collect()
    }

    /// Superpoints of a node.
    pub fn leaves(&self, node: usize) -> Vec<usize> {
        let (mut open, mut found) = (vec![node], Vec::new());
        while let Some(n) = open.pop() {
            match self.children(n) {
                Some(parts) => open.extend(parts),
                None => found.push(n),
            }
        }
        found.sort_unstable();
        found
    }

    /// The object of each superpoint: `k` in node `nodes[k]`, the last one that holds it where they nest; -1 in none.
    pub fn of_nodes(&self, nodes: &[usize]) -> Vec<i32> {
        let mut of = vec![-1; self.size.len()];
        let mut order: Vec<usize> = (0..nodes.len()).collect();
        // A part after what it is part of.
        order.sort_by_key(|n| std::cmp::Reverse(nodes[*n]));
        for object in order {
            let leaves = self.leaves(nodes[object]);
            leaves.iter().for_each(|s| of[*s] = object as i32);
        }
        of
    }

    /// What hangs together and is no smaller than 0.4 % of the splat, with a name for each: the ground, then the largest.
    pub fn whole(&self) -> Vec<(usize, String)> {
        let size = self.sizes();
        let least = (MIN_SHARE * self.superpoint.len() as f32) as usize;
        let parent = self.parents();
        let is_whole = |n: &usize| parent[*n].is_none() && size[*n] >= least.max(1);
        let mut nodes: Vec<usize> = (0..self.nodes()).filter(is_whole).collect();
        let is_ground = |n: usize| self.leaves(n).iter().any(|s| self.is_ground[*s]);
        nodes.sort_by_key(|&n| (!is_ground(n), std::cmp::Reverse(size[n]), n));
        let mut count = 0;
        let name = |n: usize| {
            if is_ground(n) && count == 0 {
                return (n, "ground".to_owned());
            }
            count += 1;
            (n, format!("object_{count}"))
        };
        nodes.into_iter().map(name).collect()
    }

    /// Labels of all Gaussians from the objects of superpoints. One in none has the label of the nearest Gaussian that has one,
    /// with a confidence of 0.
    pub fn labels(&self, splat: &Splat, of: &[i32]) -> Labels {
        let object: Vec<i32> = self.superpoint.iter().map(|s| of[*s as usize]).collect();
        let mut labels = Labels {
            confidence: object
                .iter()
                .map(|o| if *o < 0 { 0.0 } else { 1.0 })
                .collect(),
            object,
        };
        fill_from_nearest(&mut labels, &splat.position);
        labels
    }
}
