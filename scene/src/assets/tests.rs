//! Files good and bad, read and written.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::{AssetError, Dropped, Gaussians, MIN_SCALE, ply, read};

/// Gaussians of every kind of value that training produces.
fn sample(n: usize, sh_degree: u8, feature_dim: u32) -> Gaussians {
    let mut rng = Pcg32::seed_from_u64(7);
    let mut uniform = move || rng.next_u32() as f32 / u32::MAX as f32;
    let mut g = Gaussians {
        sh_degree,
        feature_dim,
        ..Gaussians::default()
    };
    for _ in 0..n {
        g.position
            .push([0.0; 3].map(|_: f32| 20.0 * uniform() - 10.0));
        g.scale
            .push([0.0; 3].map(|_: f32| (12.0 * uniform() - 10.0).exp()));
        let q = [0.0; 4].map(|_: f32| 2.0 * uniform() - 1.0);
        let length = q.iter().map(|q| q * q).sum::<f32>().sqrt();
        g.rotation.push(q.map(|q| q / length));
        g.opacity.push(uniform());
        for _ in 0..g.sh_stride() {
            g.sh.push(2.0 * uniform() - 1.0);
        }
        for _ in 0..feature_dim {
            g.feature.push(uniform());
        }
    }
    g
}

/// A PLY file with the given vertex header lines and body.
fn ply_bytes(format: &str, count: &str, properties: &[&str], body: &[u8]) -> Vec<u8> {
    let mut text =
        format!("ply\nformat {format} 1.0\ncomment made by a test\nelement vertex {count}\n");
    for property in properties {
        text += &format!("property {property}\n");
    }
    text += "end_header\n";
    [text.as_bytes(), body].concat()
}

const BASE: [&str; 14] = [
    "float x",
    "float y",
    "float z",
    "float f_dc_0",
    "float f_dc_1",
    "float f_dc_2",
    "float opacity",
    "float scale_0",
    "float scale_1",
    "float scale_2",
    "float rot_0",
    "float rot_1",
    "float rot_2",
    "float rot_3",
];
const ROW: [f32; 14] = [
    1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0, -1.0, -2.0, -3.0, 1.0, 0.0, 0.0, 0.0,
];

