//! Sizes of pictures on the command line.

/// Reads `640x480`, 1 to 16384 each.
///
/// # Errors
/// A sentence with what was given and what is expected.
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let parse = |part: &str| {
        part.parse::<u32>()
            .ok()
            .filter(|n| (1..=16_384).contains(n))
    };
    text.split_once('x')
        .and_then(|(width, height)| Some((parse(width)?, parse(height)?)))
        .ok_or_else(|| {
            format!(
                "expected WIDTHxHEIGHT in pixels from 1 to 16384, such as 640x480, not {text:?}"
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_or_refused_in_a_sentence() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        for bad in ["640", "0x10", "10x", "-1x5", "99999x2", "4x4x4"] {
            assert!(size(bad).unwrap_err().contains(bad));
        }
    }
}
