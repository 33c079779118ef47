//! The C header.

use std::fmt::Write;

use super::{Field, Kind, Schema, Type, snake};
use crate::schema::schema_hash;

const HEAD: &str = "\
/* Wire types of cosplat for C11 and C++11; docs/wire-format.md says what they mean.
 *
 * Written from the Rust types by `COSPLAT_UPDATE_DOCS=1 cargo test -p cosplat-ipc --lib bindings`; a test keeps it equal
 * to them. SPDX-License-Identifier: MIT OR Apache-2.0 */

#ifndef COSPLAT_H
#define COSPLAT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define COSPLAT_ASSERT static_assert
#define COSPLAT_ALIGNOF alignof
#define COSPLAT_ALIGNAS alignas
#else
#define COSPLAT_ASSERT _Static_assert
#define COSPLAT_ALIGNOF _Alignof
#define COSPLAT_ALIGNAS _Alignas
#endif

";

/// The whole header.
pub(super) fn header(schema: &Schema) -> String {
    let mut text = String::from(HEAD);
    writeln!(
        text,
        "/** Hash of the layout of all types: a server with another one in its hello must not be read. */"
    )
    .expect("text");
    writeln!(
        text,
        "#define COSPLAT_SCHEMA_HASH UINT64_C(0x{:016x})",
        schema_hash()
    )
    .expect("text");
    for constant in &schema.constants {
        let value = match constant.is_size {
            true => format!("((size_t){})", constant.value),
            false => format!("UINT32_C({})", constant.value),
        };
        let (name, doc) = (&constant.name, &constant.doc);
        writeln!(text, "/** {doc} */\n#define COSPLAT_{name} {value}").expect("text");
    }
    schema.types.iter().for_each(|t| structure(&mut text, t));
    text.push_str("\n#endif\n");
    text
}

fn structure(text: &mut String, wire: &Type) {
    let name = format!("cosplat_{}", snake(&wire.name));
    writeln!(text, "\n/** {} */\nstruct {name} {{", wire.doc).expect("text");
    for (index, field) in wire.fields.iter().enumerate() {
        // The alignment of primitives is that of the type, but for types that fill cache lines.
        let align = match (index, wire.align) {
            (0, 16..) => format!("COSPLAT_ALIGNAS({}) ", wire.align),
            _ => String::new(),
        };
        writeln!(
            text,
            "    /** {} */\n    {align}{};",
            field.doc,
            member(field)
        )
        .expect("text");
    }
    text.push_str("};\n");
    writeln!(
        text,
        "#define {}_TYPE_NAME \"{}\"",
        name.to_uppercase(),
        wire.wire_name
    )
    .expect("text");
    let mut assert = |what: String| {
        writeln!(text, "COSPLAT_ASSERT({what}, \"{name}\");").expect("text");
    };
    assert(format!("sizeof(struct {name}) == {}", wire.size));
    assert(format!("COSPLAT_ALIGNOF(struct {name}) == {}", wire.align));
    for field in &wire.fields {
        assert(format!(
            "offsetof(struct {name}, {}) == {}",
            field.name, field.offset
        ));
    }
    let size: usize = wire.fields.iter().map(|field| field.size).sum();
    assert_eq!(size, wire.size, "{name} has padding");
}

fn member(field: &Field) -> String {
    let name = field.name;
    match &field.kind {
        Kind::Numbers(kind, None) => format!("{} {name}", primitive(kind)),
        Kind::Numbers(kind, Some(length)) => format!("{} {name}[{length}]", primitive(kind)),
        Kind::Text(length) => format!("char {name}[{length}]"),
        Kind::Nested(kind) => format!("struct cosplat_{} {name}", snake(kind)),
    }
}

fn primitive(rust: &str) -> &'static str {
    match rust {
        "u8" => "uint8_t",
        "u32" => "uint32_t",
        "u64" => "uint64_t",
        "f32" => "float",
        "f64" => "double",
        other => panic!("{other} has no C type here"),
    }
}
