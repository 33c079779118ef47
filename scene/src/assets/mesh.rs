//! Triangle meshes of colliders from Wavefront OBJ, PLY and STL.

use std::io::Cursor;

use cosplat_sim_core::scene::TriangleMesh;

use super::mesh_ply;

/// Most triangles of a mesh.
pub const MAX_TRIANGLES: usize = 20_000_000;

/// Why a mesh cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// Not what the name says, or an index without its vertex.
    #[error("{name}: {reason}")]
    Syntax {
        /// What is read, for people.
        name: String,
        /// What is wrong.
        reason: String,
    },
    /// A number of triangles that no collider has.
    #[error("{name}: {count} triangles, expected 1 to {MAX_TRIANGLES}")]
    Count {
        /// What is read, for people.
        name: String,
        /// Triangles found.
        count: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("{name}: vertex {vertex} is {position:?}, expected finite numbers")]
    NotFinite {
        /// What is read, for people.
        name: String,
        /// Number of the vertex, from 0.
        vertex: usize,
        /// Its coordinates.
        position: [f64; 3],
    },
}

/// Reads all faces, polygons cut into triangles; colours, normals and materials are ignored. PLY is known by its first
/// line, STL (text or binary) by the end of `name`; all else is OBJ.
///
/// # Errors
/// When the file is none of them, has no triangle or a coordinate that is not finite.
pub fn read(name: &str, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let ending = name.rsplit('.').next().unwrap_or_default();
    let read = if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        mesh_ply::read(name, bytes)
    } else if ending.eq_ignore_ascii_case("stl") {
        read_stl(bytes)
    } else {
        read_obj(bytes)
    };
    let mesh = read.map_err(|reason| MeshError::Syntax {
        name: name.into(),
        reason,
    })?;
    check(name, mesh)
}

fn read_stl(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let read = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|error| error.to_string())?;
    let corner = |i: usize| u32::try_from(i).map_err(|error| error.to_string());
    let mut mesh = TriangleMesh::default();
    for vertex in &read.vertices {
        mesh.points.push(vertex.0.map(f64::from));
    }
    for face in &read.faces {
        let [a, b, c] = face.vertices;
        mesh.triangles.push([corner(a)?, corner(b)?, corner(c)?]);
    }
    Ok(mesh)
}

/// Refuses indices that no vertex can have: the parser computes with what they wrap around to.
fn check_indices(bytes: &[u8]) -> Result<(), String> {
    let most = bytes.iter().filter(|&&byte| byte == b'\n').count() as i64 + 1;
    // Positions, texture coordinates and normals so far, which negative indices count back from.
    let mut known = [0_i64; 3];
    for line in bytes.split(|&byte| byte == b'\n') {
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => known[0] += 1,
            Some("vt") => known[1] += 1,
            Some("vn") => known[2] += 1,
            Some("f" | "l" | "p") => {
                for (index, known) in words.flat_map(|word| word.split('/').zip(known)) {
                    let number = index.parse::<i64>().ok();
                    if let Some(n) = number.filter(|&n| n == 0 || n < -known || n > most) {
                        return Err(format!("index {n}, expected -{known} to -1 or 1 to {most}"));
                    }
                }
            }
            _ => {}
        }
    }
    Ok(())
}

fn read_obj(bytes: &[u8]) -> Result<TriangleMesh, String> {
    check_indices(bytes)?;
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let no_material = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_material)
        .map_err(|error| error.to_string())?;
    let mut mesh = TriangleMesh::default();
    for model in &models {
        let first = mesh.points.len() as u32;
        let (points, _) = model.mesh.positions.as_chunks::<3>();
        mesh.points.extend_from_slice(points);
        let (triangles, _) = model.mesh.indices.as_chunks::<3>();
        mesh.triangles
            .extend(triangles.iter().map(|t| t.map(|i| first + i)));
    }
    Ok(mesh)
}

