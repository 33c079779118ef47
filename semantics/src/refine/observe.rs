//! From files to what a view shows: the picture that was taken, and what its pixels belong to.

use std::{io::BufReader, path::Path};

use cosplat_files::reading;

use crate::{MaskMap, SemanticsError, View, refine::Observation};

/// Most bytes of a picture's pixels.
const LARGEST: usize = 1 << 30;

impl View {
    /// The view in a picture whose longer side has at most `longest` pixels.
    #[must_use]
    pub fn scaled(&self, longest: u32) -> View {
        let camera = self.camera;
        let side = camera.width.max(camera.height);
        if side <= longest.max(1) {
            return self.clone();
        }
        let size = [camera.width, camera.height];
        let [width, height] = size.map(|s| {
            (f64::from(s) * f64::from(longest.max(1)) / f64::from(side))
                .round()
                .max(1.0) as u32
        });
        let ratio = [
            width as f32 / size[0] as f32,
            height as f32 / size[1] as f32,
        ];
        View {
            name: self.name.clone(),
            camera: cosplat_raster::Camera {
                width,
                height,
                focal: [camera.focal[0] * ratio[0], camera.focal[1] * ratio[1]],
                center: [camera.center[0] * ratio[0], camera.center[1] * ratio[1]],
                ..camera
            },
        }
    }
}

/// Reads a picture in the size of `view`: `[3][height][width]`, 0..=1. A larger one is averaged over each pixel's area; what
/// is transparent shows `background`.
///
/// # Errors
/// When the file cannot be read, is no PNG picture, or is of another shape than the view.
pub fn picture(path: &Path, view: &View, background: [f32; 3]) -> Result<Vec<f32>, SemanticsError> {
    let wrong = |why: String| SemanticsError::format(path, why);
    let file = reading::open(path, reading::LARGEST_DATA).map_err(SemanticsError::read(path))?;
    let limits = png::Limits { bytes: LARGEST };
    let mut decoder = png::Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|error| {
        wrong(format!(
            "no PNG picture ({error}); other formats are converted by `mogrify -format png`"
        ))
    })?;
    let length = reader.output_buffer_size().unwrap_or(usize::MAX);
    if length > LARGEST {
        let (width, height) = (reader.info().width, reader.info().height);
        return Err(wrong(format!(
            "has {width} x {height} pixels, expected at most {LARGEST} bytes of them"
        )));
    }
    let mut data = vec![0; length];
    let info = reader
        .next_frame(&mut data)
        .map_err(|error| wrong(format!("a damaged PNG picture: {error}")))?;
    let from = [info.width as usize, info.height as usize];
    let to = [view.camera.width as usize, view.camera.height as usize];
    // Rounding of a scaled size moves a side by half a pixel.
    let off = (from[0] * to[1]).abs_diff(from[1] * to[0]);
    if off > from[0].max(from[1]) {
        return Err(wrong(format!(
            "has {} x {} pixels, expected the shape of its camera, {} x {}",
            from[0], from[1], to[0], to[1]
        )));
    }
    let samples = info.color_type.samples();
    let color = |x: usize, y: usize| {
        let at = (y * from[0] + x) * samples;
        let pixel = data[at..at + samples].iter().map(|v| f32::from(*v) / 255.0);
        let pixel: Vec<f32> = pixel.collect();
        let (rgb, alpha) = match *pixel.as_slice() {
            [v] => ([v; 3], 1.0),
            [v, a] => ([v; 3], a),
            [r, g, b, a] => ([r, g, b], a),
            _ => ([pixel[0], pixel[1], pixel[2]], 1.0),
        };
        std::array::from_fn::<f32, 3, _>(|c| rgb[c] * alpha + background[c] * (1.0 - alpha))
    };
    let range = |k: usize, axis: usize| {
        let first = k * from[axis] / to[axis];
        first..((k + 1) * from[axis] / to[axis]).max(first + 1)
    };
    let mut planes = vec![0.0; 3 * to[0] * to[1]];
    for pixel in 0..to[0] * to[1] {
        let (columns, rows) = (range(pixel % to[0], 0), range(pixel / to[0], 1));
        let mut sum = [0.0; 3];
        for (x, y) in rows
            .clone()
            .flat_map(|y| columns.clone().map(move |x| (x, y)))
        {
            let color = color(x, y);
            (0..3).for_each(|c| sum[c] += color[c]);
        }
        let count = (rows.len() * columns.len()) as f32;
        (0..3).for_each(|c| planes[c * to[0] * to[1] + pixel] = sum[c] / count);
    }
    Ok(planes)
}

/// What a view shows, from its picture and its mask of `objects` objects; a mask of another size is resized.
///
/// # Errors
/// Those of [`picture`].
pub fn observe(
    view: &View,
    path: &Path,
    mask: &MaskMap,
    objects: usize,
    background: [f32; 3],
) -> Result<Observation, SemanticsError> {
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let mut feature = vec![0.0; objects * width * height];
    for (pixel, object) in mask.resized(width, height).mask.iter().enumerate() {
        let object = usize::try_from(*object).ok().filter(|o| *o < objects);
        if let Some(object) = object {
            feature[object * width * height + pixel] = 1.0;
        }
    }
    Ok(Observation {
        picture: picture(path, view, background)?,
        feature,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::spiral;
    use glam::Vec3;

    #[test]
    fn pictures_are_averaged_and_other_shapes_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        let mut encoder = png::Encoder::new(std::fs::File::create(&path).expect("a file"), 4, 2);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().expect("a header");
        // The left half is red and white, the right half is transparent.
        let [red, white, none] = [[255, 0, 0, 255], [255; 4], [0; 4]];
        let rows = [red, white, none, none, white, red, none, none];
        writer
            .write_image_data(rows.as_flattened())
            .expect("written");
        drop(writer);
        let view = &spiral([-Vec3::ONE, Vec3::ONE], Vec3::Y, 1, 4, 2)[0];
        let small = view.scaled(2);
        assert_eq!((small.camera.width, small.camera.height), (2, 1));
        assert!((small.camera.focal[0] - 0.5 * view.camera.focal[0]).abs() < 1e-6);
        let planes = picture(&path, &small, [0.25; 3]).expect("a picture");
        assert_eq!(planes, [1.0, 0.25, 0.5, 0.25, 0.5, 0.25]);
        let other = &spiral([-Vec3::ONE, Vec3::ONE], Vec3::Y, 1, 4, 4)[0];
        let error = picture(&path, other, [0.0; 3]).expect_err("another shape");
        assert!(error.to_string().contains("4 x 2") && error.to_string().contains("4 x 4"));
        std::fs::write(&path, "no picture").expect("written");
        assert!(picture(&path, view, [0.0; 3]).is_err());
    }
}
