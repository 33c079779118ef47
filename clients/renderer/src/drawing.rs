//! Frames to pictures: which of them are drawn, and what came of it.

use std::path::PathBuf;
use std::time::Instant;

use cosplat_ipc::schema::{FRAME_FLAG_LAST, FrameHeader, GaussianState, ObjectInfo, SceneHeader};
use glam::{DVec3, Vec3};
use serde::Serialize;

use crate::Image;
use crate::camera::{Camera, Orbit, up_from_gravity};
use crate::client::RenderError;
use crate::output::{Outputs, Plan, Wanted, Written};
use crate::path::CameraPath;
use crate::raster::{Projected, harmonics};
use crate::shade::Shade;

/// Colour behind the splats, sRGB: light enough to show dark ones, dark enough to show white ones.
pub const BACKGROUND: [f32; 3] = [0.93; 3];

/// What pictures show, and where they go.
#[derive(Clone, Debug)]
pub struct Look {
    /// Pixels per row, 1..=16384 (a video: 16..=3840).
    pub width: u32,
    /// Rows, 1..=16384 (a video: 16..=2160).
    pub height: u32,
    /// Where to look from; the scene's bounds and gravity fill in the rest.
    pub orbit: Orbit,
    /// By how much the camera turns around the up axis per simulated second, anticlockwise from above [rad/s].
    pub turning: f32,
    /// Name of the object that the camera looks at, wherever that goes.
    pub follow: Option<String>,
    /// Where the camera goes, in place of `orbit` and `turning`.
    pub path: Option<CameraPath>,
    /// Whether what stands still is darker below what moves.
    pub is_shaded: bool,
    /// Folder for `frame_STEP.png` files.
    pub png: Option<PathBuf>,
    /// A PNG file for the first frame of every such many steps; 0 = for every frame that there is time to draw.
    pub every: u64,
    /// Video file.
    pub mp4: Option<PathBuf>,
    /// Video frames per simulated second, 1..=1000.
    pub fps: f64,
}

impl Look {
    /// The camera for a scene, at simulated time 0.
    pub fn camera(&self, scene: &SceneHeader) -> Camera {
        self.camera_of(scene, self.orbit)
    }

    fn camera_of(&self, scene: &SceneHeader, orbit: Orbit) -> Camera {
        let bounds = [
            Vec3::from_array(scene.bounds_min),
            Vec3::from_array(scene.bounds_max),
        ];
        let up = up_from_gravity(scene.gravity);
        Camera::orbit(bounds, up, orbit, self.width, self.height)
    }

    /// The camera for a frame. One that moves keeps a distance from which the scene is seen whole from all sides, where none
    /// is given.
    ///
    /// # Errors
    /// When the scene has no object of the name that is followed.
    pub fn camera_at(
        &self,
        scene: &Scene,
        header: &FrameHeader,
        gaussians: &[GaussianState],
    ) -> Result<Camera, RenderError> {
        let followed = match &self.follow {
            Some(name) => centre(gaussians, scene.object(name)?),
            None => None,
        };
        if let Some(path) = &self.path {
            let up = up_from_gravity(scene.header.gravity);
            return Ok(path.camera(header, up, followed, [self.width, self.height]));
        }
        let mut orbit = self.orbit;
        if self.turning == 0.0 && self.follow.is_none() {
            return Ok(self.camera(&scene.header));
        }
        // In f64, then within a turn: an hour of turning is a large angle.
        let turned = f64::from(self.turning) * header.sim_time;
        orbit.azimuth += (turned % std::f64::consts::TAU) as f32;
        let [low, high] = [scene.header.bounds_min, scene.header.bounds_max].map(Vec3::from);
        let narrow = (self.width as f32 / self.height as f32).min(1.0);
        // A sphere around the box, in a picture that is 40 degrees high.
        let away = 0.5 * (high - low).length() / (20f32.to_radians().sin() * narrow);
        orbit.distance = orbit.distance.or(Some(away));
        orbit.target = followed.or(orbit.target);
        Ok(self.camera_of(&scene.header, orbit))
    }
}

/// Mean position of an object's Gaussians; `None` when none is anywhere.
fn centre(gaussians: &[GaussianState], object: u32) -> Option<Vec3> {
    let positions = gaussians.iter().filter(|g| g.object == object);
    let positions = positions.map(|g| DVec3::from(g.position.map(f64::from)));
    let (sum, count) = positions
        .filter(|position| position.is_finite())
        .fold((DVec3::ZERO, 0), |(sum, count), p| (sum + p, count + 1));
    (count > 0).then(|| (sum / f64::from(count)).as_vec3())
}

