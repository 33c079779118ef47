//! Files of safetensors with metadata in the order of their keys: the same contents have the same bytes. The library keeps
//! metadata in a hash map, whose order is another one in every run.

use std::collections::BTreeMap;

use safetensors::{SafeTensorError, View};

/// The bytes of a file with tensors, at least one, and metadata.
///
/// # Errors
/// Those of the library.
pub fn serialize<'d, V: View>(
    tensors: impl IntoIterator<Item = (&'d str, V)>,
    metadata: &BTreeMap<&str, String>,
) -> Result<Vec<u8>, SafeTensorError> {
    let plain = safetensors::serialize(tensors, None)?;
    let (length, rest) = plain.split_at(8);
    let length = length.iter().rev().fold(0, |n, b| n << 8 | *b as usize);
    let (header, values) = rest.split_at(length);
    let metadata = serde_json::to_string(metadata)?;
    let header = header.trim_ascii_end();
    let inner = header.strip_prefix(b"{").unwrap_or(header);
    let mut all = [b"{\"__metadata__\":", metadata.as_bytes(), b",", inner].concat();
    // Values begin at a multiple of eight bytes, as the library has them.
    all.resize(all.len().next_multiple_of(8), b' ');
    Ok([&(all.len() as u64).to_le_bytes(), &all[..], values].concat())
}

#[cfg(test)]
mod tests {
    use safetensors::{Dtype, SafeTensors, tensor::TensorView};

    use super::*;

    #[test]
    fn the_same_contents_have_the_same_bytes_and_are_read() {
        let data = [1, 2, 3, 4];
        let keys = ["one", "two", "three", "four", "five", "a \"word\""];
        let metadata: BTreeMap<_, _> = keys.map(|key| (key, format!("{key}!"))).into();
        let write = || {
            let tensor = TensorView::new(Dtype::U8, vec![4], &data).expect("fits");
            serialize([("data", tensor)], &metadata).expect("bytes")
        };
        let bytes = write();
        for _ in 0..16 {
            assert_eq!(write(), bytes);
        }
        let (length, header) = SafeTensors::read_metadata(&bytes).expect("a header");
        assert_eq!(length % 8, 0);
        let found = header.metadata().as_ref().expect("metadata");
        assert_eq!(found.len(), keys.len());
        assert!(keys.iter().all(|key| found[*key] == format!("{key}!")));
        let file = SafeTensors::deserialize(&bytes).expect("a file");
        assert_eq!(file.tensor("data").expect("a tensor").data(), data);
    }
}
