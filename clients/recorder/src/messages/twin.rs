//! Wire types as JSON objects, by the table of their layout: a field of the wire is a field of the recording.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;

use cosplat_ipc::schema::{self as wire, FieldLayout, Wire};
use serde::de::{DeserializeSeed, Error as _, IgnoredAny, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::Hex64;

/// Fields that older recorders did not write, by their type: what is missing of them in a file is 0. A field that is added to a
/// wire type needs a row here, and the file of an older recorder in `clients/recorder/tests/older`.
const ADDED: [(&str, &str); 15] = [
    ("cosplat.v1.MaterialSpec", "region"),
    ("cosplat.v1.MaterialSpec", "parameters"),
    ("cosplat.v1.Status", "frame_readers"),
    ("cosplat.v1.Status", "has_changes"),
    ("cosplat.v1.Status", "spring_work"),
    ("cosplat.v1.Status", "edit_energy"),
    ("cosplat.v1.Status", "edit_mass"),
    ("cosplat.v1.Status", "step_seconds"),
    ("cosplat.v1.Status", "phase_shares"),
    ("cosplat.v1.Status", "cost_shares"),
    ("cosplat.v1.Status", "cost_substeps"),
    ("cosplat.v1.Status", "cost_dt"),
    ("cosplat.v1.Status", "cost_objects"),
    ("cosplat.v1.Status", "cost_limits"),
    ("cosplat.v1.Status", "cost_points"),
];

/// Fields of 64 bits that are hashes or random ids: in JSON strings of 16 hexadecimal digits.
const HASHES: [&str; 4] = ["epoch", "state_hash", "schema_hash", "client"];

/// A wire type as JSON: every field but reserved ones, under its name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twin<W>(pub W);

impl<W> Deref for Twin<W> {
    type Target = W;

    fn deref(&self) -> &W {
        &self.0
    }
}

/// The fields of a wire type that are in a recording.
fn told<W: Wire>() -> impl Iterator<Item = &'static FieldLayout> {
    W::FIELDS.iter().filter(|field| field.field != "reserved")
}

/// What a field of the wire holds.
#[derive(Clone, Copy)]
enum Kind {
    U32,
    U64,
    Hash,
    F64,
    /// So many `f64`.
    Numbers(usize),
    /// So many `u32`.
    Integers(usize),
}

impl Kind {
    /// `None` for what no record has.
    fn of(field: &FieldLayout) -> Option<Self> {
        Some(match field.field_type {
            "u32" => Self::U32,
            "u64" if HASHES.contains(&field.field) => Self::Hash,
            "u64" => Self::U64,
            "f64" => Self::F64,
            array if array.starts_with("[f64;") => Self::Numbers(field.size / 8),
            array if array.starts_with("[u32;") => Self::Integers(field.size / 4),
            _ => return None,
        })
    }
}

impl<W: Wire> Serialize for Twin<W> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let bytes = bytemuck::bytes_of(&self.0);
        let mut map = to.serialize_map(None)?;
        for field in told::<W>() {
            let bytes = &bytes[field.offset..][..field.size];
            let name = field.field;
            match Kind::of(field) {
                Some(Kind::U32) => map.serialize_entry(name, &number::<u32>(bytes))?,
                Some(Kind::U64) => map.serialize_entry(name, &number::<u64>(bytes))?,
                Some(Kind::Hash) => map.serialize_entry(name, &Hex64(number(bytes)))?,
                Some(Kind::F64) => map.serialize_entry(name, &number::<f64>(bytes))?,
                Some(Kind::Numbers(_)) => {
                    let numbers: Vec<f64> = bytes.chunks_exact(8).map(number).collect();
                    map.serialize_entry(name, &numbers)?;
                }
                Some(Kind::Integers(_)) => {
                    let numbers: Vec<u32> = bytes.chunks_exact(4).map(number).collect();
                    map.serialize_entry(name, &numbers)?;
                }
                None => return Err(serde::ser::Error::custom(strange(field))),
            }
        }
        map.end()
    }
}

