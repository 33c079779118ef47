//! Text in wire types: UTF-8, zero-padded to a fixed length.

/// Why bytes from another process are no text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextError {
    /// The bytes are not UTF-8.
    #[error("byte {at} of the text is not UTF-8")]
    NotUtf8 {
        /// Index of the first bad byte.
        at: usize,
    },
    /// Something follows the padding.
    #[error("byte {at} of the text is {value} after a zero, expected zeros up to the end")]
    AfterPadding {
        /// Index of the first non-zero byte after a zero.
        at: usize,
        /// Its value.
        value: u8,
    },
}

/// The text in a zero-padded field; it may fill the field completely.
pub fn str_from_padded(bytes: &[u8]) -> Result<&str, TextError> {
    let length = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    if let Some(offset) = bytes[length..].iter().position(|&b| b != 0) {
        let at = length + offset;
        return Err(TextError::AfterPadding {
            at,
            value: bytes[at],
        });
    }
    std::str::from_utf8(&bytes[..length]).map_err(|error| TextError::NotUtf8 {
        at: error.valid_up_to(),
    })
}

/// `text` as a zero-padded field, cut at the last character that fits and before any zero character.
pub fn padded<const N: usize>(text: &str) -> [u8; N] {
    let text = text.split('\0').next().unwrap_or("");
    let length = text.floor_char_boundary(N);
    let mut field = [0; N];
    field[..length].copy_from_slice(&text.as_bytes()[..length]);
    field
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_round_trips_and_is_cut_at_a_character() {
        assert_eq!(str_from_padded(&padded::<8>("Vase")), Ok("Vase"));
        assert_eq!(str_from_padded(&padded::<4>("Vase")), Ok("Vase"));
        assert_eq!(str_from_padded(&padded::<4>("abcü")), Ok("abc"));
        assert_eq!(str_from_padded(&padded::<4>("a\0b")), Ok("a"));
    }

    #[test]
    fn bad_bytes_are_named_not_shown() {
        assert_eq!(
            str_from_padded(b"ab\xffc"),
            Err(TextError::NotUtf8 { at: 2 })
        );
        assert_eq!(
            str_from_padded(b"a\0b\0"),
            Err(TextError::AfterPadding { at: 2, value: b'b' })
        );
    }
}