/// What pictures need to know of a scene.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The scene as it was published.
    pub header: SceneHeader,
    /// Its objects.
    pub objects: Vec<ObjectInfo>,
    /// Spherical harmonics `[gaussian][coefficient][rgb]`.
    pub sh: Vec<f32>,
}

impl Scene {
    /// The picture of a frame; shaded ones are darker below what moves.
    pub fn picture(&self, gaussians: &[GaussianState], camera: &Camera, is_shaded: bool) -> Image {
        let shade = is_shaded.then(|| Shade::new(gaussians, self));
        let sh = harmonics(&self.header, &self.sh);
        Projected::shaded(gaussians, sh, camera, shade.as_ref()).draw(BACKGROUND)
    }

    fn object(&self, name: &str) -> Result<u32, RenderError> {
        let names = || self.objects.iter().filter_map(|info| info.name().ok());
        let found = self.objects.iter().find(|info| info.name() == Ok(name));
        found
            .map(|info| info.id)
            .ok_or_else(|| RenderError::NoObject {
                name: name.to_owned(),
                names: names().collect::<Vec<_>>().join(", "),
            })
    }
}

/// What a run of the renderer did.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Frames rendered.
    pub frames_rendered: u64,
    /// Frames published since attaching and not drawn for lack of time.
    pub frames_missed: u64,
    /// Of them, those of steps that were asked for: there was no room to keep them.
    pub pictures_missed: u64,
    /// Runs of the server seen: more than 1 after a restart.
    pub runs: u64,
    /// Step of the last frame.
    pub last_step: u64,
    /// Simulated time of the last frame [s].
    pub sim_time: f64,
    /// Mean time to render a frame [ms], without waiting and encoding.
    pub render_ms: f64,
    /// PNG files written.
    pub pictures: u64,
    /// The newest of them.
    pub last_picture: Option<PathBuf>,
    /// The video, if it has any frame.
    pub video: Option<PathBuf>,
    /// Its frames.
    pub video_frames: u64,
}

/// Draws frames, one after the other, into the files of a look.
pub struct Drawing<'a> {
    look: &'a Look,
    plan: Plan,
    outputs: Outputs,
    /// So far; `render_ms` is the sum.
    pub(crate) summary: Summary,
}

impl<'a> Drawing<'a> {
    /// Makes the folders and opens the video.
    ///
    /// # Errors
    /// When a folder or file cannot be made.
    pub fn begin(look: &'a Look) -> Result<Self, RenderError> {
        Ok(Self {
            look,
            plan: Plan::new(look),
            outputs: Outputs::open(look)?,
            summary: Summary::default(),
        })
    }

    /// Draws a frame if a picture or the video needs it. `is_new_run` says that the clock may have gone back.
    ///
    /// # Errors
    /// When a file cannot be written, or the scene has no object of the name that is followed.
    pub fn show(
        &mut self,
        header: &FrameHeader,
        is_new_run: bool,
        scene: &Scene,
        gaussians: &[GaussianState],
    ) -> Result<(), RenderError> {
        let is_last = header.flags & FRAME_FLAG_LAST != 0;
        let wanted = self
            .plan
            .wants(header.step, header.sim_time, is_new_run, is_last);
        self.summary.last_step = header.step;
        self.summary.sim_time = header.sim_time;
        if !wanted.anything() {
            return Ok(());
        }
        self.plan.commit(wanted, header.step);
        let camera = self.look.camera_at(scene, header, gaussians)?;
        let is_shaded = self.look.is_shaded;
        let draw = || scene.picture(gaussians, &camera, is_shaded);
        self.draw(wanted, header.step, draw)
    }

    /// Where pictures are taken from, and how.
    pub(crate) fn look(&self) -> &'a Look {
        self.look
    }

    /// Draws the frame of `step` for what it is wanted for.
    pub(crate) fn draw(
        &mut self,
        wanted: Wanted,
        step: u64,
        draw: impl FnOnce() -> Image,
    ) -> Result<(), RenderError> {
        let drawing = Instant::now();
        let image = draw();
        self.summary.render_ms += drawing.elapsed().as_secs_f64() * 1e3;
        self.outputs.write(wanted, step, image)?;
        self.summary.frames_rendered += 1;
        Ok(())
    }

    /// Closes the files.
    ///
    /// # Errors
    /// When the video cannot be completed.
    pub fn finish(self) -> Result<Summary, RenderError> {
        let Written {
            pictures,
            last_picture,
            video,
            video_frames,
        } = self.outputs.finish()?;
        let frames = self.summary.frames_rendered.max(1);
        Ok(Summary {
            pictures,
            last_picture,
            video,
            video_frames,
            render_ms: self.summary.render_ms / frames as f64,
            ..self.summary
        })
    }
}
