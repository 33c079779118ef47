//! Every number of a checkpoint is one: a walk through all that would be written, field by field.

use std::fmt::Display;

use serde::{Serialize, Serializer, ser};

use super::{CheckpointError, inconsistent};

/// Largest number in double precision: its square is one as well.
const MAX_DOUBLE: f64 = 1e30;
/// Largest number in single precision: so is its cube, the order of a determinant.
const MAX_SINGLE: f64 = 1e12;
/// Fields that are infinite where nothing is known yet.
const OPEN_ENDED: &[&str] = &["drift", "deadline", "min_j"];
/// Types that hold something else in lanes without a particle, which nobody reads.
const UNREAD: &str = "Shape";

/// Refuses what is not a number, or beyond all that a world can hold.
pub(super) fn check_numbers(all: &impl Serialize) -> Result<(), CheckpointError> {
    let walked = all.serialize(&mut Walk { field: "state" });
    walked.map_err(|NoNumber(reason)| inconsistent(reason))
}

/// Where a walk is.
struct Walk {
    /// The innermost field that has a name.
    field: &'static str,
}

impl Walk {
    fn number(&self, value: f64, max: f64) -> Result<(), NoNumber> {
        let field = self.field;
        let is_open = value == f64::INFINITY && OPEN_ENDED.contains(&field);
        if value.abs() <= max || is_open {
            return Ok(());
        }
        Err(NoNumber(format!(
            "a number of `{field}` is {value}, expected at most {max:e} in magnitude"
        )))
    }
}

/// Why a walk ended.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct NoNumber(String);

impl ser::Error for NoNumber {
    fn custom<T: Display>(message: T) -> Self {
        Self(message.to_string())
    }
}

/// Values without a floating-point number in them.
macro_rules! passed_over {
    ($($name:ident: $type:ty,)*) => {
        $(fn $name(self, _: $type) -> Result<(), NoNumber> {
            Ok(())
        })*
    };
}

impl Serializer for &mut Walk {
    type Ok = ();
    type Error = NoNumber;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Self;
    type SerializeMap = Self;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    passed_over! {
        serialize_bool: bool,
        serialize_i8: i8,
        serialize_i16: i16,
        serialize_i32: i32,
        serialize_i64: i64,
        serialize_u8: u8,
        serialize_u16: u16,
        serialize_u32: u32,
        serialize_u64: u64,
        serialize_char: char,
        serialize_str: &str,
        serialize_bytes: &[u8],
        serialize_unit_struct: &'static str,
    }

    fn serialize_f32(self, value: f32) -> Result<(), NoNumber> {
        self.number(value.into(), MAX_SINGLE)
    }

    fn serialize_f64(self, value: f64) -> Result<(), NoNumber> {
        self.number(value, MAX_DOUBLE)
    }

    fn serialize_none(self) -> Result<(), NoNumber> {
        Ok(())
    }

    fn serialize_some<T: ?Sized + Serialize>(self, value: &T) -> Result<(), NoNumber> {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<(), NoNumber> {
        Ok(())
    }

    fn serialize_unit_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
    ) -> Result<(), NoNumber> {
        Ok(())
    }

    fn serialize_newtype_struct<T: ?Sized + Serialize>(
        self,
        name: &'static str,
        value: &T,
    ) -> Result<(), NoNumber> {
        match name == UNREAD {
            true => Ok(()),
            false => value.serialize(self),
        }
    }

    fn serialize_newtype_variant<T: ?Sized + Serialize>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        value: &T,
    ) -> Result<(), NoNumber> {
        value.serialize(self)
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Self, NoNumber> {
        Ok(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Self, NoNumber> {
        Ok(self)
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Self, NoNumber> {
        Ok(self)
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self, NoNumber> {
        Ok(self)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self, NoNumber> {
        Ok(self)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self, NoNumber> {
        Ok(self)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self, NoNumber> {
        Ok(self)
    }
}

/// Parts that follow each other without a name.
macro_rules! walked {
    ($($trait:ident, $function:ident;)*) => {
        $(impl ser::$trait for &mut Walk {
            type Ok = ();
            type Error = NoNumber;

            fn $function<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), NoNumber> {
                value.serialize(&mut **self)
            }

            fn end(self) -> Result<(), NoNumber> {
                Ok(())
            }
        })*
    };
}

walked! {
    SerializeSeq, serialize_element;
    SerializeTuple, serialize_element;
    SerializeTupleStruct, serialize_field;
    SerializeTupleVariant, serialize_field;
}

impl ser::SerializeMap for &mut Walk {
    type Ok = ();
    type Error = NoNumber;

    fn serialize_key<T: ?Sized + Serialize>(&mut self, key: &T) -> Result<(), NoNumber> {
        key.serialize(&mut **self)
    }

    fn serialize_value<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), NoNumber> {
        value.serialize(&mut **self)
    }

    fn end(self) -> Result<(), NoNumber> {
        Ok(())
    }
}

/// Fields, of which each has a name.
macro_rules! named {
    ($($trait:ident,)*) => {
        $(impl ser::$trait for &mut Walk {
            type Ok = ();
            type Error = NoNumber;

            fn serialize_field<T: ?Sized + Serialize>(
                &mut self,
                key: &'static str,
                value: &T,
            ) -> Result<(), NoNumber> {
                let outer = std::mem::replace(&mut self.field, key);
                value.serialize(&mut **self)?;
                self.field = outer;
                Ok(())
            }

            fn end(self) -> Result<(), NoNumber> {
                Ok(())
            }
        })*
    };
}

named! {
    SerializeStruct,
    SerializeStructVariant,
}
