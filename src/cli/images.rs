//! The image beside a frame file: an OBJ file's material names it, or a PLY file's comment.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Once;

use anyhow::{Context, bail};
use steadymesh_mesh_io::{Format, ImageInfo};

/// The image that a frame file names; none if it names none, or several, or one that cannot be used:
/// the frame goes on without, and its user is told once.
pub(super) fn beside(path: &Path, format: Format, bytes: &[u8]) -> Option<Vec<u8>> {
    static SAID: Once = Once::new();
    find(path, format, bytes).unwrap_or_else(|error| {
        SAID.call_once(|| super::say(&format!("without an image: {error:#}")));
        None
    })
}

fn find(path: &Path, format: Format, bytes: &[u8]) -> anyhow::Result<Option<Vec<u8>>> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let named = match format {
        Format::Obj => of_materials(folder, bytes),
        Format::Ply => of_comments(folder, bytes),
        _ => return Ok(None),
    };
    if 1 < named.len() {
        bail!("{} names several: one is supported", path.display());
    }
    let Some(image) = named.into_iter().next() else {
        return Ok(None);
    };
    let name = image.display();
    let bytes = std::fs::read(&image)
        .with_context(|| format!("{name}, which {} names, cannot be read", path.display()))?;
    ImageInfo::read(&bytes).with_context(|| name.to_string())?;
    Ok(Some(bytes))
}

/// The diffuse images of the material files that an OBJ file names and that are there.
fn of_materials(folder: &Path, obj: &[u8]) -> BTreeSet<PathBuf> {
    let mut images = BTreeSet::new();
    for library in values(obj, "mtllib") {
        let library = folder.join(&library);
        let Ok(text) = std::fs::read(&library) else {
            // Exporters name files that they do not write.
            continue;
        };
        let folder = library.parent().unwrap_or(folder);
        let maps = values(&text, "map_Kd");
        images.extend(maps.iter().map(|map| folder.join(without_options(map))));
    }
    images
}

/// What MeshLab writes into the header.
fn of_comments(folder: &Path, ply: &[u8]) -> BTreeSet<PathBuf> {
    let end = ply.windows(10).position(|window| window == b"end_header");
    let header = &ply[..end.unwrap_or(0)];
    let named = values(header, "comment TextureFile");
    named.iter().map(|name| folder.join(name)).collect()
}

/// What follows `keyword` at the beginning of a line.
fn values(text: &[u8], keyword: &str) -> Vec<String> {
    let mut found = Vec::new();
    for line in text.split(|byte| matches!(byte, b'\n' | b'\r')) {
        let value = line.trim_ascii_start().strip_prefix(keyword.as_bytes());
        let value = value.filter(|value| value.first().is_some_and(u8::is_ascii_whitespace));
        let value = value.map(|value| String::from_utf8_lossy(value.trim_ascii()).into_owned());
        found.extend(value.filter(|value| !value.is_empty()));
    }
    found
}

/// The file name of a map statement, which may have spaces, without the options before it.
///
/// Source: "MTL material format (Lightwave, OBJ)", Alias/Wavefront 1995, "Texture map statements".
fn without_options(map: &str) -> &str {
    let mut rest = map;
    while let Some(option) = rest
        .split_whitespace()
        .next()
        .filter(|o| o.starts_with('-'))
    {
        // Three of them may have fewer numbers than this.
        let most = match option {
            "-s" | "-o" | "-t" => 3,
            "-mm" => 2,
            _ => 1,
        };
        rest = rest[option.len()..].trim_start();
        for count in 0..most {
            let Some(value) = rest.split_whitespace().next() else {
                break;
            };
            if 0 < count && value.parse::<f64>().is_err() {
                break;
            }
            rest = rest[value.len()..].trim_start();
        }
    }
    rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_stand_before_the_file_name() {
        for (map, name) in [
            ("a.png", "a.png"),
            ("my atlas 01.png", "my atlas 01.png"),
            ("-s 1 1 1 -clamp on a b.png", "a b.png"),
            ("-o 0.5 a.png", "a.png"),
            ("-bm 1 -mm 0 1 a.png", "a.png"),
        ] {
            assert_eq!(without_options(map), name, "{map}");
        }
    }

    #[test]
    fn an_image_is_found_by_the_material_and_by_the_comment() {
        let folder = tempfile::tempdir().unwrap();
        let png = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x08\0\0\0\x04";
        let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes);
        write("a b.png", png).unwrap();
        write("a.mtl", b"newmtl one\r\n  map_Kd a b.png\r\n").unwrap();
        write(
            "two.mtl",
            b"newmtl x\nmap_Kd a b.png\nnewmtl y\nmap_Kd c.png",
        )
        .unwrap();
        write("lost.mtl", b"map_Kd lost.png").unwrap();
        write("text.mtl", b"map_Kd a.mtl").unwrap();
        let beside =
            |format, text: &str| find(&folder.path().join("frame"), format, text.as_bytes());
        for (format, text) in [
            (Format::Obj, "# x\nmtllib a.mtl\nv 0 0 0\n"),
            (
                Format::Ply,
                "ply\ncomment TextureFile a b.png\nend_header\n",
            ),
        ] {
            assert_eq!(beside(format, text).unwrap().unwrap(), png, "{text}");
        }
        for text in ["v 0 0 0\n", "mtllib missing.mtl\n"] {
            assert!(beside(Format::Obj, text).unwrap().is_none(), "{text}");
        }
        for (text, wrong) in [
            ("mtllib lost.mtl\n", "cannot be read"),
            ("mtllib two.mtl\n", "names several"),
            ("mtllib text.mtl\n", "begins like none"),
        ] {
            let error = format!("{:#}", beside(Format::Obj, text).unwrap_err());
            assert!(error.contains(wrong), "{error}");
        }
    }
}
