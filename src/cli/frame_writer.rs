//! Simplified frames as files of every format, with their images.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::Context;
use clap::ValueEnum;
use steadymesh_mesh_io::{ImageFormat, Limits, Mesh, drc, glb, obj, ply};

use super::output_files::write_file;

/// The formats that simplified frames can be written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum OutputFormat {
    /// Draco.
    Drc,
    /// glTF 2.0 in its binary container, not compressed, with the image inside.
    Glb,
    /// PLY, binary.
    Ply,
    /// Wavefront OBJ, with a material file if there is an image.
    Obj,
}

impl OutputFormat {
    /// The file extension, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Drc => "drc",
            Self::Glb => "glb",
            Self::Ply => "ply",
            Self::Obj => "obj",
        }
    }
}

/// Writes a frame as `stem` with the extension of its format, and its image beside it, unless it is
/// in the same file.
///
/// # Errors
///
/// A file that cannot be written, or a mesh that is none.
pub(super) fn write_frame(
    folder: &Path,
    stem: &str,
    format: OutputFormat,
    (draco, image): (&[u8], Option<(ImageFormat, &[u8])>),
) -> anyhow::Result<()> {
    let path = folder.join(format!("{stem}.{}", format.extension()));
    let mesh = || drc::read(draco, &Limits::NONE).context("the mesh cannot be read");
    let image_name = image.map(|(format, _)| format!("{stem}.{}", format.extension()));
    match format {
        OutputFormat::Drc => write_file(&path, draco)?,
        OutputFormat::Glb => return write_file(&path, &glb::write(&mesh()?, image)),
        OutputFormat::Ply => write_file(&path, &with_comment(&mesh()?, image_name.as_deref()))?,
        OutputFormat::Obj => {
            let (mesh, mut text) = (mesh()?, Vec::new());
            if let Some(image_name) = &image_name {
                let materials = materials_of(&mesh);
                text.extend(format!("mtllib {stem}.mtl\nusemtl {}\n", materials[0]).as_bytes());
                let look = format!("Kd 1 1 1\nillum 0\nmap_Kd {image_name}\n");
                let library = materials
                    .iter()
                    .map(|name| format!("newmtl {name}\n{look}"));
                let library: String = library.collect();
                write_file(&folder.join(format!("{stem}.mtl")), library.as_bytes())?;
            }
            text.extend(obj::write(&mesh));
            write_file(&path, &text)?;
        }
    }
    match (image_name, image) {
        (Some(name), Some((_, bytes))) => write_file(&folder.join(name), bytes),
        _ => Ok(()),
    }
}

/// The names of the materials that a mesh's faces have in an OBJ file, at least one.
fn materials_of(mesh: &Mesh) -> Vec<String> {
    let numbers = (0..mesh.faces.len()).filter_map(|face| mesh.material_of(face));
    let numbers: BTreeSet<u16> = numbers.collect();
    if numbers.is_empty() {
        return vec!["frame".to_owned()];
    }
    let name = |number| format!("material{number}");
    numbers.into_iter().map(name).collect()
}

/// A PLY file that names its image, as MeshLab's do.
fn with_comment(mesh: &Mesh, image: Option<&str>) -> Vec<u8> {
    let mut bytes = ply::write(mesh);
    let first_lines = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n');
    // After "ply" and "format".
    let at = first_lines.map(|(at, _)| at + 1).nth(1);
    if let (Some(image), Some(at)) = (image, at) {
        let comment = format!("comment TextureFile {image}\n").into_bytes();
        bytes.splice(at..at, comment);
    }
    bytes
}
