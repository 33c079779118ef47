//! Masks of pictures: to which object each pixel belongs.
//!
//! A mask is a `.png` of the picture's name with one channel of 8 or 16 bits, or a palette: 0 belongs to no object, `n` to
//! object `n`. `names.json` beside them says what the objects are called: `{"1": "vase"}`. A `.npy` of whole numbers `[rows]
//! [columns]` does as well. LangSplat's `NAME_s.npy` has numbers of masks at four levels, `NAME_f.npy` a vector for each mask.

use std::{
    collections::BTreeMap,
    io::Cursor,
    path::{Path, PathBuf},
};

use cosplat_files::reading;

use crate::{Evidence, MaskMap, SemanticsError, lift::Labels, npy, objects::Vectors};

/// End of the names of LangSplat's masks.
const PROPOSALS: &str = "_s.npy";
/// End of the names of their vectors.
const VECTORS: &str = "_f.npy";

/// Levels of LangSplat's masks.
const LEVELS: usize = 4;

/// Most bytes that one byte of a PNG can stand for, by its compression.
const DEFLATE: usize = 1032;

/// Most objects that masks may name: shares of each are kept for every Gaussian.
pub const MOST_OBJECTS: usize = 1024;

/// Where the masks of a view are, if there are any. A torch file is found last, to be refused with the line that converts it.
pub fn find(folder: &Path, view: &str) -> Option<PathBuf> {
    let file = |end: &str| Some(folder.join(format!("{view}{end}"))).filter(|path| path.is_file());
    file(".png")
        .or_else(|| file(".npy"))
        .or_else(|| file(PROPOSALS))
        .or_else(|| file(".pt"))
        .or_else(|| file(".pth"))
}

/// Whether a mask is one of LangSplat's: its numbers mean nothing beyond its picture.
pub fn is_proposals(path: &Path) -> bool {
    path.to_str().is_some_and(|path| path.ends_with(PROPOSALS))
}

/// Reads one level of LangSplat's masks of a picture, 0 to 3 (default, small, medium, large), and the vectors of all masks.
///
/// # Errors
/// When a file cannot be read or is no such array.
pub fn read_proposals(path: &Path, level: usize) -> Result<(MaskMap, Vectors), SemanticsError> {
    let file = vectors_of(path);
    parse_proposals(
        path,
        [
            &SemanticsError::content(path)?,
            &SemanticsError::content(&file)?,
        ],
        level,
    )
}

/// The file of the vectors of LangSplat's masks.
fn vectors_of(path: &Path) -> PathBuf {
    let name = path.to_string_lossy();
    let picture = name.strip_suffix(PROPOSALS).unwrap_or(&name);
    PathBuf::from(format!("{picture}{VECTORS}"))
}

/// As [`read_proposals`], from the bytes of both files.
///
/// # Errors
/// When one is no such array.
pub fn parse_proposals(
    path: &Path,
    bytes: [&[u8]; 2],
    level: usize,
) -> Result<(MaskMap, Vectors), SemanticsError> {
    let file = vectors_of(path);
    let wrong = |path: &Path| {
        let path = path.to_owned();
        move |why: String| SemanticsError::format(&path, why)
    };
    let numbers = npy::ints(bytes[0]).map_err(wrong(path))?;
    let &[levels, height, width] = numbers.shape.as_slice() else {
        let why = format!(
            "has shape {:?}, expected [levels, rows, columns]",
            numbers.shape
        );
        return Err(SemanticsError::format(path, why));
    };
    if level >= levels || width == 0 || height == 0 {
        let why =
            format!("has {levels} levels of {width} x {height} pixels, level {level} is asked for");
        return Err(SemanticsError::format(path, why));
    }
    let vectors = npy::floats(bytes[1]).map_err(wrong(&file))?;
    let &[count, dim] = vectors.shape.as_slice() else {
        let why = format!("has shape {:?}, expected [masks, values]", vectors.shape);
        return Err(SemanticsError::format(&file, why));
    };
    if dim == 0 {
        return Err(SemanticsError::format(
            &file,
            format!("has {count} vectors of no values"),
        ));
    }
    // There is a value for each pixel of each level: no product is too large.
    let pixels = width * height;
    let mask = numbers.value[level * pixels..(level + 1) * pixels].to_vec();
    let most = i32::try_from(count).unwrap_or(i32::MAX);
    if let Some(stranger) = mask.iter().find(|m| **m < -1 || **m >= most) {
        let why = format!(
            "names mask {stranger}, expected -1 to {}: so many vectors are beside it",
            most - 1
        );
        return Err(SemanticsError::format(path, why));
    }
    let vectors = Vectors {
        dim,
        value: vectors.value,
    };
    Ok((
        MaskMap {
            width,
            height,
            mask,
        },
        vectors,
    ))
}

