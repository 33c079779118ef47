//! One Gaussian from stored to activated values and back; the checks that every format shares.

use rayon::prelude::*;

use super::{Gaussians, MAX_LENGTH, MIN_SCALE, ReadReport};

/// Value of the zeroth spherical harmonic, `1 / (2 sqrt(pi))`.
pub const SH_C0: f32 = 0.282_094_8;

/// Logit written for opacity 1: the smallest round number whose sigmoid is exactly 1 in `f32`.
const LOGIT_ONE: f32 = 20.0;
/// Logit written for opacity 0: its sigmoid is exactly 0 in `f32`.
const LOGIT_ZERO: f32 = -110.0;

/// `exp` rounded from double precision, so that every machine reads the same bits.
pub fn exp(x: f32) -> f32 {
    f64::from(x).exp() as f32
}

/// Inverse of [`exp`].
pub fn ln(x: f32) -> f32 {
    f64::from(x).ln() as f32
}

/// Logistic function; exact at both infinities.
pub fn sigmoid(x: f32) -> f32 {
    (1.0 / (1.0 + (-f64::from(x)).exp())) as f32
}

/// Inverse of [`sigmoid`]; finite for 0 and 1, such that `sigmoid(logit(a)) == a` there.
pub fn logit(a: f32) -> f32 {
    if a <= 0.0 {
        LOGIT_ZERO
    } else if a >= 1.0 {
        LOGIT_ONE
    } else {
        let a = f64::from(a);
        (a / (1.0 - a)).ln() as f32
    }
}

/// One Gaussian as its format's reader hands it over, apart from colours and features.
pub struct Parsed {
    pub position: [f64; 3],
    /// Linear.
    pub scale: [f32; 3],
    /// xyzw, of any length.
    pub rotation: [f32; 4],
    pub opacity: f32,
}

/// What a row has.
pub struct Widths {
    /// Its length [byte].
    pub row: usize,
    /// Degree of its spherical harmonics.
    pub sh_degree: u8,
    /// Length of its feature vector.
    pub features: usize,
    /// Whether its position is in double precision, which is kept besides.
    pub is_exact: bool,
}

/// Decodes rows in parallel. `decode` fills the spherical harmonics and the features of
/// one Gaussian and returns the rest; bad Gaussians are left out and counted.
pub fn decode_rows(
    rows: &[u8],
    widths: &Widths,
    decode: impl Fn(&[u8], &mut [f32], &mut [f32]) -> Parsed + Sync,
) -> (Gaussians, ReadReport) {
    const ROWS_PER_TASK: usize = 4096;
    let &Widths {
        row,
        sh_degree,
        features: feature_dim,
        is_exact,
    } = widths;
    let count = rows.len() / row;
    let mut g = Gaussians {
        sh_degree,
        feature_dim: feature_dim as u32,
        ..Gaussians::default()
    };
    let stride = g.sh_stride();
    // Fresh zeroed memory comes from the system without being touched here.
    g.position = vec![[0.0; 3]; count];
    g.scale = vec![[0.0; 3]; count];
    g.rotation = vec![[0.0; 4]; count];
    g.opacity = vec![0.0; count];
    g.sh = vec![0.0; count * stride];
    g.feature = vec![0.0; count * feature_dim];
    let mut exact = vec![[0.0; 3]; if is_exact { count } else { 0 }];
    let mut keep = vec![false; count];
    let tasks = count.div_ceil(ROWS_PER_TASK);
    let features = split(&mut g.feature, feature_dim * ROWS_PER_TASK, tasks);
    let exacts = split(&mut exact, ROWS_PER_TASK, tasks);
    let reports = rows
        .par_chunks(row * ROWS_PER_TASK)
        .zip(g.position.par_chunks_mut(ROWS_PER_TASK))
        .zip(g.scale.par_chunks_mut(ROWS_PER_TASK))
        .zip(g.rotation.par_chunks_mut(ROWS_PER_TASK))
        .zip(g.opacity.par_chunks_mut(ROWS_PER_TASK))
        .zip(g.sh.par_chunks_mut(ROWS_PER_TASK * stride))
        .zip(features.into_par_iter())
        .zip(exacts.into_par_iter())
        .zip(keep.par_chunks_mut(ROWS_PER_TASK))
        .map(
            |((((((((rows, position), scale), rotation), opacity), sh), feature), exact), keep)| {
                let mut report = ReadReport::default();
                for (i, bytes) in rows.chunks_exact(row).enumerate() {
                    let sh = &mut sh[i * stride..(i + 1) * stride];
                    let feature = &mut feature[i * feature_dim..(i + 1) * feature_dim];
                    let mut one = decode(bytes, sh, feature);
                    keep[i] = check(&mut one, sh, feature, &mut report);
                    position[i] = one.position.map(|x| x as f32);
                    if let Some(exact) = exact.get_mut(i) {
                        *exact = one.position;
                    }
                    scale[i] = one.scale;
                    rotation[i] = one.rotation;
                    opacity[i] = one.opacity;
                }
                report
            },
        )
        .collect::<Vec<_>>();
    let mut report = ReadReport {
        count,
        ..ReadReport::default()
    };
    for part in reports {
        report.flat_scales_raised += part.flat_scales_raised;
        report.dropped.not_finite += part.dropped.not_finite;
        report.dropped.zero_rotation += part.dropped.zero_rotation;
        report.dropped.out_of_range += part.dropped.out_of_range;
    }
    if report.dropped.total() > 0 {
        report.left_out = (0..count).filter(|&row| !keep[row]).collect();
        retain(&mut g.position, &keep, 1);
        retain(&mut g.scale, &keep, 1);
        retain(&mut g.rotation, &keep, 1);
        retain(&mut g.opacity, &keep, 1);
        retain(&mut g.sh, &keep, stride);
        retain(&mut g.feature, &keep, feature_dim);
        if is_exact {
            retain(&mut exact, &keep, 1);
        }
    }
    report.exact = exact;
    (g, report)
}