/// Refuses what no collider can be.
fn check(name: &str, mesh: TriangleMesh) -> Result<TriangleMesh, MeshError> {
    let count = mesh.triangles.len();
    if !(1..=MAX_TRIANGLES).contains(&count) {
        return Err(MeshError::Count {
            name: name.into(),
            count,
        });
    }
    let bad = |p: &&[f64; 3]| !p.iter().all(|x| x.is_finite());
    if let Some(vertex) = mesh.points.iter().position(|p| bad(&p)) {
        return Err(MeshError::NotFinite {
            name: name.into(),
            vertex,
            position: mesh.points[vertex],
        });
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_become_triangles_and_materials_are_ignored() {
        let text = b"mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nusemtl x\nf 1 2 3 4\n";
        let mesh = read("quad", text).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (4, 2));
        assert_eq!(mesh.points[3], [0.0, 1.0, 0.5]);
    }

    /// Found by `fuzz/run mesh`.
    #[test]
    fn indices_that_no_vertex_has_are_refused() {
        let points = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n";
        for face in [
            "f -4 -2 -1",
            "f 1//-2 2//1 3//1",
            "f 0 1 2",
            "f 1 2 9223372036854775807",
            "l 1 -9223372036854775808",
        ] {
            let text = format!("{points}{face}\n");
            let error = read("ramp.obj", text.as_bytes()).expect_err(face);
            assert!(error.to_string().contains("index "), "{face}: {error}");
        }
        for face in ["f -3 -2 -1", "f 1//-1 2//1 3//1"] {
            let text = format!("{points}{face}\n");
            let mesh = read("ramp.obj", text.as_bytes()).expect(face);
            assert_eq!(mesh.triangles, [[0, 1, 2]], "{face}");
        }
    }

    #[test]
    fn nonsense_is_refused_with_a_reason() {
        for (text, expected) in [
            ("f 1 2 3\n", "x: "),
            ("v 0 0 0\nv 1 0 0\n", "0 triangles"),
            ("v nan 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", "expected finite"),
        ] {
            let error = read("x", text.as_bytes()).expect_err(text).to_string();
            assert!(error.contains(expected), "{expected:?} not in {error}");
        }
    }

    /// A square of two triangles as ASCII PLY, with colours and an edge that do not matter.
    const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\n\
        element edge 1\nproperty int a\nend_header\n0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0.5 9\n4 0 1 2 3\n7\n";

    /// The same in binary.
    fn binary_ply(little: bool) -> Vec<u8> {
        let order = if little { "little" } else { "big" };
        let (header, _) = PLY.split_at(PLY.find("0 0 0 9").expect("has a body"));
        let mut bytes = header
            .replace("ascii", &format!("binary_{order}_endian"))
            .into_bytes();
        let four = |bytes: &mut Vec<u8>, mut value: [u8; 4]| {
            if !little {
                value.reverse();
            }
            bytes.extend(value);
        };
        for point in [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.5_f32],
        ] {
            for x in point {
                four(&mut bytes, x.to_le_bytes());
            }
            bytes.push(9);
        }
        bytes.push(4);
        for index in 0..4_i32 {
            four(&mut bytes, index.to_le_bytes());
        }
        four(&mut bytes, 7_i32.to_le_bytes());
        bytes
    }

    #[test]
    fn ply_meshes_of_every_encoding_are_the_same() {
        let files = [PLY.as_bytes().to_vec(), binary_ply(true), binary_ply(false)];
        for bytes in files {
            let mesh = read("square.ply", &bytes).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(mesh.points[3], [0.0, 1.0, 0.5]);
            assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        }
        let whole = binary_ply(true);
        for end in 0..whole.len() {
            assert!(read("square.ply", &whole[..end]).is_err(), "{end} bytes");
        }
        let wrong = PLY.replace("4 0 1 2 3", "4 0 1 2 4");
        let error = read("square.ply", wrong.as_bytes()).expect_err("no vertex 4");
        assert!(error.to_string().contains("vertex 4"), "{error}");
    }

    #[test]
    fn stl_meshes_are_read_as_text_and_binary() {
        let text = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0.5\nendloop\n\
                    endfacet\nendsolid s\n";
        let mut binary = vec![0; 80];
        binary.extend(1_u32.to_le_bytes());
        for x in [
            0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.5_f32,
        ] {
            binary.extend(x.to_le_bytes());
        }
        binary.extend([0; 2]);
        for bytes in [text.as_bytes(), &binary] {
            let mesh = read("dir.d/Part.STL", bytes).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!((mesh.points.len(), mesh.triangles.len()), (3, 1));
            let [a, b, c] = mesh.triangles[0].map(|i| mesh.points[i as usize]);
            assert_eq!([a, b, c], [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5]]);
        }
        binary.truncate(100);
        assert!(read("part.stl", &binary).is_err());
    }
}
