//! Pictures: read, brought to the size that a network is made for, and to its levels.

use std::{fs::File, io::BufReader, path::Path};

use zune_jpeg::{
    JpegDecoder,
    zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions},
};

use crate::{FeaturesError, config::Shown};

/// Most bytes of the pixels of a picture.
const MOST_BYTES: usize = 1 << 30;

/// A picture: red, green and blue of every pixel, levels 0..=1.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`.
    pub level: Vec<[f32; 3]>,
}

/// Whether a file's name says that it is a picture which can be read.
pub fn is_picture(path: &Path) -> bool {
    let end = path.extension().and_then(|e| e.to_str());
    end.is_some_and(|e| ["png", "jpg", "jpeg"].contains(&e.to_ascii_lowercase().as_str()))
}

impl Picture {
    /// Reads a `.png` or a `.jpg`. What is transparent is black.
    ///
    /// # Errors
    /// When the file cannot be read or is damaged.
    pub fn read(path: &Path) -> Result<Self, FeaturesError> {
        let is_png = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("png"));
        let found = match is_png {
            true => png(path)?,
            false => jpeg(&std::fs::read(path).map_err(FeaturesError::read(path))?),
        };
        found.map_err(|why| FeaturesError::Picture {
            path: path.to_owned(),
            why,
        })
    }

    /// A picture of bytes: `channels` for each pixel, which are grey, grey and opacity, colours, or colours and opacity.
    fn of_bytes(width: usize, height: usize, channels: usize, data: &[u8]) -> Result<Self, String> {
        let level = |pixel: &[u8]| match *pixel {
            [v] => [f32::from(v) / 255.0; 3],
            [v, a] => [f32::from(v) / 255.0 * f32::from(a) / 255.0; 3],
            [r, g, b] => [r, g, b].map(|v| f32::from(v) / 255.0),
            [r, g, b, a] => [r, g, b].map(|v| f32::from(v) / 255.0 * f32::from(a) / 255.0),
            _ => [0.0; 3],
        };
        let level: Vec<[f32; 3]> = data.chunks_exact(channels.max(1)).map(level).collect();
        match level.len() == width * height && !level.is_empty() {
            true => Ok(Self {
                width,
                height,
                level,
            }),
            false => Err(format!(
                "has {} pixels, expected {width} x {height}",
                level.len()
            )),
        }
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The input of a network, `[3][rows][columns]`.
    pub fn shown(&self, how: &Shown) -> Vec<f32> {
        let [width, height] = how.size;
        let covered = how.covered(self.size());
        let level = self.stretched(covered[0], covered[1]);
        let mut input = vec![0.0; 3 * width * height];
        for (c, channel) in input.chunks_exact_mut(width * height).enumerate() {
            let scale = 1.0 / how.std[c];
            let rows = channel.chunks_exact_mut(width);
            for (row, level) in rows.zip(level.chunks_exact(covered[0])) {
                let values = row.iter_mut().zip(level);
                values.for_each(|(value, pixel)| *value = (pixel[c] - how.mean[c]) * scale);
            }
        }
        input
    }

    /// The picture at another size, by a triangle as wide as what a pixel stands for: smaller ones do not alias.
    pub fn stretched(&self, width: usize, height: usize) -> Vec<[f32; 3]> {
        if (width, height) == (self.width, self.height) {
            return self.level.clone();
        }
        let across = taps(self.width, width);
        let rows = self.level.chunks_exact(self.width);
        let narrow: Vec<Vec<[f32; 3]>> = rows
            .map(|row| across.iter().map(|of| mean(of, |k| row[k])).collect())
            .collect();
        let down = taps(self.height, height);
        let pixel = |n: usize| mean(&down[n / width], |k| narrow[k][n % width]);
        (0..width * height).map(pixel).collect()
    }
}

/// Which of `from` pixels each of `to` pixels is the mean of, by what weight: the first, then weights that sum to 1.
fn taps(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let scale = from as f64 / to as f64;
    let reach = scale.max(1.0);
    let of = |n: usize| {
        let center = (n as f64 + 0.5) * scale;
        let first = (center - reach + 0.5).floor().max(0.0) as usize;
        let end = ((center + reach + 0.5).floor() as usize).min(from);
        let weight = |k: usize| (1.0 - ((k as f64 + 0.5 - center) / reach).abs()).max(0.0);
        let sum: f64 = (first..end).map(weight).sum();
        let weights = (first..end).map(|k| (weight(k) / sum) as f32);
        (first, weights.collect())
    };
    (0..to).map(of).collect()
}

fn mean((first, weights): &(usize, Vec<f32>), level: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (n, weight) in weights.iter().enumerate() {
        let level = level(first + n);
        sum.iter_mut()
            .zip(level)
            .for_each(|(sum, level)| *sum += weight * level);
    }
    sum
}

fn png(path: &Path) -> Result<Result<Picture, String>, FeaturesError> {
    let file = File::open(path).map_err(FeaturesError::read(path))?;
    Ok(decoded_png(BufReader::new(file)))
}

fn decoded_png(file: BufReader<File>) -> Result<Picture, String> {
    let mut decoder = png::Decoder::new_with_limits(file, png::Limits { bytes: MOST_BYTES });
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder
        .read_info()
        .map_err(|error| format!("no PNG picture: {error}"))?;
    let size = reader
        .output_buffer_size()
        .filter(|size| *size <= MOST_BYTES);
    let mut data = vec![0; size.ok_or("a picture that is too large")?];
    let info = reader
        .next_frame(&mut data)
        .map_err(|error| format!("a damaged PNG picture: {error}"))?;
    let (width, height) = (info.width as usize, info.height as usize);
    let data = &data[..info.buffer_size()];
    Picture::of_bytes(width, height, info.color_type.samples(), data)
}

fn jpeg(bytes: &[u8]) -> Result<Picture, String> {
    // Strict: half of a file is half of a picture otherwise, and the rest is grey.
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let data = decoder
        .decode()
        .map_err(|error| format!("no JPEG picture, or a damaged one: {error}"))?;
    let (width, height) = decoder
        .dimensions()
        .ok_or("a JPEG picture without a size")?;
    Picture::of_bytes(width, height, 3, &data)
}