/// Writes masks of a picture with a vector for each as LangSplat keeps them, the same at all four levels.
///
/// # Errors
/// When a file cannot be written.
pub fn write_proposals(
    folder: &Path,
    view: &str,
    map: &MaskMap,
    vectors: &Vectors,
) -> Result<(), SemanticsError> {
    let levels = std::array::from_fn(|_| map.clone());
    write_levels(folder, view, &levels, vectors)
}

/// As [`write_proposals`], with masks of one size at each level.
///
/// # Errors
/// When a file cannot be written.
pub fn write_levels(
    folder: &Path,
    view: &str,
    maps: &[MaskMap; LEVELS],
    vectors: &Vectors,
) -> Result<(), SemanticsError> {
    let numbers = npy::write_ints(&npy::Array {
        shape: vec![LEVELS, maps[0].height, maps[0].width],
        value: maps
            .iter()
            .flat_map(|map| map.mask.iter().copied())
            .collect(),
    });
    let vectors = npy::write_floats(&npy::Array {
        shape: vec![vectors.value.len() / vectors.dim.max(1), vectors.dim],
        value: vectors.value.clone(),
    });
    for (end, bytes) in [(PROPOSALS, numbers), (VECTORS, vectors)] {
        let path = folder.join(format!("{view}{end}"));
        cosplat_files::write(&path, bytes).map_err(SemanticsError::write(&path))?;
    }
    Ok(())
}

/// Masks whose numbers mean nothing beyond their view, with the number of the object that has most weight in each; -1 for one in
/// which no object has any. `said` is the evidence of the view.
#[must_use]
pub fn with_objects(map: &MaskMap, said: &[Evidence], labels: &Labels) -> MaskMap {
    let mut weight = BTreeMap::<(i32, i32), f64>::new();
    for e in said {
        let object = labels.object[e.gaussian as usize];
        if object >= 0 {
            *weight.entry((e.mask, object)).or_default() += f64::from(e.weight);
        }
    }
    let mut best = BTreeMap::<i32, (f64, i32)>::new();
    for ((mask, object), weight) in weight {
        let most = best.entry(mask).or_insert((0.0, -1));
        if weight > most.0 {
            *most = (weight, object);
        }
    }
    let of = |mask: &i32| match mask {
        -1 => -1,
        mask => best.get(mask).map_or(-1, |b| b.1),
    };
    MaskMap {
        mask: map.mask.iter().map(of).collect(),
        ..map.clone()
    }
}

/// As [`read`], from the bytes of a `.npy` file.
///
/// # Errors
/// When it is no such array, or names more than [`MOST_OBJECTS`] objects.
pub fn parse_array(path: &Path, bytes: &[u8]) -> Result<MaskMap, SemanticsError> {
    let wrong = |why: String| SemanticsError::format(path, why);
    let found = npy::ints(bytes).map_err(wrong)?;
    let &[height, width] = found.shape.as_slice() else {
        return Err(wrong(format!(
            "has shape {:?}, expected [rows, columns]",
            found.shape
        )));
    };
    if width == 0 || height == 0 {
        return Err(wrong(format!(
            "has {width} x {height} pixels, expected some"
        )));
    }
    let range = 0..=MOST_OBJECTS as i32;
    match found.value.iter().find(|v| !range.contains(*v)) {
        Some(stranger) => Err(wrong(format!(
            "names object {stranger}, expected 0 to {MOST_OBJECTS}"
        ))),
        None => Ok(MaskMap {
            width,
            height,
            mask: found.value.iter().map(|v| v - 1).collect(),
        }),
    }
}

