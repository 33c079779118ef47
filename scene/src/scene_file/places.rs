//! Lines and columns of a text, in time that does not grow with the text.

/// Bytes between two noted counts of characters: as far as a look-up reads at most.
const STRIDE: usize = 256;

/// Where the lines of a text begin, and how many characters are before every [`STRIDE`]th byte.
pub(super) struct Places<'t> {
    text: &'t [u8],
    /// First byte of every line.
    lines: Vec<usize>,
    /// Characters that begin before byte `i * STRIDE`.
    characters: Vec<usize>,
}

/// Characters that begin in some bytes of UTF-8.
fn begun(bytes: &[u8]) -> usize {
    #[cfg(test)]
    tests::READ.with(|read| read.set(read.get() + bytes.len()));
    let begins = |byte: &&u8| (*byte & 0xc0) != 0x80;
    bytes.iter().filter(begins).count()
}

impl<'t> Places<'t> {
    pub fn new(text: &'t str) -> Self {
        let text = text.as_bytes();
        let ends = text.iter().enumerate().filter(|(_, byte)| **byte == b'\n');
        let starts = ends.map(|(i, _)| i + 1);
        let lines = std::iter::once(0).chain(starts).collect();
        let chunks = text.chunks(STRIDE).scan(0, |before, chunk| {
            *before += begun(chunk);
            Some(*before)
        });
        let characters = std::iter::once(0).chain(chunks).collect();
        Self {
            text,
            lines,
            characters,
        }
    }

    /// Line and column of a byte, both from 1, the column in characters; behind the text those of its end.
    pub fn of(&self, byte: usize) -> [usize; 2] {
        let byte = byte.min(self.text.len());
        let line = self.lines.partition_point(|start| *start <= byte);
        let start = self.lines[line - 1];
        [line, self.before(byte) - self.before(start) + 1]
    }

    /// Characters that begin before a byte of the text.
    fn before(&self, byte: usize) -> usize {
        let noted = byte / STRIDE;
        self.characters[noted] + begun(&self.text[noted * STRIDE..byte])
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::scene_file::SceneFile;

    thread_local! {
        /// Bytes looked at.
        pub(super) static READ: Cell<usize> = const { Cell::new(0) };
    }

    /// Counted from the start of the text.
    fn counted(text: &str, byte: usize) -> [usize; 2] {
        let before = &text[..byte];
        let start = before.rfind('\n').map_or(0, |i| i + 1);
        let line = before.matches('\n').count() + 1;
        [line, before[start..].chars().count() + 1]
    }

    #[test]
    fn places_are_those_that_counting_finds() {
        let long = "äb€𝄞".repeat(STRIDE);
        for text in [
            "",
            "\n",
            "a = 1\nb = \"ü\"\n\nc",
            &long,
            &format!("{long}\n{long}x"),
        ] {
            let places = Places::new(text);
            let bytes = (0..=text.len()).filter(|&byte| text.is_char_boundary(byte));
            for byte in bytes {
                assert_eq!(places.of(byte), counted(text, byte), "byte {byte}");
            }
            assert_eq!(places.of(usize::MAX), counted(text, text.len()));
        }
    }

    #[test]
    fn twice_the_unknown_keys_are_found_in_twice_the_work() {
        let work = |keys: usize, end: &str| {
            let keys: String = (0..keys).map(|i| format!("k{i:06} = 1{end}")).collect();
            let text = match end {
                "\n" => keys,
                _ => format!("objects = [{{ {} }}]", keys.trim_end_matches(end)),
            };
            READ.set(0);
            let errors = SceneFile::parse(&text).expect_err("no object");
            (READ.get() as f64, errors.0.len())
        };
        for end in ["\n", ", "] {
            let ((once, few), (twice, many)) = (work(2000, end), work(4000, end));
            assert_eq!(many, few + 2000);
            // A quarter more where numbers of places in the text get longer would still be linear; quadratic is 4.
            assert!(twice < 2.5 * once, "{once} bytes read, then {twice}");
        }
    }
}
