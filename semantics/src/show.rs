//! Objects in colours with their names: a picture for a person to look at.

use std::path::Path;

use cosplat_raster::{
    Camera, Ellipse, Row, SIZE, Sink,
    camera::{Orbit, up_from_gravity},
};
use cosplat_scene::load::LoadedScene;
use glam::Vec3;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use rayon::prelude::*;

use crate::{SemanticsError, Splat};

/// What is behind everything.
const BACKGROUND: Vec3 = Vec3::splat(0.96);
/// Colour of Gaussians that belong to nothing, of marks and of letters.
const GREY: Vec3 = Vec3::splat(0.45);
/// Share of an object's colour in what is drawn; the rest is how light the Gaussian is itself.
const TINT: f32 = 0.7;
/// Height of a line of the legend [pixel].
const LINE: usize = 20;
/// Side of a colour's square in the legend [pixel].
const MARK: usize = 12;
/// Most lines of a legend; what is left is counted in the last.
const MAX_LINES: usize = 40;

/// Pixels of the picture of a scene, without its legend.
const SIZES: [u32; 2] = [960, 720];

/// Colours that are easy to tell apart, also for the colour-blind (M. Okabe and K. Ito, 2008).
const FIRST: [[f32; 3]; 6] = [
    [0.90, 0.62, 0.00],
    [0.34, 0.71, 0.91],
    [0.00, 0.62, 0.45],
    [0.94, 0.89, 0.26],
    [0.80, 0.47, 0.65],
    [0.00, 0.45, 0.70],
];

/// Colour of object `n`, RGB 0..=1; grey for -1.
pub fn color(n: i32) -> Vec3 {
    let Ok(n) = usize::try_from(n) else {
        return GREY;
    };
    if let Some(first) = FIRST.get(n) {
        return Vec3::from_array(*first);
    }
    // The golden ratio: no two hues are the same, and neighbours in number are far apart.
    let hue = (n as f32 * 0.618_034).fract() * 6.0;
    let ramp = |offset: f32| (((hue + offset) % 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0);
    let dark = if n % 2 == 0 { 0.9 } else { 0.6 };
    dark * (0.25 + 0.75 * Vec3::new(ramp(0.0), ramp(4.0), ramp(2.0)))
}

/// A picture, 8 bits per channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`, RGB.
    pub rgb: Vec<[u8; 3]>,
}

/// Sums of one strip.
struct Strip<'a> {
    color: &'a [Vec3],
    width: usize,
    left: usize,
    pixel: Vec<Vec3>,
}

impl Sink<u32> for Strip<'_> {
    fn begin_strip(&mut self, _: &[Ellipse<u32>]) {}

    fn begin_tile(&mut self, left: usize, _: usize) {
        self.left = left;
    }

    #[inline(always)]
    fn row(&mut self, _: usize, gaussian: u32, row: usize, weight: &Row) {
        let columns = SIZE.min(self.width - self.left);
        let line = &mut self.pixel[row * self.width + self.left..][..columns];
        for (pixel, weight) in line.iter_mut().zip(weight) {
            *pixel += *weight * self.color[gaussian as usize];
        }
    }

    fn end_tile(&mut self, transmittance: &[Row; SIZE]) {
        let columns = SIZE.min(self.width - self.left);
        for (row, passes) in transmittance.iter().enumerate() {
            let line = &mut self.pixel[row * self.width + self.left..][..columns];
            for (pixel, passes) in line.iter_mut().zip(passes) {
                *pixel += *passes * BACKGROUND;
            }
        }
    }
}

fn bytes(color: Vec3) -> [u8; 3] {
    (color.clamp(Vec3::ZERO, Vec3::ONE) * 255.0)
        .round()
        .to_array()
        .map(|level| level as u8)
}

/// The splat in `camera`, each Gaussian in the colour of its object (-1 for none).
pub fn picture(splat: &Splat, object: &[i32], camera: &Camera) -> Picture {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let colors: Vec<Vec3> = splat
        .color
        .iter()
        .zip(object)
        .map(|(own, object)| {
            let light = own.clamp(Vec3::ZERO, Vec3::ONE).element_sum() / 3.0;
            TINT * color(*object) + (1.0 - TINT) * light
        })
        .collect();
    let strips = (0..height.div_ceil(SIZE)).into_par_iter().map(|_| Strip {
        color: &colors,
        width,
        left: 0,
        pixel: vec![Vec3::ZERO; SIZE * width],
    });
    let strips = splat.project(camera).blend(strips);
    let pixels = strips.iter().flat_map(|strip| &strip.pixel);
    Picture {
        width,
        height,
        rgb: pixels.take(width * height).map(|p| bytes(*p)).collect(),
    }
}

