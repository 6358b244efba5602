//! GLB files with images.

#![allow(clippy::unwrap_used, reason = "this is test code")]

mod support;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};
use steadymesh_draco::{EncodeOptions, MeshView, encode_with_info};
use steadymesh_mesh_io::{ImageBytes, ImageFormat, Mesh, ReadError, glb};
use support::{LIMITS, floats, glb as pack, tetrahedron};

fn read(bytes: &[u8]) -> Result<Mesh, ReadError> {
    glb::read(bytes, &LIMITS)
}

fn message(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x08\0\0\0\x04";

/// The image of a mesh that was read from `file`.
fn image_of(mesh: &Mesh, file: &[u8]) -> Vec<u8> {
    match &mesh.image.as_ref().expect("an image").bytes {
        ImageBytes::Within(range) => file[range.clone()].to_vec(),
        ImageBytes::Own(bytes) => bytes.clone(),
    }
}

#[test]
fn an_image_reads_back_with_the_coordinates_upright() {
    for format in ImageFormat::ALL {
        let file = glb::write(&tetrahedron(), Some((format, PNG)));
        let back = read(&file).unwrap();
        assert_eq!(image_of(&back, &file), PNG);
        assert_eq!(back.texture_coordinates, tetrahedron().texture_coordinates);
    }
}

#[test]
fn a_wrapped_draco_file_with_an_image_reads_back_upright() {
    let mesh = tetrahedron();
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|v| v as f32)).collect();
    let view = MeshView {
        positions: &positions,
        point_vertices: None,
        faces: &mesh.faces,
        normals: None,
        colors: None,
        materials: None,
        texture_coordinates: mesh.texture_coordinates.as_ref().map(|a| &a.values[..]),
    };
    let encoded = encode_with_info(&view, &EncodeOptions::default()).unwrap();
    let parts = glb::DracoPart::split(&encoded.bytes, &LIMITS).unwrap();
    let file = glb::wrap_draco(&parts, Some((ImageFormat::Png, PNG)));
    let back = read(&file).unwrap();
    assert_eq!(image_of(&back, &file), PNG);
    let corner = back.positions.iter().position(|p| p[2] > 0.9).unwrap();
    let [u, v] = back.texture_coordinates.unwrap().values[corner];
    assert!(
        (u - 0.25).abs() < 1e-3 && (v - 0.75).abs() < 1e-3,
        "{u} {v}"
    );
}

/// A triangle whose material is placed by `transform`, with `images` of which each primitive has one.
fn textured(transform: &Value, images: &Value) -> Vec<u8> {
    let count = images.as_array().map_or(0, Vec::len);
    let primitive = |material: usize| json!({ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": material });
    let material = |texture: usize| {
        json!({ "pbrMetallicRoughness": { "baseColorTexture": {
            "index": texture, "extensions": { "KHR_texture_transform": transform },
        } } })
    };
    let document = json!({
        "asset": { "version": "2.0" },
        "meshes": [{ "primitives": (0..count).map(primitive).collect::<Vec<_>>() }],
        "materials": (0..count).map(material).collect::<Vec<_>>(),
        "textures": (0..count).map(|i| json!({ "source": i })).collect::<Vec<_>>(),
        "images": images,
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 }, { "buffer": 0, "byteOffset": 36, "byteLength": 24 },
        ],
        "buffers": [{ "byteLength": 60 }],
    });
    let values = [
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.25, 0.0, 1.0, 0.0, 0.0, 1.0,
    ];
    pack(document, &floats(&values))
}

#[test]
fn an_image_in_the_text_is_read_and_its_place_is_applied() {
    let uri = format!("data:image/png;base64,{}", BASE64_STANDARD.encode(PNG));
    let turn =
        json!({ "offset": [0.5, 0.25], "rotation": std::f64::consts::FRAC_PI_2, "scale": [2, 1] });
    let file = textured(&turn, &json!([{ "uri": uri }]));
    let mesh = read(&file).unwrap();
    assert_eq!(image_of(&mesh, &file), PNG);
    // Scaled (0.5, 0), turned to (0, -0.5), moved to (0.5, -0.25), and turned over.
    let [u, v] = mesh.texture_coordinates.unwrap().values[0];
    assert!((u - 0.5).abs() < 1e-6 && (v - 1.25).abs() < 1e-6, "{u} {v}");
}

#[test]
fn an_image_that_is_not_in_the_file_or_not_the_only_one_is_left_out() {
    let data = format!("data:image/png;base64,{}", BASE64_STANDARD.encode(PNG));
    for images in [
        json!([{ "uri": "beside.png" }]),
        json!([{ "uri": data }, { "uri": data }]),
    ] {
        assert_eq!(read(&textured(&json!({}), &images)).unwrap().image, None);
    }
    let gif = json!([{ "uri": "data:image/gif;base64,R0lGODlhAQABAAAAACw=" }]);
    let error = message(&textured(&json!({}), &gif));
    assert!(error.contains("begins like none of JPEG"), "{error}");
}