/// Reads a mask: numbers of objects from 0, -1 for none.
///
/// # Errors
/// When the file cannot be read, is no such picture, or names more than [`MOST_OBJECTS`] objects.
pub fn read(path: &Path) -> Result<MaskMap, SemanticsError> {
    let wrong = |why: String| SemanticsError::format(path, why);
    if path.extension().is_some_and(|e| e == "pt" || e == "pth") {
        return Err(wrong(
            "a torch file may run programs when it is read; convert it: \
             python -c \"import sys,torch,PIL.Image as I; I.fromarray(torch.load(sys.argv[1],weights_only=True).short().numpy()).save(sys.argv[2])\""
                .into(),
        ));
    }
    let bytes = SemanticsError::content(path)?;
    match path.extension().is_some_and(|e| e == "npy") {
        true => parse_array(path, &bytes),
        false => parse_picture(path, &bytes),
    }
}

/// As [`read`], from the bytes of a PNG.
///
/// # Errors
/// When they are no such picture or name too many objects.
pub fn parse_picture(path: &Path, bytes: &[u8]) -> Result<MaskMap, SemanticsError> {
    let wrong = |why: String| SemanticsError::format(path, why);
    let most = bytes.len().saturating_mul(DEFLATE);
    let limits = png::Limits {
        bytes: most.max(1 << 20),
    };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    // A palette's numbers are the objects, not its colours.
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder
        .read_info()
        .map_err(|error| wrong(format!("no PNG picture: {error}")))?;
    let info = reader.info();
    let (width, height) = (info.width as usize, info.height as usize);
    let (color, depth) = (info.color_type, info.bit_depth);
    let is_number = matches!(color, png::ColorType::Grayscale | png::ColorType::Indexed);
    let size = match depth {
        png::BitDepth::Eight => 1,
        png::BitDepth::Sixteen => 2,
        _ => 0,
    };
    if !is_number || size == 0 {
        return Err(wrong(format!(
            "a mask with colours {color:?} of {depth:?} bits, expected one channel or a palette of 8 or 16 bits: \
             0 for no object, n for object n"
        )));
    }
    let length = reader.output_buffer_size().unwrap_or(usize::MAX);
    if length > most {
        return Err(wrong(format!(
            "a damaged PNG picture: {width} x {height} pixels, expected at most {most} bytes of them in a file of {}",
            bytes.len()
        )));
    }
    let mut data = vec![0; length];
    reader
        .next_frame(&mut data)
        .map_err(|error| wrong(format!("a damaged PNG picture: {error}")))?;
    let number = |pixel: &[u8]| match pixel {
        [high, low] => i32::from(u16::from_be_bytes([*high, *low])),
        _ => i32::from(pixel[0]),
    };
    let mask: Vec<i32> = data
        .chunks_exact(size)
        .take(width * height)
        .map(|pixel| number(pixel) - 1)
        .collect();
    let largest = mask.iter().copied().max().unwrap_or(-1);
    if largest >= MOST_OBJECTS as i32 {
        return Err(wrong(format!(
            "names object {}, expected at most {MOST_OBJECTS}",
            largest + 1
        )));
    }
    Ok(MaskMap {
        width,
        height,
        mask,
    })
}

