//! Splats and meshes.

use cosplat_scene::assets::{self, Gaussians, mesh as meshes, ply as plys};

/// Some Gaussians that are sound.
pub fn few() -> Gaussians {
    let rows: Vec<u8> = (0..27).flat_map(row).collect();
    let (gaussians, _) = assets::read("few.splat", &rows).expect("sound rows");
    gaussians
}

/// Some Gaussians in a line: filling what they enclose takes a hundredth of the time.
pub fn line() -> Gaussians {
    let rows: Vec<u8> = (0..3).flat_map(row).collect();
    let (gaussians, _) = assets::read("line.splat", &rows).expect("sound rows");
    gaussians
}

/// A row of a `.splat` file: one of 27 in a cube of 1 m.
fn row(n: usize) -> Vec<u8> {
    let place = [n % 3, n / 3 % 3, n / 9].map(|x| 0.5 * x as f32 - 0.5);
    let numbers = [place, [0.2, 0.3, 0.01]].concat();
    let mut row: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    row.extend([200, 100, 50, 255, 255, 128, 128, 128]);
    row
}

/// What a reader accepts is sound.
fn check(gaussians: &Gaussians) {
    let count = gaussians.len();
    assert!(count > 0, "nothing is an error");
    assert_eq!(gaussians.scale.len(), count);
    assert_eq!(gaussians.rotation.len(), count);
    assert_eq!(gaussians.opacity.len(), count);
    assert_eq!(gaussians.sh.len(), count * gaussians.sh_stride());
    assert_eq!(
        gaussians.feature.len(),
        count * gaussians.feature_dim as usize
    );
    for n in 0..count {
        let rotation = gaussians.rotation[n];
        let length: f32 = rotation.iter().map(|x| x * x).sum();
        assert!((length - 1.0).abs() < 1e-3, "rotation {rotation:?}");
        let place = gaussians.position[n];
        assert!(
            place.iter().all(|x| x.abs() <= assets::MAX_LENGTH),
            "{place:?}"
        );
        let scale = gaussians.scale[n];
        assert!(
            scale
                .iter()
                .all(|s| (assets::MIN_SCALE..=assets::MAX_LENGTH).contains(s)),
            "{scale:?}"
        );
        assert!((0.0..=1.0).contains(&gaussians.opacity[n]));
    }
    assert!(gaussians.sh.iter().all(|x| x.is_finite()));
    assert!(gaussians.feature.iter().all(|x| x.is_finite()));
}

/// A PLY file of Gaussians.
pub fn ply(data: &[u8]) {
    let Ok((gaussians, _)) = assets::read("fuzz.ply", data) else {
        return;
    };
    check(&gaussians);
    let again = assets::read("again.ply", &plys::write(&gaussians));
    let (again, _) =
        again.unwrap_or_else(|error| panic!("what is written cannot be read: {error}"));
    assert_eq!(again.len(), gaussians.len());
}

/// PLY files in each encoding, with and without spherical harmonics and features.
pub fn ply_seeds() -> Vec<Vec<u8>> {
    let mut plain = few();
    let written = plys::write(&plain);
    let end = b"end_header\n";
    let body = written
        .windows(end.len())
        .position(|w| w == end)
        .expect("a header")
        + end.len();
    let header = String::from_utf8_lossy(&written[..body]).into_owned();
    let mut big = header.replace("little", "big").into_bytes();
    big.extend(
        written[body..]
            .chunks_exact(4)
            .flat_map(|word| [word[3], word[2], word[1], word[0]]),
    );
    let numbers = written[body..]
        .chunks_exact(4)
        .map(|word| f32::from_le_bytes([word[0], word[1], word[2], word[3]]));
    let columns = header.matches("property").count();
    let mut ascii = header.replace("binary_little_endian", "ascii");
    for (n, number) in numbers.enumerate() {
        ascii += &format!(
            "{number}{}",
            if (n + 1) % columns == 0 { '\n' } else { ' ' }
        );
    }
    plain.sh_degree = 1;
    plain.sh = (0..12 * plain.len()).map(|n| (n as f32).sin()).collect();
    plain.feature_dim = 2;
    plain.feature = vec![0.5; 2 * plain.len()];
    let lists = "ply\nformat ascii 1.0\ncomment a mesh\nelement face 1\nproperty list uchar int vertex_indices\n\
                 element vertex 1\nproperty double x\nproperty double y\nproperty float z\nend_header\n3 0 1 2\n0 0 0\n";
    vec![
        written,
        big,
        ascii.into_bytes(),
        plys::write(&plain),
        lists.into(),
    ]
}

/// Rows of 32 bytes.
pub fn splat(data: &[u8]) {
    if let Ok((gaussians, _)) = assets::read("fuzz.splat", data) {
        check(&gaussians);
    }
}

/// One row, and some.
pub fn splat_seeds() -> Vec<Vec<u8>> {
    vec![row(0), (0..5).flat_map(row).collect()]
}

/// A mesh: the first byte chooses the name, which chooses the format.
pub fn mesh(data: &[u8]) {
    let Some((first, data)) = data.split_first() else {
        return;
    };
    let name = if first & 1 == 0 {
        "fuzz.obj"
    } else {
        "fuzz.stl"
    };
    let Ok(mesh) = meshes::read(name, data) else {
        return;
    };
    assert!(!mesh.triangles.is_empty(), "nothing is an error");
    assert!(mesh.points.as_flattened().iter().all(|x| x.is_finite()));
    let corners = mesh.triangles.as_flattened().iter();
    assert!(
        corners
            .copied()
            .all(|corner| (corner as usize) < mesh.points.len())
    );
}

/// OBJ, PLY in text and bytes, STL in text and bytes; a first byte of `@` is even, `A` is odd.
pub fn mesh_seeds() -> Vec<Vec<u8>> {
    let obj = "@v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\no quad\ng side\nusemtl red\nf 1 2 3 4\nf -4/1/1 -3/1/1 -2/1/1\nl 1 2\n";
    let ply = "@ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let mut binary_ply = ply.replace("ascii", "binary_little_endian").into_bytes();
    binary_ply.truncate(binary_ply.len() - "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".len());
    let numbers = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    binary_ply.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    binary_ply.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    let stl = "Asolid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n";
    let mut binary_stl = vec![b'A'];
    binary_stl.extend([b' '; 80]);
    binary_stl.extend(1_u32.to_le_bytes());
    binary_stl.extend(
        [0.0_f32, 0.0, 1.0]
            .iter()
            .chain(&numbers)
            .flat_map(|x| x.to_le_bytes()),
    );
    binary_stl.extend([0, 0]);
    vec![obj.into(), ply.into(), binary_ply, stl.into(), binary_stl]
}
