//! PLY headers: elements, their properties, and where each row's values are.

use super::AssetError;

/// Longest header read [bytes]; real ones are below 4 kB, with 768 semantic features 20 kB.
const MAX_HEADER: usize = 1 << 17;

/// How values are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Scalar types of PLY.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one value.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// One property; lists have no fixed place in a row.
#[derive(Clone, Debug)]
pub struct Property {
    pub name: String,
    pub scalar: Scalar,
    /// How a list counts its values.
    pub list: Option<Scalar>,
    /// Byte offset in a binary row.
    pub offset: usize,
}

/// One element: a table.
#[derive(Clone, Debug)]
pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
    /// Bytes of a binary row, lists aside.
    pub row: usize,
}

impl Element {
    /// Index of the property of that name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }

    /// Makes the layout that of rows of little-endian numbers, all of them `f32` but for those declared as doubles; lists stay marked.
    pub fn store_as_floats(&mut self) {
        self.row = 0;
        for property in &mut self.properties {
            property.offset = self.row;
            if property.scalar != Scalar::F64 {
                property.scalar = Scalar::F32;
            }
            self.row += property.scalar.size();
        }
    }

    /// Number of properties `prefix0`, `prefix1`, ... without a gap; `Err` holds the number that exist.
    pub fn family(&self, prefix: &str) -> Result<usize, usize> {
        let members = self
            .properties
            .iter()
            .filter_map(|p| p.name.strip_prefix(prefix)?.parse::<usize>().ok())
            .collect::<Vec<_>>();
        match members.iter().max() {
            Some(last) if last.checked_add(1) != Some(members.len()) => Err(members.len()),
            _ => Ok(members.len()),
        }
    }
}

/// A parsed header.
#[derive(Clone, Debug)]
pub struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// Bytes up to and including the line end of `end_header`.
    pub len: usize,
}

impl Header {
    /// Parses the header at the start of `bytes`.
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Self, AssetError> {
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut at = 0;
        let mut line = 0;
        loop {
            line += 1;
            let bad = |expected: &'static str, actual: &str| AssetError::Header {
                file: file.into(),
                line,
                expected,
                actual: actual.chars().take(80).collect(),
            };
            let rest = &bytes[at..bytes.len().min(MAX_HEADER)];
            let Some(end) = rest.iter().position(|b| *b == b'\n') else {
                return Err(bad(
                    "a line `end_header`",
                    "the end of the file or no line end",
                ));
            };
            at += end + 1;
            let Ok(text) = std::str::from_utf8(&rest[..end]) else {
                return Err(bad("text", "bytes that are not UTF-8"));
            };
            let text = text.trim_end();
            let words = text.split_ascii_whitespace().collect::<Vec<_>>();
            match words.as_slice() {
                ["ply"] if line == 1 => {}
                _ if line == 1 => return Err(bad("`ply`", text)),
                [] | ["comment" | "obj_info", ..] => {}
                ["format", kind, "1.0"] if encoding.is_none() => {
                    encoding = Some(match *kind {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(bad("ascii or binary_*_endian", kind)),
                    });
                }
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| bad("a count of rows", count))?;
                    elements.push(Element {
                        name: (*name).into(),
                        count,
                        properties: Vec::new(),
                        row: 0,
                    });
                }
                ["property", declaration @ ..] => {
                    let Some(element) = elements.last_mut() else {
                        return Err(bad("an element before its properties", text));
                    };
                    let property = parse_property(declaration, element.row)
                        .ok_or_else(|| bad("`property TYPE NAME`", text))?;
                    if element.find(&property.name).is_some() {
                        return Err(bad("a property name not used before", text));
                    }
                    if property.list.is_none() {
                        element.row += property.scalar.size();
                    }
                    element.properties.push(property);
                }
                ["end_header"] => {
                    let encoding = encoding.ok_or_else(|| bad("a `format` line", "none"))?;
                    return Ok(Self {
                        encoding,
                        elements,
                        len: at,
                    });
                }
                _ => {
                    return Err(bad(
                        "format, element, property, comment or end_header",
                        text,
                    ));
                }
            }
        }
    }
}

fn parse_property(words: &[&str], offset: usize) -> Option<Property> {
    let (scalar, name, list) = match words {
        ["list", count, item, name] => (item, name, Some(Scalar::parse(count)?)),
        [scalar, name] => (scalar, name, None),
        _ => return None,
    };
    Some(Property {
        name: (*name).into(),
        scalar: Scalar::parse(scalar)?,
        list,
        offset,
    })
}
