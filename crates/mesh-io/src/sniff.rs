//! Tells a format from its bytes.

use crate::cursor::{Lines, Tokens, number};
use crate::{Format, glb};

/// The format that `bytes` begin like, if any.
///
/// PLY, GLB, Draco, native frames and bundles have signatures. glTF text is a JSON object with an `asset`,
/// which the format asks for. OBJ is recognized by its first vertex record, with nothing but
/// comments and other OBJ records before it.
#[must_use]
pub fn sniff(bytes: &[u8]) -> Option<Format> {
    if bytes.starts_with(b"glTF") {
        return Some(Format::Glb);
    }
    if bytes.starts_with(b"DRACO") {
        return Some(Format::Drc);
    }
    if bytes.starts_with(b"SMF1") {
        return Some(Format::Native);
    }
    if bytes.starts_with(b"SMB1") {
        return Some(Format::Bundle);
    }
    if bytes.starts_with(b"ply") && bytes.get(3).is_some_and(u8::is_ascii_whitespace) {
        return Some(Format::Ply);
    }
    let start = &bytes[..bytes.len().min(WINDOW)];
    if glb::has_top_level_key(start, b"asset") {
        return Some(Format::Glb);
    }
    begins_like_obj(start).then_some(Format::Obj)
}

/// How far to look for the first vertex; exporters write license texts before it.
const WINDOW: usize = 1 << 18;

/// Every keyword of the OBJ specification that can precede a vertex, and what
/// exporters add to it.
const OBJ_KEYWORDS: [&[u8]; 23] = [
    b"v",
    b"vt",
    b"vn",
    b"vp",
    b"f",
    b"l",
    b"p",
    b"o",
    b"g",
    b"s",
    b"mg",
    b"usemtl",
    b"mtllib",
    b"usemap",
    b"maplib",
    b"lod",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"shadow_obj",
    b"trace_obj",
    b"call",
    b"cstype",
];

fn begins_like_obj(text: &[u8]) -> bool {
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    for (_, line) in Lines::new(text, 1) {
        let mut tokens = Tokens::new(line);
        let Some(keyword) = tokens.next() else {
            continue;
        };
        if keyword.starts_with(b"#") {
            continue;
        }
        if keyword == b"v" {
            let coordinates = tokens.take_while(|token| number(token).is_some()).count();
            return coordinates >= 3;
        }
        if !OBJ_KEYWORDS.contains(&keyword) {
            return false;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signatures_are_recognized() {
        assert_eq!(sniff(b"ply\nformat ascii 1.0\n"), Some(Format::Ply));
        assert_eq!(sniff(b"ply\r\nformat"), Some(Format::Ply));
        assert_eq!(sniff(b"glTF\x02\0\0\0"), Some(Format::Glb));
        assert_eq!(sniff(b"DRACO\x02\x02"), Some(Format::Drc));
        assert_eq!(sniff(b"ply\rformat"), Some(Format::Ply));
    }

    #[test]
    fn gltf_text_is_recognized_by_its_asset() {
        for text in [
            "{\"asset\": {\"version\": \"2.0\"}}",
            "\u{feff}\n{\"accessors\": [], \"asset\" : {",
        ] {
            assert_eq!(sniff(text.as_bytes()), Some(Format::Glb), "{text}");
        }
    }

    #[test]
    fn obj_is_recognized_by_its_first_vertex() {
        for text in [
            "v 0 0 0\n",
            "# made by hand\r\n\r\nmtllib a.mtl\r\no thing\r\nv 1.5 -2e3 .5 1 0 0\r\n",
            "\u{feff}# bom\nv 0 0 0",
            "vn 0 0 1\nvt 0 0\ng\nv\t1 2 3",
            "# old\r# Mac\rv 1 2 3\r",
        ] {
            assert_eq!(sniff(text.as_bytes()), Some(Format::Obj), "{text}");
        }
    }

    #[test]
    fn other_text_and_noise_are_not_a_mesh() {
        for bytes in [
            &b""[..],
            b"hello world",
            b"{\"assets\": {\"asset\": \"2.0\"}}",
            b"<!doctype html><html></html>",
            b"# only a comment\n",
            b"v for vendetta\n",
            b"v 1 2\n",
            b"f 1 2 3\n",
            b"plywood is no mesh",
            b"solid cube\n facet normal 0 0 1\n",
            b"OFF\n8 6 12\n0 0 0\n",
            b"x,y,z\n1,2,3\n",
            b"\x00\x01\x02\xff\xfe",
        ] {
            assert_eq!(sniff(bytes), None, "{}", String::from_utf8_lossy(bytes));
        }
    }
}
