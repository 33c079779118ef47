//! `/gaussians`: a frame, or an object of it, as a `foxglove.PointCloud`, the Gaussians' bytes verbatim.

use std::mem::{offset_of, size_of};

use cosplat_ipc::schema::GaussianState;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{PackedElementField, PointCloud, Pose, Quaternion, Timestamp, Vector3};
use prost::Message;
use prost::encoding::{WireType, encode_key, encode_varint};

/// Name of the world frame in every message.
pub const WORLD_FRAME: &str = "world";

/// Field number of `data` in `foxglove.PointCloud`.
const DATA_FIELD: u32 = 6;

/// Bytes from one Gaussian to the next.
const STRIDE: usize = size_of::<GaussianState>();

/// Named fields of one Gaussian within its 64 bytes.
pub fn fields() -> Vec<PackedElementField> {
    let mut fields = Vec::new();
    let mut run = |first: usize, size: usize, kind: NumericType, names: &[&str]| {
        for (i, name) in names.iter().enumerate() {
            fields.push(PackedElementField {
                name: (*name).to_owned(),
                offset: (first + i * size) as u32,
                r#type: kind as i32,
            });
        }
    };
    let float = NumericType::Float32;
    run(
        offset_of!(GaussianState, position),
        4,
        float,
        &["x", "y", "z"],
    );
    run(
        offset_of!(GaussianState, color),
        1,
        NumericType::Uint8,
        &["red", "green", "blue", "alpha"],
    );
    run(
        offset_of!(GaussianState, covariance),
        4,
        float,
        &["cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz"],
    );
    run(
        offset_of!(GaussianState, object),
        4,
        NumericType::Uint32,
        &["object_id", "index"],
    );
    run(
        offset_of!(GaussianState, rotation),
        4,
        float,
        &["rot_x", "rot_y", "rot_z", "rot_w"],
    );
    fields
}

/// First part of a message: the Gaussians. Protobuf fields come in any order, and this one needs no time.
pub(crate) fn encode_points(gaussians: &[GaussianState], out: &mut Vec<u8>) {
    let bytes: &[u8] = bytemuck::cast_slice(gaussians);
    out.reserve(bytes.len() + 1024);
    encode_key(DATA_FIELD, WireType::LengthDelimited, out);
    encode_varint(bytes.len() as u64, out);
    out.extend_from_slice(bytes);
}

/// Second part of a message: what the bytes mean.
pub(crate) fn encode_description(log_time_ns: u64, frame: &str, out: &mut Vec<u8>) {
    let description = PointCloud {
        timestamp: Some(timestamp(log_time_ns)),
        frame_id: frame.to_owned(),
        pose: Some(Pose {
            position: Some(Vector3::default()),
            orientation: Some(Quaternion {
                w: 1.0,
                ..Default::default()
            }),
        }),
        point_stride: STRIDE as u32,
        fields: fields(),
        data: Default::default(),
    };
    out.extend_from_slice(&description.encode_to_vec());
}

/// The Gaussians of a message of `/gaussians` or one below, and the name of the frame that they are in.
///
/// # Errors
/// A sentence when the message is no point cloud or its layout is not that of [`GaussianState`].
pub fn decode(message: &[u8]) -> Result<(Vec<GaussianState>, String), String> {
    let cloud =
        PointCloud::decode(message).map_err(|e| format!("not a foxglove.PointCloud: {e}"))?;
    if cloud.point_stride as usize != STRIDE {
        return Err(format!(
            "point stride is {}, expected {STRIDE}",
            cloud.point_stride
        ));
    }
    if cloud.fields != fields() {
        let names: Vec<_> = cloud.fields.iter().map(|f| f.name.as_str()).collect();
        return Err(format!(
            "point fields {names:?} are not those of a Gaussian"
        ));
    }
    if cloud.data.len() % STRIDE != 0 {
        return Err(format!(
            "{} bytes of points are no multiple of {STRIDE}",
            cloud.data.len()
        ));
    }
    let gaussians = bytemuck::pod_collect_to_vec(&cloud.data[..]);
    Ok((gaussians, cloud.frame_id))
}

/// Nanoseconds as the message set's time; saturates in the year 2106.
pub(crate) fn timestamp(ns: u64) -> Timestamp {
    u32::try_from(ns / 1_000_000_000)
        .ok()
        .and_then(|sec| Timestamp::new_checked(sec, (ns % 1_000_000_000) as u32))
        .unwrap_or(Timestamp::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_tile_the_gaussian_without_gap_or_overlap() {
        let mut next = 0;
        for field in fields() {
            assert_eq!(field.offset, next, "field {}", field.name);
            next += if field.r#type == NumericType::Uint8 as i32 {
                1
            } else {
                4
            };
        }
        assert_eq!(next as usize, STRIDE);
    }

    #[test]
    fn a_cloud_of_another_layout_is_refused() {
        let mut message = Vec::new();
        encode_points(&[GaussianState::default(); 3], &mut message);
        encode_description(0, WORLD_FRAME, &mut message);
        assert_eq!(decode(&message).unwrap().0.len(), 3);
        let mut other = PointCloud::decode(&message[..]).unwrap();
        other.point_stride = 48;
        let refusal = decode(&other.encode_to_vec()).unwrap_err();
        assert!(
            refusal.contains("48") && refusal.contains("64"),
            "{refusal}"
        );
        other.point_stride = 64;
        other.fields.swap(0, 1);
        assert!(decode(&other.encode_to_vec()).is_err());
    }
}
