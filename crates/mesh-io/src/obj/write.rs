//! A mesh to OBJ text.

use crate::{Attribute, Mesh};
use std::fmt::Write;

/// Writes an OBJ file.
///
/// Numbers are the shortest decimals that read back as the same values. Colors
/// become three fractions after each position; alpha is left out, for OBJ has no
/// place for it. Faces of one material come together, under the names `material0`, `material1` and
/// so on.
#[must_use]
pub fn write(mesh: &Mesh) -> Vec<u8> {
    let has_own_color_faces = mesh.colors.as_ref().is_some_and(|c| c.faces.is_some());
    let split = has_own_color_faces.then(|| mesh.with_attributes_per_vertex());
    let mesh = split.as_deref().unwrap_or(mesh);
    let mut text = String::with_capacity(mesh.positions.len() * 40 + mesh.faces.len() * 24);
    // Writing to a `String` cannot fail.
    let _ = write_all(&mut text, mesh);
    text.into_bytes()
}

fn write_all(text: &mut String, mesh: &Mesh) -> std::fmt::Result {
    let colors = mesh
        .colors
        .as_ref()
        .filter(|c| c.values.len() == mesh.positions.len());
    for (index, [x, y, z]) in mesh.positions.iter().enumerate() {
        write!(text, "v {x} {y} {z}")?;
        if let Some(colors) = colors {
            let [red, green, blue, _] = colors.values[index].map(|c| f32::from(c) / 255.0);
            write!(text, " {red} {green} {blue}")?;
        }
        text.push('\n');
    }
    for [u, v] in mesh.texture_coordinates.iter().flat_map(|a| &a.values) {
        writeln!(text, "vt {u} {v}")?;
    }
    for [x, y, z] in mesh.normals.iter().flat_map(|a| &a.values) {
        writeln!(text, "vn {x} {y} {z}")?;
    }
    let mut material = None;
    for index in by_material(mesh) {
        let (face, own) = (mesh.faces[index], mesh.material_of(index));
        if let Some(number) = own.filter(|_| own != material) {
            writeln!(text, "usemtl material{number}")?;
        }
        material = own;
        let coordinates = corners(mesh.texture_coordinates.as_ref(), mesh, index);
        let normals = corners(mesh.normals.as_ref(), mesh, index);
        text.push('f');
        for corner in 0..3 {
            write!(text, " {}", one(face[corner]))?;
            match (coordinates, normals) {
                (Some(c), Some(n)) => write!(text, "/{}/{}", one(c[corner]), one(n[corner]))?,
                (Some(c), None) => write!(text, "/{}", one(c[corner]))?,
                (None, Some(n)) => write!(text, "//{}", one(n[corner]))?,
                (None, None) => {}
            }
        }
        text.push('\n');
    }
    Ok(())
}

/// The faces, those of each material together.
fn by_material(mesh: &Mesh) -> Vec<usize> {
    let mut faces: Vec<usize> = (0..mesh.faces.len()).collect();
    if mesh.materials.is_some() {
        faces.sort_by_key(|&face| mesh.material_of(face));
    }
    faces
}

fn one(index: u32) -> u64 {
    u64::from(index) + 1
}

fn corners<T>(attribute: Option<&Attribute<T>>, mesh: &Mesh, face: usize) -> Option<[u32; 3]> {
    let attribute = attribute?;
    match &attribute.faces {
        None => Some(mesh.faces[face]),
        Some(faces) => faces.get(face).copied(),
    }
}
