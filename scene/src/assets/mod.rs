//! Splat assets: activated Gaussians in memory, and the files they come from.

mod activate;
mod error;
pub mod generate;
pub mod mesh;
mod mesh_ply;
pub mod objects;
mod paint;
pub mod ply;
mod ply_header;
pub mod splat;
pub mod tensors;

pub use activate::SH_C0;
pub(crate) use activate::sigmoid;
pub use cosplat_sim_core::scene::Gaussians;
pub use error::{AssetError, Dropped, ReadReport};
pub use paint::Paint;

/// Largest coordinate or scale that is taken as real, asset units; Gaussians beyond it are dropped. Its square
/// still leaves headroom in `f32`.
pub const MAX_LENGTH: f32 = 1e9;

/// Smallest scale kept, asset units: perfectly flat discs get this thickness, whose square is still normal.
pub const MIN_SCALE: f32 = 1e-12;

/// Reads an asset, choosing the format by its first bytes and by the extension of `name` (which is otherwise
/// used in messages only). Bad single Gaussians are left out and counted; anything else wrong is an error.
pub fn read(name: &str, bytes: &[u8]) -> Result<(Gaussians, ReadReport), AssetError> {
    if bytes.is_empty() {
        return Err(AssetError::Empty {
            file: name.into(),
            element: "the file",
        });
    }
    let extension = name
        .rsplit_once('.')
        .map_or("", |(_, e)| e)
        .to_ascii_lowercase();
    let is_ply = bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r");
    match (extension.as_str(), is_ply) {
        ("splat", false) => splat::read(name, bytes),
        ("splat", true) => Err(AssetError::Format {
            file: name.into(),
            expected: "32-byte .splat rows",
            actual: "a PLY header: rename the file to .ply".into(),
        }),
        (_, true) => ply::read(name, bytes),
        (_, false) => Err(AssetError::Format {
            file: name.into(),
            expected: if extension == "ply" {
                "a PLY file, which starts with a line `ply`"
            } else {
                "a PLY file or a name that ends in .splat"
            },
            actual: describe(bytes),
        }),
    }
}

/// Says in words what foreign content looks like.
fn describe(bytes: &[u8]) -> String {
    let convert = "convert it to .ply first, for example with splat-transform";
    match bytes {
        [0x1f, 0x8b, ..] => format!("gzip data, perhaps SPZ: {convert}"),
        [b'N', b'G', b'S', b'P', ..] => format!("an SPZ file: {convert}"),
        [b'P', b'K', 3, 4, ..] => format!("a zip archive, perhaps SOG: {convert}"),
        [b'g', b'l', b'T', b'F', ..] => format!("a binary glTF file: {convert}"),
        _ => format!("bytes {:02x?}", &bytes[..bytes.len().min(8)]),
    }
}

/// Turns what a format's reader collected into the result of [`read`].
fn finish(
    name: &str,
    (gaussians, report): (Gaussians, ReadReport),
) -> Result<(Gaussians, ReadReport), AssetError> {
    if gaussians.is_empty() {
        return Err(AssetError::NoneUsable {
            file: name.into(),
            count: report.count,
            dropped: report.dropped,
        });
    }
    Ok((gaussians, report))
}

#[cfg(test)]
mod tests;
