//! A mesh to binary PLY.

use crate::Mesh;

/// Writes a binary little-endian PLY file with 32-bit floats and 32-bit indices.
///
/// An attribute with corner indices of its own repeats positions; see
/// [`Mesh::with_attributes_per_vertex`].
#[must_use]
pub fn write(mesh: &Mesh) -> Vec<u8> {
    let mesh = mesh.with_attributes_per_vertex();
    let vertices = mesh.positions.len();
    let normals = mesh.normals.as_ref().filter(|a| a.values.len() == vertices);
    let colors = mesh.colors.as_ref().filter(|a| a.values.len() == vertices);
    let coordinates = mesh
        .texture_coordinates
        .as_ref()
        .filter(|a| a.values.len() == vertices);

    let mut bytes = header(
        &mesh,
        normals.is_some(),
        colors.is_some(),
        coordinates.is_some(),
    );
    bytes.reserve(vertices * 36 + mesh.faces.len() * 13);
    for (index, position) in mesh.positions.iter().enumerate() {
        push(&mut bytes, &position.map(|value| value as f32));
        if let Some(normals) = normals {
            push(&mut bytes, &normals.values[index]);
        }
        if let Some(colors) = colors {
            bytes.extend(colors.values[index]);
        }
        if let Some(coordinates) = coordinates {
            push(&mut bytes, &coordinates.values[index]);
        }
    }
    for face in &mesh.faces {
        bytes.push(3);
        bytes.extend_from_slice(face.map(u32::to_le_bytes).as_flattened());
    }
    bytes
}

fn header(mesh: &Mesh, normals: bool, colors: bool, coordinates: bool) -> Vec<u8> {
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n",
        mesh.positions.len()
    );
    if normals {
        text += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    if colors {
        text += "property uchar red\nproperty uchar green\nproperty uchar blue\n\
                 property uchar alpha\n";
    }
    if coordinates {
        text += "property float s\nproperty float t\n";
    }
    text += &format!(
        "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.faces.len()
    );
    text.into_bytes()
}

fn push(bytes: &mut Vec<u8>, values: &[f32]) {
    for value in values {
        bytes.extend(value.to_le_bytes());
    }
}