/// Normalises and bounds one Gaussian; false, with the cause counted, if it is unusable.
fn check(one: &mut Parsed, sh: &[f32], feature: &[f32], report: &mut ReadReport) -> bool {
    // Multiplying by zero keeps zeros and turns everything that is not finite into NaN.
    let probe = |values: &[f32]| values.iter().fold(0.0f32, |sum, v| sum + v * 0.0);
    let is_somewhere = one.position.iter().all(|x| x.is_finite());
    let numbers = probe(&one.rotation) + probe(sh) + probe(feature);
    let length = one
        .rotation
        .iter()
        .map(|q| f64::from(*q) * f64::from(*q))
        .sum::<f64>()
        .sqrt();
    if !is_somewhere
        || numbers.is_nan()
        || one.opacity.is_nan()
        || one.scale.iter().any(|s| s.is_nan())
    {
        report.dropped.not_finite += 1;
    } else if length < 1e-12 {
        report.dropped.zero_rotation += 1;
    } else if one.position.iter().any(|p| p.abs() > f64::from(MAX_LENGTH))
        || one.scale.iter().any(|s| !(0.0..=MAX_LENGTH).contains(s))
    {
        report.dropped.out_of_range += 1;
    } else {
        report.flat_scales_raised += one.scale.iter().filter(|s| **s < MIN_SCALE).count();
        one.scale = one.scale.map(|s| s.max(MIN_SCALE));
        one.rotation = one.rotation.map(|q| (f64::from(q) / length) as f32);
        return true;
    }
    false
}

/// `parts` chunks of `size`, also when `size` is 0.
fn split<T>(mut values: &mut [T], size: usize, parts: usize) -> Vec<&mut [T]> {
    (0..parts)
        .map(|_| {
            let all = std::mem::take(&mut values);
            let (part, rest) = all.split_at_mut(size.min(all.len()));
            values = rest;
            part
        })
        .collect()
}

fn retain<T: Copy>(values: &mut Vec<T>, keep: &[bool], stride: usize) {
    let mut end = 0;
    for (i, _) in keep.iter().enumerate().filter(|(_, keep)| **keep) {
        values.copy_within(i * stride..(i + 1) * stride, end);
        end += stride;
    }
    values.truncate(end);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacity_survives_a_round_trip() {
        // Storing the logit rounds it to 24 bits, which moves the opacity by |logit| a (1 - a) 2^-24: that, plus
        // one rounding of the result, is the whole error.
        for step in 0..=100_000u32 {
            let a = step as f32 / 100_000.0;
            let back = sigmoid(logit(a));
            let allowed = (logit(a).abs() * a * (1.0 - a) + a) * f32::EPSILON;
            assert!((back - a).abs() <= allowed, "{a} came back as {back}");
        }
        for a in [0.0, 1.0, f32::MIN_POSITIVE, 1e-30, 1.0 - f32::EPSILON / 2.0] {
            let back = sigmoid(logit(a));
            assert!(
                (back - a).abs() <= a * 90.0 * f32::EPSILON,
                "{a:e} came back as {back:e}"
            );
        }
        assert_eq!(sigmoid(f32::INFINITY), 1.0);
        assert_eq!(sigmoid(f32::NEG_INFINITY), 0.0);
    }

    #[test]
    fn scale_survives_a_round_trip() {
        // ln s is stored with relative error 2^-24, so s comes back within |ln s| 2^-24 plus one rounding.
        let mut s = 1e-12f32;
        while s < 1e9 {
            let back = exp(ln(s));
            let allowed = s * (ln(s).abs() + 1.0) * f32::EPSILON;
            assert!((back - s).abs() <= allowed, "{s:e} came back as {back:e}");
            s *= 1.37;
        }
    }
}
