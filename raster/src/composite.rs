//! Pictures of any number of values per Gaussian: colours, features.

use rayon::prelude::*;

use crate::{Ellipse, Row, SIZE, Sink, Splats};

/// Values composited at every pixel, and what passes there.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values per Gaussian, and per pixel.
    pub channels: usize,
    /// `[channels + 1][height][width]`: sums of weight times value, last the light that passes all Gaussians, 0..=1.
    pub planes: Vec<f32>,
}

impl Picture {
    /// One plane, `[height][width]`; plane `channels` is what passes.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let pixels = self.width * self.height;
        &self.planes[channel * pixels..(channel + 1) * pixels]
    }
}

/// Composites `values`, `[gaussians][channels]`, with the weights of each Gaussian at each pixel.
///
/// Equal input gives equal bits for any number of threads and any instruction set.
pub fn composite(splats: &Splats<u32>, values: &[f32], channels: usize) -> Picture {
    let [width, height] = splats.size();
    let stride = width.next_multiple_of(SIZE);
    let strips = (0..height.div_ceil(SIZE)).into_par_iter().map(|_| Strip {
        values,
        channels,
        stride,
        left: 0,
        gaussian: Vec::new(),
        sums: vec![0.0; (channels + 1) * SIZE * stride],
    });
    let strips = splats.blend(strips);
    let mut planes = vec![0.0; (channels + 1) * width * height];
    planes
        .par_chunks_mut((width * height).max(1))
        .enumerate()
        .for_each(|(channel, plane)| {
            for (y, line) in plane.chunks_mut(width).enumerate() {
                let from = (channel * SIZE + y % SIZE) * stride;
                line.copy_from_slice(&strips[y / SIZE].sums[from..from + width]);
            }
        });
    Picture {
        width,
        height,
        channels,
        planes,
    }
}

/// Sums of one strip of tiles.
struct Strip<'a> {
    values: &'a [f32],
    channels: usize,
    /// Pixels per row, whole tiles.
    stride: usize,
    left: usize,
    gaussian: Vec<u32>,
    /// `[channels + 1][SIZE][stride]`.
    sums: Vec<f32>,
}

impl Sink<u32> for Strip<'_> {
    fn begin_strip(&mut self, ellipses: &[Ellipse<u32>]) {
        self.gaussian = ellipses.iter().map(|e| e.payload).collect();
    }

    fn begin_tile(&mut self, left: usize, _: usize) {
        self.left = left;
    }

    #[inline(always)]
    fn row(&mut self, place: usize, _: u32, row: usize, weight: &Row) {
        let first = self.gaussian[place] as usize * self.channels;
        let values = &self.values[first..first + self.channels];
        for (channel, value) in values.iter().enumerate() {
            let at = (channel * SIZE + row) * self.stride + self.left;
            let line = &mut self.sums[at..at + SIZE];
            for lane in 0..SIZE {
                line[lane] += value * weight[lane];
            }
        }
    }

    fn end_tile(&mut self, transmittance: &[Row; SIZE]) {
        for (row, line) in transmittance.iter().enumerate() {
            let at = (self.channels * SIZE + row) * self.stride + self.left;
            self.sums[at..at + SIZE].copy_from_slice(line);
        }
    }
}
