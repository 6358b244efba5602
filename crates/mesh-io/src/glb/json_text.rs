//! What can be told of JSON text before it is parsed.

/// True if `text` is a JSON object that has `key` at its top level, as far as it goes: text that
/// was cut off later counts.
pub(crate) fn has_top_level_key(text: &[u8], key: &[u8]) -> bool {
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    let text = text.trim_ascii_start();
    if !text.starts_with(b"{") {
        return false;
    }
    let (mut depth, mut at) = (0_usize, 0);
    while let Some(&byte) = text.get(at) {
        match byte {
            b'{' | b'[' => depth += 1,
            b'}' | b']' => depth = depth.saturating_sub(1),
            b'"' => {
                let Some(string) = string_after(&text[at + 1..]) else {
                    return false;
                };
                at += string.len() + 1;
                let after = text[at + 1..].trim_ascii_start();
                if depth == 1 && string == key && after.starts_with(b":") {
                    return true;
                }
            }
            _ => {}
        }
        at += 1;
    }
    false
}

/// How many bytes there are beside the strings that are `data:` URIs.
pub(super) fn length_without_data_uris(text: &[u8]) -> usize {
    let (mut length, mut rest) = (0, text);
    while let Some(quote) = rest.iter().position(|&byte| byte == b'"') {
        length += quote + 1;
        rest = &rest[quote + 1..];
        let Some(string) = string_after(rest) else {
            break;
        };
        rest = &rest[string.len() + 1..];
        let is_data_uri = super::data_uri::payload(string).is_some();
        length += 1 + if is_data_uri { 0 } else { string.len() };
    }
    length + rest.len()
}

/// The string that begins after a quotation mark, up to the next one that is not escaped.
fn string_after(text: &[u8]) -> Option<&[u8]> {
    let mut at = 0;
    loop {
        at += text[at..]
            .iter()
            .position(|byte| matches!(byte, b'"' | b'\\'))?;
        if text[at] == b'"' {
            return Some(&text[..at]);
        }
        // Whatever is escaped ends no string.
        at += 2;
        if text.len() < at {
            return None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_found_at_the_top_level_only() {
        for (text, expected) in [
            (&br#"{"asset":{}}"#[..], true),
            (
                b"\xef\xbb\xbf \r\n{ \"buffers\" : [{}], \"asset\" : {",
                true,
            ),
            (br#"{"a\"sset\\":1,"asset":2"#, true),
            (br#"{"extras":{"asset":1}}"#, false),
            (br#"{"name":"asset"}"#, false),
            (br#"["asset"]"#, false),
            (br#"{"asset"#, false),
            (b"{\"\\", false),
            (br#"{"ASSET":1}"#, false),
            (b"", false),
        ] {
            let shown = String::from_utf8_lossy(text);
            assert_eq!(has_top_level_key(text, b"asset"), expected, "{shown}");
        }
    }

    #[test]
    fn data_uris_do_not_count() {
        for (text, expected) in [
            (&br#"{"uri":"data:,abc"}"#[..], 10),
            (br#"{"uri":"DATA:;base64,AAAA","a":1}"#, 16),
            (br#"{"uri":"mesh.bin"}"#, 18),
            (br#"{"a":"data"}"#, 12),
            (br#"{"uri":"data:,cut"#, 17),
            (b"{}", 2),
        ] {
            let shown = String::from_utf8_lossy(text);
            assert_eq!(length_without_data_uris(text), expected, "{shown}");
        }
    }
}
