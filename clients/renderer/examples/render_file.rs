//! Pictures of a splat file (`.splat`, or trained `.ply`) and how long they take: for looking, and for timing.
//!
//! `cargo run --release -p cosplat-renderer --example render_file -- FILE OUT.png [WxH] [UP] [AZIMUTH] [ELEVATION]`
//! with UP one of +x -x +y -y +z -z and angles in degrees. It reads well-formed files only; the server's importer is
//! the careful one.

use std::collections::HashMap;
use std::path::Path;
use std::time::Instant;

use cosplat_ipc::schema::GaussianState;
use cosplat_renderer::camera::{Camera, Orbit};
use cosplat_renderer::{Harmonics, picture, png::write_png};
use glam::{Mat3, Quat, Vec3};

struct Splats {
    gaussians: Vec<GaussianState>,
    sh_degree: u32,
    sh: Vec<f32>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [file, out, rest @ ..] = args.as_slice() else {
        return Err("usage: render_file FILE OUT.png [WxH] [UP] [AZIMUTH] [ELEVATION]".into());
    };
    let rest = |k: usize, otherwise: &'static str| rest.get(k).map_or(otherwise, String::as_str);
    let (width, height) = rest(0, "640x480").split_once('x').ok_or("size is WxH")?;
    let (width, height) = (width.parse()?, height.parse()?);
    let up = match rest(1, "-y") {
        "+x" => Vec3::X,
        "-x" => -Vec3::X,
        "+y" => Vec3::Y,
        "-y" => -Vec3::Y,
        "+z" => Vec3::Z,
        "-z" => -Vec3::Z,
        other => return Err(format!("up is a signed axis such as -y, not {other}").into()),
    };
    let orbit = Orbit {
        azimuth: rest(2, "30").parse::<f32>()?.to_radians(),
        elevation: rest(3, "15").parse::<f32>()?.to_radians(),
        ..Orbit::default()
    };
    let bytes = std::fs::read(file)?;
    let splats = if Path::new(file).extension().is_some_and(|e| e == "splat") {
        read_splat(&bytes)
    } else {
        read_ply(&bytes)?
    };
    let camera = Camera::orbit(bounds(&splats.gaussians), up, orbit, width, height);
    let sh = (!splats.sh.is_empty())
        .then(|| Harmonics::new(splats.sh_degree, &splats.sh))
        .flatten();
    let mut times = Vec::new();
    let image = loop {
        let start = Instant::now();
        let image = picture(&splats.gaussians, sh, &camera, [0.93; 3]);
        times.push(start.elapsed().as_secs_f64() * 1e3);
        if times.len() == 9 {
            break image;
        }
    };
    times.sort_by(f64::total_cmp);
    println!(
        "{} Gaussians, {width}x{height}, {} threads: median {:.1} ms, best {:.1} ms",
        splats.gaussians.len(),
        rayon::current_num_threads(),
        times[times.len() / 2],
        times[0],
    );
    write_png(Path::new(out), &image)?;
    Ok(())
}

/// Box that holds all but the outermost hundredth at either end of every axis.
fn bounds(gaussians: &[GaussianState]) -> [Vec3; 2] {
    let mut corners = [Vec3::ZERO; 2];
    for axis in 0..3 {
        let mut values: Vec<f32> = gaussians.iter().map(|g| g.position[axis]).collect();
        values.sort_by(f32::total_cmp);
        let cut = values.len() / 100;
        corners[0][axis] = values[cut];
        corners[1][axis] = values[values.len() - 1 - cut];
    }
    corners
}

fn gaussian(
    index: usize,
    position: [f32; 3],
    scale: Vec3,
    wxyz: [f32; 4],
    color: [u8; 4],
) -> GaussianState {
    let [w, x, y, z] = wxyz;
    let axes =
        Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize()) * Mat3::from_diagonal(scale);
    let s = axes * axes.transpose();
    GaussianState {
        position,
        color,
        covariance: [
            s.x_axis.x, s.x_axis.y, s.x_axis.z, s.y_axis.y, s.y_axis.z, s.z_axis.z,
        ],
        object: 0,
        index: index as u32,
        rotation: [0.0, 0.0, 0.0, 1.0],
    }
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn read_splat(bytes: &[u8]) -> Splats {
    let gaussians = bytes
        .chunks_exact(32)
        .enumerate()
        .map(|(index, row)| {
            let f = |k: usize| float(row, 4 * k);
            let q = |k: usize| (f32::from(row[28 + k]) - 128.0) / 128.0;
            let color = [row[24], row[25], row[26], row[27]];
            let scale = Vec3::new(f(3), f(4), f(5));
            gaussian(
                index,
                [f(0), f(1), f(2)],
                scale,
                [q(0), q(1), q(2), q(3)],
                color,
            )
        })
        .collect();
    Splats {
        gaussians,
        sh_degree: 0,
        sh: Vec::new(),
    }
}

fn read_ply(bytes: &[u8]) -> Result<Splats, Box<dyn std::error::Error>> {
    const END: &[u8] = b"end_header\n";
    let end = bytes
        .windows(END.len())
        .position(|w| w == END)
        .ok_or("no PLY header")?
        + END.len();
    let header = std::str::from_utf8(&bytes[..end])?;
    let columns: HashMap<&str, usize> = header
        .lines()
        .filter_map(|line| line.strip_prefix("property float "))
        .enumerate()
        .map(|(column, name)| (name, column))
        .collect();
    let column = |name: &str| {
        columns
            .get(name)
            .copied()
            .ok_or(format!("no property {name}"))
    };
    let numbered = |stem: &str, count: usize| -> Result<Vec<usize>, String> {
        (0..count).map(|k| column(&format!("{stem}{k}"))).collect()
    };
    let rest_count = columns
        .keys()
        .filter(|name| name.starts_with("f_rest_"))
        .count();
    let [constant, rest] = [numbered("f_dc_", 3)?, numbered("f_rest_", rest_count)?];
    let [scale, rotation] = [numbered("scale_", 3)?, numbered("rot_", 4)?];
    let (opacity, place) = (
        column("opacity")?,
        [column("x")?, column("y")?, column("z")?],
    );
    let mut splats = Splats {
        gaussians: Vec::new(),
        sh_degree: ((rest_count / 3 + 1) as f32).sqrt() as u32 - 1,
        sh: Vec::new(),
    };
    for (index, row) in bytes[end..].chunks_exact(4 * columns.len()).enumerate() {
        let f = |column: usize| float(row, 4 * column);
        let level = |value: f32| (value * 255.0 + 0.5) as u8;
        let base = |c: usize| level(0.5 + 0.282_094_8 * f(constant[c]));
        let alpha = level(1.0 / (1.0 + (-f(opacity)).exp()));
        splats.gaussians.push(gaussian(
            index,
            place.map(f),
            Vec3::from_array([0, 1, 2].map(|k| f(scale[k]).exp())),
            [0, 1, 2, 3].map(|k| f(rotation[k])),
            [base(0), base(1), base(2), alpha],
        ));
        // The file has all of red, then all of green, then all of blue.
        splats.sh.extend(constant.iter().map(|&column| f(column)));
        for coefficient in 0..rest_count / 3 {
            for channel in 0..3 {
                splats
                    .sh
                    .push(f(rest[channel * (rest_count / 3) + coefficient]));
            }
        }
    }
    Ok(splats)
}
