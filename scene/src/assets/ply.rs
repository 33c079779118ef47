//! PLY files of 3D Gaussian splatting: logarithmic scales, opacity before the sigmoid, rotations wxyz,
//! spherical harmonics channel by channel. Properties are found by name, in any order.

use rayon::prelude::*;

use super::{
    AssetError, Gaussians, ReadReport,
    activate::{Parsed, Widths, decode_rows, exp, ln, logit, sigmoid},
    ply_header::{Element, Encoding, Header, Scalar},
};

/// Reads a PLY file: ASCII or binary of either byte order, spherical-harmonics degree 0 to 3, semantic
/// features `f_sem_*` if present.
///
/// # Errors
/// See [`AssetError`]; nothing is allocated before the file is known to hold the rows it promises.
pub fn read(name: &str, bytes: &[u8]) -> Result<(Gaussians, ReadReport), AssetError> {
    let header = Header::parse(name, bytes)?;
    let body = &bytes[header.len..];
    let Some(index) = header.elements.iter().position(|e| e.name == "vertex") else {
        return Err(property_error(
            name,
            "vertex",
            "*",
            "an element `vertex`",
            "no such element",
        ));
    };
    let mut vertex = header.elements[index].clone();
    if vertex.count == 0 {
        return Err(AssetError::Empty {
            file: name.into(),
            element: "element vertex",
        });
    }
    let ascii = header.encoding == Encoding::Ascii;
    if ascii {
        vertex.store_as_floats();
    }
    let columns = Columns::find(name, &vertex)?;
    let before = &header.elements[..index];
    let all_f32 = vertex.properties.iter().all(|p| p.scalar == Scalar::F32);
    let decode = |rows: &[u8], is_little: bool| match (is_little, all_f32) {
        (true, true) => columns.decode(rows, f32_at, |row, c| f32_at(row, c).into()),
        (true, false) => {
            columns.decode(rows, |row, c| number::<true>(row, c) as f32, number::<true>)
        }
        (false, _) => columns.decode(
            rows,
            |row, c| number::<false>(row, c) as f32,
            number::<false>,
        ),
    };
    let decoded = if ascii {
        // Text becomes binary rows first, so that there is one decoder.
        decode(&parse_ascii(name, body, before, &vertex)?, true)
    } else {
        let mut body = body;
        for element in before {
            check_scalars(name, element)?;
            body = take_rows(name, element, body)?.1;
        }
        let rows = take_rows(name, &vertex, body)?.0;
        decode(rows, header.encoding == Encoding::LittleEndian)
    };
    super::finish(name, decoded)
}

/// Where the values of a Gaussian are in a row.
struct Columns {
    position: [Column; 3],
    scale: [Column; 3],
    rotation: [Column; 4],
    opacity: Column,
    /// In memory order: coefficient-major.
    sh: Vec<Column>,
    feature: Vec<Column>,
    sh_degree: u8,
    row: usize,
}

#[derive(Clone, Copy)]
struct Column {
    offset: usize,
    scalar: Scalar,
}

