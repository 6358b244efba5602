//! The image on a mesh: the base color texture of its material.
//!
//! Sources: "glTF 2.0 Specification" (Khronos Group, 2.0.1), 3.8 and 3.9, and the extensions
//! `KHR_texture_transform`, `KHR_materials_unlit`, `EXT_texture_webp`, `EXT_texture_avif` and
//! `KHR_texture_basisu`.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use super::accessor::Source;
use super::data_uri;
use super::document::{Document, Primitive, Texture, TextureInfo, entry};
use super::malformed;
use crate::{Image, ImageFormat, ReadError};

/// The image of these primitives, if all of them that have one have the same, and if it is stored
/// in the file.
pub(super) fn image(
    source: &Source<'_>,
    used: &BTreeSet<usize>,
    body: &[u8],
) -> Result<Option<Image>, ReadError> {
    let mut used = used.iter();
    let (Some(&index), None) = (used.next(), used.next()) else {
        return Ok(None);
    };
    let entry = entry(&source.document.images, index, "image")?;
    if let Some(view) = entry.buffer_view {
        let (bytes, _) = source.view(view)?;
        return Ok(Some(match range_within(body, bytes) {
            Some(range) => Image::within(body, range)?,
            None => Image::new(bytes.to_vec())?,
        }));
    }
    let uri = entry.uri.as_deref().unwrap_or_default();
    let Some(payload) = data_uri::payload(uri.as_bytes()) else {
        return Ok(None);
    };
    let bytes = data_uri::decode(payload)
        .map_err(|wrong| malformed(format!("the data: URI of image {index} {wrong}")))?;
    Ok(Some(Image::new(bytes)?))
}

/// Where `part` is in `body`, if it is a part of it.
fn range_within(body: &[u8], part: &[u8]) -> Option<std::ops::Range<usize>> {
    let start = (part.as_ptr() as usize).checked_sub(body.as_ptr() as usize)?;
    let range = start..start.checked_add(part.len())?;
    (range.end <= body.len()).then_some(range)
}

/// The base color texture of a primitive and its image.
pub(super) fn base_color<'a>(
    document: &'a Document,
    primitive: &Primitive,
) -> Result<Option<(&'a TextureInfo, usize)>, ReadError> {
    let Some(material) = primitive.material else {
        return Ok(None);
    };
    let material = entry(&document.materials, material, "material")?;
    let surface = material.pbr_metallic_roughness.as_ref();
    let Some(info) = surface.and_then(|surface| surface.base_color_texture.as_ref()) else {
        return Ok(None);
    };
    let texture = entry(&document.textures, info.index, "texture")?;
    Ok(source_of(texture).map(|image| (info, image)))
}

/// The image that a texture is made of: the first choice, which is that of an extension.
fn source_of(texture: &Texture) -> Option<usize> {
    let extensions = &texture.extensions;
    let choices = [&extensions.avif, &extensions.webp, &extensions.basisu];
    let first = choices
        .into_iter()
        .flatten()
        .find_map(|choice| choice.source);
    first.or(texture.source)
}

/// Texture coordinates as the image is looked up with them, v upwards.
pub(super) fn place(coordinates: &mut [[f32; 2]], info: Option<&TextureInfo>) {
    let transform = info.and_then(|info| info.extensions.transform.as_ref());
    let [ox, oy] = transform.map_or([0.0; 2], |t| t.offset.unwrap_or([0.0; 2]));
    let [sx, sy] = transform.map_or([1.0; 2], |t| t.scale.unwrap_or([1.0; 2]));
    let (sin, cos) = transform.map_or(0.0, |t| t.rotation).sin_cos();
    for coordinate in coordinates {
        let [u, v] = coordinate.map(f64::from);
        let (u, v) = (u * sx, v * sy);
        let (u, v) = (cos * u + sin * v + ox, cos * v - sin * u + oy);
        *coordinate = [u as f32, (1.0 - v) as f32];
    }
}

/// Gives each of several primitives a material of its own, like that of the first if it has one.
pub(super) fn tell_apart(document: &mut Value) {
    let primitives = document["meshes"][0]["primitives"].as_array_mut();
    let Some(primitives) = primitives.filter(|primitives| 1 < primitives.len()) else {
        return;
    };
    let count = primitives.len();
    for (number, primitive) in primitives.iter_mut().enumerate() {
        primitive["material"] = number.into();
    }
    let look = document["materials"].get(0).cloned();
    let material = |number: usize| {
        let mut material = look.clone().unwrap_or_else(|| json!({}));
        material["name"] = format!("material{number}").into();
        material
    };
    document["materials"] = (0..count).map(material).collect();
}

/// Puts an image, which is in buffer view `view`, on the first primitive of `document`.
/// `turns_over`: its texture coordinates have v upwards.
pub(super) fn put_on(document: &mut Value, format: ImageFormat, view: usize, turns_over: bool) {
    let mut used = vec!["KHR_materials_unlit"];
    let mut required = Vec::new();
    let mut base_color = json!({ "index": 0 });
    if turns_over {
        const TRANSFORM: &str = "KHR_texture_transform";
        used.push(TRANSFORM);
        required.push(TRANSFORM);
        base_color["extensions"] = json!({ TRANSFORM: { "offset": [0, 1], "scale": [1, -1] } });
    }
    let extension = match format {
        ImageFormat::Jpeg | ImageFormat::Png => None,
        ImageFormat::Webp => Some("EXT_texture_webp"),
        ImageFormat::Avif => Some("EXT_texture_avif"),
        ImageFormat::Ktx2 => Some("KHR_texture_basisu"),
    };
    document["textures"] = match extension {
        None => json!([{ "source": 0 }]),
        Some(name) => {
            used.push(name);
            required.push(name);
            json!([{ "extensions": { name: { "source": 0 } } }])
        }
    };
    document["images"] = json!([{ "bufferView": view, "mimeType": format.media_type() }]);
    // Captured colors have their light in them.
    document["materials"] = json!([{
        "pbrMetallicRoughness": {
            "baseColorTexture": base_color, "metallicFactor": 0, "roughnessFactor": 1,
        },
        "extensions": { "KHR_materials_unlit": {} },
    }]);
    document["meshes"][0]["primitives"][0]["material"] = 0.into();
    for (list, names) in [("extensionsUsed", used), ("extensionsRequired", required)] {
        let mut all = document[list].as_array().cloned().unwrap_or_default();
        all.extend(names.into_iter().map(Value::from));
        if !all.is_empty() {
            document[list] = all.into();
        }
    }
}