fn number<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> T {
    bytemuck::pod_read_unaligned(bytes)
}

fn strange(field: &FieldLayout) -> String {
    let (kind, name, of) = (field.field_type, field.field, field.type_name);
    format!("{name} of {of} is {kind}, expected u32, u64, f64 or an array of u32 or f64")
}

impl<'de, W: Wire> Deserialize<'de> for Twin<W> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_map(Fields(PhantomData))
    }
}

/// Reads an object of JSON.
struct Fields<W>(PhantomData<W>);

impl<'de, W: Wire> Visitor<'de> for Fields<W> {
    type Value = Twin<W>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with the fields of a wire type")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Twin<W>, M::Error> {
        let mut value = W::zeroed();
        let mut found = vec![false; W::FIELDS.len()];
        while let Some(key) = map.next_key::<String>()? {
            let at = W::FIELDS.iter().position(|field| field.field == key);
            let at = at.filter(|at| W::FIELDS[*at].field != "reserved");
            let Some(at) = at else {
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            let field = &W::FIELDS[at];
            let bytes = &mut bytemuck::bytes_of_mut(&mut value)[field.offset..][..field.size];
            map.next_value_seed(Field { field, bytes })?;
            found[at] = true;
        }
        for field in told::<W>().filter(|field| !is_added(field)) {
            if !W::FIELDS
                .iter()
                .zip(&found)
                .any(|(f, found)| *found && f.field == field.field)
            {
                return Err(M::Error::missing_field(field.field));
            }
        }
        Ok(Twin(value))
    }
}

/// Whether older recorders did not write a field.
pub fn is_added(field: &FieldLayout) -> bool {
    ADDED.contains(&(field.type_name, field.field))
}

/// Reads a field to its place.
struct Field<'a> {
    field: &'static FieldLayout,
    bytes: &'a mut [u8],
}

impl<'de> DeserializeSeed<'de> for Field<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        // What is not finite is null in JSON.
        let or_nan = |number: Option<f64>| number.unwrap_or(f64::NAN).to_ne_bytes();
        match Kind::of(self.field) {
            Some(Kind::U32) => self
                .bytes
                .copy_from_slice(&u32::deserialize(from)?.to_ne_bytes()),
            Some(Kind::U64) => self
                .bytes
                .copy_from_slice(&u64::deserialize(from)?.to_ne_bytes()),
            Some(Kind::Hash) => {
                let Hex64(hash) = Hex64::deserialize(from)?;
                self.bytes.copy_from_slice(&hash.to_ne_bytes());
            }
            Some(Kind::F64) => self
                .bytes
                .copy_from_slice(&or_nan(Option::deserialize(from)?)),
            Some(Kind::Numbers(count)) => {
                let numbers = self.so_many(count, Vec::<Option<f64>>::deserialize(from)?)?;
                for (to, number) in self.bytes.chunks_exact_mut(8).zip(numbers) {
                    to.copy_from_slice(&or_nan(number));
                }
            }
            Some(Kind::Integers(count)) => {
                let numbers = self.so_many(count, Vec::<u32>::deserialize(from)?)?;
                for (to, number) in self.bytes.chunks_exact_mut(4).zip(numbers) {
                    to.copy_from_slice(&number.to_ne_bytes());
                }
            }
            None => return Err(D::Error::custom(strange(self.field))),
        }
        Ok(())
    }
}

impl Field<'_> {
    /// Numbers of an array, if they are as many as it has.
    fn so_many<T, E: serde::de::Error>(&self, count: usize, numbers: Vec<T>) -> Result<Vec<T>, E> {
        if numbers.len() == count {
            return Ok(numbers);
        }
        let (name, found) = (self.field.field, numbers.len());
        Err(E::custom(format!(
            "expected {count} numbers of {name}, found {found}"
        )))
    }
}

/// The server's status board.
pub type BoardRecord = Twin<wire::Status>;
/// One object of `/objects`.
pub type ObjectRecord = Twin<wire::ObjectState>;
/// Material of a journal entry.
pub type MaterialRecord = Twin<wire::MaterialSpec>;
