//! The header: encoding, elements and their properties.

use super::malformed;
use crate::ReadError;
use crate::cursor::{Lines, Tokens, shown};
use steadymesh_proto::wording::counted;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
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
    fn parse(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The largest value of an unsigned color channel of this type.
    pub(super) fn channel_max(self) -> f64 {
        match self {
            Self::U16 => f64::from(u16::MAX),
            Self::F32 | Self::F64 => 1.0,
            // Programs that declare `int` or `char` still count to 255.
            _ => 255.0,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The first property with one of these names.
    pub(super) fn find(&self, names: &[&str]) -> Option<usize> {
        self.properties
            .iter()
            .position(|property| names.contains(&property.name.as_str()))
    }

    /// How many records there are to be, for messages.
    pub(super) fn counted(&self) -> String {
        match self.name.as_str() {
            known @ ("vertex" | "face") => counted(self.count, known),
            other => counted(self.count, &format!("`{other}` record")),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header<'a> {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    pub(super) body: &'a [u8],
    /// The number of the body's first line.
    pub(super) body_line: usize,
}

pub(super) fn parse(bytes: &[u8]) -> Result<Header<'_>, ReadError> {
    if !bytes.starts_with(b"ply") || !bytes.get(3).is_some_and(u8::is_ascii_whitespace) {
        return Err(malformed(
            "not a PLY file: it does not begin with a line that says \"ply\"",
        ));
    }
    let mut encoding = None;
    let mut elements = Vec::new();
    let mut lines = Lines::new(bytes, 1);
    while let Some((number, line)) = lines.next() {
        let mut tokens = Tokens::new(line);
        match tokens.next() {
            None | Some(b"ply" | b"comment" | b"obj_info") => {}
            Some(b"format") => encoding = Some(parse_encoding(tokens, number)?),
            Some(b"element") => elements.push(parse_element(tokens, number)?),
            Some(b"property") => parse_property(tokens, number, elements.last_mut())?,
            Some(b"end_header") => {
                let encoding = encoding.ok_or_else(|| {
                    malformed("the header has no `format` line, so the encoding is unknown")
                })?;
                return Ok(Header {
                    encoding,
                    elements,
                    body: body(bytes, lines.rest(), encoding),
                    body_line: number + 1,
                });
            }
            Some(keyword) => {
                return Err(malformed(format!(
                    "line {number}: the header keyword {} is unknown",
                    shown(keyword)
                )));
            }
        }
    }
    Err(malformed("the header has no `end_header` line"))
}

/// The body of a file, `rest` being what follows the last line of its header.
///
/// Where lines end with `\r` alone, a binary body may begin with the byte of a `\n`, which
/// then is no part of the header's last line.
fn body<'a>(bytes: &'a [u8], rest: &'a [u8], encoding: Encoding) -> &'a [u8] {
    let ending = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
    let ends_with_cr = ending.is_some_and(|at| {
        let ending = &bytes[at..];
        ending.starts_with(b"\r") && !ending.starts_with(b"\r\n")
    });
    let start = bytes.len() - rest.len();
    if encoding != Encoding::Ascii && ends_with_cr && bytes[..start].ends_with(b"\r\n") {
        return &bytes[start - 1..];
    }
    rest
}

fn parse_encoding(mut tokens: Tokens<'_>, line: usize) -> Result<Encoding, ReadError> {
    match tokens.next() {
        Some(b"ascii") => Ok(Encoding::Ascii),
        Some(b"binary_little_endian") => Ok(Encoding::LittleEndian),
        Some(b"binary_big_endian") => Ok(Encoding::BigEndian),
        other => Err(malformed(format!(
            "line {line}: the format {} is unknown; expected ascii, binary_little_endian or \
             binary_big_endian",
            shown(other.unwrap_or_default())
        ))),
    }
}

fn parse_element(mut tokens: Tokens<'_>, line: usize) -> Result<Element, ReadError> {
    let (name, count) = (tokens.next(), tokens.next());
    let count = count.and_then(|text| std::str::from_utf8(text).ok()?.parse().ok());
    match (name, count) {
        (Some(name), Some(count)) => Ok(Element {
            name: lowercase(name),
            count,
            properties: Vec::new(),
        }),
        _ => Err(malformed(format!(
            "line {line}: expected `element NAME COUNT` with a count that is not negative"
        ))),
    }
}

fn parse_property(
    mut tokens: Tokens<'_>,
    line: usize,
    element: Option<&mut Element>,
) -> Result<(), ReadError> {
    let element =
        element.ok_or_else(|| malformed(format!("line {line}: a property before any element")))?;
    let scalar = |token: Option<&[u8]>| {
        let name = token.unwrap_or_default();
        Scalar::parse(name)
            .ok_or_else(|| malformed(format!("line {line}: the type {} is unknown", shown(name))))
    };
    let kind_of = |first: Option<&[u8]>, tokens: &mut Tokens<'_>| match first {
        Some(b"list") => {
            let (count, item) = (scalar(tokens.next())?, scalar(tokens.next())?);
            if !count.is_integer() {
                return Err(malformed(format!(
                    "line {line}: a list's count must be an integer"
                )));
            }
            Ok(Kind::List { count, item })
        }
        first => Ok(Kind::Scalar(scalar(first)?)),
    };
    let first = tokens.next();
    let kind = kind_of(first, &mut tokens)?;
    let name = tokens
        .next()
        .ok_or_else(|| malformed(format!("line {line}: a property has no name")))?;
    element.properties.push(Property {
        name: lowercase(name),
        kind,
    });
    Ok(())
}

fn lowercase(name: &[u8]) -> String {
    String::from_utf8_lossy(name).to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_body_begins_after_each_of_the_three_line_endings() {
        for (text, body) in [
            (
                "ply\nformat binary_little_endian 1.0\nend_header\n\nx",
                &b"\nx"[..],
            ),
            (
                "ply\r\nformat ascii 1.0\r\nobj_info a b\r\nend_header\r\n7",
                b"7",
            ),
            ("ply\rformat ascii 1.0\rend_header\r7\r", b"7\r"),
            ("ply\rformat binary_big_endian 1.0\rend_header\r\nx", b"\nx"),
            ("ply\nformat ascii 1.0\nend_header", b""),
        ] {
            assert_eq!(parse(text.as_bytes()).unwrap().body, body);
        }
    }

    #[test]
    fn elements_and_properties_are_read_in_order() {
        let text = "ply\nformat ascii 1.0\ncomment hi\nelement vertex 3\nproperty float x\n\
                    element face 1\nproperty list uint8 int32 Vertex_Indices\nend_header\n";
        let header = parse(text.as_bytes()).unwrap();
        assert_eq!(header.elements[0].count, 3);
        assert_eq!(
            header.elements[0].properties[0].kind,
            Kind::Scalar(Scalar::F32)
        );
        assert_eq!(header.elements[1].find(&["vertex_indices"]), Some(0));
        assert_eq!(header.body_line, 9);
    }

    #[test]
    fn mistakes_are_named() {
        for (text, message) in [
            ("obj\n", "does not begin"),
            ("ply\nformat ascii 1.0\n", "end_header"),
            ("ply\nend_header\n", "no `format` line"),
            ("ply\nformat utf8 1.0\n", "line 2: the format `utf8`"),
            (
                "ply\nelement vertex -3\n",
                "line 2: expected `element NAME COUNT`",
            ),
            ("ply\nproperty float x\n", "before any element"),
            (
                "ply\nelement a 1\nproperty quad x\n",
                "line 3: the type `quad`",
            ),
            (
                "ply\nelement a 1\nproperty list float int x\n",
                "must be an integer",
            ),
            ("ply\nhello\n", "line 2: the header keyword `hello`"),
        ] {
            let error = parse(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
