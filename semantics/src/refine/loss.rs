//! Both terms of equation (1), with their gradients by the planes of a picture.
//!
//! `L_visual = (1 - l) L1 + l (1 - SSIM)` against the picture that was taken, with the window and constants of the training
//! of splats (Kerbl et al. 2023): 11 pixels of standard deviation 1.5, zeros outside. `L_semantic = 1 - cos` between what is
//! composited of the features and what the view says, in the mean over the pixels of which it says anything.

use rayon::prelude::*;

/// Standard deviation of the window of SSIM [pixel].
const SIGMA: f32 = 1.5;
/// Pixels of the window to either side.
const REACH: usize = 5;
/// Constants of SSIM for values 0..=1.
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;
/// Below this length what is composited of the features has no direction.
const LENGTH_MIN: f32 = 1e-3;

/// Mean of `(1 - dssim) |x - y| + dssim (1 - SSIM)` over the planes of `x` and `y`, each `[planes][pixels]` with rows of
/// `width`. Adds `scale` times its gradient by `x` to `gradient`.
pub fn visual(
    x: &[f32],
    y: &[f32],
    [width, pixels]: [usize; 2],
    dssim: f32,
    scale: f32,
    gradient: &mut [f32],
) -> f64 {
    let count = x.len().max(1) as f64;
    let each = scale / x.len().max(1) as f32;
    let mut sum = 0.0;
    let planes = x.chunks(pixels).zip(y.chunks(pixels));
    for ((x, y), gradient) in planes.zip(gradient.chunks_mut(pixels)) {
        let (similar, by_x) = ssim(x, y, width);
        let mut off = 0.0;
        for n in 0..x.len() {
            let difference = x[n] - y[n];
            off += f64::from(difference.abs());
            let sign = f32::from(i8::from(difference > 0.0) - i8::from(difference < 0.0));
            gradient[n] += each * ((1.0 - dssim) * sign - dssim * by_x[n]);
        }
        sum += f64::from(1.0 - dssim) * off + f64::from(dssim) * (x.len() as f64 - similar);
    }
    sum / count
}

/// Sum of SSIM over the pixels of a plane, and its gradient by `x`.
fn ssim(x: &[f32], y: &[f32], width: usize) -> (f64, Vec<f32>) {
    let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>();
    let blurred = |plane: &[f32]| blur(plane, width);
    let (mx, my) = (blurred(x), blurred(y));
    let (xx, yy, xy) = (
        blurred(&product(x, x)),
        blurred(&product(y, y)),
        blurred(&product(x, y)),
    );
    let mut sum = 0.0;
    let (mut by_mean, mut by_square, mut by_product) =
        (vec![0.0; x.len()], vec![0.0; x.len()], vec![0.0; x.len()]);
    for n in 0..x.len() {
        let (m, k) = (mx[n], my[n]);
        let (a1, a2) = (2.0 * m * k + C1, 2.0 * (xy[n] - m * k) + C2);
        let (b1, b2) = (
            m * m + k * k + C1,
            (xx[n] - m * m).max(0.0) + (yy[n] - k * k).max(0.0) + C2,
        );
        let inverse = 1.0 / (b1 * b2);
        let s = a1 * a2 * inverse;
        sum += f64::from(s);
        by_square[n] = -s / b2;
        by_product[n] = 2.0 * a1 * inverse;
        by_mean[n] = 2.0 * k * (a2 - a1) * inverse + 2.0 * m * (s / b2 - s / b1);
    }
    // The window is even, so the blur is its own transpose.
    let (by_mean, by_square, by_product) =
        (blurred(&by_mean), blurred(&by_square), blurred(&by_product));
    let by_x = |n: usize| by_mean[n] + 2.0 * x[n] * by_square[n] + y[n] * by_product[n];
    (sum, (0..x.len()).map(by_x).collect())
}

/// A plane blurred by the window along rows, then along columns.
fn blur(plane: &[f32], width: usize) -> Vec<f32> {
    let taps: [f32; 2 * REACH + 1] = std::array::from_fn(|k| {
        let off = (k as f32 - REACH as f32) / SIGMA;
        (-0.5 * off * off).exp()
    });
    let sum: f32 = taps.iter().sum();
    let taps = taps.map(|t| t / sum);
    let mut along = vec![0.0; plane.len()];
    let lines = along.par_chunks_mut(width).zip(plane.par_chunks(width));
    lines.for_each(|(out, line)| {
        for (at, out) in out.iter_mut().enumerate() {
            let first = at.saturating_sub(REACH);
            let end = (at + REACH + 1).min(width);
            let tap = &taps[first + REACH - at..];
            *out = line[first..end].iter().zip(tap).map(|(v, t)| v * t).sum();
        }
    });
    let height = plane.len() / width;
    let mut both = vec![0.0; plane.len()];
    both.par_chunks_mut(width)
        .enumerate()
        .for_each(|(at, out)| {
            let first = at.saturating_sub(REACH);
            for from in first..(at + REACH + 1).min(height) {
                let tap = taps[from + REACH - at];
                let line = &along[from * width..(from + 1) * width];
                for (out, value) in out.iter_mut().zip(line) {
                    *out += tap * value;
                }
            }
        });
    both
}

