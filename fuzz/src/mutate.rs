//! Mutations that keep the shape of a format: lines, words and numbers of texts, fields and lengths of binary data.

use rand_core::Rng;

use crate::targets::{Shape, Target};

/// Numbers of texts that readers get wrong.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "1",
    "-1",
    "nan",
    "-inf",
    "inf",
    "1e308",
    "-1e308",
    "1e-320",
    "1e39",
    "255",
    "256",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "18446744073709551616",
    "0.5",
    "1e9",
    "1e-9",
    "999999999",
    "[]",
    "\"\"",
    "true",
    "{}",
    "null",
];
/// Integers of binary data that readers get wrong.
const INTEGERS: &[u64] = &[
    0,
    1,
    2,
    15,
    16,
    127,
    128,
    255,
    256,
    32_767,
    65_535,
    65_536,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    1 << 32,
    1 << 40,
    i64::MAX as u64,
    1 << 63,
    u64::MAX - 7,
    u64::MAX,
];
/// Numbers of binary data that solvers get wrong.
const FLOATS: &[f64] = &[
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    4.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    1e-320,
    1e38,
    -1e38,
    1e30,
    1e15,
    1e9,
    -1e9,
    1e6,
    1e3,
    -1e3,
    1e-6,
    1e-9,
];

/// An input that differs from `data` by one to four mutations.
pub fn mutate(target: &Target, data: &[u8], rng: &mut impl Rng) -> Vec<u8> {
    let mut mutated = data.to_vec();
    for _ in 0..1 + below(rng, 4) {
        match (target.shape, below(rng, 4)) {
            (_, 0) | (Shape::Binary, 1) => bytes(&mut mutated, rng),
            (Shape::Text, _) => text(&mut mutated, rng),
            (Shape::Binary, _) => fields(&mut mutated, rng),
        }
    }
    mutated
}

/// A number below `end`; 0 where that is 0.
pub fn below(rng: &mut impl Rng, end: usize) -> usize {
    (rng.next_u64() % end.max(1) as u64) as usize
}

fn pick<T: Copy>(rng: &mut impl Rng, from: &[T]) -> T {
    from[below(rng, from.len())]
}

/// Two places in order.
fn range(rng: &mut impl Rng, length: usize) -> std::ops::Range<usize> {
    let (a, b) = (below(rng, length + 1), below(rng, length + 1));
    a.min(b)..a.max(b)
}

/// Bits, cuts, repetitions.
fn bytes(data: &mut Vec<u8>, rng: &mut impl Rng) {
    let place = range(rng, data.len());
    match below(rng, 5) {
        0 => data.truncate(place.end),
        1 => drop(data.drain(place.start..place.end.min(place.start + 64))),
        2 => {
            let part = data[place.start..place.end.min(place.start + 256)].to_vec();
            data.splice(place.end..place.end, part);
        }
        _ => {
            if let Some(byte) = data.get_mut(place.start) {
                *byte ^= 1 << below(rng, 8);
            }
        }
    }
}

/// A field of two, four or eight bytes becomes a number that hurts.
fn fields(data: &mut [u8], rng: &mut impl Rng) {
    let (float, integer) = (pick(rng, FLOATS), pick(rng, INTEGERS));
    let field = match below(rng, 5) {
        0 => float.to_le_bytes().to_vec(),
        1 => (float as f32).to_le_bytes().to_vec(),
        2 => integer.to_le_bytes().to_vec(),
        3 => (integer as u32).to_le_bytes().to_vec(),
        _ => (integer as u16).to_le_bytes().to_vec(),
    };
    // Fields of formats without padding begin anywhere.
    let at = below(rng, data.len().saturating_sub(field.len()) + 1);
    if let Some(to) = data.get_mut(at..at + field.len()) {
        to.copy_from_slice(&field);
    }
}

/// Numbers become others, words and lines come twice, go or trade places.
fn text(data: &mut Vec<u8>, rng: &mut impl Rng) {
    let is_word = |byte: u8| byte.is_ascii_alphanumeric() || b"+-._".contains(&byte);
    let unit: fn(u8) -> bool = match below(rng, 3) {
        0 => |byte| byte != b'\n',
        _ => is_word,
    };
    let at = below(rng, data.len());
    let Some(first) = data[at..].iter().position(|&byte| unit(byte)) else {
        return;
    };
    let first = at + first;
    let length = data[first..].iter().position(|&byte| !unit(byte));
    let end = length.map_or(data.len(), |length| first + length);
    match below(rng, 4) {
        0 => drop(data.drain(first..end)),
        1 => {
            let twice = [&data[first..end], b"\n"].concat();
            data.splice(first..first, twice);
        }
        2 => {
            // What stands elsewhere in the same text is a word of the format.
            let other = below(rng, data.len());
            let begin = data[other..].iter().position(|&byte| unit(byte));
            let other = other + begin.unwrap_or_default();
            let length = data[other..]
                .iter()
                .take(256)
                .take_while(|&&byte| unit(byte));
            let word = data[other..other + length.count()].to_vec();
            data.splice(first..end, word);
        }
        _ => drop(data.splice(first..end, pick(rng, NUMBERS).bytes())),
    }
}
