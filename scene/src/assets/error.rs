//! Why an asset is refused, and what was dropped from one that is accepted.

use std::fmt;

/// Why an asset is refused. `file` is the name the caller gave.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AssetError {
    /// No bytes, or no Gaussians.
    #[error("{file}: {element} is empty, expected at least 1 Gaussian, found 0")]
    Empty {
        /// File name as given.
        file: String,
        /// The file or the element without rows.
        element: &'static str,
    },
    /// The content is not what the name says, or not known at all.
    #[error("{file}: expected {expected}, found {actual}")]
    Format {
        /// File name as given.
        file: String,
        /// What the name promised or what can be read.
        expected: &'static str,
        /// What the first bytes say.
        actual: String,
    },
    /// A line of a PLY header cannot be understood.
    #[error("{file}: header line {line}: expected {expected}, found {actual}")]
    Header {
        /// File name as given.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// What should stand there.
        expected: &'static str,
        /// What stands there.
        actual: String,
    },
    /// A property is absent, of the wrong kind, or there are too many or too few of a family.
    #[error("{file}: element {element}: property {property}: expected {expected}, found {actual}")]
    Property {
        /// File name as given.
        file: String,
        /// Element of the PLY file.
        element: String,
        /// Property or family, such as `f_rest_*`.
        property: String,
        /// What is needed.
        expected: String,
        /// What is there.
        actual: String,
    },
    /// Fewer bytes than the element's count needs. Checked before anything is allocated.
    #[error(
        "{file}: element {element}: expected {expected} bytes for {count} rows, found {actual}"
    )]
    Truncated {
        /// File name as given.
        file: String,
        /// Element of the PLY file, or `row` of a `.splat`.
        element: String,
        /// Rows promised.
        count: u64,
        /// Bytes they take (at least, for ASCII).
        expected: u64,
        /// Bytes left in the file.
        actual: u64,
    },
    /// A value of an ASCII file is not a number.
    #[error("{file}: element {element}, row {row}: expected a number, found {actual:?}")]
    Number {
        /// File name as given.
        file: String,
        /// Element of the PLY file.
        element: String,
        /// Row, from 0.
        row: usize,
        /// What stands there.
        actual: String,
    },
    /// Every single Gaussian was bad.
    #[error("{file}: expected at least 1 usable Gaussian, found {count}, all bad: {dropped}")]
    NoneUsable {
        /// File name as given.
        file: String,
        /// Gaussians in the file.
        count: usize,
        /// Why they were dropped.
        dropped: Dropped,
    },
    /// There is no generated asset of that name.
    #[error("builtin asset {name:?} does not exist, expected one of {known}")]
    UnknownBuiltin {
        /// Name asked for.
        name: String,
        /// Names that exist.
        known: String,
    },
}

/// Gaussians left out while reading, by cause. A Gaussian counts once, under the first cause that applies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// A position, scale, rotation or colour is NaN or infinite, or opacity is NaN.
    pub not_finite: usize,
    /// The rotation quaternion has no direction.
    pub zero_rotation: usize,
    /// A coordinate or scale is beyond [`MAX_LENGTH`](super::MAX_LENGTH), or a linear scale is negative.
    pub out_of_range: usize,
}

impl Dropped {
    /// Sum over the causes.
    pub fn total(&self) -> usize {
        self.not_finite + self.zero_rotation + self.out_of_range
    }
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} not finite, {} zero rotation, {} out of range",
            self.not_finite, self.zero_rotation, self.out_of_range
        )
    }
}

/// What reading an asset found besides the Gaussians returned.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadReport {
    /// Gaussians in the file.
    pub count: usize,
    /// Gaussians left out.
    pub dropped: Dropped,
    /// Their rows in the file, ascending.
    pub left_out: Vec<usize>,
    /// Scales that were zero (perfectly flat discs) and were raised to [`MIN_SCALE`](super::MIN_SCALE).
    pub flat_scales_raised: usize,
    /// Positions of the Gaussians as the file has them, asset units, where that is in double precision; else empty.
    pub exact: Vec<[f64; 3]>,
}

impl ReadReport {
    /// Rows of the file that became Gaussians, in their order.
    pub fn rows(&self) -> Vec<usize> {
        let mut left_out = self.left_out.iter().peekable();
        (0..self.count)
            .filter(|row| left_out.next_if_eq(&row).is_none())
            .collect()
    }
}