impl Columns {
    fn find(file: &str, vertex: &Element) -> Result<Self, AssetError> {
        if vertex.find("packed_position").is_some() {
            return Err(property_error(
                file,
                "vertex",
                "packed_position",
                "plain float properties",
                "a compressed PLY: convert it first, for example with splat-transform",
            ));
        }
        check_scalars(file, vertex)?;
        let column = |name: &str| {
            let index = vertex.find(name).ok_or_else(|| {
                property_error(file, "vertex", name, "a number", "no such property")
            })?;
            let property = &vertex.properties[index];
            Ok(Column {
                offset: property.offset,
                scalar: property.scalar,
            })
        };
        let family = |prefix: &str, expected: &str| {
            vertex.family(prefix).map_err(|found| {
                let found = format!("{found} with gaps in their numbers");
                property_error(file, "vertex", &format!("{prefix}*"), expected, &found)
            })
        };
        let rest_expected = "0, 9, 24 or 45 of them";
        let rest = family("f_rest_", rest_expected)?;
        let sh_degree = match rest {
            0 => 0,
            9 => 1,
            24 => 2,
            45 => 3,
            _ => {
                let found = rest.to_string();
                return Err(property_error(
                    file,
                    "vertex",
                    "f_rest_*",
                    rest_expected,
                    &found,
                ));
            }
        };
        let per_channel = rest / 3;
        let mut sh = Vec::with_capacity(3 + rest);
        for channel in 0..3 {
            sh.push(column(&format!("f_dc_{channel}"))?);
        }
        for coefficient in 0..per_channel {
            for channel in 0..3 {
                sh.push(column(&format!(
                    "f_rest_{}",
                    channel * per_channel + coefficient
                ))?);
            }
        }
        let features = family("f_sem_", "consecutive numbers from 0")?;
        let feature = (0..features)
            .map(|i| column(&format!("f_sem_{i}")))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            position: [column("x")?, column("y")?, column("z")?],
            scale: [column("scale_0")?, column("scale_1")?, column("scale_2")?],
            // File order is wxyz, memory order xyzw.
            rotation: [
                column("rot_1")?,
                column("rot_2")?,
                column("rot_3")?,
                column("rot_0")?,
            ],
            opacity: column("opacity")?,
            sh,
            feature,
            sh_degree,
            row: vertex.row,
        })
    }

    fn decode(
        &self,
        rows: &[u8],
        value: impl Fn(&[u8], &Column) -> f32 + Sync,
        place: impl Fn(&[u8], &Column) -> f64 + Sync,
    ) -> (Gaussians, ReadReport) {
        let widths = Widths {
            row: self.row,
            sh_degree: self.sh_degree,
            features: self.feature.len(),
            is_exact: self.position.iter().any(|c| c.scalar == Scalar::F64),
        };
        decode_rows(rows, &widths, |row, sh, feature| {
            for (value_out, column) in sh.iter_mut().zip(&self.sh) {
                *value_out = value(row, column);
            }
            for (value_out, column) in feature.iter_mut().zip(&self.feature) {
                *value_out = value(row, column);
            }
            Parsed {
                position: self.position.each_ref().map(|c| place(row, c)),
                scale: self.scale.each_ref().map(|c| exp(value(row, c))),
                rotation: self.rotation.each_ref().map(|c| value(row, c)),
                opacity: sigmoid(value(row, &self.opacity)),
            }
        })
    }
}

#[inline(always)]
fn f32_at(row: &[u8], column: &Column) -> f32 {
    let mut bytes = [0; 4];
    bytes.copy_from_slice(&row[column.offset..column.offset + 4]);
    f32::from_le_bytes(bytes)
}

#[inline(always)]
fn number<const LITTLE: bool>(row: &[u8], column: &Column) -> f64 {
    fn bytes<const N: usize, const LITTLE: bool>(row: &[u8], at: usize) -> [u8; N] {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&row[at..at + N]);
        if !LITTLE {
            bytes.reverse();
        }
        bytes
    }
    let at = column.offset;
    match column.scalar {
        Scalar::F32 => f32::from_le_bytes(bytes::<4, LITTLE>(row, at)).into(),
        Scalar::F64 => f64::from_le_bytes(bytes::<8, LITTLE>(row, at)),
        Scalar::I8 => row[at].cast_signed().into(),
        Scalar::U8 => row[at].into(),
        Scalar::I16 => i16::from_le_bytes(bytes::<2, LITTLE>(row, at)).into(),
        Scalar::U16 => u16::from_le_bytes(bytes::<2, LITTLE>(row, at)).into(),
        Scalar::I32 => i32::from_le_bytes(bytes::<4, LITTLE>(row, at)).into(),
        Scalar::U32 => u32::from_le_bytes(bytes::<4, LITTLE>(row, at)).into(),
    }
}