fn little(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn message(result: Result<(Gaussians, super::ReadReport), AssetError>) -> String {
    result.expect_err("the file is bad").to_string()
}

#[test]
fn what_is_written_is_read_back() {
    for (degree, dim) in [(0, 0), (1, 0), (2, 5), (3, 0)] {
        let g = sample(5000, degree, dim);
        let (back, report) = read("round.ply", &ply::write(&g)).expect("own files are readable");
        assert_eq!((report.count, report.dropped), (5000, Dropped::default()));
        // Stored as they are: exact.
        assert_eq!(back.position, g.position);
        assert_eq!(back.sh, g.sh);
        assert_eq!(back.feature, g.feature);
        assert_eq!((back.sh_degree, back.feature_dim), (degree, dim));
        // Stored as logarithm or logit: one rounding of a number of size below 12, so 12 ulp.
        for (a, b) in g.scale.as_flattened().iter().zip(back.scale.as_flattened()) {
            assert!(
                (a - b).abs() <= 12.0 * f32::EPSILON * a,
                "scale {a} came back as {b}"
            );
        }
        for (a, b) in g.opacity.iter().zip(&back.opacity) {
            assert!(
                (a - b).abs() <= 4.0 * f32::EPSILON * a.max(0.1),
                "opacity {a} became {b}"
            );
        }
        // Normalised again: one ulp of 1.
        for (a, b) in g
            .rotation
            .as_flattened()
            .iter()
            .zip(back.rotation.as_flattened())
        {
            assert!(
                (a - b).abs() <= 2.0 * f32::EPSILON,
                "rotation {a} came back as {b}"
            );
        }
        // From the second time on, nothing moves any more but by the same roundings.
        let again = read("again.ply", &ply::write(&back))
            .expect("own files are readable")
            .0;
        assert_eq!(again.sh, g.sh);
    }
}

#[test]
fn values_are_activated() {
    let file = ply_bytes("binary_little_endian", "1", &BASE, &little(&ROW));
    let (g, _) = read("one.ply", &file).expect("a good file");
    assert_eq!(g.position, [[1.0, 2.0, 3.0]]);
    assert_eq!(g.opacity, [0.5]);
    assert_eq!(
        g.rotation,
        [[0.0, 0.0, 0.0, 1.0]],
        "wxyz in the file, xyzw in memory"
    );
    for (s, stored) in g.scale[0].iter().zip([-1.0f32, -2.0, -3.0]) {
        assert!((s - stored.exp()).abs() <= f32::EPSILON * s);
    }
}

#[test]
fn harmonics_go_from_channel_major_to_coefficient_major() {
    let rest = (0..9)
        .map(|i| format!("float f_rest_{i}"))
        .collect::<Vec<_>>();
    let names = BASE
        .into_iter()
        .chain(rest.iter().map(String::as_str))
        .collect::<Vec<_>>();
    let body = [
        little(&ROW),
        little(&[1., 2., 3., 10., 20., 30., 100., 200., 300.]),
    ]
    .concat();
    let file = ply_bytes("binary_little_endian", "1", &names, &body);
    let (g, _) = read("sh.ply", &file).expect("a good file");
    let expected = [0.1, 0.2, 0.3, 1., 10., 100., 2., 20., 200., 3., 30., 300.];
    assert_eq!((g.sh_degree, g.sh.as_slice()), (1, expected.as_slice()));
}

#[test]
fn every_encoding_order_and_scalar_type_reads_the_same() {
    let reference = read(
        "le.ply",
        &ply_bytes("binary_little_endian", "1", &BASE, &little(&ROW)),
    )
    .expect("good")
    .0;
    let big = ROW.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<_>>();
    let text = ROW.map(|v| v.to_string()).join(" ") + "\r\n";
    let mut reversed_names = BASE;
    reversed_names.reverse();
    let mut reversed = ROW;
    reversed.reverse();
    let doubles = BASE.map(|p| p.replace("float", "double"));
    let doubles = doubles.iter().map(String::as_str).collect::<Vec<_>>();
    let double_body = ROW
        .iter()
        .flat_map(|v| f64::from(*v).to_le_bytes())
        .collect::<Vec<_>>();
    // Unknown columns, here normals and a label of another size, are passed over.
    let extra = ["float nx", "uchar label"]
        .into_iter()
        .chain(BASE)
        .collect::<Vec<_>>();
    let extra_body = [little(&[9.0]), vec![7], little(&ROW)].concat();
    for file in [
        ply_bytes("binary_big_endian", "1", &BASE, &big),
        ply_bytes("ascii", "1", &BASE, text.as_bytes()),
        ply_bytes(
            "binary_little_endian",
            "1",
            &reversed_names,
            &little(&reversed),
        ),
        ply_bytes("binary_little_endian", "1", &doubles, &double_body),
        ply_bytes("binary_little_endian", "1", &extra, &extra_body),
    ] {
        assert_eq!(read("other.ply", &file).expect("good").0, reference);
    }
}

#[test]
fn other_elements_are_passed_over() {
    let header = "ply\nformat binary_little_endian 1.0\nelement camera 2\nproperty double f\n\
                  element vertex 1\n";
    let vertex = BASE.map(|p| format!("property {p}\n")).concat();
    let tail = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let file = [
        header.as_bytes(),
        vertex.as_bytes(),
        tail.as_bytes(),
        &[0; 16],
        &little(&ROW),
        &[0],
    ]
    .concat();
    assert_eq!(
        read("more.ply", &file).expect("good").0.position,
        [[1.0, 2.0, 3.0]]
    );
    let text = "ply\nformat ascii 1.0\nelement camera 1\nproperty float f\nelement vertex 1\n";
    let row = ROW.map(|v| v.to_string()).join(" ");
    let file = format!("{text}{vertex}end_header\n0.5\n{row}");
    assert_eq!(
        read("more.ply", file.as_bytes()).expect("good").0.position,
        [[1.0, 2.0, 3.0]]
    );
}

#[test]
fn bad_gaussians_are_dropped_and_counted_by_cause() {
    let with = |index: usize, value: f32| {
        let mut row = ROW;
        row[index] = value;
        row.to_vec()
    };
    let mut no_rotation = ROW;
    no_rotation[10] = 0.0;
    let rows = [
        ROW.to_vec(),
        with(0, f32::NAN),
        with(1, f32::INFINITY),
        with(3, f32::NAN),
        with(6, f32::NAN),
        no_rotation.to_vec(),
        with(8, 80.0),
        with(9, f32::INFINITY),
        with(2, 1e12),
        with(7, f32::NEG_INFINITY),
        with(6, f32::INFINITY),
    ];
    let body = little(&rows.concat());
    let (g, report) = read(
        "bad.ply",
        &ply_bytes("binary_little_endian", "11", &BASE, &body),
    )
    .expect("some good");
    let expected = Dropped {
        not_finite: 4,
        zero_rotation: 1,
        out_of_range: 3,
    };
    assert_eq!(
        (report.count, report.dropped, report.flat_scales_raised),
        (11, expected, 1)
    );
    assert_eq!(g.len(), 3);
    assert_eq!(
        g.sh.len(),
        9,
        "the colours of dropped Gaussians go with them"
    );
    assert_eq!(g.scale[1][0], MIN_SCALE);
    assert_eq!(g.opacity[2], 1.0);
    let all_bad = ply_bytes("binary_little_endian", "1", &BASE, &little(&rows[1]));
    assert!(message(read("bad.ply", &all_bad)).contains("found 1, all bad: 1 not finite"));
}

#[test]
fn broken_files_are_refused_with_expected_and_actual() {
    let good = ply_bytes(
        "binary_little_endian",
        "2",
        &BASE,
        &little(&[ROW, ROW].concat()),
    );
    let count = |n: &str| ply_bytes("binary_little_endian", n, &BASE, &little(&ROW));
    let without = |name: &str| {
        let names = BASE
            .into_iter()
            .filter(|p| !p.ends_with(name))
            .collect::<Vec<_>>();
        ply_bytes("binary_little_endian", "1", &names, &little(&ROW))
    };
    let plus = |extra: &[&str], format: &str| {
        let names = BASE
            .into_iter()
            .chain(extra.iter().copied())
            .collect::<Vec<_>>();
        ply_bytes(format, "1", &names, &[little(&ROW), vec![0; 64]].concat())
    };
    let ascii = |body: &str| ply_bytes("ascii", "1", &BASE, body.as_bytes());
    let le = "binary_little_endian";
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        (
            "a.ply",
            vec![],
            "the file is empty, expected at least 1 Gaussian, found 0",
        ),
        ("a.splat", vec![], "the file is empty"),
        ("a.ply", count("0"), "element vertex is empty"),
        (
            "a.ply",
            good[..good.len() - 1].to_vec(),
            "expected 112 bytes for 2 rows, found 111",
        ),
        (
            "a.ply",
            count("18446744073709551615"),
            "for 18446744073709551615 rows, found 56",
        ),
        (
            "a.ply",
            count("4000000000"),
            "expected 224000000000 bytes for 4000000000 rows, found 56",
        ),
        (
            "a.ply",
            count("-3"),
            "header line 4: expected a count of rows, found -3",
        ),
        (
            "a.ply",
            without("rot_2"),
            "property rot_2: expected a number, found no such property",
        ),
        (
            "a.ply",
            plus(&["float f_rest_0"], le),
            "expected 0, 9, 24 or 45 of them, found 1",
        ),
        ("a.ply", plus(&["float f_rest_1"], le), "found 1 with gaps"),
        (
            "a.ply",
            plus(&["float f_sem_2"], le),
            "f_sem_*: expected consecutive numbers",
        ),
        (
            "a.ply",
            plus(&["list uchar int f"], le),
            "property f: expected a single number, found a list",
        ),
        (
            "a.ply",
            plus(&["list uchar int f"], "ascii"),
            "expected a single number, found a list",
        ),
        (
            "a.ply",
            plus(&["float x"], le),
            "expected a property name not used before, found property float x",
        ),
        (
            "a.ply",
            plus(&["quad w"], le),
            "expected `property TYPE NAME`, found property quad w",
        ),
        (
            "a.ply",
            plus(&["uint packed_position"], le),
            "a compressed PLY",
        ),
        (
            "a.ply",
            plus(&[], "binary_middle_endian"),
            "expected ascii or binary_*_endian",
        ),
        (
            "a.ply",
            b"ply\nelement vertex 1\n".to_vec(),
            "line 3: expected a line `end_header`",
        ),
        (
            "a.ply",
            b"ply\nend_header\n".to_vec(),
            "expected a `format` line, found none",
        ),
        (
            "a.ply",
            b"ply\nproperty float x\n".to_vec(),
            "expected an element before its properties",
        ),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nend_header\n".to_vec(),
            "an element `vertex`",
        ),
        ("a.ply", b"plyformat".to_vec(), "expected a PLY file"),
        ("a.ply", ascii(""), "expected 27 bytes for 1 rows, found 0"),
        (
            "a.ply",
            ascii("1 2 3 0 0 0 0 0 0 0 1 0 0 x"),
            "row 0: expected a number, found \"x\"",
        ),
        (
            "a.ply",
            ascii("1 2 3 0 0 0 0 0 0 0 1 0 0  "),
            "expected 14 values, found 13",
        ),
        ("a.ply", vec![0x1f, 0x8b, 8, 0], "gzip data, perhaps SPZ"),
        ("a.spz", b"NGSP\0\0".to_vec(), "an SPZ file"),
        (
            "a.splat",
            good.clone(),
            "expected 32-byte .splat rows, found a PLY header",
        ),
        (
            "a.splat",
            vec![1; 33],
            "expected 64 bytes for 2 rows, found 33",
        ),
        (
            "noname",
            vec![1; 32],
            "expected a PLY file or a name that ends in .splat",
        ),
    ];
    for (name, bytes, expected) in cases {
        let message = message(read(name, &bytes));
        assert!(message.starts_with(&format!("{name}: ")), "{message}");
        assert!(
            message.contains(expected),
            "{message:?} does not say {expected:?}"
        );
    }
    assert!(
        read("no_extension", &good).is_ok(),
        "the content alone says PLY"
    );
}

