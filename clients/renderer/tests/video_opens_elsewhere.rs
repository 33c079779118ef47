//! The video file in an independent reader: PyAV, that is FFmpeg, installed under the target folder.

use std::path::{Path, PathBuf};
use std::process::Command;

use cosplat_renderer::{Image, mp4::Mp4Writer};

/// Prints frame count, codec, rate, size, last time stamp and the mean colour of the first and last frame.
const SCRIPT: &str = "
import av, sys
with av.open(sys.argv[1]) as file:
    stream = file.streams.video[0]
    frames = list(file.decode(stream))
    print(len(frames), stream.codec_context.name, stream.average_rate, frames[0].width, frames[0].height)
    print(float(frames[-1].pts * stream.time_base))
    print(int(frames[0].colorspace), int(frames[0].color_range))
    for frame in (frames[0], frames[-1]):
        data = bytes(frame.reformat(width=1, height=1, format='rgb24', interpolation='AREA').planes[0])
        print(*data[:3])
";

/// The interpreter of an environment with PyAV; `None`, said aloud, when it cannot be had.
fn python(test: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pyav");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).output();
        output.is_ok_and(|output| output.status.success())
    };
    let ready = run(&python, &["-c", "import av"])
        || (run(
            Path::new("python3"),
            &["-m", "venv", &folder.to_string_lossy()],
        ) && run(&python, &["-m", "pip", "install", "--quiet", "av"])
            && run(&python, &["-c", "import av"]));
    if !ready {
        let why = "needs python3 with venv and the package av";
        assert!(
            std::env::var_os("COSPLAT_REQUIRE_ALL").is_none(),
            "{test}: {why}"
        );
        eprintln!("SKIPPED: {test}: {why}");
        return None;
    }
    Some(python)
}

#[test]
fn ffmpeg_decodes_every_frame_in_the_right_colors() {
    let Some(python) = python("ffmpeg_decodes_every_frame_in_the_right_colors") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("video.mp4");
    let (width, height) = (320, 180);
    let plain = |rgb: [u8; 3]| Image {
        width,
        height,
        rgb: rgb.repeat((width * height) as usize),
    };
    let (first, last) = ([200, 60, 20], [30, 90, 210]);
    let mut writer = Mp4Writer::create(&path, width, height, 60.0).unwrap();
    for index in 0..90 {
        writer
            .add(&plain(if index < 45 { first } else { last }))
            .unwrap();
    }
    assert_eq!(writer.finish().unwrap(), 90);
    let output = Command::new(python)
        .args(["-c", SCRIPT])
        .arg(&path)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "90 h264 60 320 180");
    let end: f64 = lines[1].parse().unwrap();
    assert!((end - 89.0 / 60.0).abs() < 1e-6, "{end}");
    // FFmpeg's numbers for the BT.601 matrix and limited range.
    assert_eq!(lines[2], "6 1");
    for (line, color) in [(lines[3], first), (lines[4], last)] {
        let seen: Vec<i32> = line.split(' ').map(|c| c.parse().unwrap()).collect();
        for channel in 0..3 {
            // 8-bit limited-range YUV and back costs up to two levels, quantisation a few more; swapped colour planes
            // would cost more than a hundred.
            let error = (seen[channel] - i32::from(color[channel])).abs();
            assert!(error <= 6, "{line}, expected {color:?}");
        }
    }
}