/// Names of `count` objects: those of `names.json` in `folder`, else `object_1`, `object_2`.
///
/// # Errors
/// When that file cannot be read or says something else.
pub fn names(folder: &Path, count: usize) -> Result<Vec<String>, SemanticsError> {
    let path = folder.join("names.json");
    let given: BTreeMap<String, String> = match reading::read_text(&path) {
        Ok(text) => serde_json::from_str(&text).map_err(|error| {
            SemanticsError::format(&path, format!("expected {{\"1\": \"name\"}}: {error}"))
        })?,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => BTreeMap::new(),
        Err(error) => return Err(SemanticsError::read(&path)(error)),
    };
    if let Some(key) = given
        .keys()
        .find(|key| !matches!(key.parse(), Ok(1..=MOST_OBJECTS)))
    {
        let why = format!("key {key:?}, expected the number of an object, 1 to {MOST_OBJECTS}");
        return Err(SemanticsError::format(&path, why));
    }
    let most = given
        .keys()
        .filter_map(|key| key.parse().ok())
        .max()
        .unwrap_or(0);
    let name = |n: usize| given.get(&n.to_string()).cloned();
    Ok((1..=count.max(most))
        .map(|n| name(n).unwrap_or_else(|| format!("object_{n}")))
        .collect())
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;
    use crate::npy::tests::file;

    fn write(path: &Path, color: png::ColorType, depth: png::BitDepth, data: &[u8]) {
        let mut encoder = png::Encoder::new(File::create(path).expect("a file"), 2, 2);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header().expect("a header");
        writer.write_image_data(data).expect("written");
    }

    #[test]
    fn what_is_no_plain_file_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let link = |name: &str| {
            let path = folder.path().join(name);
            std::os::unix::fs::symlink("/dev/zero", &path).expect("linked");
            path
        };
        let said = |error: SemanticsError| {
            let words = error.to_string();
            assert!(words.contains("expected a plain file"), "{words}");
        };
        said(read(&link("a.png")).expect_err("a device"));
        said(read(&link("a.npy")).expect_err("a device"));
        link("names.json");
        said(names(folder.path(), 1).expect_err("a device"));
    }

    #[test]
    fn masks_are_numbers_less_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        write(
            &path,
            png::ColorType::Grayscale,
            png::BitDepth::Eight,
            &[0, 1, 2, 255],
        );
        assert_eq!(read(&path).expect("a mask").mask, [-1, 0, 1, 254]);
        write(
            &path,
            png::ColorType::Grayscale,
            png::BitDepth::Sixteen,
            &[0, 0, 1, 0, 0, 3, 0, 1],
        );
        assert_eq!(read(&path).expect("a mask").mask, [-1, 255, 2, 0]);
        assert_eq!(find(folder.path(), "a"), Some(path));
        assert_eq!(find(folder.path(), "b"), None);
    }

    #[test]
    fn masks_of_langsplat_have_levels_and_vectors() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a_s.npy");
        let numbers = |of: [i32; 8]| of.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
        let array = |data: [i32; 8]| file("<i4", "(4, 1, 2)", &numbers(data));
        std::fs::write(&path, array([-1, 0, 1, 1, 0, 1, -1, 1])).expect("written");
        let vectors: Vec<u8> = [1.0f32, 0.0, 0.0, 1.0]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        std::fs::write(
            folder.path().join("a_f.npy"),
            file("<f4", "(2, 2)", &vectors),
        )
        .expect("written");
        assert_eq!(find(folder.path(), "a").as_deref(), Some(path.as_path()));
        assert!(is_proposals(&path));
        let (map, vectors) = read_proposals(&path, 3).expect("masks");
        assert_eq!((map.width, map.height, map.mask), (2, 1, vec![-1, 1]));
        assert_eq!(vectors.of(1), [0.0, 1.0]);
        let refused = |level| {
            read_proposals(&path, level)
                .expect_err("refused")
                .to_string()
        };
        assert!(refused(4).contains("4 levels"));
        // No pixel, and a picture whose size is beyond what can be counted.
        for (shape, why) in [
            ("(4, 0, 2)", "level 0 is asked for"),
            ("(0, 99999999999, 99999999999)", "has 0 bytes of values"),
        ] {
            std::fs::write(&path, file("<i4", shape, &[])).expect("written");
            assert!(refused(0).contains(why), "{shape}: {}", refused(0));
        }
        std::fs::write(&path, array([0, 0, 0, 0, 0, 0, 0, 2])).expect("written");
        assert!(refused(3).contains("names mask 2"));
        let plain = folder.path().join("b.npy");
        std::fs::write(&plain, file("|u1", "(1, 2)", &[0, 3])).expect("written");
        assert_eq!(read(&plain).expect("a mask").mask, [-1, 2]);
        std::fs::write(&plain, file("|u1", "(0, 2)", &[])).expect("written");
        let error = read(&plain).expect_err("no pixel").to_string();
        assert!(error.contains("2 x 0 pixels"), "{error}");
    }

    #[test]
    fn vectors_without_values_are_refused() {
        let numbers = file("<i4", "(1, 1, 1)", &0i32.to_le_bytes());
        let refused = |shape| {
            let vectors = file("<f4", shape, &[]);
            let found = parse_proposals(Path::new("a_s.npy"), [&numbers, &vectors], 0);
            found.expect_err("refused").to_string()
        };
        // More than there are numbers of masks.
        let error = refused("(4294967296, 0)");
        assert!(error.contains("a_f.npy: has 4294967296 vectors"), "{error}");
        let error = refused("(0, 4)");
        assert!(error.contains("names mask 0, expected -1 to -1"), "{error}");
    }

    #[test]
    fn proposals_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let map = MaskMap {
            width: 3,
            height: 1,
            mask: vec![1, -1, 0],
        };
        let vectors = Vectors {
            dim: 2,
            value: vec![1.0, 0.0, 0.6, 0.8],
        };
        write_proposals(folder.path(), "a", &map, &vectors).expect("written");
        let path = find(folder.path(), "a").expect("there");
        for level in 0..LEVELS {
            let found = read_proposals(&path, level).expect("masks");
            assert_eq!(found, (map.clone(), vectors.clone()));
        }
    }

    #[test]
    fn proposals_take_the_object_that_most_of_them_covers() {
        let map = MaskMap {
            width: 4,
            height: 1,
            mask: vec![0, 1, 2, -1],
        };
        let labels = Labels {
            object: vec![5, 3, -1],
            confidence: vec![1.0; 3],
        };
        let said = [(0, 0, 1.0), (1, 0, 2.0), (0, 1, 0.5), (2, 2, 9.0)];
        let said = said.map(|(gaussian, mask, weight)| Evidence {
            gaussian,
            mask,
            weight,
        });
        assert_eq!(with_objects(&map, &said, &labels).mask, [3, 5, -1, -1]);
    }

    #[test]
    fn a_small_file_of_a_huge_picture_is_refused() {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 60_000, 60_000);
        encoder.set_color(png::ColorType::Grayscale);
        let mut writer = encoder.write_header().expect("a header");
        let data = [0x78, 0x01, 0x03, 0x00];
        writer
            .write_chunk(png::chunk::IDAT, &data)
            .expect("written");
        drop(writer);
        let refused = parse_picture(Path::new("a.png"), &bytes).expect_err("refused");
        let expected = format!("at most {} bytes", DEFLATE * bytes.len());
        assert!(refused.to_string().contains(&expected), "{refused}");
    }

    #[test]
    fn what_is_no_mask_is_refused_in_a_sentence() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        write(&path, png::ColorType::Rgb, png::BitDepth::Eight, &[0; 12]);
        let refused = |path: &Path| read(path).expect_err("refused").to_string();
        assert!(
            refused(&path).contains("expected one channel"),
            "{}",
            refused(&path)
        );
        write(
            &path,
            png::ColorType::Grayscale,
            png::BitDepth::Sixteen,
            &[255; 8],
        );
        assert!(
            refused(&path).contains("names object 65535"),
            "{}",
            refused(&path)
        );
        std::fs::write(&path, "no picture").expect("written");
        assert!(
            refused(&path).contains("no PNG picture"),
            "{}",
            refused(&path)
        );
        std::fs::write(folder.path().join("b.pt"), "PK").expect("written");
        let torch = find(folder.path(), "b").expect("a file");
        assert!(refused(&torch).contains("torch.load"));
        std::fs::write(folder.path().join("names.json"), r#"{"2": "vase"}"#).expect("written");
        assert_eq!(
            names(folder.path(), 1).expect("names"),
            ["object_1", "vase"]
        );
        std::fs::write(folder.path().join("names.json"), r#"{"vase": "2"}"#).expect("written");
        assert!(
            names(folder.path(), 1)
                .expect_err("refused")
                .to_string()
                .contains("vase")
        );
    }
}
