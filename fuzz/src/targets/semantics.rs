//! Stage 1: arrays of numpy, files of objects and of trees, cameras of COLMAP and of `transforms.json`.

use std::path::Path;

use cosplat_scene::assets::objects::{Labels, Objects, Vectors};
use cosplat_semantics::{
    View,
    colmap::{self, Form},
    dense, masks, npy,
    query::Words,
    transforms,
    tree::Tree,
};

/// The line between the two files of a COLMAP model in text.
const BETWEEN: &[u8] = b"=\n";
/// What the seed of `tree` is for.
const TREE_ASSET: (u64, usize) = (7, 8);

/// The text up to the first line's end, and what follows that.
fn lines(data: &[u8]) -> (&[u8], &[u8]) {
    let end = data.iter().position(|byte| *byte == b'\n');
    let end = end.unwrap_or(data.len());
    (&data[..end], data.get(end + 1..).unwrap_or_default())
}

/// A `.npy` file. The first byte says what follows it: a whole file, or from 1 to 3 the version of one whose header is the
/// first line. So mutations of the header keep its length right.
pub fn array(data: &[u8]) {
    let Some((first, data)) = data.split_first() else {
        return;
    };
    let (header, values) = lines(data);
    let length = header.len() as u32 + 1;
    let length = length.to_le_bytes();
    let whole = |version: u8, length: &[u8]| {
        let magic = [&b"\x93NUMPY"[..], &[version, 0]].concat();
        [&magic, length, header, b"\n", values].concat()
    };
    let file = match first & 3 {
        0 => data.to_vec(),
        1 => whole(1, &length[..2]),
        version => whole(version, &length),
    };
    if let Ok(found) = npy::ints(&file) {
        assert_eq!(found.shape.iter().product::<usize>(), found.value.len());
        assert_eq!(npy::ints(&npy::write_ints(&found)), Ok(found));
    }
    if let Ok(found) = npy::floats(&file) {
        assert!(found.value.iter().all(|x| x.is_finite()));
        assert_eq!(found.shape.iter().product::<usize>(), found.value.len());
        assert_eq!(npy::floats(&npy::write_floats(&found)), Ok(found));
    }
    map(Path::new("fuzz.npy"), &file);
    let path = Path::new("fuzz_s.npy");
    if let Ok(map) = masks::parse_array(path, &file) {
        assert_eq!(map.resized(5, 3).mask.len(), 15);
    }
    // The same file as LangSplat's masks of two vectors, then as their vectors.
    let vectors = npy::write_floats(&npy::Array {
        shape: vec![2, 1],
        value: vec![1.0, 0.5],
    });
    let numbers = npy::write_ints(&npy::Array {
        shape: vec![1, 1, 2],
        value: vec![-1, 0],
    });
    for bytes in [[&file, &vectors], [&numbers, &file]] {
        let Ok((map, vectors)) = masks::parse_proposals(path, bytes.map(|b| &b[..]), 0) else {
            continue;
        };
        assert_eq!(map.resized(5, 3).mask.len(), 15);
        for mask in map.mask.into_iter().filter(|mask| *mask >= 0) {
            assert_eq!(vectors.of(mask as usize).len(), vectors.dim);
        }
    }
}

/// A map of features has a finite vector for each of its cells, which are not too many, and comes back as it was written.
fn map(path: &Path, file: &[u8]) {
    let Ok(map) = dense::parse(path, file) else {
        return;
    };
    let cells = map.cells();
    assert!((1..=128).contains(&map.rows) && (1..=128).contains(&map.columns));
    assert_eq!(cells.mask.len(), map.rows * map.columns);
    assert_eq!(map.vectors.value.len(), cells.mask.len() * map.vectors.dim);
    assert!(map.vectors.value.iter().all(|x| x.is_finite()));
    let again = dense::parse(Path::new("again.npy"), &map.to_bytes());
    assert_eq!(again.expect("what is written can be read"), map);
}

