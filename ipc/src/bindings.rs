//! The wire types in other languages: a C header and a Python module, written from the layout table and the schema's text.
//!
//! `COSPLAT_UPDATE_DOCS=1 cargo test -p cosplat-ipc --lib bindings` writes them anew.

mod c;
mod python;

use std::{collections::BTreeMap, fs, path::PathBuf};

use crate::schema::layout;

/// What a binding needs to know.
struct Schema {
    types: Vec<Type>,
    constants: Vec<Constant>,
}

struct Type {
    /// Name in Rust, without path.
    name: String,
    /// Name that iceoryx2 compares.
    wire_name: &'static str,
    size: usize,
    align: usize,
    doc: String,
    fields: Vec<Field>,
}

struct Field {
    name: &'static str,
    kind: Kind,
    offset: usize,
    size: usize,
    doc: String,
}

/// What a field is made of.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    /// Primitives of this Rust name; without a length a single one.
    Numbers(&'static str, Option<usize>),
    /// Zero-padded UTF-8 of this many bytes.
    Text(usize),
    /// Another wire type.
    Nested(&'static str),
}

struct Constant {
    name: String,
    /// Whether it counts elements or bytes, and is no `u32` of the wire.
    is_size: bool,
    value: u64,
    doc: String,
}

/// Documentation and constants in the text of the schema, which the compiler does not hand out.
#[derive(Default)]
struct Text {
    /// By type, and by type and field.
    docs: BTreeMap<(String, String), String>,
    constants: Vec<Constant>,
}

impl Text {
    fn read() -> Text {
        let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/src/schema"));
        let mut files: Vec<PathBuf> = fs::read_dir(&folder)
            .expect("the schema")
            .map(|file| file.expect("a file").path())
            .collect();
        files.sort();
        let mut text = Text::default();
        for file in files {
            text.scan(&fs::read_to_string(&file).expect("a module of the schema"));
        }
        text
    }

    fn scan(&mut self, source: &str) {
        let mut doc = Vec::new();
        let mut inside: Option<String> = None;
        for line in source.lines() {
            let code = line.trim();
            if let Some(words) = code.strip_prefix("///") {
                doc.push(words.trim());
                continue;
            }
            if code.starts_with("#[") {
                continue;
            }
            let words = plain(&std::mem::take(&mut doc).join(" "));
            if let Some(name) = between(code, "pub struct ", " {") {
                self.docs.insert((name.into(), String::new()), words);
                inside = Some(name.into());
            } else if let Some(constant) = code.strip_prefix("pub const ") {
                // Lists of names are told in the words of what has their order.
                if !constant.contains(": [") {
                    self.constants.push(constant_of(constant, words));
                }
            } else if let (Some(name), Some(field)) = (&inside, between(code, "pub ", ":")) {
                self.docs.insert((name.clone(), field.into()), words);
            } else if line == "}" {
                inside = None;
            }
        }
    }

    fn doc(&self, name: &str, field: &str) -> String {
        let found = self.docs.get(&(name.into(), field.into()));
        found
            .unwrap_or_else(|| panic!("no documentation of {name} {field}"))
            .clone()
    }
}

fn between<'a>(text: &'a str, start: &str, end: &str) -> Option<&'a str> {
    Some(text.strip_prefix(start)?.split_once(end)?.0)
}

/// `NAME: TYPE = VALUE;`
fn constant_of(text: &str, doc: String) -> Constant {
    let parts = text.trim_end_matches(';').split_once(" = ");
    let (head, value) = parts.unwrap_or_else(|| panic!("no value in {text:?}"));
    let (name, kind) = head.split_once(": ").expect("a type");
    let value = match value {
        "u32::MAX" => u64::from(u32::MAX),
        digits => digits
            .replace('_', "")
            .parse()
            .unwrap_or_else(|_| panic!("{name}: {value:?} is no plain number")),
    };
    Constant {
        name: name.into(),
        is_size: kind == "usize",
        value,
        doc,
    }
}

/// Documentation without Rust's links: the code span in brackets stays.
fn plain(doc: &str) -> String {
    let mut text = String::new();
    let mut rest = doc;
    while let Some((head, tail)) = rest.split_once("[`") {
        let (span, after) = tail.split_once("`]").expect("a whole link");
        text.push_str(&format!("{head}`{span}`"));
        rest = match after.strip_prefix('(') {
            Some(target) => target.split_once(')').expect("a whole target").1,
            None => after,
        };
    }
    text + rest
}

impl Schema {
    fn read() -> Schema {
        let mut text = Text::read();
        let mut types: Vec<Type> = Vec::new();
        for row in layout() {
            let name = row.type_name.rsplit('.').next().expect("a name").to_owned();
            if types.last().is_none_or(|last| last.name != name) {
                types.push(Type {
                    doc: text.doc(&name, ""),
                    name: name.clone(),
                    wire_name: row.type_name,
                    size: row.type_size,
                    align: row.type_align,
                    fields: Vec::new(),
                });
            }
            let doc = text.doc(&name, row.field);
            let kind = kind_of(row.field_type, doc.contains("zero-padded"));
            types.last_mut().expect("a type").fields.push(Field {
                name: row.field,
                kind,
                offset: row.offset,
                size: row.size,
                doc,
            });
        }
        Schema {
            types,
            constants: std::mem::take(&mut text.constants),
        }
    }
}

fn kind_of(rust: &'static str, is_text: bool) -> Kind {
    match between(rust, "[", "]") {
        Some(array) => {
            let (element, length) = array.split_once("; ").expect("an array");
            let length = length.parse().expect("a length");
            match is_text {
                true => Kind::Text(length),
                false => Kind::Numbers(element, Some(length)),
            }
        }
        None if rust.starts_with(char::is_uppercase) => Kind::Nested(rust),
        None => Kind::Numbers(rust, None),
    }
}

/// `FrameHeader` as `frame_header`.
fn snake(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.push(letter.to_ascii_lowercase());
    }
    text
}

/// Compares a committed file with what it should be.
fn check(path: &str, expected: &str) {
    let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(path);
    if std::env::var_os("COSPLAT_UPDATE_DOCS").is_some() {
        fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
        fs::write(&file, expected).expect("written");
        return;
    }
    let text = fs::read_to_string(&file).unwrap_or_default();
    assert!(
        text == expected,
        "{path} is not that of the wire types: COSPLAT_UPDATE_DOCS=1 cargo test -p cosplat-ipc --lib bindings"
    );
}

#[test]
fn the_c_header_has_the_layout_of_the_code() {
    check("clients/c/cosplat.h", &c::header(&Schema::read()));
}

#[test]
fn the_python_module_has_the_layout_of_the_code() {
    check(
        "clients/python/src/cosplat/wire.py",
        &python::module(&Schema::read()),
    );
}

#[test]
fn the_schema_is_read_with_its_words() {
    let schema = Schema::read();
    let header = schema.types.iter().find(|t| t.name == "FrameHeader");
    let field = &header.expect("a type").fields[6];
    assert_eq!(
        (field.name, &field.kind),
        ("count", &Kind::Numbers("u32", None))
    );
    assert_eq!(field.doc, "Gaussians in this frame.");
    let version = schema.constants.iter().find(|c| c.name == "WIRE_VERSION");
    assert_eq!(
        version.map(|c| c.value),
        Some(crate::schema::WIRE_VERSION.into())
    );
    assert_eq!(
        plain("a [`B`](super::B) and [`C`] [m]"),
        "a `B` and `C` [m]"
    );
    assert_eq!(kind_of("[u8; 24]", true), Kind::Text(24));
    assert_eq!(snake("ObjectState"), "object_state");
}
