//! The parts of the JSON document that describe geometry and the image on it.

use super::malformed;
use crate::ReadError;
use crate::error::are;
use serde::Deserialize;
use serde::de::{Deserializer, Error, SeqAccess, Visitor};
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

/// An array of a document. It is cut off with an error at [`MAX_ENTRIES`], because
/// an entry of two characters in the text takes a hundred bytes and more here.
#[derive(Debug, Clone)]
pub(super) struct Array<T>(pub(super) Vec<T>);

/// Far above what the geometry of one frame needs.
const MAX_ENTRIES: usize = 65_536;

impl<T> Default for Array<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Array<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Entries<T> {
            type Value = Array<T>;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("an array")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Array<T>, A::Error> {
                let mut all = Vec::new();
                while let Some(entry) = entries.next_element()? {
                    if all.len() == MAX_ENTRIES {
                        return Err(A::Error::custom(format!(
                            "an array has more than {MAX_ENTRIES} entries"
                        )));
                    }
                    all.push(entry);
                }
                Ok(Array(all))
            }
        }
        deserializer.deserialize_seq(Entries(PhantomData))
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    #[serde(default)]
    pub(super) extensions_required: Array<String>,
    pub(super) scene: Option<usize>,
    #[serde(default)]
    pub(super) scenes: Array<Scene>,
    #[serde(default)]
    pub(super) nodes: Array<Node>,
    #[serde(default)]
    pub(super) meshes: Array<MeshEntry>,
    #[serde(default)]
    pub(super) accessors: Array<Accessor>,
    #[serde(default)]
    pub(super) buffer_views: Array<BufferView>,
    #[serde(default)]
    pub(super) buffers: Array<Buffer>,
    #[serde(default)]
    pub(super) materials: Array<Material>,
    #[serde(default)]
    pub(super) textures: Array<Texture>,
    #[serde(default)]
    pub(super) images: Array<ImageEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) pbr_metallic_roughness: Option<Surface>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Surface {
    pub(super) base_color_texture: Option<TextureInfo>,
}

#[derive(Debug, Deserialize)]
pub(super) struct TextureInfo {
    pub(super) index: usize,
    #[serde(default)]
    pub(super) extensions: InfoExtensions,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct InfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub(super) transform: Option<TextureTransform>,
}

#[derive(Debug, Deserialize)]
pub(super) struct TextureTransform {
    pub(super) offset: Option<[f64; 2]>,
    #[serde(default)]
    pub(super) rotation: f64,
    pub(super) scale: Option<[f64; 2]>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Texture {
    pub(super) source: Option<usize>,
    #[serde(default)]
    pub(super) extensions: TextureExtensions,
}

/// Other formats than JPEG and PNG.
#[derive(Debug, Default, Deserialize)]
pub(super) struct TextureExtensions {
    #[serde(rename = "EXT_texture_avif")]
    pub(super) avif: Option<OtherSource>,
    #[serde(rename = "EXT_texture_webp")]
    pub(super) webp: Option<OtherSource>,
    #[serde(rename = "KHR_texture_basisu")]
    pub(super) basisu: Option<OtherSource>,
}

#[derive(Debug, Deserialize)]
pub(super) struct OtherSource {
    pub(super) source: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct ImageEntry {
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<usize>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub(super) nodes: Array<usize>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Node {
    #[serde(default)]
    pub(super) children: Array<usize>,
    pub(super) mesh: Option<usize>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
}

#[derive(Debug, Deserialize)]
pub(super) struct MeshEntry {
    #[serde(default)]
    pub(super) primitives: Array<Primitive>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) mode: Option<u32>,
    pub(super) material: Option<usize>,
    #[serde(default)]
    pub(super) extensions: PrimitiveExtensions,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub(super) draco: Option<Box<DracoExtension>>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct DracoExtension {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, u32>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) shape: String,
    pub(super) sparse: Option<Box<Sparse>>,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct Sparse {
    pub(super) count: usize,
    pub(super) indices: SparseIndices,
    pub(super) values: SparseValues,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: usize,
}

/// Required extensions that are understood, or that leave geometry and coordinates alone.
const SUPPORTED: [&str; 2] = ["KHR_draco_mesh_compression", "KHR_mesh_quantization"];
const HARMLESS_PREFIXES: [&str; 6] = [
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
];

pub(super) fn parse(json: &[u8]) -> Result<Document, ReadError> {
    let document: Document = serde_json::from_slice(json)
        .map_err(|error| malformed(format!("the JSON cannot be used: {error}")))?;
    let is_unknown = |name: &&String| {
        !SUPPORTED.contains(&name.as_str())
            && !HARMLESS_PREFIXES
                .iter()
                .any(|prefix| name.starts_with(prefix))
    };
    if let Some(name) = document.extensions_required.0.iter().find(is_unknown) {
        let name: String = name.chars().filter(|c| !c.is_control()).take(64).collect();
        return Err(malformed(format!(
            "the file requires the extension {name}, which is not supported"
        )));
    }
    Ok(document)
}

/// Entry `index` of one of the document's arrays, or an error that names it.
pub(super) fn entry<'a, T>(
    array: &'a Array<T>,
    index: usize,
    what: &str,
) -> Result<&'a T, ReadError> {
    array.0.get(index).ok_or_else(|| {
        malformed(format!(
            "{what} {index} is referred to, but there {}",
            are(array.0.len(), what)
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_without_end_is_cut_off() {
        let json = format!("{{\"nodes\":[{}{{}}]}}", "{},".repeat(MAX_ENTRIES));
        let error = parse(json.as_bytes()).unwrap_err().to_string();
        assert!(error.contains("more than 65536 entries"), "{error}");
    }

    #[test]
    fn an_unknown_required_extension_is_named() {
        let json =
            b"{\"extensionsRequired\":[\"KHR_materials_unlit\",\"EXT_meshopt_compression\"]}";
        let error = parse(json).unwrap_err().to_string();
        assert!(error.contains("EXT_meshopt_compression"), "{error}");
    }
}