/// Whole files and headers of each version, of whole numbers and of fractions.
pub fn array_seeds() -> Vec<Vec<u8>> {
    let masks = npy::Array {
        shape: vec![4, 1, 2],
        value: vec![0, 1, -1, 0, 1, 1, -1, -1],
    };
    let vectors = npy::Array {
        shape: vec![2, 3],
        value: vec![1.0, 0.0, 0.5, -1.0, 2.0, 0.25],
    };
    let text = |first: char, kind: &str, shape: &str| {
        format!("{first}{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n")
    };
    let file = |header: String, values: &[u8]| [header.as_bytes(), values].concat();
    let whole = |bytes: Vec<u8>| [b"@", &bytes[..]].concat();
    vec![
        whole(npy::write_ints(&masks)),
        whole(npy::write_floats(&vectors)),
        file(text('A', "|u1", "(2, 3)"), &[0, 1, 2, 3, 4, 255]),
        file(text('B', "<i8", "(1,)"), &[255; 8]),
        file(text('C', "<f2", "(2, 1)"), &[0, 60, 0, 184]),
        file(text('A', "<f2", "(1, 2, 1)"), &[0, 60, 0, 184]),
        file(text('A', "<f4", "(130, 1, 1)"), &[0; 520]),
    ]
}

/// A file of safetensors. After an even first byte it comes whole; after an odd one its header is the first line, and the
/// length of that is put before it.
fn tensors(data: &[u8]) -> Option<Vec<u8>> {
    let (first, data) = data.split_first()?;
    let (header, values) = lines(data);
    Some(match first & 1 {
        0 => data.to_vec(),
        _ => [&(header.len() as u64).to_le_bytes()[..], header, values].concat(),
    })
}

/// A file of objects.
pub fn objects(data: &[u8]) {
    let Some(file) = tensors(data) else {
        return;
    };
    map(Path::new("fuzz.safetensors"), &file);
    words(&file);
    let Ok(found) = Objects::parse_any("fuzz", &file) else {
        return;
    };
    let (rows, count) = (found.labels.object.len(), found.names.len());
    assert_eq!(found.labels.confidence.len(), rows);
    let is_object = |object: &i32| (-1..count as i32).contains(object);
    assert!(found.labels.object.iter().all(is_object));
    let is_share = |share: &f32| (0.0..=1.0).contains(share);
    assert!(found.labels.confidence.iter().all(is_share));
    for (vectors, of) in [(&found.feature, rows), (&found.object_feature, count)] {
        let Some(vectors) = vectors else {
            continue;
        };
        assert_eq!(vectors.value.len(), of * vectors.dim);
        assert!(vectors.value.iter().all(|x| x.is_finite()));
    }
    // Every chain of parts ends, and rows that cannot be read come back with nothing.
    assert!((0..count).all(|object| found.root_of(object) < count));
    let _ = found.named(&found.names);
    let even: Vec<usize> = (0..rows).step_by(2).collect();
    let spread = found.subset(&even).spread(&even, rows);
    assert_eq!(spread.subset(&even), found.subset(&even));
    let again = found.to_bytes().expect("what is accepted can be written");
    assert_eq!(Objects::parse_any("again", &again).expect("again"), found);
}

/// Vectors of words score objects by numbers from 0 to 1.
fn words(file: &[u8]) {
    let Ok(words) = Words::parse(file) else {
        return;
    };
    assert!(!words.vector.is_empty());
    for vector in words.vector.values() {
        assert_eq!(vector.len(), words.dim);
        let length: f64 = vector.iter().map(|x| f64::from(*x).powi(2)).sum();
        assert!((length - 1.0).abs() < 1e-3, "{length}");
    }
    let objects = Vectors {
        dim: words.dim,
        value: words.vector.values().flatten().copied().collect(),
    };
    let all: Vec<&str> = words.vector.keys().map(String::as_str).collect();
    let is_share = |score: &f32| (0.0..=1.0).contains(score);
    for query in &all {
        let scores = words.relevancy(&objects, query, &all);
        assert!(scores.is_some_and(|scores| scores.iter().all(is_share)));
        let stands_out = words.contrast(&objects, query).unwrap_or_default();
        assert!(stands_out.iter().all(|deviations| !deviations.is_nan()));
        let scores = words.softmax(&objects, query, &all);
        assert!(scores.is_some_and(|scores| scores.iter().all(is_share)));
    }
}

