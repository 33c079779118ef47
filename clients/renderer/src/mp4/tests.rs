//! The video file taken apart: boxes, sample table, and every frame decoded.

use openh264::decoder::Decoder;
use openh264::formats::YUVSource;

use super::*;

/// Frame `index` of a test video: a white square on a teal gradient, moving right.
fn frame(index: u32, width: u32, height: u32) -> Image {
    let mut rgb = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let left = 8 + 3 * index;
            let square = (left..left + 24).contains(&x) && (20..44).contains(&y);
            let shade = (40 + x) as u8;
            rgb.extend(if square { [250; 3] } else { [30, shade, 120] });
        }
    }
    Image { width, height, rgb }
}

/// Content of the box at `path` in `bytes`.
fn find<'a>(bytes: &'a [u8], path: &[&str]) -> Option<&'a [u8]> {
    let Some((name, rest)) = path.split_first() else {
        return Some(bytes);
    };
    let mut at = 0;
    while at + 8 <= bytes.len() {
        let size = u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert!(
            size >= 8 && at + size <= bytes.len(),
            "box at {at} has size {size}"
        );
        if &bytes[at + 4..at + 8] == name.as_bytes() {
            return find(&bytes[at + 8..at + size], rest);
        }
        at += size;
    }
    None
}

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes
        .chunks_exact(4)
        .map(|word| u32::from_be_bytes(word.try_into().unwrap()))
        .collect()
}

const TABLE: [&str; 5] = ["moov", "trak", "mdia", "minf", "stbl"];

fn table<'a>(file: &'a [u8], name: &'static str) -> &'a [u8] {
    let mut path = TABLE.to_vec();
    path.push(name);
    find(file, &path).unwrap_or_else(|| panic!("no {name} in the sample table"))
}

fn write(folder: &Path, width: u32, height: u32, fps: f64, count: u32) -> Vec<u8> {
    let path = folder.join("video.mp4");
    let mut writer = Mp4Writer::create(&path, width, height, fps).unwrap();
    for index in 0..count {
        writer.add(&frame(index, width, height)).unwrap();
    }
    assert_eq!(writer.finish().unwrap(), u64::from(count));
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1);
    std::fs::read(path).unwrap()
}

#[test]
fn the_file_holds_every_frame_at_the_right_time() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), 160, 96, 30.0, 75);
    assert!(find(&file, &["ftyp"]).is_some());
    // A page can play it while it loads: the table comes before the data.
    let place = |name: &[u8]| file.windows(4).position(|w| w == name).unwrap();
    assert!(place(b"moov") < place(b"mdat"));
    let sizes = words(table(&file, "stsz"));
    assert_eq!(sizes[2], 75);
    let media = words(find(&file, &["moov", "trak", "mdia", "mdhd"]).unwrap());
    let timescale = media[3];
    let times = words(table(&file, "stts"));
    let runs: Vec<(u32, u32)> = times[2..]
        .chunks_exact(2)
        .map(|run| (run[0], run[1]))
        .collect();
    assert_eq!(runs.iter().map(|run| run.0).sum::<u32>(), 75);
    for (_, duration) in runs {
        assert_eq!(duration, timescale / 30);
    }
    // A key frame at the start and every two seconds.
    assert_eq!(words(table(&file, "stss"))[2..], [1, 61]);
}

#[test]
fn every_frame_decodes_to_the_picture_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let count = 20;
    let file = write(folder.path(), 161, 97, 60.0, count);
    let entry = table(&file, "stsd");
    let config = entry.windows(4).position(|w| w == b"avcC").unwrap() + 4;
    let mut parameters = Vec::new();
    // avcC: five bytes, then the counted sequence sets, then the counted picture sets, each with a 16-bit length.
    let mut at = config + 5;
    for mask in [0x1f, 0xff] {
        let sets = entry[at] & mask;
        at += 1;
        for _ in 0..sets {
            let length = usize::from(u16::from_be_bytes([entry[at], entry[at + 1]]));
            parameters.extend([0, 0, 0, 1]);
            parameters.extend(&entry[at + 2..at + 2 + length]);
            at += 2 + length;
        }
    }
    let mut decoder = Decoder::new().unwrap();
    assert!(decoder.decode(&parameters).unwrap().is_none());
    let mut data = find(&file, &["mdat"]).unwrap();
    let mut decoded = 0;
    for size in &words(table(&file, "stsz"))[3..] {
        let (mut sample, rest) = data.split_at(*size as usize);
        data = rest;
        let mut annex_b = Vec::new();
        while let Some((length, units)) = sample.split_at_checked(4) {
            let length = u32::from_be_bytes(length.try_into().unwrap()) as usize;
            annex_b.extend([0, 0, 0, 1]);
            annex_b.extend(&units[..length]);
            sample = &units[length..];
        }
        let picture = decoder
            .decode(&annex_b)
            .unwrap()
            .expect("one picture per sample");
        assert_eq!(picture.dimensions(), (160, 96));
        let mut rgb = vec![0; 160 * 96 * 3];
        picture.write_rgb8(&mut rgb);
        let original = frame(decoded, 161, 97);
        let mut sum = 0.0;
        for y in 0..96 {
            for x in 0..160 {
                let wanted = original.pixel(x, y).unwrap();
                let at = 3 * (y as usize * 160 + x as usize);
                for channel in 0..3 {
                    sum += f64::from(i32::from(wanted[channel]) - i32::from(rgb[at + channel]))
                        .powi(2);
                }
            }
        }
        let psnr = 10.0 * (255.0 * 255.0 * (160.0 * 96.0 * 3.0) / sum).log10();
        // 30 dB is the usual line for good video; a frame out of place, or wrong colours, give below 20.
        assert!(psnr > 30.0, "frame {decoded}: {psnr} dB");
        decoded += 1;
    }
    assert_eq!(decoded, count);
    assert!(data.is_empty());
}

#[test]
fn an_abandoned_video_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("video.mp4");
    let mut writer = Mp4Writer::create(&path, 64, 64, 30.0).unwrap();
    writer.add(&frame(0, 64, 64)).unwrap();
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let empty = Mp4Writer::create(&path, 64, 64, 30.0).unwrap();
    assert_eq!(empty.finish().unwrap(), 0);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn impossible_videos_are_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("video.mp4");
    for (width, height, fps) in [
        (8, 64, 30.0),
        (5000, 64, 30.0),
        (3000, 3000, 30.0),
        (64, 64, f64::NAN),
    ] {
        let error = Mp4Writer::create(&path, width, height, fps).err().unwrap();
        assert!(
            error.to_string().contains(&format!("{width} x {height}")),
            "{error}"
        );
    }
    let error = Mp4Writer::create(Path::new("/nonexistent/v.mp4"), 64, 64, 30.0)
        .err()
        .unwrap();
    assert!(error.to_string().contains("/nonexistent/v.mp4"));
    let mut writer = Mp4Writer::create(&path, 64, 64, 30.0).unwrap();
    let error = writer.add(&frame(0, 66, 64)).unwrap_err();
    assert!(error.to_string().contains("64 x 64") && error.to_string().contains("66 x 64"));
}
