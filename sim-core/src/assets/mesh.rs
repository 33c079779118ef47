//! Triangle meshes of colliders from Wavefront OBJ text.

use std::io::Cursor;

use crate::scene::TriangleMesh;

/// Most triangles of a mesh.
pub const MAX_TRIANGLES: usize = 20_000_000;

/// Why a mesh cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// Not OBJ, or an index without its vertex.
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

/// Reads all faces of an OBJ text, polygons cut into triangles; `name` is for messages. Materials are ignored.
///
/// # Errors
/// When the text is no OBJ, has no triangle or a coordinate that is not finite.
pub fn read(name: &str, bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let no_material = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) =
        tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_material).map_err(|error| {
            MeshError::Syntax {
                name: name.into(),
                reason: error.to_string(),
            }
        })?;
    let mut mesh = TriangleMesh::default();
    for model in &models {
        let first = mesh.points.len() as u32;
        let (points, _) = model.mesh.positions.as_chunks::<3>();
        mesh.points.extend_from_slice(points);
        let (triangles, _) = model.mesh.indices.as_chunks::<3>();
        mesh.triangles
            .extend(triangles.iter().map(|t| t.map(|i| first + i)));
    }
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
}