/// Objects with everything that a file may have, and with what it must have.
pub fn objects_seeds() -> Vec<Vec<u8>> {
    let plain = Objects {
        asset_hash: 0x1234_5678_9abc_def0,
        names: vec!["vase".into(), "table".into()],
        labels: Labels {
            object: vec![0, 1, -1],
            confidence: vec![1.0, 0.5, 0.0],
        },
        made: "by hand".into(),
        ..Objects::default()
    };
    let full = Objects {
        parent: vec![-1, 0],
        feature: Some(Vectors {
            dim: 2,
            value: vec![1.0, 0.5, 0.25, -1.0, 0.0, 3.0],
        }),
        object_feature: Some(Vectors {
            dim: 1,
            value: vec![0.1, 0.2],
        }),
        ..plain.clone()
    };
    let seed = |objects: &Objects| {
        let bytes = objects.to_bytes().expect("sound objects");
        let (length, rest) = bytes.split_first_chunk::<8>().expect("a length");
        let (header, values) = rest.split_at(u64::from_le_bytes(*length) as usize);
        let framed = [b"A", header, b"\n", values].concat();
        [[b"@", &bytes[..]].concat(), framed]
    };
    let tensors = [
        r#"A{"clip":{"dtype":"F16","shape":[1,2,1],"data_offsets":[0,4]}}"#,
        r#"A{"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]},"b":{"dtype":"F32","shape":[1],"data_offsets":[4,8]}}"#,
    ];
    let tensor = |(header, values): (&str, &[u8])| [header.as_bytes(), b"\n", values].concat();
    let more = tensors
        .into_iter()
        .zip([&[0, 60, 0, 184][..], &[0, 0, 128, 63, 0, 0, 128, 191]]);
    let seeds = [&plain, &full].into_iter().flat_map(seed);
    seeds.chain(more.map(tensor)).collect()
}

/// A mask as PNG: columns, rows, kind of colours, bits, and whether it is interlaced, a byte each but for two of rows; then
/// what its compressed data are. The chunks around it are made here, as no mutation would hit their sums.
pub fn mask(data: &[u8]) {
    let Some(file) = picture(data) else {
        return;
    };
    let Ok(map) = masks::parse_picture(Path::new("fuzz.png"), &file) else {
        return;
    };
    assert_eq!(map.mask.len(), map.width * map.height);
    let most = masks::MOST_OBJECTS as i32;
    assert!(map.mask.iter().all(|mask| (-1..most).contains(mask)));
    assert_eq!(map.resized(5, 3).mask.len(), 15);
}

fn picture(data: &[u8]) -> Option<Vec<u8>> {
    let ([columns, rows, high, color, depth, interlaced], packed) = data.split_first_chunk()?;
    let chunk = |kind: &[u8], data: &[u8]| {
        let body = [kind, data].concat();
        let sum = crc32fast::hash(&body).to_be_bytes();
        [&(data.len() as u32).to_be_bytes(), &body[..], &sum].concat()
    };
    let size = [0, 0, 0, *columns, 0, 0, *high, *rows];
    let kind = [*depth, *color, 0, 0, *interlaced & 1];
    let palette = [[1, 2, 3]; 256];
    let palette = match color {
        3 => chunk(b"PLTE", palette.as_flattened()),
        _ => Vec::new(),
    };
    let head = chunk(b"IHDR", &[&size[..], &kind].concat());
    let start = b"\x89PNG\r\n\x1a\n";
    let data = chunk(b"IDAT", packed);
    let end = chunk(b"IEND", b"");
    Some([start, &head[..], &palette, &data, &end].concat())
}

/// Three pixels with their rows as they are: of 8 bits, of a palette, of 16 bits.
pub fn mask_seeds() -> Vec<Vec<u8>> {
    // A block that is not compressed: its length, that with all bits turned, a filter and the pixels.
    let seed = |color: u8, depth: u8, pixels: &[u8]| {
        let length = pixels.len() as u16 + 1;
        let head = [3, 1, 0, color, depth, 0, 0x78, 0x01, 1];
        let lengths = [length.to_le_bytes(), (!length).to_le_bytes()];
        [&head[..], lengths.as_flattened(), &[0], pixels].concat()
    };
    vec![
        seed(0, 8, &[0, 1, 2]),
        seed(3, 8, &[0, 1, 2]),
        seed(0, 16, &[0, 1, 0, 2, 0, 0]),
    ]
}

