//! Buffers inside the text: `data:` URIs.
//!
//! Source: RFC 2397, "The 'data' URL scheme", 1998, with the base64 of RFC 4648.

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use std::borrow::Cow;

/// Takes what exporters leave out or fill in wrongly at the end.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// What follows `data:`, if `uri` begins with it in any case.
pub(super) fn payload(uri: &[u8]) -> Option<&[u8]> {
    let (scheme, payload) = uri.split_at_checked(5)?;
    scheme.eq_ignore_ascii_case(b"data:").then_some(payload)
}

/// Decodes what [`payload`] gave; never more bytes than it has itself.
///
/// # Errors
///
/// What is wrong, as the end of a sentence that begins with the URI.
pub(super) fn decode(payload: &[u8]) -> Result<Vec<u8>, String> {
    let comma = payload.iter().position(|&byte| byte == b',');
    let comma = comma.ok_or("has no comma between its type and its data")?;
    let (media_type, data) = (&payload[..comma], &payload[comma + 1..]);
    let last_parameter = media_type.rsplit(|&byte| byte == b';').next();
    let is_base64 = media_type.contains(&b';')
        && last_parameter.is_some_and(|name| name.trim_ascii().eq_ignore_ascii_case(b"base64"));
    let data = without_percents(data)?;
    if !is_base64 {
        return Ok(data.into_owned());
    }
    BASE64
        .decode(&data)
        .map_err(|error| format!("is not base64: {}", what_is_wrong(&error)))
}

fn what_is_wrong(error: &base64::DecodeError) -> String {
    use base64::DecodeError;
    match error {
        DecodeError::InvalidByte(at, byte) => {
            format!("byte {at} of its data is `{}`", byte.escape_ascii())
        }
        DecodeError::InvalidLength(length) => format!("its data ends early, after {length} bytes"),
        other => other.to_string(),
    }
}

/// Replaces `%41` by `A`.
fn without_percents(data: &[u8]) -> Result<Cow<'_, [u8]>, String> {
    let Some(first) = data.iter().position(|&byte| byte == b'%') else {
        return Ok(Cow::Borrowed(data));
    };
    let mut decoded = Vec::with_capacity(data.len());
    decoded.extend_from_slice(&data[..first]);
    let mut rest = &data[first..];
    while let Some((&byte, after)) = rest.split_first() {
        if byte != b'%' {
            decoded.push(byte);
            rest = after;
            continue;
        }
        let digits = after.split_first_chunk::<2>();
        let value = digits.and_then(|([high, low], after)| {
            let digit = |byte: u8| char::from(byte).to_digit(16);
            Some((digit(*high)? * 16 + digit(*low)?, after))
        });
        let Some((value, after)) = value else {
            let at = data.len() - rest.len();
            return Err(format!(
                "is not percent-encoded: no two hexadecimal digits follow the % at byte {at} of \
                 its data"
            ));
        };
        // Two hexadecimal digits are a byte.
        decoded.push(value as u8);
        rest = after;
    }
    Ok(Cow::Owned(decoded))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(uri: &str) -> Result<Vec<u8>, String> {
        decode(payload(uri.as_bytes()).unwrap())
    }

    #[test]
    fn both_encodings_are_read_in_all_their_spellings() {
        for uri in [
            "data:application/octet-stream;base64,/wBB+g==",
            "data:application/gltf-buffer;base64,/wBB+g",
            "DATA:;BASE64,/wBB%2bg%3D%3D",
            "data:a/b;charset=x;base64,/wBB%2Bh==",
            "data:,%FF%00A%fa",
            "data:application/octet-stream,%FF%00%41%FA",
        ] {
            assert_eq!(decoded(uri), Ok(vec![0xff, 0, b'A', 0xfa]), "{uri}");
        }
        assert_eq!(decoded("data:base64,AAAA"), Ok(b"AAAA".to_vec()));
        assert_eq!(decoded("data:,"), Ok(Vec::new()));
        assert_eq!(payload(b"mesh.bin"), None);
        assert_eq!(payload(b"dat"), None);
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (uri, expected) in [
            ("data:;base64", "has no comma between its type and its data"),
            (
                "data:;base64,AA*A",
                "is not base64: byte 2 of its data is `*`",
            ),
            (
                "data:,a%4",
                "is not percent-encoded: no two hexadecimal digits follow the % at byte 1 of its \
                 data",
            ),
            (
                "data:;base64,AAAAA",
                "is not base64: its data ends early, after 5 bytes",
            ),
        ] {
            assert_eq!(decoded(uri).unwrap_err(), expected, "{uri}");
        }
    }
}
