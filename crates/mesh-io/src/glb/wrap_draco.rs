//! A Draco file inside a GLB file.

use super::write::bounds;
use super::{container, texture};
use crate::{ImageFormat, Limits, ReadError, drc};
use serde_json::{Map, Value, json};
use steadymesh_draco::decode_and_identify;

/// What glTF says about a Draco mesh outside of its bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DracoInfo {
    /// Draco unique id of the positions.
    pub position_id: u32,
    /// Draco unique id of 32-bit float normals.
    pub normal_id: Option<u32>,
    /// Draco unique id of 8-bit RGBA colors.
    pub color_id: Option<u32>,
    /// Draco unique id of 32-bit float texture coordinates.
    pub texture_coordinate_id: Option<u32>,
    /// Vertices that a decoder returns (Draco's points).
    pub vertex_count: usize,
    /// Faces that a decoder returns.
    pub face_count: usize,
    /// Smallest coordinate on each axis.
    pub min: [f32; 3],
    /// Largest coordinate on each axis.
    pub max: [f32; 3],
}

impl DracoInfo {
    /// Describes a Draco file after decoding it.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if it cannot be decoded.
    pub fn read(bytes: &[u8], limits: &Limits) -> Result<Self, ReadError> {
        let limits = drc::decode_limits(limits);
        let (mesh, ids) = decode_and_identify(bytes, &limits)?;
        let (min, max) = bounds(&mesh.positions);
        Ok(Self {
            position_id: ids.position,
            normal_id: ids.normal,
            color_id: ids.color,
            texture_coordinate_id: ids.texture_coordinate,
            vertex_count: mesh.positions.len(),
            face_count: mesh.faces.len(),
            min,
            max,
        })
    }
}

/// Wraps a Draco file, and the image on it if it has one, into a GLB file with
/// `KHR_draco_mesh_compression`, without decoding or copying more than their bytes.
///
/// Texture coordinates with v upwards, as they are in the Draco file, are turned over by
/// `KHR_texture_transform`. An image without texture coordinates is left out.
#[must_use]
pub fn wrap_draco(drc: &[u8], info: &DracoInfo, image: Option<(ImageFormat, &[u8])>) -> Vec<u8> {
    let count = info.vertex_count;
    let described = [
        (
            "POSITION",
            Some(info.position_id),
            json!({
                "componentType": 5126, "count": count, "type": "VEC3",
                "min": info.min, "max": info.max,
            }),
        ),
        (
            "NORMAL",
            info.normal_id,
            json!({
                "componentType": 5126, "count": count, "type": "VEC3",
            }),
        ),
        (
            "COLOR_0",
            info.color_id,
            json!({
                "componentType": 5121, "normalized": true, "count": count, "type": "VEC4",
            }),
        ),
        (
            "TEXCOORD_0",
            info.texture_coordinate_id,
            json!({
                "componentType": 5126, "count": count, "type": "VEC2",
            }),
        ),
    ];
    let mut accessors = vec![json!({
        "componentType": 5125, "count": 3 * info.face_count, "type": "SCALAR",
    })];
    let (mut attributes, mut ids) = (Map::new(), Map::new());
    for (name, id, accessor) in described {
        if let Some(id) = id {
            attributes.insert(name.to_owned(), accessors.len().into());
            ids.insert(name.to_owned(), id.into());
            accessors.push(accessor);
        }
    }
    let mut document = document(drc.len(), &accessors, &attributes, &ids);
    let image = image.filter(|_| info.texture_coordinate_id.is_some());
    let Some((format, image)) = image else {
        return container::join(document.to_string().as_bytes(), drc);
    };
    let mut bin = drc.to_vec();
    bin.resize(drc.len().next_multiple_of(4), 0);
    let view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": image.len() });
    bin.extend_from_slice(image);
    if let Some(views) = document["bufferViews"].as_array_mut() {
        views.push(view);
    }
    document["buffers"][0]["byteLength"] = bin.len().into();
    texture::put_on(&mut document, format, 1, true);
    container::join(document.to_string().as_bytes(), &bin)
}

fn document(
    byte_length: usize,
    accessors: &[Value],
    attributes: &Map<String, Value>,
    ids: &Map<String, Value>,
) -> Value {
    const EXTENSION: &str = "KHR_draco_mesh_compression";
    json!({
        "asset": { "version": "2.0", "generator": "steadymesh" },
        "extensionsUsed": [EXTENSION],
        "extensionsRequired": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{
            "primitives": [{
                "attributes": attributes,
                "indices": 0,
                "extensions": { EXTENSION: { "bufferView": 0, "attributes": ids } },
            }],
        }],
        "accessors": accessors,
        "bufferViews": [{ "buffer": 0, "byteOffset": 0, "byteLength": byte_length }],
        "buffers": [{ "byteLength": byte_length }],
    })
}
