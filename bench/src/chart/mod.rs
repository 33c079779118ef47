//! Charts of measurements as SVG: work against precision on logarithmic axes, and maps of fields.
//!
//! Everything is drawn in pixels of its own picture, readable on light and dark pages, with the machine, commit and
//! flags in the caption; [`csv`] writes the figures beside it.

mod draw;
mod heat;
mod loglog;
#[cfg(test)]
mod tests;
mod theme;

pub use heat::{Class, HeatMap, HeatPanel};
pub use loglog::{Emphasis, Figure, Panel, Point, Series};

/// Indices of the points that no other point beats in both coordinates (smaller is better), from left to right.
/// Points with a coordinate that is not finite are never among them.
pub fn pareto(points: &[[f64; 2]]) -> Vec<usize> {
    let finite = |i: &usize| points[*i].iter().all(|c| c.is_finite());
    let mut order: Vec<usize> = (0..points.len()).filter(finite).collect();
    order.sort_by(|&a, &b| {
        let [a, b] = [points[a], points[b]];
        a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i][1] < best;
        best = best.min(points[i][1]);
        better
    });
    order
}

/// By which factor a point is more expensive than the front at its own error: the ratio of its first coordinate to
/// the smallest one among points whose second is not larger. 1 on the front.
pub fn cost_over_front(points: &[[f64; 2]], at: usize) -> f64 {
    let [cost, error] = points[at];
    let as_good = points
        .iter()
        .filter(|p| p[0].is_finite() && p[1] <= error)
        .map(|p| p[0]);
    cost / as_good.fold(cost, f64::min)
}

/// Lines of comma-separated values; fields with commas, quotes or line ends are quoted.
pub fn csv(header: &[&str], rows: &[Vec<String>]) -> String {
    let field = |text: &str| {
        if text.contains([',', '"', '\n']) {
            format!("\"{}\"", text.replace('"', "\"\""))
        } else {
            text.to_owned()
        }
    };
    let line = |fields: Vec<String>| fields.join(",") + "\n";
    let mut text = line(header.iter().map(|f| field(f)).collect());
    for row in rows {
        text += &line(row.iter().map(|f| field(f)).collect());
    }
    text
}