/// A file of a tree, for the asset that the seed is for.
pub fn tree(data: &[u8]) {
    let Some(file) = tensors(data) else {
        return;
    };
    let (hash, rows) = TREE_ASSET;
    let Ok(tree) = Tree::parse(&file, hash, rows) else {
        return;
    };
    let count = tree.size.len();
    assert!(tree.superpoint.iter().all(|s| (*s as usize) < count));
    assert!(tree.height.iter().all(|height| height.is_finite()));
    if let Some(ground) = tree.ground {
        assert!((ground.up.length() - 1.0).abs() < 1e-3, "{ground:?}");
        assert!(ground.offset.is_finite() && ground.tolerance.is_finite());
    }
    for (node, parent) in tree.parents().into_iter().enumerate() {
        assert!(parent.is_none_or(|parent| parent > node));
        assert!(parent.is_none_or(|parent| tree.height_of(parent) >= tree.height_of(node)));
    }
    // A level is a cut: each superpoint is in one of its nodes.
    let level = tree.level(0.5);
    let leaves: usize = level.iter().map(|node| tree.leaves(*node).len()).sum();
    assert_eq!(leaves, count);
    let whole: Vec<usize> = tree.whole().iter().map(|(node, _)| *node).collect();
    assert_eq!(tree.of_nodes(&whole).len(), count);
}

/// Eight Gaussians in four superpoints in a row.
pub fn tree_seeds() -> Vec<Vec<u8>> {
    let header = "A{\"__metadata__\":{\"cosplat.tree\":\"1\",\"asset_hash\":\"0000000000000007\",\"plane\":\"[0,1,0,0.5,0.01,0.75]\"},\
                  \"superpoint\":{\"dtype\":\"U32\",\"shape\":[8],\"data_offsets\":[0,32]},\
                  \"touch\":{\"dtype\":\"U32\",\"shape\":[3,2],\"data_offsets\":[32,56]},\
                  \"votes\":{\"dtype\":\"F32\",\"shape\":[3,2],\"data_offsets\":[56,80]},\
                  \"ground\":{\"dtype\":\"U8\",\"shape\":[4],\"data_offsets\":[80,84]}}\n";
    let words = [0_u32, 0, 1, 1, 2, 2, 3, 3, 0, 1, 1, 2, 2, 3];
    let votes = [0.2_f32, 1.0, 0.8, 1.0, 0.4, 1.0];
    let mut seed = header.as_bytes().to_vec();
    seed.extend(words.iter().flat_map(|x| x.to_le_bytes()));
    seed.extend(votes.iter().flat_map(|x| x.to_le_bytes()));
    seed.extend([1, 0, 0, 0]);
    vec![seed]
}

/// What is read as a view can be drawn from, and comes back from the file that we write of it.
fn check(views: &[View]) {
    let size = 1..=16_384;
    for View { name, camera } in views {
        assert!(!name.contains(['/', '\\']), "{name:?}");
        assert!(camera.position.is_finite(), "{camera:?}");
        assert!(camera.focal.iter().all(|f| f.is_finite() && *f > 0.0));
        assert!(camera.center.iter().all(|c| c.is_finite()));
        assert!(size.contains(&camera.width) && size.contains(&camera.height));
        // As far as a pose of `transforms.json` may be from a rotation.
        let volume = camera.world_from_camera.determinant();
        assert!((volume - 1.0).abs() < 1.001e-2, "{camera:?}");
    }
    // Poses at the edge of what is one may fall over it by rounding.
    let is_sure = |view: &View| (view.camera.world_from_camera.determinant() - 1.0).abs() < 9e-3;
    if !views.iter().all(is_sure) {
        return;
    }
    let again = transforms::parse(Path::new("again"), &transforms::write(views), None);
    let again = again.expect("what is written can be read");
    assert_eq!(again.len(), views.len());
    for (a, b) in views.iter().zip(&again) {
        assert_eq!(a.name, b.name);
        assert_eq!(a.camera.position, b.camera.position);
        assert_eq!(
            [a.camera.focal, a.camera.center],
            [b.camera.focal, b.camera.center]
        );
    }
}

/// A COLMAP model in text: cameras, a line with `=`, pictures.
pub fn colmap_text(data: &[u8]) {
    let at = data
        .windows(BETWEEN.len())
        .position(|bytes| bytes == BETWEEN);
    let at = at.unwrap_or(data.len());
    let images = data.get(at + BETWEEN.len()..).unwrap_or_default();
    if let Ok(views) = colmap::parse(Path::new("fuzz"), Form::Text, [&data[..at], images]) {
        check(&views);
    }
}

