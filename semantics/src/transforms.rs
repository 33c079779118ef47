//! `transforms.json`, as nerfstudio and the synthetic data sets have it.
//!
//! Its poses are camera to world with axes right, up, backward. Focal lengths stand for all pictures or for each, or there is
//! an angle of view. Poses must be in the frame of the splat.

use std::path::Path;

use cosplat_files::reading;
use cosplat_raster::Camera;
use glam::{Mat3, Mat4, Vec3};
use serde::{Deserialize, Serialize};

use crate::{
    SemanticsError, View,
    views::{Pinhole, stem},
};

/// Numbers that stand for the whole file, for one frame, or for neither.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
struct Lens {
    #[serde(skip_serializing_if = "Option::is_none")]
    w: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    h: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fl_x: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fl_y: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cx: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cy: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera_angle_x: Option<f64>,
    #[serde(default, skip_serializing)]
    k1: f64,
    #[serde(default, skip_serializing)]
    k2: f64,
    #[serde(default, skip_serializing)]
    k3: f64,
    #[serde(default, skip_serializing)]
    p1: f64,
    #[serde(default, skip_serializing)]
    p2: f64,
}

#[derive(Deserialize, Serialize)]
struct Frame {
    file_path: String,
    transform_matrix: [[f64; 4]; 4],
    #[serde(flatten)]
    lens: Lens,
}

#[derive(Deserialize, Serialize)]
struct Transforms {
    #[serde(flatten)]
    lens: Lens,
    frames: Vec<Frame>,
}

impl Lens {
    /// The first coefficient of distortion that is not 0.
    fn distortion(&self) -> Option<String> {
        let all = [
            ("k1", self.k1),
            ("k2", self.k2),
            ("k3", self.k3),
            ("p1", self.p1),
            ("p2", self.p2),
        ];
        let bent = all.into_iter().find(|(_, value)| *value != 0.0);
        bent.map(|(name, value)| format!("{name} = {value}"))
    }

    /// With what it lacks from `general`.
    fn or(self, general: Lens) -> Lens {
        Lens {
            w: self.w.or(general.w),
            h: self.h.or(general.h),
            fl_x: self.fl_x.or(general.fl_x),
            fl_y: self.fl_y.or(general.fl_y),
            cx: self.cx.or(general.cx),
            cy: self.cy.or(general.cy),
            camera_angle_x: self.camera_angle_x.or(general.camera_angle_x),
            ..general
        }
    }

    fn pinhole(&self) -> Option<Pinhole> {
        let (w, h) = (self.w?, self.h?);
        let from_angle = self
            .camera_angle_x
            .map(|angle| 0.5 * w / (0.5 * angle).tan());
        let fl_x = self.fl_x.or(from_angle)?;
        Some(Pinhole {
            width: w as u32,
            height: h as u32,
            focal: [fl_x as f32, self.fl_y.unwrap_or(fl_x) as f32],
            center: [
                self.cx.unwrap_or(0.5 * w) as f32,
                self.cy.unwrap_or(0.5 * h) as f32,
            ],
        })
    }
}

/// Reads the views of a `transforms.json`. Files without a size, as those of synthetic sets, take `size` (width, height) for
/// it.
///
/// # Errors
/// When the file cannot be read, is something else, or a camera bends its picture.
pub fn read(path: &Path, size: Option<[u32; 2]>) -> Result<Vec<View>, SemanticsError> {
    let text = reading::read_text(path).map_err(SemanticsError::read(path))?;
    parse(path, &text, size)
}

