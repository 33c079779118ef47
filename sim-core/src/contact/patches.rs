//! Patches: connected nodes of one pair, and the normals that their nodes agree on.

use rayon::prelude::*;

use super::sites::{ContactBlock, ContactBlocks, Node, coordinates, members};
use crate::mat3::{dot, unit};

/// Length of the mean normal of a patch from which on the patch counts as flat: its nodes within some 25 degrees.
const FLAT: f64 = 0.9;
/// Rounds of averaging over neighbours where a patch is not flat.
const ROUNDS: usize = 3;

/// Gives every node the normal of its patch, or, where the patch is curved, of its surroundings.
pub(super) fn smooth_normals(sites: &mut ContactBlocks) {
    let ContactBlocks { sites, nodes } = sites;
    let mut by_pair: Vec<&ContactBlock> = sites.iter().collect();
    // Stable: sums run in the order of places.
    by_pair.sort_by_key(|site| site.fields);
    let smoothed: Vec<(&[&ContactBlock], Vec<[f64; 3]>)> = by_pair
        .par_chunk_by(|a, b| a.fields == b.fields)
        .map(|pair| (pair, normals_of(pair, nodes)))
        .collect();
    for (pair, normals) in smoothed {
        let own = pair.iter().flat_map(|site| site.range());
        for (n, normal) in own.zip(normals) {
            nodes[n].normal = normal;
        }
    }
}

/// Normals of the nodes of one pair, site after site.
fn normals_of(pair: &[&ContactBlock], nodes: &[Node]) -> Vec<[f64; 3]> {
    let nodes: Vec<&Node> = pair.iter().flat_map(|site| &nodes[site.range()]).collect();
    let edges = edges(pair);
    let patches = Patches::new(nodes.len(), &edges);
    let weighted: Vec<[f64; 3]> = nodes
        .iter()
        .map(|node| node.normal.map(|n| node.weight() * n))
        .collect();
    let mut sums = vec![[0.0; 4]; nodes.len()];
    for (n, node) in nodes.iter().enumerate() {
        let sum = &mut sums[patches.of[n]];
        for a in 0..3 {
            sum[a] += weighted[n][a];
        }
        sum[3] += node.weight();
    }
    let flat = |sum: &[f64; 4]| {
        let [x, y, z, weight] = *sum;
        dot([x, y, z], [x, y, z]).sqrt() >= FLAT * weight
    };
    let mut local = vec![];
    if (0..nodes.len()).any(|n| !flat(&sums[patches.of[n]])) {
        local = weighted;
        for _ in 0..ROUNDS {
            let before = local.clone();
            for &[n, m] in &edges {
                for a in 0..3 {
                    local[n][a] += before[m][a];
                    local[m][a] += before[n][a];
                }
            }
        }
    }
    let normals = (0..nodes.len()).map(|n| {
        let sum = &sums[patches.of[n]];
        match flat(sum) {
            true => unit([sum[0], sum[1], sum[2]]),
            false => unit(local[n]),
        }
    });
    normals.collect()
}

/// Pairs of neighbours along the axes, numbered site after site.
fn edges(sites: &[&ContactBlock]) -> Vec<[usize; 2]> {
    let mut numbered = Vec::with_capacity(sites.len());
    let mut first = 0;
    for &site in sites {
        numbered.push((site, first));
        first += site.range().len();
    }
    let mut order = numbered.clone();
    order.sort_unstable_by_key(|(site, _)| site.index);
    let mut edges = Vec::with_capacity(3 * first);
    for &(site, first) in &numbered {
        for (axis, stride) in [16, 4, 1].into_iter().enumerate() {
            let mut index = site.index;
            index[axis] += 1;
            let next = order.binary_search_by_key(&index, |(site, _)| site.index);
            let next = next.ok().map(|place| order[place]);
            for at in members(site.mask) {
                let (other, to) = if coordinates(at)[axis] < 3 {
                    (Some((site, first)), at + stride)
                } else {
                    (next, at - 3 * stride)
                };
                if let Some((other, start)) = other.filter(|(other, _)| other.mask >> to & 1 == 1) {
                    edges.push([first + site.rank(at), start + other.rank(to)]);
                }
            }
        }
    }
    edges
}

/// Connected components.
struct Patches {
    /// Per node the first node of its patch.
    of: Vec<usize>,
}

impl Patches {
    fn new(count: usize, edges: &[[usize; 2]]) -> Self {
        let mut of: Vec<usize> = (0..count).collect();
        let root = |of: &mut Vec<usize>, mut n: usize| {
            while of[n] != n {
                of[n] = of[of[n]];
                n = of[n];
            }
            n
        };
        for &[n, m] in edges {
            let (n, m) = (root(&mut of, n), root(&mut of, m));
            of[n.max(m)] = n.min(m);
        }
        for n in 0..count {
            of[n] = root(&mut of, n);
        }
        Self { of }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{contact::sites::Node, grid::FieldPass};

    fn site(index: [i32; 3], mask: u64, first: usize) -> ContactBlock {
        ContactBlock {
            shared: 0,
            fields: [0, 1],
            index,
            blocks: [0, 1],
            mask,
            first,
            passes: [FieldPass::of(1.0); 2],
        }
    }

    fn node(at: usize, normal: [f64; 3]) -> Node {
        Node {
            at,
            mass: [2.0; 2],
            normal: unit(normal),
            gap: 0.0,
        }
    }

    /// And another patch its own.
    #[test]
    fn a_flat_patch_over_two_blocks_has_one_normal() {
        // Nodes 60..64 of one block end at its upper face along x; 12..16 of the next begin there.
        let mut sites = ContactBlocks {
            sites: vec![
                site([0, 0, 0], 0b1 << 60 | 0b1 << 1, 0),
                site([1, 0, 0], 0b1 << 12, 2),
            ],
            nodes: vec![
                node(1, [1.0, 0.0, 0.0]),
                node(60, [0.0, 0.3, 1.0]),
                node(12, [0.0, -0.3, 1.0]),
            ],
        };
        smooth_normals(&mut sites);
        assert_eq!(sites.nodes[0].normal, [1.0, 0.0, 0.0]);
        for n in [1, 2] {
            let [x, y, z] = sites.nodes[n].normal;
            assert!(x == 0.0 && y.abs() < 1e-15 && (z - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn a_curved_patch_keeps_the_directions_of_its_parts() {
        let nodes: Vec<Node> = (0..4)
            .map(|at| {
                let angle = f64::from(at) * 0.8;
                node(at as usize, [angle.cos(), angle.sin(), 0.0])
            })
            .collect();
        let mut sites = ContactBlocks {
            sites: vec![site([0; 3], 0b1111, 0)],
            nodes: nodes.clone(),
        };
        smooth_normals(&mut sites);
        // By hand: rounds of averaging make the weights 4, 5, 3, 1 at the ends, 0.83 off the first direction.
        let at_end = dot(sites.nodes[0].normal, nodes[0].normal);
        assert!((at_end.acos() - 0.83).abs() < 0.01, "{at_end}");
        assert!(dot(sites.nodes[0].normal, sites.nodes[3].normal) < 0.75);
    }
}
