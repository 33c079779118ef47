//! Arrays of numpy's `.npy` files (format 1 to 3 of NEP 1): numbers, little endian, in C or Fortran order. Objects are pickles
//! and refused.
//!
//! A reader of our own: the one that is kept up brings fourteen crates and an assembler for a header of one line.

use half::f16;

/// First bytes of a file.
const MAGIC: &[u8] = b"\x93NUMPY";
/// Most axes, as in numpy.
const MOST_AXES: usize = 64;

/// An array: its shape, and its values in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array<T> {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// All values.
    pub value: Vec<T>,
}

/// What follows a key in the header's dictionary.
fn entry<'t>(header: &'t str, key: &str) -> Result<&'t str, String> {
    let found = header.split_once(&format!("'{key}':"));
    let found = found.ok_or_else(|| format!("its header has no {key}"))?;
    Ok(found.1.trim_start())
}

/// What a header says.
struct Header {
    /// Kind of the numbers, as numpy writes it.
    kind: String,
    /// Whether the first axis is the fastest.
    is_fortran: bool,
    shape: Vec<usize>,
}

/// What the header says, and the bytes of the numbers.
fn parse(bytes: &[u8]) -> Result<(Header, &[u8]), String> {
    let rest = bytes.strip_prefix(MAGIC).ok_or("no .npy file of numpy")?;
    let (length, rest) = match rest {
        [1, _, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
        [2 | 3, _, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest),
        [version, ..] => return Err(format!("has version {version}, expected 1 to 3")),
        [] => return Err("ends in its header".to_owned()),
    };
    let cut = rest.split_at_checked(length).ok_or("ends in its header")?;
    let header = std::str::from_utf8(cut.0).map_err(|_| "its header is no text")?;
    let kind = entry(header, "descr")?;
    let kind = kind.strip_prefix('\'').and_then(|k| k.split_once('\''));
    let (kind, _) = kind.ok_or("holds records, expected numbers of one kind")?;
    let order = entry(header, "fortran_order")?;
    let is_fortran = order.starts_with("True");
    if !is_fortran && !order.starts_with("False") {
        return Err("its fortran_order is neither True nor False".to_owned());
    }
    let shape = entry(header, "shape")?;
    let shape = shape.strip_prefix('(').and_then(|s| s.split_once(')'));
    let (shape, _) = shape.ok_or("its header has no shape")?;
    let axes = shape
        .split(',')
        .map(str::trim)
        .filter(|axis| !axis.is_empty());
    let shape: Result<Vec<usize>, _> = axes.map(str::parse).collect();
    let shape = shape.map_err(|error| format!("its shape is no list of lengths: {error}"))?;
    if shape.len() > MOST_AXES {
        return Err(format!(
            "has {} axes, expected at most {MOST_AXES}",
            shape.len()
        ));
    }
    let header = Header {
        kind: kind.to_owned(),
        is_fortran,
        shape,
    };
    Ok((header, cut.1))
}

/// Bytes of the largest numbers.
const LARGEST: usize = 8;

/// Values of `size` bytes each.
fn values<T: Copy>(
    header: Header,
    bytes: &[u8],
    size: usize,
    value: impl Fn(&[u8]) -> Option<T>,
) -> Result<Array<T>, String> {
    let shape = header.shape;
    // As numpy has it, what is empty by one axis is not beyond all memory by others, in numbers of any size.
    let mut filled = shape.iter().filter(|axis| **axis > 0);
    let most = filled.try_fold(LARGEST, |all, axis| all.checked_mul(*axis));
    let all = most.map(|_| size * shape.iter().product::<usize>());
    if all != Some(bytes.len()) {
        return Err(format!(
            "has {} bytes of values, expected {shape:?} of {size} bytes",
            bytes.len()
        ));
    }
    let found: Option<Vec<T>> = bytes.chunks_exact(size).map(value).collect();
    let mut value = found.ok_or("has a number beyond 32 bits")?;
    if header.is_fortran && shape.len() > 1 {
        value = in_c_order(&shape, &value);
    }
    Ok(Array { shape, value })
}

/// Values whose first axis is the fastest, with the last axis the fastest.
fn in_c_order<T: Copy>(shape: &[usize], value: &[T]) -> Vec<T> {
    let place = |n: usize| {
        // How many values the axes from here to the last have, and those before.
        let (mut at, mut rest, mut before) = (0, n, value.len());
        for axis in shape.iter().rev() {
            before /= axis;
            at += rest % axis * before;
            rest /= axis;
        }
        at
    };
    (0..value.len()).map(|n| value[place(n)]).collect()
}

fn fixed<const N: usize>(bytes: &[u8]) -> [u8; N] {
    std::array::from_fn(|k| bytes[k])
}

/// Whole numbers of 8 to 64 bits, or truth values as 0 and 1.
///
/// # Errors
/// When the bytes are no such array or a number is beyond 32 bits, in words.
pub fn ints(bytes: &[u8]) -> Result<Array<i32>, String> {
    let (header, data) = parse(bytes)?;
    match header.kind.as_str() {
        "|b1" => values(header, data, 1, |b| Some(i32::from(b[0] != 0))),
        "|u1" => values(header, data, 1, |b| Some(b[0].into())),
        "|i1" => values(header, data, 1, |b| {
            Some(i8::from_le_bytes(fixed(b)).into())
        }),
        "<u2" => values(header, data, 2, |b| {
            Some(u16::from_le_bytes(fixed(b)).into())
        }),
        "<i2" => values(header, data, 2, |b| {
            Some(i16::from_le_bytes(fixed(b)).into())
        }),
        "<u4" => values(header, data, 4, |b| {
            u32::from_le_bytes(fixed(b)).try_into().ok()
        }),
        "<i4" => values(header, data, 4, |b| Some(i32::from_le_bytes(fixed(b)))),
        "<u8" => values(header, data, 8, |b| {
            u64::from_le_bytes(fixed(b)).try_into().ok()
        }),
        "<i8" => values(header, data, 8, |b| {
            i64::from_le_bytes(fixed(b)).try_into().ok()
        }),
        kind => Err(format!(
            "holds {kind:?}, expected whole numbers such as int32"
        )),
    }
}

/// Numbers with a fraction, of 16 to 64 bits; those of 64 are rounded to 32.
///
/// # Errors
/// When the bytes are no such array or a number is not finite in 32 bits, in words.
pub fn floats(bytes: &[u8]) -> Result<Array<f32>, String> {
    let (header, data) = parse(bytes)?;
    let found = match header.kind.as_str() {
        "<f2" => values(header, data, 2, |b| {
            Some(f16::from_le_bytes(fixed(b)).to_f32())
        })?,
        "<f4" => values(header, data, 4, |b| Some(f32::from_le_bytes(fixed(b))))?,
        "<f8" => values(header, data, 8, |b| {
            Some(f64::from_le_bytes(fixed(b)) as f32)
        })?,
        kind => {
            return Err(format!(
                "holds {kind:?}, expected float16, float32 or float64"
            ));
        }
    };
    match found.value.iter().position(|v| !v.is_finite()) {
        Some(at) => Err(format!(
            "has {} at {at}, expected finite numbers",
            found.value[at]
        )),
        None => Ok(found),
    }
}

/// A file of whole numbers of 32 bits, as numpy writes it.
#[must_use]
pub fn write_ints(array: &Array<i32>) -> Vec<u8> {
    let data = array.value.iter().flat_map(|v| v.to_le_bytes());
    file("<i4", &array.shape, data)
}

/// A file of numbers with a fraction, of 32 bits, as numpy writes it.
#[must_use]
pub fn write_floats(array: &Array<f32>) -> Vec<u8> {
    let data = array.value.iter().flat_map(|v| v.to_le_bytes());
    file("<f4", &array.shape, data)
}

fn file(kind: &str, shape: &[usize], data: impl Iterator<Item = u8>) -> Vec<u8> {
    let axes: String = shape.iter().map(|axis| format!("{axis}, ")).collect();
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({axes}), }}");
    // The values begin at a multiple of 64 bytes, the header ends a line.
    let before = MAGIC.len() + 4;
    let length = (before + header.len() + 1).next_multiple_of(64) - before;
    let mut bytes = [MAGIC, &[1, 0], &(length as u16).to_le_bytes()].concat();
    bytes.extend(format!("{header:<width$}\n", width = length - 1).into_bytes());
    bytes.extend(data);
    bytes
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A file of this kind and shape, as numpy writes it.
    pub(crate) fn file(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = MAGIC.to_vec();
        bytes.extend([1, 0]);
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn whole_numbers_of_any_size_are_read() {
        let found = ints(&file("|u1", "(2, 3)", &[0, 1, 2, 3, 4, 255])).expect("an array");
        assert_eq!(
            (found.shape, found.value),
            (vec![2, 3], vec![0, 1, 2, 3, 4, 255])
        );
        let found = ints(&file("<i8", "(1,)", &(-1i64).to_le_bytes())).expect("an array");
        assert_eq!((found.shape, found.value), (vec![1], vec![-1]));
        let found = floats(&file("<f2", "(1, 1)", &f16::from_f32(0.5).to_le_bytes()));
        assert_eq!(found.expect("an array").value, [0.5]);
    }

    #[test]
    fn arrays_come_back_as_they_were_written() {
        let whole = Array {
            shape: vec![2, 1, 3],
            value: vec![0, -1, 7, i32::MAX, i32::MIN, 5],
        };
        let bytes = write_ints(&whole);
        assert_eq!(ints(&bytes), Ok(whole));
        assert_eq!((bytes.len() - 24) % 64, 0);
        let parts = Array {
            shape: vec![2],
            value: vec![0.5, -1e30],
        };
        assert_eq!(floats(&write_floats(&parts)), Ok(parts));
    }

    #[test]
    fn what_is_no_such_array_is_refused_in_a_sentence() {
        let whole = file("<i4", "(2,)", &[0; 8]);
        for cut in 0..whole.len() {
            assert!(ints(&whole[..cut]).is_err(), "{cut}");
        }
        let refused = |bytes: &[u8]| ints(bytes).expect_err("refused");
        assert!(refused(&file("|O", "(2,)", &[0; 8])).contains("whole numbers"));
        assert!(refused(&file("<i4", "(3,)", &[0; 8])).contains("8 bytes"));
        assert!(refused(&file("<i4", "(99999999999, 99999999999)", &[0; 8])).contains("8 bytes"));
        for axes in [
            format!("({}, 0)", usize::MAX / 4),
            format!("(0, {0}, {0})", 1u64 << 40),
        ] {
            assert!(
                refused(&file("<i2", &axes, &[])).contains("0 bytes"),
                "{axes}"
            );
        }
        assert_eq!(
            ints(&file("<i2", "(3, 0, 2)", &[])).expect("empty").shape,
            [3, 0, 2]
        );
        assert!(refused(&file("<i4", "(-2,)", &[0; 8])).contains("lengths"));
        let axes = format!("({})", "1, ".repeat(65));
        assert!(refused(&file("<i4", &axes, &[0; 4])).contains("65 axes"));
        assert!(refused(&file("<i8", "(1,)", &i64::MAX.to_le_bytes())).contains("32 bits"));
        let wrong = floats(&file("<f4", "(1,)", &f32::NAN.to_le_bytes()));
        assert!(wrong.expect_err("refused").contains("finite"));
    }
}