/// Mean of `1 - cos` over the pixels whose `target` is not 0, of planes `[channels][pixels]` each. Adds `scale` times its
/// gradient by `x` to `gradient`.
pub fn semantic(
    x: &[f32],
    target: &[f32],
    channels: usize,
    scale: f32,
    gradient: &mut [f32],
) -> f64 {
    let pixels = x.len() / channels.max(1);
    let dot = |a: &[f32], b: &[f32], pixel: usize| {
        (0..channels)
            .map(|c| a[c * pixels + pixel] * b[c * pixels + pixel])
            .sum::<f32>()
    };
    let lengths: Vec<f32> = (0..pixels).map(|p| dot(target, target, p).sqrt()).collect();
    let said = lengths.iter().filter(|l| **l > 0.0).count();
    let each = scale / said.max(1) as f32;
    let mut sum = 0.0;
    for (pixel, length) in lengths.iter().enumerate().filter(|(_, l)| **l > 0.0) {
        let own = dot(x, x, pixel).sqrt();
        if own < LENGTH_MIN {
            sum += 1.0;
            continue;
        }
        let cosine = dot(x, target, pixel) / (own * length);
        sum += 1.0 - f64::from(cosine);
        for channel in 0..channels {
            let at = channel * pixels + pixel;
            gradient[at] -= each * (target[at] / length - cosine * x[at] / own) / own;
        }
    }
    sum / said.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [23, 23 * 17];

    fn wave(k: usize, a: f32) -> f32 {
        0.5 + 0.3 * (k as f32 * a).sin() + 0.1 * (k as f32 * a * 7.3).cos()
    }

    /// Largest difference between a gradient and central differences, over the largest gradient.
    fn worst(x: &[f32], gradient: &[f32], value: impl Fn(&[f32]) -> f64) -> f64 {
        // A loss is a mean over all pixels in f64 of terms in f32: this step has the least error.
        let step = 2e-3;
        let largest = gradient.iter().fold(0.0f32, |l, g| l.max(g.abs()));
        let off = (0..x.len()).step_by(13).map(|n| {
            let mut other = x.to_vec();
            other[n] = x[n] + step;
            let above = value(&other);
            other[n] = x[n] - step;
            let slope = (above - value(&other)) / (2.0 * f64::from(step));
            (slope - f64::from(gradient[n])).abs() / f64::from(largest)
        });
        off.fold(0.0, f64::max)
    }

    #[test]
    fn the_visual_gradient_is_that_of_differences() {
        let x: Vec<f32> = (0..3 * SIZE[1]).map(|k| wave(k, 0.171)).collect();
        let y: Vec<f32> = (0..3 * SIZE[1]).map(|k| wave(k, 0.168) + 0.07).collect();
        // L1 has a kink where both are equal; the waves hardly are.
        for dssim in [0.0, 0.2, 1.0] {
            let mut gradient = vec![0.0; x.len()];
            visual(&x, &y, SIZE, dssim, 1.0, &mut gradient);
            let value = |x: &[f32]| visual(x, &y, SIZE, dssim, 0.0, &mut vec![0.0; x.len()]);
            let worst = worst(&x, &gradient, value);
            println!("dssim {dssim}: {worst:.1e}");
            assert!(worst < 1e-3, "{worst}");
        }
    }

    #[test]
    fn equal_pictures_have_no_loss_and_ssim_is_one() {
        let x: Vec<f32> = (0..3 * SIZE[1]).map(|k| wave(k, 0.3)).collect();
        let mut gradient = vec![0.0; x.len()];
        let loss = visual(&x, &x, SIZE, 0.5, 1.0, &mut gradient);
        assert!(loss.abs() < 1e-6, "{loss}");
        assert!(gradient.iter().all(|g| g.abs() < 1e-6));
    }

    #[test]
    fn the_semantic_gradient_is_that_of_differences() {
        let (channels, pixels) = (4, 60);
        let x: Vec<f32> = (0..channels * pixels).map(|k| wave(k, 0.7)).collect();
        let mut target: Vec<f32> = (0..channels * pixels).map(|k| wave(k, 1.1)).collect();
        // Of the first pixel nothing is said.
        (0..channels).for_each(|c| target[c * pixels] = 0.0);
        let mut gradient = vec![0.0; x.len()];
        semantic(&x, &target, channels, 1.0, &mut gradient);
        let value = |x: &[f32]| semantic(x, &target, channels, 0.0, &mut vec![0.0; x.len()]);
        let worst = worst(&x, &gradient, value);
        println!("{worst:.1e}");
        assert!(worst < 1e-3, "{worst}");
        assert!((0..channels).all(|c| gradient[c * pixels] == 0.0));
    }
}
