//! Frame files: which ones, in which order, and what is in them.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use steadymesh_geometry::TriangleMesh;
use steadymesh_mesh_io::{Format, Image, Limits, Mesh, read, sniff};

use crate::pipeline::{Attributes, RawFrame};
use crate::textures::SourceImage;

use super::images;

/// Files are the user's own: the limits are those of 32-bit indices and of a workstation.
const LIMITS: Limits = Limits {
    max_vertices: u32::MAX as usize,
    max_faces: u32::MAX as usize,
    max_memory_bytes: 4 << 30,
};

/// The frame files that `paths` name: files as they are, folders by their frame files in
/// natural order (`frame2` before `frame10`).
///
/// # Errors
///
/// A path that does not exist, or a folder without frame files.
pub(super) fn expand(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        let metadata = std::fs::metadata(path)
            .with_context(|| format!("{} cannot be read", path.display()))?;
        if !metadata.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path)
            .with_context(|| format!("the folder {} cannot be read", path.display()))?;
        let mut inside = Vec::new();
        for entry in entries {
            let entry =
                entry.with_context(|| format!("the folder {} cannot be read", path.display()))?;
            let file = entry.path();
            if file.is_file() && format_by_name(&file).is_some() {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            bail!(
                "the folder {} has no .obj, .ply, .glb, .gltf, .drc, .smf or .smb files",
                path.display()
            );
        }
        inside.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
        files.extend(inside);
    }
    Ok(files)
}

/// Reads one frame's geometry, without what it looks like.
///
/// # Errors
///
/// What is wrong with the file, and where.
pub(super) fn read_geometry(path: &Path) -> anyhow::Result<RawFrame> {
    let (_, bytes, mesh) = read_mesh(path)?;
    Ok(RawFrame {
        attributes: Attributes::default(),
        ..RawFrame::from_mesh(mesh, bytes.len())
    })
}

/// Reads one frame and the image on it: in the same file, or beside it.
///
/// # Errors
///
/// What is wrong with the file or the image, and where.
pub(super) fn read_textured(path: &Path) -> anyhow::Result<(RawFrame, Option<SourceImage>)> {
    let (format, bytes, mut mesh) = read_mesh(path)?;
    if mesh.image.is_none()
        && let Some(image) = images::beside(path, format, &bytes)
    {
        mesh.image = Some(Image::new(image)?);
    }
    let image = mesh.image.as_ref();
    let image = image.map(|image| SourceImage::new(image, &bytes));
    Ok((RawFrame::from_mesh(mesh, bytes.len()), image))
}

fn read_mesh(path: &Path) -> anyhow::Result<(Format, Vec<u8>, Mesh)> {
    let bytes =
        std::fs::read(path).with_context(|| format!("{} cannot be read", path.display()))?;
    if bytes.is_empty() {
        bail!("{} is empty", path.display());
    }
    let format = format_of(path, &bytes)?;
    let mesh = read(&bytes, format, &LIMITS).with_context(|| path.display().to_string())?;
    Ok((format, bytes, mesh))
}

/// A mesh as the writers take it.
pub(super) fn to_file_mesh(mesh: &TriangleMesh) -> Mesh {
    Mesh {
        positions: mesh.positions().iter().map(|p| p.coords.into()).collect(),
        faces: mesh.faces().to_vec(),
        normals: None,
        colors: None,
        texture_coordinates: None,
        materials: None,
        image: None,
    }
}

/// The format that a file's name says it has, or else its content.
///
/// # Errors
///
/// It has none.
pub(super) fn format_of(path: &Path, bytes: &[u8]) -> anyhow::Result<Format> {
    let format = format_by_name(path).or_else(|| sniff(bytes));
    format.with_context(|| {
        format!(
            "{}: neither its name nor its content is OBJ, PLY, glTF, Draco, a native frame or a bundle",
            path.display()
        )
    })
}

fn format_by_name(path: &Path) -> Option<Format> {
    Format::from_extension(path.extension()?.to_str()?)
}

/// Compares runs of digits by their value and the rest byte by byte.
fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a.as_bytes(), b.as_bytes());
    loop {
        let (digits_a, digits_b) = (leading_digits(a), leading_digits(b));
        if 0 < digits_a && 0 < digits_b {
            let (number_a, rest_a) = a.split_at(digits_a);
            let (number_b, rest_b) = b.split_at(digits_b);
            let (value_a, value_b) = (without_zeros(number_a), without_zeros(number_b));
            let order = value_a.len().cmp(&value_b.len()).then(value_a.cmp(value_b));
            if order.is_ne() {
                return order;
            }
            (a, b) = (rest_a, rest_b);
            continue;
        }
        match (a.split_first(), b.split_first()) {
            (Some((x, rest_a)), Some((y, rest_b))) if x == y => (a, b) = (rest_a, rest_b),
            _ => return a.cmp(b),
        }
    }
}

fn leading_digits(text: &[u8]) -> usize {
    text.iter().take_while(|byte| byte.is_ascii_digit()).count()
}

fn without_zeros(number: &[u8]) -> &[u8] {
    let zeros = number.iter().take_while(|&&digit| digit == b'0').count();
    &number[zeros..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_ordered_by_their_numbers() {
        let mut names = ["f10.obj", "f2.obj", "f1.obj", "f002.obj", "f1a.obj"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(
            names,
            ["f1.obj", "f1a.obj", "f2.obj", "f002.obj", "f10.obj"]
        );
    }
}
