//! COLMAP models, text and binary: `cameras` and `images` of a folder such as `sparse/0`.
//!
//! Its poses are world to camera with axes right, down, forward. Layouts: the format page of COLMAP's documentation.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use glam::{DMat3, DQuat, DVec3};

use crate::{
    SemanticsError, View,
    views::{Pinhole, stem},
};

/// Camera models by their number in binary files.
const MODELS: [&str; 11] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
];

/// A picture of a model.
struct Image {
    name: String,
    camera: u32,
    /// Camera from world, w x y z.
    rotation: [f64; 4],
    translation: [f64; 3],
}

/// Whether a folder holds a model.
pub fn is_model(folder: &Path) -> bool {
    ["cameras.bin", "cameras.txt"]
        .iter()
        .any(|name| folder.join(name).is_file())
}

/// How the files of a model are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// `cameras.txt`, `images.txt`.
    Text,
    /// `cameras.bin`, `images.bin`.
    Binary,
}

impl Form {
    /// The files of cameras and of pictures.
    fn files(self, folder: &Path) -> [PathBuf; 2] {
        let extension = match self {
            Self::Text => "txt",
            Self::Binary => "bin",
        };
        ["cameras", "images"].map(|name| folder.join(format!("{name}.{extension}")))
    }
}

/// Reads the views of a model, sorted by name. Binary files go before text where both are there, as in COLMAP.
///
/// # Errors
/// When a file cannot be read, is damaged, or a camera bends its picture.
pub fn read(folder: &Path) -> Result<Vec<View>, SemanticsError> {
    let is_binary = folder.join("cameras.bin").is_file();
    let form = if is_binary { Form::Binary } else { Form::Text };
    let [cameras, images] = form.files(folder);
    parse(
        folder,
        form,
        [
            &SemanticsError::content(&cameras)?,
            &SemanticsError::content(&images)?,
        ],
    )
}

/// As [`read`], from the bytes of the files of cameras and of pictures in `folder`.
///
/// # Errors
/// When a file is damaged or a camera bends its picture.
pub fn parse(folder: &Path, form: Form, bytes: [&[u8]; 2]) -> Result<Vec<View>, SemanticsError> {
    let [cameras, images] = form.files(folder);
    let of = |path, why: String| SemanticsError::format(path, why);
    let (found, pictures) = match form {
        Form::Binary => (
            binary_cameras(bytes[0]).map_err(|why| of(&cameras, why))?,
            binary_images(bytes[1]).map_err(|why| of(&images, why))?,
        ),
        Form::Text => {
            let text = |path, bytes| {
                std::str::from_utf8(bytes).map_err(|error| of(path, format!("no text: {error}")))
            };
            (
                text_cameras(text(&cameras, bytes[0])?).map_err(|why| of(&cameras, why))?,
                text_images(text(&images, bytes[1])?).map_err(|why| of(&images, why))?,
            )
        }
    };
    let mut lenses = BTreeMap::new();
    for (id, camera) in found {
        let lens = camera
            .pinhole()
            .map_err(|model| SemanticsError::Distorted {
                path: cameras.clone(),
                camera: id.to_string(),
                model,
            })?;
        if let Some(fault) = lens.fault() {
            return Err(of(&cameras, format!("camera {id}: {fault}")));
        }
        lenses.insert(id, lens);
    }
    let view = |image: &Image| {
        let wrong = |why: String| of(&images, format!("{}: {why}", image.name));
        let lens = lenses
            .get(&image.camera)
            .ok_or_else(|| wrong(format!("camera {} is not among the cameras", image.camera)))?;
        let [w, x, y, z] = image.rotation;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let translation = DVec3::from(image.translation);
        let length = rotation.length();
        let world_from_camera = DMat3::from_quat(rotation.normalize()).transpose();
        let position = -(world_from_camera * translation).as_vec3();
        if !(length.is_finite() && length > 1e-9 && position.is_finite()) {
            return Err(wrong("its pose is no rotation and place".into()));
        }
        Ok(View {
            name: stem(&image.name),
            camera: lens.camera(position, world_from_camera.as_mat3()),
        })
    };
    let mut views: Vec<View> = pictures.iter().map(view).collect::<Result<_, _>>()?;
    views.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(views)
}

/// A camera as the file has it.
struct Lens {
    model: String,
    size: [u64; 2],
    parameters: Vec<f64>,
}

impl Lens {
    /// The camera; the name of its model where that is none that we draw.
    fn pinhole(&self) -> Result<Pinhole, String> {
        let p: Vec<f32> = self.parameters.iter().map(|x| *x as f32).collect();
        let (focal, center) = match (self.model.as_str(), &p[..]) {
            ("SIMPLE_PINHOLE", [f, cx, cy]) => ([*f, *f], [*cx, *cy]),
            ("PINHOLE", [fx, fy, cx, cy]) => ([*fx, *fy], [*cx, *cy]),
            _ => return Err(format!("{} with {} parameters", self.model, p.len())),
        };
        let [width, height] = self.size.map(|n| u32::try_from(n).unwrap_or(u32::MAX));
        Ok(Pinhole {
            width,
            height,
            focal,
            center,
        })
    }
}

