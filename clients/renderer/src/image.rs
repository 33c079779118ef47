//! The finished picture in memory.

/// Picture of `width` x `height` pixels, sRGB, 8 bits per channel, rows from top to bottom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height][width][rgb]`.
    pub rgb: Vec<u8>,
}

impl Image {
    /// Colour of one pixel; `None` outside.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[u8; 3]> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let at = 3 * (y as usize * self.width as usize + x as usize);
        self.rgb.get(at..at + 3)?.try_into().ok()
    }

    /// The picture at half its size: each pixel the mean of 2 x 2.
    #[must_use]
    pub fn halved(&self) -> Image {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut rgb = Vec::with_capacity(3 * (width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                for channel in 0..3 {
                    let mut sum = 2;
                    for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let at = 3 * ((2 * y + j) * self.width + 2 * x + i) as usize + channel;
                        sum += u32::from(self.rgb[at]);
                    }
                    rgb.push((sum / 4) as u8);
                }
            }
        }
        Image { width, height, rgb }
    }

    /// Rows of pictures of the same size, with `gap` white pixels between them; of no size without pictures.
    pub fn mosaic(rows: &[Vec<Image>], gap: u32) -> Image {
        let first = rows.first().and_then(|row| row.first());
        let (w, h) = first.map_or((0, 0), |image| (image.width, image.height));
        let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
        let sum = |count: u32, length: u32| count * length + count.saturating_sub(1) * gap;
        let (width, height) = (sum(columns, w), sum(rows.len() as u32, h));
        let mut rgb = vec![255; 3 * (width * height) as usize];
        for (i, row) in rows.iter().enumerate() {
            for (j, image) in row.iter().enumerate() {
                for y in 0..h {
                    let to = (i as u32 * (h + gap) + y) * width + j as u32 * (w + gap);
                    let (to, from) = (3 * to as usize, 3 * (y * w) as usize);
                    let length = 3 * w as usize;
                    rgb[to..to + length].copy_from_slice(&image.rgb[from..from + length]);
                }
            }
        }
        Image { width, height, rgb }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAP: u32 = 2;

    fn plain(value: u8) -> Image {
        Image {
            width: 4,
            height: 2,
            rgb: vec![value; 24],
        }
    }

    #[test]
    fn a_mosaic_keeps_every_picture_in_its_place() {
        let all = Image::mosaic(&[vec![plain(1), plain(2)], vec![plain(3), plain(4)]], GAP);
        assert_eq!((all.width, all.height), (8 + GAP, 4 + GAP));
        assert_eq!(all.pixel(0, 0), Some([1; 3]));
        assert_eq!(all.pixel(all.width - 1, 1), Some([2; 3]));
        assert_eq!(all.pixel(3, all.height - 1), Some([3; 3]));
        assert_eq!(all.pixel(4, 0), Some([255; 3]));
        assert_eq!(all.pixel(all.width - 1, all.height - 1), Some([4; 3]));
    }

    #[test]
    fn half_the_size_has_the_mean_colour() {
        let mut image = plain(10);
        image.rgb[..3].copy_from_slice(&[50, 10, 10]);
        let half = image.halved();
        assert_eq!((half.width, half.height), (2, 1));
        assert_eq!(half.pixel(0, 0), Some([20, 10, 10]));
        assert_eq!(half.pixel(1, 0), Some([10; 3]));
    }
}