/// The rows of `vertex`, little-endian as its layout says; the elements before it are passed over.
fn parse_ascii(
    file: &str,
    body: &[u8],
    before: &[Element],
    vertex: &Element,
) -> Result<Vec<u8>, AssetError> {
    let mut left = body.len() as u64;
    let mut lines = body
        .split(|b| *b == b'\n')
        .filter(|line| !line.trim_ascii().is_empty());
    let truncated = |element: &Element, expected, actual| AssetError::Truncated {
        file: file.into(),
        element: element.name.clone(),
        count: element.count,
        expected,
        actual,
    };
    let least_bytes = |element: &Element| {
        // A value takes at least a digit and a separator; the last separator may be missing.
        let width = 2 * element.properties.len().max(1) as u64;
        element.count.saturating_mul(width).saturating_sub(1)
    };
    for element in before {
        let expected = least_bytes(element);
        if expected > left
            || lines.by_ref().take(element.count as usize).count() as u64 != element.count
        {
            return Err(truncated(element, expected, left));
        }
        left -= expected;
    }
    let expected = least_bytes(vertex);
    if expected > left {
        return Err(truncated(vertex, expected, left));
    }
    let columns = vertex.properties.len();
    let mut rows = Vec::with_capacity(vertex.count as usize * vertex.row);
    for row in 0..vertex.count as usize {
        let Some(line) = lines.next() else {
            return Err(truncated(vertex, expected, left));
        };
        let line = String::from_utf8_lossy(line);
        let mut found = 0;
        for word in line.split_ascii_whitespace() {
            let is_double = (vertex.properties.get(found)).is_some_and(|p| p.scalar == Scalar::F64);
            let bad = || AssetError::Number {
                file: file.into(),
                element: vertex.name.clone(),
                row,
                actual: word.chars().take(40).collect(),
            };
            match is_double {
                true => rows.extend(word.parse::<f64>().map_err(|_| bad())?.to_le_bytes()),
                false => rows.extend(word.parse::<f32>().map_err(|_| bad())?.to_le_bytes()),
            }
            found += 1;
        }
        if found != columns {
            let expected = format!("{columns} values");
            let property = format!("* of row {row}");
            return Err(property_error(
                file,
                &vertex.name,
                &property,
                &expected,
                &found.to_string(),
            ));
        }
    }
    Ok(rows)
}

fn take_rows<'a>(
    file: &str,
    element: &Element,
    body: &'a [u8],
) -> Result<(&'a [u8], &'a [u8]), AssetError> {
    let expected = element.count.saturating_mul(element.row as u64);
    if expected > body.len() as u64 {
        return Err(AssetError::Truncated {
            file: file.into(),
            element: element.name.clone(),
            count: element.count,
            expected,
            actual: body.len() as u64,
        });
    }
    Ok(body.split_at(expected as usize))
}

fn check_scalars(file: &str, element: &Element) -> Result<(), AssetError> {
    match element.properties.iter().find(|p| p.list.is_some()) {
        Some(p) => Err(property_error(
            file,
            &element.name,
            &p.name,
            "a single number",
            "a list",
        )),
        None => Ok(()),
    }
}

fn property_error(
    file: &str,
    element: &str,
    property: &str,
    expected: &str,
    actual: &str,
) -> AssetError {
    AssetError::Property {
        file: file.into(),
        element: element.into(),
        property: property.into(),
        expected: expected.into(),
        actual: actual.into(),
    }
}

/// Writes a binary little-endian PLY file; the exact inverse of [`read`] to `f32` precision.
pub fn write(gaussians: &Gaussians) -> Vec<u8> {
    let n = gaussians.len();
    let (stride, dim) = (gaussians.sh_stride(), gaussians.feature_dim as usize);
    let rest = stride - 3;
    let numbered = |prefix: &str, count: usize| {
        (0..count)
            .map(|i| format!("{prefix}{i}"))
            .collect::<Vec<_>>()
    };
    let names = [
        ["x", "y", "z"].map(String::from).to_vec(),
        numbered("f_dc_", 3),
        numbered("f_rest_", rest),
        vec!["opacity".into()],
        numbered("scale_", 3),
        numbered("rot_", 4),
        numbered("f_sem_", dim),
    ]
    .concat();
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {n}\n");
    for name in &names {
        header += &format!("property float {name}\n");
    }
    header += "end_header\n";
    let row = 4 * names.len();
    let mut file = header.into_bytes();
    let start = file.len();
    file.resize(start + n * row, 0);
    file[start..]
        .par_chunks_mut(row)
        .enumerate()
        .for_each(|(i, bytes)| {
            let mut words = bytes.as_chunks_mut::<4>().0.iter_mut();
            let mut put = |value: f32| {
                if let Some(word) = words.next() {
                    *word = value.to_le_bytes();
                }
            };
            gaussians.position[i].into_iter().for_each(&mut put);
            let sh = &gaussians.sh[i * stride..(i + 1) * stride];
            sh[..3].iter().copied().for_each(&mut put);
            for channel in 0..3 {
                sh[3..]
                    .iter()
                    .skip(channel)
                    .step_by(3)
                    .copied()
                    .for_each(&mut put);
            }
            put(logit(gaussians.opacity[i]));
            gaussians.scale[i].map(ln).into_iter().for_each(&mut put);
            let [x, y, z, w] = gaussians.rotation[i];
            [w, x, y, z].into_iter().for_each(&mut put);
            gaussians.feature[i * dim..(i + 1) * dim]
                .iter()
                .copied()
                .for_each(&mut put);
        });
    file
}
