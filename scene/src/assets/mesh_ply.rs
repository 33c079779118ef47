//! Triangle meshes from PLY: the positions of `vertex`, the index lists of `face`.

use std::str::SplitAsciiWhitespace;

use cosplat_sim_core::scene::TriangleMesh;

use super::ply_header::{Encoding, Header, Property, Scalar};

/// Values of a body, one after the other.
enum Values<'a> {
    Text(SplitAsciiWhitespace<'a>),
    Binary { bytes: &'a [u8], little: bool },
}

impl Values<'_> {
    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        match self {
            Self::Text(words) => words.next()?.parse().ok(),
            Self::Binary { bytes, little } => {
                let (value, rest) = bytes.split_at_checked(scalar.size())?;
                *bytes = rest;
                let mut raw = [0; 8];
                raw[..value.len()].copy_from_slice(value);
                if !*little {
                    raw[..value.len()].reverse();
                }
                let [a, b, c, d, ..] = raw;
                Some(match scalar {
                    Scalar::I8 => f64::from(a as i8),
                    Scalar::U8 => f64::from(a),
                    Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
                    Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
                    Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
                    Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
                    Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
                    Scalar::F64 => f64::from_le_bytes(raw),
                })
            }
        }
    }

    /// The values of one property in one row: one, or those of a list.
    fn property(&mut self, property: &Property, to: &mut Vec<f64>) -> Option<()> {
        to.clear();
        let count = match property.list {
            Some(count) => self.next(count)?,
            None => 1.0,
        };
        if !(0.0..=f64::from(u32::MAX)).contains(&count) {
            return None;
        }
        for _ in 0..count as u32 {
            to.push(self.next(property.scalar)?);
        }
        Some(())
    }
}

/// Reads the mesh, polygons cut into triangles that share their first corner.
pub(super) fn read(name: &str, bytes: &[u8]) -> Result<TriangleMesh, String> {
    let header = Header::parse(name, bytes).map_err(|error| error.to_string())?;
    let body = &bytes[header.len..];
    let mut values = match header.encoding {
        Encoding::Ascii => {
            let text = std::str::from_utf8(body).map_err(|error| error.to_string())?;
            Values::Text(text.split_ascii_whitespace())
        }
        encoding => Values::Binary {
            bytes: body,
            little: encoding == Encoding::LittleEndian,
        },
    };
    let mut mesh = TriangleMesh::default();
    let mut found = vec![];
    for element in &header.elements {
        let axes = ["x", "y", "z"].map(|axis| element.find(axis));
        if element.name == "vertex" && axes.contains(&None) {
            return Err("element vertex: expected properties x, y and z".into());
        }
        if element.properties.is_empty() {
            continue;
        }
        for row in 0..element.count {
            let mut point = [0.0; 3];
            for (n, property) in element.properties.iter().enumerate() {
                if values.property(property, &mut found).is_none() {
                    let (element, count) = (&element.name, element.count);
                    return Err(format!(
                        "element {element}: expected {count} rows of numbers, found {row}"
                    ));
                }
                if let (Some(axis), [value]) = (axes.iter().position(|a| *a == Some(n)), &found[..])
                {
                    point[axis] = *value;
                }
                let corners = ["vertex_indices", "vertex_index"].contains(&&*property.name);
                if element.name == "face" && corners {
                    add_polygon(&mut mesh, &found, row)?;
                }
            }
            if element.name == "vertex" {
                mesh.points.push(point);
            }
        }
    }
    let count = mesh.points.len();
    match mesh
        .triangles
        .iter()
        .flatten()
        .find(|i| **i as usize >= count)
    {
        Some(index) => Err(format!(
            "a face names vertex {index}, expected one of 0..{count}"
        )),
        None => Ok(mesh),
    }
}

fn add_polygon(mesh: &mut TriangleMesh, corners: &[f64], row: u64) -> Result<(), String> {
    let index = |x: f64| (x >= 0.0 && x < f64::from(u32::MAX)).then_some(x as u32);
    let corners: Option<Vec<u32>> = corners.iter().map(|x| index(*x)).collect();
    let Some(corners) = corners else {
        return Err(format!("face {row}: expected vertex numbers from 0"));
    };
    for n in 2..corners.len() {
        mesh.triangles
            .push([corners[0], corners[n - 1], corners[n]]);
    }
    Ok(())
}
