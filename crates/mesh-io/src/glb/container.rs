//! The container: a header, a JSON chunk and a binary chunk; or the JSON alone.

use super::{json_text, malformed};
use crate::ReadError;

const JSON: &[u8; 4] = b"JSON";
const BIN: &[u8; 4] = b"BIN\0";

/// What the JSON of geometry never needs beside its `data:` URIs; a parsed document is larger
/// than its text.
const MAX_JSON_BYTES: usize = 4 << 20;

#[derive(Debug, PartialEq, Eq)]
pub(super) struct Container<'a> {
    pub(super) json: &'a [u8],
    pub(super) bin: Option<&'a [u8]>,
}

/// Splits a container; text is JSON without a binary chunk.
pub(super) fn split(bytes: &[u8]) -> Result<Container<'_>, ReadError> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let container = if text.trim_ascii_start().starts_with(b"{") {
        Container {
            json: text,
            bin: None,
        }
    } else {
        chunks(bytes)?
    };
    let length = json_text::length_without_data_uris(container.json);
    if length > MAX_JSON_BYTES {
        return Err(malformed(format!(
            "the JSON has {length} bytes beside its data: URIs; at most {MAX_JSON_BYTES} are \
             accepted"
        )));
    }
    Ok(container)
}

fn chunks(bytes: &[u8]) -> Result<Container<'_>, ReadError> {
    let (magic, rest) = take(bytes, 4).unwrap_or((bytes, &[]));
    if magic != b"glTF" {
        return Err(malformed(
            "not a glTF file: it begins neither with \"glTF\", as .glb files do, nor with \"{\", \
             as .gltf files do",
        ));
    }
    let header = number(rest).zip(rest.get(4..).and_then(number));
    let Some((version, length)) = header else {
        return Err(malformed("the file ends inside its 12-byte header"));
    };
    if version != 2 {
        return Err(malformed(format!(
            "the container version is {version}, but only 2 (glTF 2.0) is supported"
        )));
    }
    let Some(body) = bytes.get(..length).and_then(|whole| whole.get(12..)) else {
        return Err(malformed(format!(
            "the header says {length} bytes, but the file has {}",
            bytes.len()
        )));
    };
    let Chunk {
        kind,
        data: json,
        after,
    } = chunk(body)?;
    if kind != JSON {
        return Err(malformed("the first chunk is not JSON"));
    }
    Ok(Container {
        json,
        bin: find_bin(after)?,
    })
}

/// The first binary chunk; chunks of unknown types are skipped.
fn find_bin(mut rest: &[u8]) -> Result<Option<&[u8]>, ReadError> {
    while !rest.is_empty() {
        let Chunk { kind, data, after } = chunk(rest)?;
        if kind == BIN {
            return Ok(Some(data));
        }
        rest = after;
    }
    Ok(None)
}

struct Chunk<'a> {
    kind: &'a [u8],
    data: &'a [u8],
    /// What follows the chunk.
    after: &'a [u8],
}

fn chunk(bytes: &[u8]) -> Result<Chunk<'_>, ReadError> {
    let split = || {
        let length = number(bytes)?;
        let (kind, rest) = take(bytes.get(4..)?, 4)?;
        Some((length, kind, rest))
    };
    let (length, kind, rest) =
        split().ok_or_else(|| malformed("the file ends inside the header of a chunk"))?;
    let (data, after) = take(rest, length).ok_or_else(|| {
        malformed(format!(
            "a chunk promises {length} bytes, but {} are left",
            rest.len()
        ))
    })?;
    Ok(Chunk { kind, data, after })
}

fn take(bytes: &[u8], count: usize) -> Option<(&[u8], &[u8])> {
    bytes.split_at_checked(count)
}

/// The little-endian number at the start.
fn number(bytes: &[u8]) -> Option<usize> {
    let (first, _) = bytes.split_first_chunk::<4>()?;
    usize::try_from(u32::from_le_bytes(*first)).ok()
}

/// Joins a JSON and a binary chunk; both are padded to multiples of four bytes.
pub(super) fn join(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let (json_length, bin_length) = (
        json.len().next_multiple_of(4),
        bin.len().next_multiple_of(4),
    );
    let length = 12 + 8 + json_length + 8 + bin_length;
    let mut bytes = Vec::with_capacity(length);
    let push_number = |bytes: &mut Vec<u8>, value: usize| {
        // The format ends at 4 GiB, far beyond any frame.
        bytes.extend(u32::try_from(value).unwrap_or(u32::MAX).to_le_bytes());
    };
    bytes.extend(b"glTF");
    push_number(&mut bytes, 2);
    push_number(&mut bytes, length);
    for (kind, data, padding, padded) in
        [(JSON, json, b' ', json_length), (BIN, bin, 0, bin_length)]
    {
        push_number(&mut bytes, padded);
        bytes.extend(kind);
        bytes.extend(data);
        bytes.resize(bytes.len() + padded - data.len(), padding);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_joined_is_split_again() {
        let bytes = join(b"{}", b"abcde");
        let expected = Container {
            json: b"{}  ",
            bin: Some(b"abcde\0\0\0"),
        };
        assert_eq!(split(&bytes), Ok(expected));
    }

    #[test]
    fn every_cut_is_refused_and_none_panics() {
        let bytes = join(b"{}", b"abcde");
        for length in 0..bytes.len() {
            assert!(split(&bytes[..length]).is_err());
        }
    }

    #[test]
    fn version_1_and_foreign_bytes_are_named() {
        let mut bytes = join(b"{}", b"");
        bytes[4] = 1;
        assert!(
            split(&bytes)
                .unwrap_err()
                .to_string()
                .contains("version is 1")
        );
        assert!(
            split(b"hello")
                .unwrap_err()
                .to_string()
                .contains("not a glTF file")
        );
    }

    #[test]
    fn text_is_json_without_a_binary_chunk() {
        let expected = Container {
            json: b"\n{}",
            bin: None,
        };
        assert_eq!(split(b"\xef\xbb\xbf\n{}"), Ok(expected));
    }

    #[test]
    fn long_json_is_refused_but_long_data_is_not() {
        let long = "A".repeat(MAX_JSON_BYTES);
        let data = format!("{{\"uri\":\"data:;base64,{long}\"}}");
        assert!(split(data.as_bytes()).is_ok());
        assert!(split(&join(data.as_bytes(), b"")).is_ok());
        let text = data.replace("data:", "file:");
        for bytes in [text.as_bytes(), &join(text.as_bytes(), b"")] {
            let error = split(bytes).unwrap_err().to_string();
            assert!(error.contains("at most 4194304 are accepted"), "{error}");
        }
    }
}
