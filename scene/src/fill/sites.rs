//! Sites of a lattice that are filled in part: one particle each, with what is filled and its centroid.

/// Sites filled less than this are joined to a neighbour.
const SLIVER: f64 = 0.15;

/// Filled volume and first moment of one site.
#[derive(Clone, Copy, Default)]
pub(crate) struct Site {
    pub volume: f64,
    pub moment: [f64; 3],
}

impl Site {
    /// Adds a volume whose centroid is `x`.
    pub fn add(&mut self, x: [f64; 3], volume: f64) {
        self.volume += volume;
        for a in 0..3 {
            self.moment[a] += volume * x[a];
        }
    }
}

/// Of a lattice of `size` sites, the first axis fastest: hands sites with little of their volume `full` to the fullest face neighbour that has more; volume and centroid
/// are kept.
pub(crate) fn join_slivers(size: [usize; 3], sites: &mut [Site], full: f64) {
    let least = SLIVER * full;
    let strides = [1, size[0], size[0] * size[1]];
    for i in 0..sites.len() {
        let small = sites[i].volume;
        if small <= 0.0 || small >= least {
            continue;
        }
        let p: [usize; 3] = std::array::from_fn(|a| i / strides[a] % size[a]);
        let lower = (0..3).filter(|&a| p[a] > 0).map(|a| i - strides[a]);
        let upper = (0..3)
            .filter(|&a| p[a] + 1 < size[a])
            .map(|a| i + strides[a]);
        let fullest = lower
            .chain(upper)
            .filter(|&j| sites[j].volume > small)
            .max_by(|&a, &b| sites[a].volume.total_cmp(&sites[b].volume).then(b.cmp(&a)));
        if let Some(j) = fullest {
            let moved = std::mem::take(&mut sites[i]);
            sites[j].volume += moved.volume;
            for a in 0..3 {
                sites[j].moment[a] += moved.moment[a];
            }
        }
    }
}
