//! The Python module.

use std::fmt::Write;

use super::{Field, Kind, Schema, Type};
use crate::schema::schema_hash;

const HEAD: &str = r#""""Wire types of cosplat; `docs/wire-format.md` says what they mean.

Written from the Rust types by `COSPLAT_UPDATE_DOCS=1 cargo test -p cosplat-ipc --lib bindings`; a test keeps it equal to
them. `X.dtype` is the layout of X in shared memory, for arrays; an X is one of them, read.
"""

# ruff: noqa: E501
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


def _dtype(size: int, **fields: tuple[Any, int]) -> np.dtype[np.void]:
    return np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": size,
        }
    )


class Record:
    """A wire type, read."""

    __slots__ = ()

    type_name: ClassVar[str]
    """Name that iceoryx2 compares."""
    alignment: ClassVar[int]
    """Alignment in shared memory [byte]."""
    dtype: ClassVar[np.dtype[np.void]]
    """Layout, without reserved fields."""
    nested: ClassVar[dict[str, type[Record]]] = {}
    """Fields that are wire types themselves."""

    @classmethod
    def read(cls, element: np.void) -> Self:
        """An element of an array of `dtype`, copied."""
        element = element.copy()
        values = list(element.item())
        for name, kind in cls.nested.items():
            values[(cls.dtype.names or ()).index(name)] = kind.read(element[name])
        return cls(*values)


"#;

/// The whole module.
pub(super) fn module(schema: &Schema) -> String {
    let mut text = String::from(HEAD);
    writeln!(
        text,
        "SCHEMA_HASH = 0x{:016x}\n\"\"\"Hash of the layout of all types: a server with another one in its hello is not read.\"\"\"",
        schema_hash()
    )
    .expect("text");
    for constant in &schema.constants {
        let (name, value, doc) = (&constant.name, constant.value, &constant.doc);
        writeln!(text, "{name} = {value}\n\"\"\"{doc}\"\"\"").expect("text");
    }
    schema.types.iter().for_each(|t| class(&mut text, t));
    text
}

fn class(text: &mut String, wire: &Type) {
    let fields = || wire.fields.iter().filter(|field| field.name != "reserved");
    let head = format!(
        "\n\n@dataclass(slots=True)\nclass {}(Record):\n    \"\"\"{}\"\"\"\n\n    type_name = \"{}\"\n    alignment = {}\n    dtype = _dtype(\n        {},\n",
        wire.name, wire.doc, wire.wire_name, wire.align, wire.size
    );
    text.push_str(&head);
    for field in fields() {
        let format = format_of(&field.kind);
        writeln!(text, "        {}=({format}, {}),", field.name, field.offset).expect("text");
    }
    text.push_str("    )\n");
    let nested: Vec<String> = fields()
        .filter_map(|field| match field.kind {
            Kind::Nested(kind) => Some(format!("\"{}\": {kind}", field.name)),
            _ => None,
        })
        .collect();
    if !nested.is_empty() {
        writeln!(text, "    nested = {{{}}}", nested.join(", ")).expect("text");
    }
    text.push('\n');
    for field in fields() {
        let annotation = annotation(field);
        writeln!(
            text,
            "    {}: {annotation}\n    \"\"\"{}\"\"\"",
            field.name, field.doc
        )
        .expect("text");
    }
}

fn format_of(kind: &Kind) -> String {
    let number = |rust: &str| match rust {
        "u8" => "\"u1\"",
        "u32" => "\"<u4\"",
        "u64" => "\"<u8\"",
        "f32" => "\"<f4\"",
        "f64" => "\"<f8\"",
        other => panic!("{other} has no numpy type here"),
    };
    match kind {
        Kind::Numbers(kind, None) => number(kind).into(),
        Kind::Numbers(kind, Some(length)) => format!("({}, ({length},))", number(kind)),
        Kind::Text(length) => format!("\"S{length}\""),
        Kind::Nested(kind) => format!("{kind}.dtype"),
    }
}

fn annotation(field: &Field) -> String {
    match &field.kind {
        Kind::Numbers("f32" | "f64", None) => "float".into(),
        Kind::Numbers(_, None) => "int".into(),
        Kind::Numbers(kind, Some(_)) => {
            let element = match *kind {
                "u8" => "uint8",
                "u32" => "uint32",
                "u64" => "uint64",
                "f32" => "float32",
                _ => "float64",
            };
            format!("NDArray[np.{element}]")
        }
        Kind::Text(_) => "bytes".into(),
        Kind::Nested(kind) => (*kind).into(),
    }
}