/// As [`read`], from the text of the file.
///
/// # Errors
/// When it is something else or a camera bends its picture.
pub fn parse(path: &Path, text: &str, size: Option<[u32; 2]>) -> Result<Vec<View>, SemanticsError> {
    let file: Transforms = serde_json::from_str(text)
        .map_err(|error| SemanticsError::format(path, format!("no transforms.json: {error}")))?;
    let of_size = Lens {
        w: size.map(|s| f64::from(s[0])),
        h: size.map(|s| f64::from(s[1])),
        ..Lens::default()
    };
    let general = file.lens.or(of_size);
    let view = |frame: &Frame| {
        if let Some(model) = file.lens.distortion().or(frame.lens.distortion()) {
            return Err(SemanticsError::Distorted {
                path: path.to_owned(),
                camera: frame.file_path.clone(),
                model,
            });
        }
        let wrong =
            |why: String| SemanticsError::format(path, format!("{}: {why}", frame.file_path));
        let pinhole = frame.lens.or(general).pinhole();
        let pinhole = pinhole.ok_or_else(|| {
            wrong("expected w, h and fl_x or camera_angle_x, for the file or the frame".into())
        })?;
        let pose =
            Mat4::from_cols_array_2d(&frame.transform_matrix.map(|row| row.map(|x| x as f32)));
        let pose = pose.transpose();
        // Right, up, backward to right, down, forward; a scale of the poses is none of the axes.
        let axes = Mat3::from_mat4(pose) * Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
        let axes = Mat3::from_cols(
            axes.x_axis.normalize_or_zero(),
            axes.y_axis.normalize_or_zero(),
            axes.z_axis.normalize_or_zero(),
        );
        let is_rotation = (axes.determinant() - 1.0).abs() < 1e-2;
        if let Some(fault) = pinhole.fault() {
            return Err(wrong(fault));
        }
        if !pose.is_finite() || !is_rotation {
            return Err(wrong(
                "transform_matrix is no pose: its axes are not at right angles".into(),
            ));
        }
        Ok(View {
            name: stem(&frame.file_path),
            camera: pinhole.camera(pose.w_axis.truncate(), axes),
        })
    };
    file.frames.iter().map(view).collect()
}

/// The text of a `transforms.json` for views, with their pictures in the folder `images`.
pub fn write(views: &[View]) -> String {
    let frame = |view: &View| {
        let Camera {
            position,
            world_from_camera: axes,
            focal,
            center,
            width,
            height,
            ..
        } = view.camera;
        let row = |k: usize| {
            [
                axes.x_axis[k],
                -axes.y_axis[k],
                -axes.z_axis[k],
                position[k],
            ]
            .map(f64::from)
        };
        Frame {
            file_path: format!("images/{}.png", view.name),
            transform_matrix: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            lens: Lens {
                w: Some(width.into()),
                h: Some(height.into()),
                fl_x: Some(focal[0].into()),
                fl_y: Some(focal[1].into()),
                cx: Some(center[0].into()),
                cy: Some(center[1].into()),
                ..Lens::default()
            },
        }
    };
    let file = Transforms {
        lens: Lens::default(),
        frames: views.iter().map(frame).collect(),
    };
    // A tree of numbers and strings has no way to fail.
    serde_json::to_string_pretty(&file).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::views::spiral;

    #[test]
    fn views_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("transforms.json");
        let views = spiral([-Vec3::ONE, Vec3::ONE], Vec3::Y, 7, 320, 240);
        std::fs::write(&path, write(&views)).expect("written");
        let again = read(&path, None).expect("readable");
        assert_eq!(again.len(), 7);
        for (a, b) in views.iter().zip(&again) {
            assert_eq!(
                (&a.name, a.camera.focal, a.camera.center),
                (&b.name, b.camera.focal, b.camera.center)
            );
            for point in [Vec3::ZERO, Vec3::new(0.4, -0.3, 0.9)] {
                let ((x, y, _), (u, v, _)) = (a.camera.project(point), b.camera.project(point));
                // f32 of coordinates of some hundred pixels.
                assert!(
                    (x - u).abs() < 1e-3 && (y - v).abs() < 1e-3,
                    "{x} {y} {u} {v}"
                );
            }
        }
    }

    #[test]
    fn an_angle_of_view_makes_a_camera_and_a_bent_one_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("transforms.json");
        let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
        let text = |more: &str| {
            format!(
                r#"{{"camera_angle_x": 1.5707963267948966{more}, "frames": [{{"file_path": "./train/r_0", "transform_matrix": {pose}}}]}}"#
            )
        };
        std::fs::write(&path, text("")).expect("written");
        let error = read(&path, None).expect_err("no size");
        assert!(error.to_string().contains("expected w, h"), "{error}");
        let views = read(&path, Some([800, 600])).expect("a camera");
        // A right angle of view: half the width is the focal length. The camera at z = 4 looks at the origin.
        assert!((views[0].camera.focal[0] - 400.0).abs() < 1e-3);
        assert_eq!(views[0].name, "r_0");
        let (x, y, depth) = views[0].camera.project(Vec3::ZERO);
        assert_eq!((x, y, depth), (400.0, 300.0, 4.0));
        std::fs::write(&path, text(", \"k1\": 0.1")).expect("written");
        let error = read(&path, Some([800, 600])).expect_err("bent");
        assert!(error.to_string().contains("k1 = 0.1"), "{error}");
        assert!(error.to_string().contains("image_undistorter"), "{error}");
    }
}