/// Found by `fuzz/run ply`: the number of a property is one more than there are places.
#[test]
fn the_last_number_of_a_property_is_refused() {
    let mut bytes = ply::write(&sample(2, 1, 0));
    let name = b"f_rest_8\n";
    let at = bytes.windows(name.len()).position(|w| w == name);
    let at = at.expect("a column of degree 1");
    let number = usize::MAX.to_string();
    bytes.splice(at + 7..at + 8, number.bytes());
    let error = message(read("a.ply", &bytes));
    assert!(error.contains("f_rest_"), "{error}");
}

#[test]
fn splat_rows_are_decoded() {
    let mut row = little(&[1.0, 2.0, 3.0, 0.1, 0.2, 0.3]);
    row.extend([255, 0, 128, 51, 255, 128, 128, 1]);
    let (g, _) = read("one.SPLAT", &row).expect("a good file");
    assert_eq!(
        (g.position[0], g.scale[0]),
        ([1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    );
    assert_eq!(g.opacity, [0.2]);
    assert!(
        (0.5 + super::SH_C0 * g.sh[0] - 1.0).abs() < 1e-6,
        "red 255 is 1"
    );
    // wxyz = (127, 0, 0, -127) / 128, normalised.
    let half = 0.5f32.sqrt();
    for (a, b) in g.rotation[0].iter().zip([0.0, 0.0, -half, half]) {
        assert!((a - b).abs() < 1e-6, "{:?}", g.rotation);
    }
}

/// Flips, overwrites, inserts, cuts: whatever comes out, reading it returns.
#[test]
fn mutated_files_never_panic() {
    let text = ply_bytes(
        "ascii",
        "2",
        &BASE,
        b"1 2 3 0 0 0 0 0 0 0 1 0 0 0\n1 2 3 0 0 0 0 0 0 0 1 0 0 0\n",
    );
    let splat = [little(&[1.0, 2.0, 3.0, 0.1, 0.2, 0.3]), vec![255; 8]]
        .concat()
        .repeat(3);
    let seeds = [
        ("m.ply", ply::write(&sample(3, 1, 2))),
        ("m.ply", text),
        ("m.splat", splat),
    ];
    let mut rng = Pcg32::seed_from_u64(1);
    let mut accepted = 0;
    for (name, seed) in &seeds {
        for cut in 0..seed.len() {
            accepted += u32::from(read(name, &seed[..cut]).is_ok());
        }
        for _ in 0..3000 {
            let mut bytes = seed.clone();
            for _ in 0..1 + rng.next_u32() % 4 {
                let at = rng.next_u32() as usize % bytes.len();
                match rng.next_u32() % 5 {
                    0 => bytes[at] ^= 1 << (rng.next_u32() % 8),
                    1 => bytes[at] = rng.next_u32() as u8,
                    2 => bytes[at] = b'0' + (rng.next_u32() % 10) as u8,
                    3 => bytes.insert(at, rng.next_u32() as u8),
                    _ => {
                        drop(bytes.drain(at..bytes.len().min(at + 1 + rng.next_u32() as usize % 8)))
                    }
                }
                if bytes.is_empty() {
                    break;
                }
            }
            if let Ok((g, report)) = read(name, &bytes) {
                accepted += 1;
                assert_eq!(g.len() + report.dropped.total(), report.count);
                assert_eq!(g.sh.len(), g.len() * g.sh_stride());
                assert!(g.position.as_flattened().iter().all(|p| p.is_finite()));
                assert!(
                    g.scale
                        .as_flattened()
                        .iter()
                        .all(|s| *s > 0.0 && s.is_finite())
                );
            }
        }
    }
    assert!(
        accepted > 1000,
        "{accepted} accepted: the mutations are too gentle or the reader too strict"
    );
}