/// Models of one camera and of two.
pub fn colmap_text_seeds() -> Vec<Vec<u8>> {
    let pinhole = "# Camera list\n7 PINHOLE 640 480 500 510 320 240\n=\n\
                   # Image list\n1 1 0 0 0 0 0 5 7 b.jpg\n1.0 2.0 -1\n2 0.7071 0 0 0.7071 0 0 5 7 left/a.jpg\n\n";
    let two = "1 SIMPLE_PINHOLE 64 48 50 32 24\n2 SIMPLE_RADIAL 640 480 1 2 3 4\n=\n1 1 0 0 0 0 0 5 1 a b.png\n\n";
    vec![pinhole.into(), two.into()]
}

/// A COLMAP model in bytes: the length of the cameras as u16, cameras, pictures.
pub fn colmap_binary(data: &[u8]) {
    let Some((length, rest)) = data.split_first_chunk::<2>() else {
        return;
    };
    let length = usize::from(u16::from_le_bytes(*length)).min(rest.len());
    let (cameras, images) = rest.split_at(length);
    if let Ok(views) = colmap::parse(Path::new("fuzz"), Form::Binary, [cameras, images]) {
        check(&views);
    }
}

/// Two cameras, two pictures with a point each.
pub fn colmap_binary_seeds() -> Vec<Vec<u8>> {
    let mut cameras = 2_u64.to_le_bytes().to_vec();
    let models: [(u32, &[f64]); 2] = [
        (0, &[500.0, 320.0, 240.0]),
        (1, &[500.0, 510.0, 320.0, 240.0]),
    ];
    for (model, parameters) in models {
        cameras.extend([model + 1, model].iter().flat_map(|x| x.to_le_bytes()));
        cameras.extend([640_u64, 480].iter().flat_map(|x| x.to_le_bytes()));
        cameras.extend(parameters.iter().flat_map(|x| x.to_le_bytes()));
    }
    let mut images = 2_u64.to_le_bytes().to_vec();
    for id in 1_u32..=2 {
        images.extend(id.to_le_bytes());
        let pose = [0.6_f64, 0.0, 0.8, 0.0, 0.5, 0.25, 5.0];
        images.extend(pose.iter().flat_map(|x| x.to_le_bytes()));
        images.extend(id.to_le_bytes());
        images.extend(format!("{id}.jpg\0").bytes());
        images.extend(1_u64.to_le_bytes());
        images.extend([0; 24]);
    }
    vec![[&(cameras.len() as u16).to_le_bytes(), &cameras[..], &images].concat()]
}

/// A `transforms.json`, of pictures of 64 x 48 where it says no size.
pub fn cameras(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    if let Ok(views) = transforms::parse(Path::new("fuzz"), text, Some([64, 48])) {
        check(&views);
    }
}

/// As nerfstudio and as the synthetic sets have it.
pub fn cameras_seeds() -> Vec<Vec<u8>> {
    let frame = |path: &str, more: &str| {
        format!(
            r#"{{"file_path":"{path}"{more},"transform_matrix":[[0,0,1,2],[1,0,0,0],[0,1,0,-1],[0,0,0,1]]}}"#
        )
    };
    let synthetic = format!(
        r#"{{"camera_angle_x":0.69,"frames":[{}]}}"#,
        frame("./train/r_0", "")
    );
    let nerfstudio = format!(
        r#"{{"camera_model":"OPENCV","w":640,"h":480,"fl_x":500.0,"fl_y":510.0,"cx":320.0,"cy":240.0,"k1":0,"p1":0.0,"frames":[{},
{}]}}"#,
        frame("images/a.png", ""),
        frame("images/b.png", r#","fl_x":400,"w":32.5"#)
    );
    vec![synthetic.into(), nerfstudio.into()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_of_masks_are_masks() {
        let of = |seed: &Vec<u8>| {
            let file = picture(seed).expect("a picture");
            masks::parse_picture(Path::new("seed.png"), &file).map(|map| map.mask)
        };
        let found: Vec<_> = mask_seeds().iter().map(of).collect();
        for mask in &found[..2] {
            assert_eq!(mask.as_ref().expect("a mask"), &[-1, 0, 1]);
        }
        assert_eq!(found[2].as_ref().expect("a mask"), &[0, 1, -1]);
    }
}
