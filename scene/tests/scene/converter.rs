//! Reading and writing against an independent converter, `splat-transform` from npm.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::{Mutex, PoisonError},
};

use cosplat_scene::assets::{Gaussians, ply};

use crate::{data, read, skip};

/// Version of the converter that runs on node 20.
const CONVERTER: &str = "@playcanvas/splat-transform@2.7.1";

/// Tests run side by side, and npm does not bear a second one in its folder.
static INSTALL: Mutex<()> = Mutex::new(());

/// Path of the converter, installed on first use.
fn converter(test: &str) -> Option<PathBuf> {
    let _alone = INSTALL.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("splat-transform");
    let program = folder.join("node_modules/.bin/splat-transform");
    if !program.exists() {
        let installed = Command::new("npm")
            .args([
                "install",
                "--no-audit",
                "--no-fund",
                "--ignore-scripts",
                "--prefix",
            ])
            .arg(&folder)
            .arg(CONVERTER)
            .output();
        match installed {
            Ok(output) if output.status.success() && program.exists() => {}
            Ok(output) => {
                let why = String::from_utf8_lossy(&output.stderr);
                skip(test, &format!("npm install {CONVERTER}: {}", why.trim()));
                return None;
            }
            Err(error) => {
                skip(test, &format!("npm cannot be run: {error}"));
                return None;
            }
        }
    }
    Some(program)
}

fn convert(program: &Path, from: &Path, name: &str) -> PathBuf {
    let to = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let output = Command::new(program)
        .args(["--overwrite", "--quiet", "-g", "cpu"])
        .args([from, &to])
        .output()
        .expect("the converter runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    to
}

fn assert_close(what: &str, a: &[f32], b: &[f32], relative: f32, absolute: f32) {
    assert_eq!(a.len(), b.len(), "{what}: counts differ");
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        let allowed = relative * a.abs().max(b.abs()) + absolute;
        assert!(
            (a - b).abs() <= allowed,
            "{what} {i}: {a} and {b} differ by more than {allowed}"
        );
    }
}

/// Equal up to the roundings of logarithms; `rotation` is the absolute tolerance of quaternion components.
fn assert_same(a: &Gaussians, b: &Gaussians, rotation: f32) {
    assert_eq!(a.sh_degree, b.sh_degree);
    assert_close(
        "position",
        a.position.as_flattened(),
        b.position.as_flattened(),
        0.0,
        0.0,
    );
    // A logarithm of size up to 16 rounds to 2^-21, and so the scale by that factor.
    assert_close(
        "scale",
        a.scale.as_flattened(),
        b.scale.as_flattened(),
        1e-6,
        0.0,
    );
    // q and -q are the same rotation; both sides keep the file's sign.
    assert_close(
        "rotation",
        a.rotation.as_flattened(),
        b.rotation.as_flattened(),
        0.0,
        rotation,
    );
    assert_close("opacity", &a.opacity, &b.opacity, 1e-6, 1e-6);
    assert_close("sh", &a.sh, &b.sh, 1e-6, 1e-6);
}

#[test]
fn splat_rows_agree_with_splat_transform() {
    let test = "splat_rows_agree_with_splat_transform";
    let (Some(plant), Some(program)) = (data(test, "plant.splat"), converter(test)) else {
        return;
    };
    let ours = read(&plant);
    assert_eq!(ours.len(), 113_648);
    // The converter takes a byte as b / 127.5 - 1, the format's author and we as b / 128 - 1: half a
    // quantisation step of 1/128 apart at most, and as much again after both are normalised.
    assert_same(
        &ours,
        &read(&convert(&program, &plant, "plant.ply")),
        1.0 / 128.0,
    );
}

#[test]
fn ply_files_agree_with_splat_transform_both_ways() {
    let test = "ply_files_agree_with_splat_transform_both_ways";
    let (Some(playbot), Some(program)) = (data(test, "playbot_lod3.ply"), converter(test)) else {
        return;
    };
    let ours = read(&playbot);
    assert_eq!((ours.len(), ours.sh_degree), (31_000, 2));
    assert_same(
        &ours,
        &read(&convert(&program, &playbot, "playbot_theirs.ply")),
        1e-6,
    );
    let written = Path::new(env!("CARGO_TARGET_TMPDIR")).join("playbot_ours.ply");
    fs::write(&written, ply::write(&ours)).expect("target is writable");
    assert_same(
        &ours,
        &read(&convert(&program, &written, "playbot_ours_theirs.ply")),
        1e-6,
    );
}

