//! `.splat` files: rows of 32 bytes, without header and spherical harmonics.

use super::{
    AssetError, Gaussians, ReadReport, SH_C0,
    activate::{Parsed, Widths, decode_rows},
};

/// Bytes per Gaussian: position 3 x `f32`, linear scale 3 x `f32`, rgba 4 x `u8`, rotation wxyz 4 x `u8`.
pub const ROW: usize = 32;

/// Reads `.splat` rows; degree 0 spherical harmonics.
///
/// # Errors
/// No rows, or a length that is not a multiple of [`ROW`].
pub fn read(name: &str, bytes: &[u8]) -> Result<(Gaussians, ReadReport), AssetError> {
    if bytes.is_empty() {
        return Err(AssetError::Empty {
            file: name.into(),
            element: "the file",
        });
    }
    if !bytes.len().is_multiple_of(ROW) {
        let count = bytes.len().div_ceil(ROW) as u64;
        return Err(AssetError::Truncated {
            file: name.into(),
            element: "row".into(),
            count,
            expected: count * ROW as u64,
            actual: bytes.len() as u64,
        });
    }
    let widths = Widths {
        row: ROW,
        sh_degree: 0,
        features: 0,
        is_exact: false,
    };
    super::finish(name, decode_rows(bytes, &widths, decode))
}

fn decode(row: &[u8], sh: &mut [f32], _: &mut [f32]) -> Parsed {
    let f = |i: usize| f32::from_le_bytes([row[i], row[i + 1], row[i + 2], row[i + 3]]);
    let q = |i: usize| (f32::from(row[28 + i]) - 128.0) / 128.0;
    for channel in 0..3 {
        sh[channel] = (f32::from(row[24 + channel]) / 255.0 - 0.5) / SH_C0;
    }
    Parsed {
        position: [f(0), f(4), f(8)].map(f64::from),
        scale: [f(12), f(16), f(20)],
        rotation: [q(1), q(2), q(3), q(0)],
        opacity: f32::from(row[27]) / 255.0,
    }
}
