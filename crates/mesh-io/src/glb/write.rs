//! A mesh to a plain GLB file.

use super::{container, texture};
use crate::{ImageFormat, Mesh};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

const U8: u32 = 5121;
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes a GLB file with one mesh: 32-bit float positions, and indices of 16 bits
/// where they fit, else 32.
///
/// Faces of each material are a primitive. An image is put on it if the mesh has texture coordinates; its bytes are passed beside it, since
/// the mesh may only say where they are.
///
/// An attribute with corner indices of its own repeats positions; see
/// [`Mesh::with_attributes_per_vertex`].
#[must_use]
pub fn write(mesh: &Mesh, image: Option<(ImageFormat, &[u8])>) -> Vec<u8> {
    let mesh = mesh.with_attributes_per_vertex();
    let count = mesh.positions.len();
    let mut writer = Writer::default();
    let positions: Vec<[f32; 3]> = mesh
        .positions
        .iter()
        .map(|p| p.map(|value| value as f32))
        .collect();
    let (min, max) = bounds(&positions);
    writer.attribute(
        "POSITION",
        &little_endian(&positions),
        json!({
            "componentType": F32, "count": count, "type": "VEC3", "min": min, "max": max,
        }),
    );
    if let Some(normals) = mesh.normals.as_ref().filter(|a| a.values.len() == count) {
        let normals: Vec<_> = normals.values.iter().map(|&n| unit(n)).collect();
        writer.attribute(
            "NORMAL",
            &little_endian(&normals),
            json!({
                "componentType": F32, "count": count, "type": "VEC3",
            }),
        );
    }
    if let Some(colors) = mesh.colors.as_ref().filter(|a| a.values.len() == count) {
        writer.attribute(
            "COLOR_0",
            colors.values.as_flattened(),
            json!({
                "componentType": U8, "normalized": true, "count": count, "type": "VEC4",
            }),
        );
    }
    if let Some(uv) = mesh
        .texture_coordinates
        .as_ref()
        .filter(|a| a.values.len() == count)
    {
        // Downwards, as glTF has it.
        let values: Vec<_> = uv.values.iter().map(|&[u, v]| [u, 1.0 - v]).collect();
        writer.attribute(
            "TEXCOORD_0",
            &little_endian(&values),
            json!({
                "componentType": F32, "count": count, "type": "VEC2",
            }),
        );
    }
    let has_coordinates = writer.attributes.contains_key("TEXCOORD_0");
    let faces = faces_by_material(&mesh);
    writer.finish(&faces, count, image.filter(|_| has_coordinates))
}

/// The faces of each material; all of them if there are no materials.
fn faces_by_material(mesh: &Mesh) -> Vec<Vec<[u32; 3]>> {
    let mut groups: BTreeMap<Option<u16>, Vec<[u32; 3]>> = BTreeMap::new();
    for (index, face) in mesh.faces.iter().enumerate() {
        groups
            .entry(mesh.material_of(index))
            .or_default()
            .push(*face);
    }
    groups.into_values().collect()
}

/// Smallest and largest coordinates; zero for no positions.
pub(super) fn bounds(positions: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let Some(&first) = positions.first() else {
        return ([0.0; 3], [0.0; 3]);
    };
    positions.iter().fold((first, first), |(min, max), p| {
        (
            [0, 1, 2].map(|i| min[i].min(p[i])),
            [0, 1, 2].map(|i| max[i].max(p[i])),
        )
    })
}

#[derive(Default)]
struct Writer {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    attributes: Map<String, Value>,
}

impl Writer {
    fn attribute(&mut self, name: &str, bytes: &[u8], accessor: Value) {
        let index = self.accessor(bytes, accessor, ARRAY_BUFFER);
        self.attributes.insert(name.to_owned(), index.into());
    }

    /// Adds a buffer view and an accessor for all of it; returns the accessor's index.
    fn accessor(&mut self, bytes: &[u8], mut accessor: Value, target: u32) -> usize {
        let view = self.view(bytes);
        self.views[view]["target"] = target.into();
        accessor["bufferView"] = view.into();
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds a buffer view; returns its index.
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len(),
        }));
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    /// Adds an accessor of indices below the vertex count.
    fn indices(&mut self, faces: &[[u32; 3]], vertex_count: usize) -> usize {
        // 65535 is reserved for restarting strips.
        let is_short = vertex_count < usize::from(u16::MAX);
        let indices = faces.as_flattened().iter();
        let bytes: Vec<u8> = if is_short {
            // Lossless: every index is below the vertex count.
            indices
                .flat_map(|&index| (index as u16).to_le_bytes())
                .collect()
        } else {
            indices.flat_map(|index| index.to_le_bytes()).collect()
        };
        let component = if is_short { U16 } else { U32 };
        let accessor = json!({
            "componentType": component, "count": 3 * faces.len(), "type": "SCALAR",
        });
        self.accessor(&bytes, accessor, ELEMENT_ARRAY_BUFFER)
    }

    fn finish(
        mut self,
        groups: &[Vec<[u32; 3]>],
        vertex_count: usize,
        image: Option<(ImageFormat, &[u8])>,
    ) -> Vec<u8> {
        let attributes = Value::Object(std::mem::take(&mut self.attributes));
        let mut primitives = Vec::new();
        for faces in groups {
            let indices = self.indices(faces, vertex_count);
            primitives.push(json!({ "attributes": attributes, "indices": indices }));
        }
        let view = image.map(|(format, bytes)| (format, self.view(bytes)));
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "steadymesh" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": primitives }],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.bin.len() }],
        });
        if let Some((format, view)) = view {
            texture::put_on(&mut document, format, view, false);
        }
        texture::tell_apart(&mut document);
        container::join(document.to_string().as_bytes(), &self.bin)
    }
}

fn little_endian<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
    values
        .as_flattened()
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

/// glTF asks for unit normals; one that has no direction becomes the z axis.
fn unit(normal: [f32; 3]) -> [f32; 3] {
    let wide = normal.map(f64::from);
    let length = wide.iter().map(|value| value * value).sum::<f64>().sqrt();
    if length.is_normal() {
        wide.map(|value| (value / length) as f32)
    } else {
        [0.0, 0.0, 1.0]
    }
}