/// The objects of a scene at their places, in colours, above their names.
pub fn scene(loaded: &LoadedScene) -> Picture {
    let scene = &loaded.scene;
    let splat = Splat::from(&scene.gaussians);
    let mut object = vec![-1; splat.len()];
    for (n, o) in scene.objects.iter().enumerate() {
        object[o.gaussians.clone()].fill(n as i32);
    }
    let up = up_from_gravity(scene.gravity);
    let camera = Camera::orbit(splat.bounds(), up, Orbit::default(), SIZES[0], SIZES[1]);
    let mut picture = picture(&splat, &object, &camera);
    let names = scene.objects.iter().enumerate();
    let entries = names.map(|(n, o)| (color(n as i32), o.name.clone()));
    picture.add_legend(&entries.collect::<Vec<_>>());
    picture
}

impl Picture {
    /// Adds a line below for each name, with its colour; letters beyond those of ASCII show as `?`.
    pub fn add_legend(&mut self, entries: &[(Vec3, String)]) {
        let shown = entries.len().min(MAX_LINES);
        let top = self.height;
        self.height += LINE * (shown + usize::from(shown < entries.len())) + LINE / 2;
        let white = [255; 3];
        self.rgb.resize(self.width * self.height, white);
        let margin = (LINE - MARK) / 2;
        for (n, (color, name)) in entries[..shown].iter().enumerate() {
            let line = top + LINE / 4 + n * LINE;
            for y in 0..MARK {
                for x in 0..MARK {
                    self.put(LINE / 2 + x, line + margin + y, bytes(*color));
                }
            }
            self.text(2 * LINE, line, name);
        }
        if shown < entries.len() {
            let rest = format!("and {} more", entries.len() - shown);
            self.text(2 * LINE, top + LINE / 4 + shown * LINE, &rest);
        }
    }

    fn put(&mut self, x: usize, y: usize, rgb: [u8; 3]) {
        if x < self.width && y < self.height {
            self.rgb[y * self.width + x] = rgb;
        }
    }

    fn text(&mut self, left: usize, top: usize, text: &str) {
        let (weight, size) = (FontWeight::Regular, RasterHeight::Size16);
        let step = get_raster_width(weight, size);
        for (n, letter) in text.chars().enumerate() {
            let glyph = get_raster(letter, weight, size).or_else(|| get_raster('?', weight, size));
            let Some(glyph) = glyph else { continue };
            for (y, row) in glyph.rows().enumerate() {
                for (x, ink) in row.iter().enumerate() {
                    let level = 255 - (u16::from(*ink) * 3 / 4) as u8;
                    self.put(left + n * step + x, top + 2 + y, [level; 3]);
                }
            }
        }
    }

    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// When the picture has no pixels.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.rgb.as_flattened())?;
        writer.finish()?;
        Ok(bytes)
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), SemanticsError> {
        let bytes = self.png();
        let bytes = bytes.map_err(|error| SemanticsError::format(path, error.to_string()))?;
        cosplat_files::write(path, bytes).map_err(SemanticsError::write(path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_show_in_their_colours_above_their_names() {
        let splat = Splat {
            position: vec![Vec3::new(-0.5, 0.0, 0.0), Vec3::new(0.5, 0.0, 0.0)],
            covariance: vec![[0.01, 0.0, 0.0, 0.01, 0.0, 0.01]; 2],
            opacity: vec![1.0; 2],
            color: vec![Vec3::ONE; 2],
            normal: vec![Vec3::Y; 2],
        };
        let bounds = [Vec3::new(-0.8, -0.3, -0.3), Vec3::new(0.8, 0.3, 0.3)];
        let orbit = Orbit {
            azimuth: 0.0,
            elevation: 0.0,
            ..Orbit::default()
        };
        let camera = Camera::orbit(bounds, Vec3::Y, orbit, 80, 40);
        let mut image = picture(&splat, &[1, -1], &camera);
        let at = |image: &Picture, place: Vec3| {
            let (x, y, _) = camera.project(place);
            image.rgb[y as usize * image.width + x as usize]
        };
        let shown = |object: i32| bytes(TINT * color(object) + (1.0 - TINT));
        let near = |a: [u8; 3], b: [u8; 3]| (0..3).all(|c| a[c].abs_diff(b[c]) < 8);
        assert!(near(at(&image, splat.position[0]), shown(1)));
        assert!(near(at(&image, splat.position[1]), shown(-1)));
        let legend = [
            (color(1), "cup".to_owned()),
            (color(-1), "\u{e9}".to_owned()),
        ];
        image.add_legend(&legend);
        assert_eq!(image.height, 40 + 2 * LINE + LINE / 2);
        let middle = |line: usize| (40 + LINE / 4 + line * LINE + LINE / 2) * 80 + LINE / 2 + 3;
        assert_eq!(image.rgb[middle(0)], bytes(color(1)));
        assert_eq!(image.rgb[middle(1)], bytes(GREY));
        // Something is written beside it.
        let written = &image.rgb[40 * 80..];
        assert!(
            written
                .iter()
                .filter(|p| p[0] < 100 && p[0] == p[1])
                .count()
                > 20
        );
        assert!(image.png().expect("a picture").starts_with(b"\x89PNG"));
    }
}
