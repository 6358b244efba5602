//! Draco files inside a GLB file.

use super::write::bounds;
use super::{container, texture};
use crate::{ImageFormat, Limits, ReadError, drc};
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use steadymesh_draco::{DecodedMesh, EncodeOptions, decode_and_identify, encode};

/// A Draco file that becomes one primitive.
#[derive(Debug, Clone, PartialEq)]
pub struct DracoPart<'a> {
    /// The file.
    pub bytes: Cow<'a, [u8]>,
    /// What is in it.
    pub info: DracoInfo,
}

impl<'a> DracoPart<'a> {
    /// Describes a Draco file after decoding it. One whose faces have several materials, which a
    /// primitive cannot, becomes a part for each, encoded anew.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if it cannot be decoded.
    pub fn split(bytes: &'a [u8], limits: &Limits) -> Result<Vec<Self>, ReadError> {
        let (mesh, _) = decode_and_identify(bytes, &drc::decode_limits(limits))?;
        if mesh.materials.is_none() {
            let info = DracoInfo::read(bytes, limits)?;
            let bytes = Cow::Borrowed(bytes);
            return Ok(vec![Self { bytes, info }]);
        }
        let parts = by_material(&mesh).into_iter().map(|part| {
            // What meets at the border of two parts is rounded in each of them.
            let options = EncodeOptions {
                position_bits: 16,
                texture_coordinate_bits: 14,
                ..EncodeOptions::default()
            };
            let bytes = encode(&part.view(), &options)
                .map_err(|error| super::malformed(error.to_string()))?;
            Ok(Self {
                info: DracoInfo::read(&bytes, limits)?,
                bytes: Cow::Owned(bytes),
            })
        });
        parts.collect()
    }
}

/// The faces of each material with their points.
fn by_material(mesh: &DecodedMesh) -> Vec<DecodedMesh> {
    let mut groups: BTreeMap<u16, Vec<[u32; 3]>> = BTreeMap::new();
    let materials = mesh.materials.as_deref().unwrap_or_default();
    for face in &mesh.faces {
        let material = materials.get(face[0] as usize).copied();
        groups
            .entry(material.unwrap_or_default())
            .or_default()
            .push(*face);
    }
    let with_points = |mut faces: Vec<[u32; 3]>| {
        let mut points: Vec<u32> = faces.iter().flatten().copied().collect();
        points.sort_unstable();
        points.dedup();
        for corner in faces.iter_mut().flatten() {
            // Every corner is among the points.
            *corner = points.binary_search(corner).unwrap_or_default() as u32;
        }
        DecodedMesh {
            positions: keep(&mesh.positions, &points),
            normals: mesh.normals.as_ref().map(|all| keep(all, &points)),
            colors: mesh.colors.as_ref().map(|all| keep(all, &points)),
            texture_coordinates: mesh
                .texture_coordinates
                .as_ref()
                .map(|all| keep(all, &points)),
            materials: None,
            faces,
        }
    };
    groups.into_values().map(with_points).collect()
}

fn keep<T: Copy>(all: &[T], points: &[u32]) -> Vec<T> {
    points.iter().map(|&point| all[point as usize]).collect()
}

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

/// Wraps the Draco files of a mesh's parts, and the image on it if it has one, into a GLB file with
/// `KHR_draco_mesh_compression`, without decoding or copying more than their bytes. Each is a
/// primitive; of several each has a material of its own.
///
/// Texture coordinates with v upwards, as they are in the Draco files, are turned over by
/// `KHR_texture_transform`. An image without texture coordinates is left out.
#[must_use]
pub fn wrap_draco(parts: &[DracoPart<'_>], image: Option<(ImageFormat, &[u8])>) -> Vec<u8> {
    let (mut bin, mut views) = (Vec::new(), Vec::new());
    let mut view = |bytes: &[u8]| {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        bin.extend_from_slice(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
        views.len() - 1
    };
    let (mut accessors, mut primitives) = (Vec::new(), Vec::new());
    for part in parts {
        let view = view(&part.bytes);
        primitives.push(primitive(&part.info, view, &mut accessors));
    }
    let is_textured = parts
        .iter()
        .all(|part| part.info.texture_coordinate_id.is_some());
    let image = image.filter(|_| is_textured);
    let image = image.map(|(format, bytes)| (format, view(bytes)));
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "steadymesh" },
        "extensionsUsed": [EXTENSION],
        "extensionsRequired": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": primitives }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": bin.len() }],
    });
    if let Some((format, view)) = image {
        texture::put_on(&mut document, format, view, true);
    }
    texture::tell_apart(&mut document);
    container::join(document.to_string().as_bytes(), &bin)
}

const EXTENSION: &str = "KHR_draco_mesh_compression";

/// A primitive whose Draco file is in buffer view `view`, and the accessors that describe it.
fn primitive(info: &DracoInfo, view: usize, accessors: &mut Vec<Value>) -> Value {
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
    let indices = accessors.len();
    accessors.push(json!({
        "componentType": 5125, "count": 3 * info.face_count, "type": "SCALAR",
    }));
    let (mut attributes, mut ids) = (Map::new(), Map::new());
    for (name, id, accessor) in described {
        if let Some(id) = id {
            attributes.insert(name.to_owned(), accessors.len().into());
            ids.insert(name.to_owned(), id.into());
            accessors.push(accessor);
        }
    }
    json!({
        "attributes": attributes,
        "indices": indices,
        "extensions": { EXTENSION: { "bufferView": view, "attributes": ids } },
    })
}