/// Lines that say something, with their numbers from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text
        .lines()
        .enumerate()
        .map(|(n, line)| (n + 1, line.trim()));
    numbered.filter(|(_, line)| !line.starts_with('#'))
}

fn number<T: std::str::FromStr>(word: Option<&str>, line: usize, what: &str) -> Result<T, String> {
    let word = word.unwrap_or("");
    word.parse()
        .map_err(|_| format!("line {line}: {what} is {word:?}, expected a number"))
}

fn text_cameras(text: &str) -> Result<Vec<(u32, Lens)>, String> {
    let mut cameras = Vec::new();
    for (line, words) in lines(text).filter(|(_, line)| !line.is_empty()) {
        let mut words = words.split_whitespace();
        let id = number(words.next(), line, "the camera")?;
        let model = words.next().unwrap_or("").to_owned();
        let size = [
            number(words.next(), line, "the width")?,
            number(words.next(), line, "the height")?,
        ];
        let parameters = words
            .map(|word| number(Some(word), line, "a parameter"))
            .collect::<Result<_, _>>()?;
        cameras.push((
            id,
            Lens {
                model,
                size,
                parameters,
            },
        ));
    }
    Ok(cameras)
}

fn text_images(text: &str) -> Result<Vec<Image>, String> {
    let mut images = Vec::new();
    let mut all = lines(text);
    while let Some((line, words)) = all.next() {
        if words.is_empty() {
            continue;
        }
        let mut words = words.splitn(10, char::is_whitespace);
        words.next();
        let mut value = |what| number::<f64>(words.next(), line, what);
        let rotation = [value("qw")?, value("qx")?, value("qy")?, value("qz")?];
        let translation = [value("tx")?, value("ty")?, value("tz")?];
        let camera = number(words.next(), line, "the camera")?;
        let name = words.next().unwrap_or("").trim().to_owned();
        if name.is_empty() {
            return Err(format!("line {line}: the picture has no name"));
        }
        images.push(Image {
            name,
            camera,
            rotation,
            translation,
        });
        // The points of a picture are in the line behind it.
        all.next();
    }
    Ok(images)
}

/// Little-endian numbers one after the other.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (head, rest) = self
            .0
            .split_first_chunk::<N>()
            .ok_or_else(|| format!("ends {} bytes too early", N - self.0.len()))?;
        self.0 = rest;
        Ok(*head)
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, String> {
        self.take().map(u64::from_le_bytes)
    }

    fn numbers<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = f64::from_le_bytes(self.take()?);
        }
        Ok(numbers)
    }
}

fn binary_cameras(bytes: &[u8]) -> Result<Vec<(u32, Lens)>, String> {
    let mut bytes = Bytes(bytes);
    let mut cameras = Vec::new();
    for _ in 0..bytes.u64()? {
        let (id, model) = (bytes.u32()?, bytes.u32()?);
        let size = [bytes.u64()?, bytes.u64()?];
        let name = MODELS.get(model as usize).copied();
        let parameters = match name {
            Some("SIMPLE_PINHOLE") => bytes.numbers::<3>()?.to_vec(),
            Some("PINHOLE") => bytes.numbers::<4>()?.to_vec(),
            // Refused by its name: how many numbers follow does not matter.
            _ => {
                let model = name.map_or(format!("number {model}"), str::to_owned);
                cameras.push((
                    id,
                    Lens {
                        model,
                        size,
                        parameters: Vec::new(),
                    },
                ));
                return Ok(cameras);
            }
        };
        let model = name.unwrap_or_default().to_owned();
        cameras.push((
            id,
            Lens {
                model,
                size,
                parameters,
            },
        ));
    }
    Ok(cameras)
}