/// The converter's table of our file, as text, is an oracle for names and order of the columns.
#[test]
fn written_columns_mean_what_splat_transform_reads() {
    let test = "written_columns_mean_what_splat_transform_reads";
    let (Some(playbot), Some(program)) = (data(test, "playbot_lod3.ply"), converter(test)) else {
        return;
    };
    let ours = read(&playbot);
    let written = Path::new(env!("CARGO_TARGET_TMPDIR")).join("columns.ply");
    fs::write(&written, ply::write(&ours)).expect("target is writable");
    let table = fs::read_to_string(convert(&program, &written, "columns.csv")).expect("a table");
    let mut lines = table.lines();
    let names = lines
        .next()
        .expect("a line of names")
        .split(',')
        .collect::<Vec<_>>();
    let column = |name: &str| {
        names
            .iter()
            .position(|n| *n == name)
            .expect("a known column")
    };
    let wanted = [
        "x", "scale_1", "rot_0", "rot_3", "opacity", "f_dc_2", "f_rest_0", "f_rest_9",
    ];
    let wanted = wanted.map(column);
    for (i, line) in lines.enumerate() {
        let values = line
            .split(',')
            .map(|v| v.parse().expect("a number"))
            .collect::<Vec<f32>>();
        let [x, scale, w, z, opacity, blue, red_1, green_2] = wanted.map(|c| values[c]);
        let sh = &ours.sh[i * 27..(i + 1) * 27];
        assert_close(
            "row",
            &[x, w, z],
            &[
                ours.position[i][0],
                ours.rotation[i][3],
                ours.rotation[i][2],
            ],
            1e-6,
            1e-6,
        );
        assert_close(
            "activated",
            &[scale.exp(), 1.0 / (1.0 + (-opacity).exp())],
            &[ours.scale[i][1], ours.opacity[i]],
            1e-5,
            1e-6,
        );
        // Channel-major in the file: green starts at f_rest_8, so f_rest_9 is green's coefficient 2.
        assert_close(
            "colour",
            &[blue, red_1, green_2],
            &[sh[2], sh[3], sh[7]],
            1e-6,
            1e-6,
        );
    }
}

/// `docs/export.md` names these two: what comes back of our file is that up to the bits that they have.
#[test]
fn spz_and_sog_hold_what_we_write() {
    let test = "spz_and_sog_hold_what_we_write";
    let (Some(playbot), Some(program)) = (data(test, "playbot_lod3.ply"), converter(test)) else {
        return;
    };
    // Few: SOG's palettes are searched for on the processor.
    let all = read(&playbot);
    let (count, sh) = (300, all.sh.len() / all.len());
    let ours = Gaussians {
        position: all.position[..count].to_vec(),
        scale: all.scale[..count].to_vec(),
        rotation: all.rotation[..count].to_vec(),
        opacity: all.opacity[..count].to_vec(),
        sh: all.sh[..count * sh].to_vec(),
        ..all
    };
    let written = Path::new(env!("CARGO_TARGET_TMPDIR")).join("few.ply");
    fs::write(&written, ply::write(&ours)).expect("target is writable");
    for format in ["spz", "sog"] {
        let packed = convert(&program, &written, &format!("few.{format}"));
        let theirs = read(&convert(&program, &packed, &format!("few_{format}.ply")));
        assert_eq!((theirs.len(), theirs.sh_degree), (count, ours.sh_degree));
        for n in 0..count {
            let away = |k: &usize| {
                let apart = |a: usize| ours.position[n][a] - theirs.position[*k][a];
                (0..3).map(|a| apart(a).abs()).fold(0.0, f32::max)
            };
            // SOG sorts anew.
            let near = (0..count).min_by(|a, b| away(a).total_cmp(&away(b)));
            let near = near.expect("some");
            // SPZ has positions in 4096ths of a unit, SOG in 65536ths of a logarithmic range.
            assert!(away(&near) <= 1.3e-4, "{format} {n}: {}", away(&near));
            // Halves of a sixteenth of the logarithm, and of a level of 255.
            let scale = |g: &Gaussians, k: usize| g.scale[k].map(f32::ln);
            let (one, other) = (scale(&ours, n), scale(&theirs, near));
            assert_close("scale", &one, &other, 0.0, 0.0313);
            assert_close(
                "opacity",
                &[ours.opacity[n]],
                &[theirs.opacity[near]],
                0.0,
                1.01 / 255.0,
            );
        }
    }
}