fn binary_images(bytes: &[u8]) -> Result<Vec<Image>, String> {
    let mut bytes = Bytes(bytes);
    let mut images = Vec::new();
    for _ in 0..bytes.u64()? {
        bytes.u32()?;
        let (rotation, translation) = (bytes.numbers()?, bytes.numbers()?);
        let camera = bytes.u32()?;
        let end = bytes.0.iter().position(|byte| *byte == 0);
        let end = end.ok_or("a name has no end")?;
        let name = String::from_utf8_lossy(&bytes.0[..end]).into_owned();
        bytes.0 = &bytes.0[end + 1..];
        let points = usize::try_from(bytes.u64()?)
            .ok()
            .and_then(|n| n.checked_mul(24));
        bytes.0 = points
            .and_then(|length| bytes.0.get(length..))
            .ok_or("ends within the points of a picture")?;
        images.push(Image {
            name,
            camera,
            rotation,
            translation,
        });
    }
    Ok(images)
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::*;

    /// A camera at (0, 0, -5) that looks along z, turned by a quarter about it for the second picture.
    fn binary() -> [Vec<u8>; 2] {
        let mut cameras = Vec::new();
        cameras.extend(1u64.to_le_bytes());
        cameras.extend(7u32.to_le_bytes());
        cameras.extend(1u32.to_le_bytes());
        [640u64, 480]
            .iter()
            .for_each(|n| cameras.extend(n.to_le_bytes()));
        [500.0f64, 510.0, 320.0, 240.0]
            .iter()
            .for_each(|x| cameras.extend(x.to_le_bytes()));
        let mut images = Vec::new();
        images.extend(2u64.to_le_bytes());
        let half = std::f64::consts::FRAC_1_SQRT_2;
        for (name, pose) in [
            ("b.jpg", [1.0, 0.0, 0.0, 0.0]),
            ("a.jpg", [half, 0.0, 0.0, half]),
        ] {
            images.extend(1u32.to_le_bytes());
            pose.iter()
                .chain(&[0.0, 0.0, 5.0])
                .for_each(|x: &f64| images.extend(x.to_le_bytes()));
            images.extend(7u32.to_le_bytes());
            images.extend(name.bytes().chain([0]));
            images.extend(1u64.to_le_bytes());
            images.extend([0; 24]);
        }
        [cameras, images]
    }

    fn text() -> [String; 2] {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        [
            "# Camera list\n7 PINHOLE 640 480 500 510 320 240\n".into(),
            format!(
                "# Image list\n1 1 0 0 0 0 0 5 7 b.jpg\n1.0 2.0 -1\n2 {half} 0 0 {half} 0 0 5 7 a.jpg\n\n"
            ),
        ]
    }

    fn model(files: [(&str, &[u8]); 2]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, content) in files {
            std::fs::write(folder.path().join(name), content).expect("written");
        }
        folder
    }

    #[test]
    fn text_and_binary_say_the_same() {
        let [cameras, images] = binary();
        let folder = model([("cameras.bin", &cameras), ("images.bin", &images)]);
        assert!(is_model(folder.path()));
        let views = read(folder.path()).expect("a model");
        let [cameras, images] = text();
        let folder = model([
            ("cameras.txt", cameras.as_bytes()),
            ("images.txt", images.as_bytes()),
        ]);
        assert_eq!(read(folder.path()).expect("a model"), views);

        assert_eq!((&*views[0].name, &*views[1].name), ("a", "b"));
        let plain = views[1].camera;
        assert_eq!(plain.position, Vec3::new(0.0, 0.0, -5.0));
        assert_eq!(plain.project(Vec3::new(1.0, 0.0, 0.0)), (420.0, 240.0, 5.0));
        // World x is camera y after a quarter turn about z.
        let expected = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2) * Vec3::X;
        let (x, y, _) = views[0].camera.project(Vec3::X);
        assert!((x - 320.0 - 100.0 * expected.x).abs() < 1e-3, "{x}");
        assert!((y - 240.0 - 102.0 * expected.y).abs() < 1e-3, "{y}");
    }

    #[test]
    fn bent_pictures_are_refused_with_the_command_that_helps() {
        let [_, images] = text();
        for camera in [
            "7 OPENCV 640 480 1 2 3 4 5 6 7 8",
            "7 SIMPLE_RADIAL 640 480 1 2 3 4",
        ] {
            let folder = model([
                ("cameras.txt", camera.as_bytes()),
                ("images.txt", images.as_bytes()),
            ]);
            let error = read(folder.path()).expect_err("refused").to_string();
            assert!(error.contains("colmap image_undistorter"), "{error}");
        }
    }

    #[test]
    fn a_pose_that_is_none_is_refused() {
        let [cameras, _] = text();
        // The second place is finite in f64 alone.
        for pose in [
            "0 0 0 0 0 0 5",
            "1 0 0 0 1e300 0 5",
            "1 0 0 0 nan 0 5",
            "1e200 0 0 1e200 0 0 5",
        ] {
            let images = format!("1 {pose} 7 b.jpg\n\n");
            let bytes = [cameras.as_bytes(), images.as_bytes()];
            let error = parse(Path::new("sparse"), Form::Text, bytes).expect_err(pose);
            assert!(
                error.to_string().contains("b.jpg: its pose is no"),
                "{error}"
            );
        }
    }

    #[test]
    fn cut_files_are_refused() {
        let [cameras, images] = binary();
        for length in 0..images.len() {
            let folder = model([("cameras.bin", &cameras), ("images.bin", &images[..length])]);
            assert!(read(folder.path()).is_err(), "{length}");
        }
        for length in 0..cameras.len() {
            let folder = model([("cameras.bin", &cameras[..length]), ("images.bin", &images)]);
            assert!(read(folder.path()).is_err(), "{length}");
        }
    }
}
