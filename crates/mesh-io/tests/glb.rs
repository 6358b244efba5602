//! GLB files by hand.

#![allow(clippy::unwrap_used, reason = "this is test code")]

mod support;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};
use steadymesh_draco::{EncodeOptions, MeshView, encode_with_info};
use steadymesh_mesh_io::{Limits, Mesh, ReadError, glb};
use support::{LIMITS, floats, glb as pack, tetrahedron};

fn read(bytes: &[u8]) -> Result<Mesh, ReadError> {
    glb::read(bytes, &LIMITS)
}

fn message(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

/// Four points of the unit square, 48 bytes.
fn square() -> Vec<u8> {
    floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0])
}

/// A document with the square as accessor 0 and `indices` (if any) as accessor 1.
fn document(index_type: u32, index_count: usize, index_bytes: usize) -> Value {
    json!({
        "asset": { "version": "2.0" },
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": index_type, "count": index_count, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": index_bytes },
        ],
    })
}

/// The square with one-byte indices in `mode`, and a change to its document.
fn with_indices(mode: u32, indices: &[u8], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let mut document = document(5121, indices.len(), indices.len());
    document["meshes"][0]["primitives"][0]["mode"] = mode.into();
    change(&mut document);
    pack(document, &[square(), indices.to_vec()].concat())
}

#[test]
fn every_index_type_is_read() {
    let indices: [u32; 6] = [0, 1, 2, 0, 2, 3];
    let stored: [(u32, Vec<u8>); 3] = [
        (5121, indices.map(|i| i as u8).to_vec()),
        (
            5123,
            indices
                .iter()
                .flat_map(|&i| (i as u16).to_le_bytes())
                .collect(),
        ),
        (5125, indices.iter().flat_map(|i| i.to_le_bytes()).collect()),
    ];
    for (component, bytes) in stored {
        let file = pack(
            document(component, 6, bytes.len()),
            &[square(), bytes].concat(),
        );
        assert_eq!(read(&file).unwrap().faces, [[0, 1, 2], [0, 2, 3]]);
    }
}

#[test]
fn strips_and_fans_become_triangles() {
    let strip = read(&with_indices(5, &[0, 1, 3, 2], |_| ())).unwrap();
    assert_eq!(strip.faces, [[0, 1, 3], [1, 2, 3]]);
    let fan = read(&with_indices(6, &[0, 1, 2, 3], |_| ())).unwrap();
    assert_eq!(fan.faces, [[0, 1, 2], [0, 2, 3]]);
    let joined = read(&with_indices(5, &[0, 1, 3, 3, 3, 1, 2], |_| ())).unwrap();
    assert_eq!(joined.faces, [[0, 1, 3], [3, 1, 2]]);
}

#[test]
fn a_primitive_without_indices_uses_its_vertices_in_order() {
    let file = with_indices(6, &[], |document| {
        document["meshes"][0]["primitives"][0]
            .as_object_mut()
            .unwrap()
            .remove("indices");
    });
    assert_eq!(read(&file).unwrap().faces, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn points_and_lines_are_no_faces() {
    let error = message(&with_indices(1, &[0, 1, 2], |_| ()));
    assert!(error.contains("no vertices"), "{error}");
}

#[test]
fn nodes_place_meshes_and_mirrors_turn_the_winding() {
    let file = with_indices(4, &[0, 1, 2], |document| {
        document["nodes"] = json!([
            { "children": [1], "translation": [10, 0, 0] },
            { "mesh": 0, "scale": [-1, 1, 1] },
            { "mesh": 0 },
            { "mesh": 0, "translation": [0, 0, 99] },
        ]);
        document["scenes"] = json!([{ "nodes": [3] }, { "nodes": [0, 2] }]);
        document["scene"] = 1.into();
    });
    let mesh = read(&file).unwrap();
    assert_eq!(mesh.positions.len(), 8);
    assert_eq!(mesh.positions[1], [9.0, 0.0, 0.0]);
    assert_eq!(mesh.faces, [[0, 2, 1], [4, 5, 6]]);
}

#[test]
fn without_a_default_scene_all_roots_are_shown() {
    let file = with_indices(4, &[0, 1, 2], |document| {
        document["nodes"] = json!([{ "mesh": 0 }, { "children": [0] }, { "mesh": 0 }]);
        document["scenes"] = json!([{ "nodes": [2] }]);
    });
    assert_eq!(read(&file).unwrap().faces.len(), 2);
}

#[test]
fn cycles_and_shared_children_are_refused() {
    for (nodes, expected) in [
        (
            json!([{ "children": [1] }, { "children": [0], "mesh": 0 }]),
            "has a cycle",
        ),
        (
            json!([{ "children": [1, 1] }, { "mesh": 0 }]),
            "node 1 has two parents",
        ),
        (
            json!([{ "children": [7] }]),
            "node 7 is referred to, but there is 1",
        ),
    ] {
        let file = with_indices(4, &[0, 1, 2], |document| document["nodes"] = nodes);
        let error = message(&file);
        assert!(error.contains(expected), "{error}");
    }
    let file = with_indices(4, &[0, 1, 2], |document| {
        document["nodes"] = json!([{ "children": [0], "mesh": 0 }]);
        document["scenes"] = json!([{ "nodes": [0] }]);
        document["scene"] = 0.into();
    });
    assert!(message(&file).contains("its own ancestor"));
}

#[test]
fn primitives_that_share_attributes_share_vertices() {
    let file = with_indices(4, &[0, 1, 2, 0, 2, 3], |document| {
        let primitive = document["meshes"][0]["primitives"][0].clone();
        document["meshes"][0]["primitives"] = json!([primitive, primitive]);
        let other = json!({ "primitives": [primitive] });
        document["meshes"].as_array_mut().unwrap().push(other);
    });
    let mesh = read(&file).unwrap();
    assert_eq!((mesh.positions.len(), mesh.faces.len()), (8, 6));
    assert_eq!(mesh.faces[4], [4, 5, 6]);
}

#[test]
fn interleaved_quantized_and_normalized_attributes_are_read() {
    // Position i16 x 3 (+ 2 bytes padding), texture coordinate u16 x 2, color u8 x 4.
    let mut bin = Vec::new();
    for (position, uv, color) in [
        ([0_i16, 0, 0], [0_u16, 65535], [255_u8, 0, 0, 128]),
        ([32767, 0, 0], [65535, 0], [0, 255, 0, 128]),
        ([0, -32768, 7], [0, 0], [0, 0, 255, 128]),
    ] {
        bin.extend(position.iter().flat_map(|v| v.to_le_bytes()));
        bin.extend([0, 0]);
        bin.extend(uv.iter().flat_map(|v| v.to_le_bytes()));
        bin.extend(color);
    }
    let accessor = |offset: usize, component: u32, normalized: bool, shape: &str| {
        json!({ "bufferView": 0, "byteOffset": offset, "componentType": component,
                "normalized": normalized, "count": 3, "type": shape })
    };
    let document = json!({
        "extensionsRequired": ["KHR_mesh_quantization"],
        "meshes": [{ "primitives": [{ "attributes":
            { "POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2 } }] }],
        "accessors": [
            accessor(0, 5122, true, "VEC3"),
            accessor(8, 5123, true, "VEC2"),
            accessor(12, 5121, true, "VEC4"),
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 48, "byteStride": 16 }],
    });
    let mesh = read(&pack(document, &bin)).unwrap();
    assert_eq!(mesh.positions[1], [1.0, 0.0, 0.0]);
    assert_eq!(mesh.positions[2], [0.0, -1.0, 7.0 / 32767.0]);
    // Turned over: v points up.
    assert_eq!(mesh.texture_coordinates.unwrap().values[0], [0.0, 0.0]);
    assert_eq!(mesh.colors.unwrap().values[1], [0, 255, 0, 128]);
}

#[test]
fn sparse_values_replace_those_of_the_view() {
    let sparse = json!({
        "count": 1,
        "indices": { "bufferView": 1, "byteOffset": 3, "componentType": 5121 },
        "values": { "bufferView": 0, "byteOffset": 24 },
    });
    let file = with_indices(4, &[0, 1, 2, 3], |document| {
        document["accessors"][0]["sparse"] = sparse.clone();
        document["accessors"][1]["count"] = 3.into();
    });
    assert_eq!(read(&file).unwrap().positions[3], [1.0, 1.0, 0.0]);
    let zeros = with_indices(4, &[0, 1, 2, 3], |document| {
        document["accessors"][0]["sparse"] = sparse;
        document["accessors"][0]
            .as_object_mut()
            .unwrap()
            .remove("bufferView");
        document["accessors"][1]["count"] = 3.into();
    });
    assert_eq!(
        read(&zeros).unwrap().positions,
        [[0.0; 3], [0.0; 3], [0.0; 3], [1.0, 1.0, 0.0]]
    );
}

#[test]
fn spans_beyond_their_buffer_are_refused() {
    let set = |path: &'static str, value: u64| {
        message(&with_indices(4, &[0, 1, 2], |document| {
            *document.pointer_mut(path).unwrap() = value.into();
        }))
    };
    let error = set("/accessors/0/count", 5);
    assert!(
        error.contains("accessor 0: 5 elements of 12 bytes"),
        "{error}"
    );
    let error = set("/bufferViews/1/byteLength", 4);
    assert!(
        error.contains("buffer view 1 spans 4 bytes from 48 on, but buffer 0 has 51"),
        "{error}"
    );
    let error = set("/bufferViews/1/byteOffset", u64::MAX);
    assert!(error.contains("buffer view 1"), "{error}");
    let error = set("/bufferViews/1/buffer", 1);
    assert!(
        error.contains("buffer 1 is referred to, but there is 1"),
        "{error}"
    );
    let error = set("/accessors/0/componentType", 5124);
    assert!(error.contains("component type 5124"), "{error}");
}

#[test]
fn external_buffers_are_refused_with_a_sentence() {
    let expected = "glTF: accessor 0: buffer 0 is stored outside, at \"mesh.bin\"; pack \
                    everything into one .glb file, or into data: URIs";
    assert_eq!(message(&with_buffer("mesh.bin", 51)), expected);
    let mut document = document(5121, 3, 3);
    document["buffers"] = json!([{ "byteLength": 51, "uri": "mesh.bin" }]);
    assert_eq!(message(document.to_string().as_bytes()), expected);
}

/// A container of the square and one triangle, whose buffer 0 is `uri`.
fn with_buffer(uri: &str, byte_length: usize) -> Vec<u8> {
    with_indices(4, &[0, 1, 2], |document| {
        document["buffers"] = json!([{ "byteLength": byte_length, "uri": uri }]);
    })
}

/// The square and one triangle as text in base64.
fn base64_uri() -> String {
    let bytes = [square(), vec![0, 1, 2]].concat();
    format!(
        "data:application/octet-stream;base64,{}",
        BASE64_STANDARD.encode(bytes)
    )
}

#[test]
fn a_buffer_in_the_text_is_read_in_a_container_and_in_json_alone() {
    let bytes = [square(), vec![0, 1, 2]].concat();
    let percents: String = bytes.iter().map(|byte| format!("%{byte:02x}")).collect();
    let expected = read(&with_indices(4, &[0, 1, 2], |_| ())).unwrap();
    for uri in [base64_uri(), format!("data:,{percents}")] {
        assert_eq!(read(&with_buffer(&uri, 51)).unwrap(), expected);
        let mut document = document(5121, 3, 3);
        document["buffers"] = json!([{ "byteLength": 51, "uri": uri }]);
        let text = document.to_string();
        assert_eq!(read(text.as_bytes()).unwrap(), expected);
        let with_mark = format!("\u{feff}\n{text}");
        assert_eq!(read(with_mark.as_bytes()).unwrap(), expected);
    }
}

#[test]
fn buffers_in_the_text_and_in_the_chunk_stand_side_by_side() {
    let file = with_indices(4, &[0, 1, 2], |document| {
        document["buffers"] = json!([
            { "byteLength": 48 },
            { "byteLength": 3, "uri": "data:;base64,AAID" },
            { "byteLength": 9, "uri": "unused.bin" },
        ]);
        document["bufferViews"][1] = json!({ "buffer": 1, "byteLength": 3 });
    });
    assert_eq!(read(&file).unwrap().faces, [[0, 2, 3]]);
}

#[test]
fn a_data_uri_that_cannot_be_used_is_named() {
    for (uri, byte_length, expected) in [
        (
            "data:;base64,A*==".to_owned(),
            51,
            "glTF: the data: URI of buffer 0 is not base64: byte 1 of its data is `*`",
        ),
        (
            "data:".to_owned(),
            51,
            "glTF: the data: URI of buffer 0 has no comma between its type and its data",
        ),
        (
            base64_uri(),
            52,
            "glTF: accessor 0: buffer 0 is to have 52 bytes, but its data: URI has 51",
        ),
        (
            base64_uri(),
            usize::MAX,
            "glTF: accessor 0: buffer 0 is to have 18446744073709551615 bytes, but its data: URI \
             has 51",
        ),
    ] {
        assert_eq!(message(&with_buffer(&uri, byte_length)), expected);
    }
    let text = document(5121, 3, 3).to_string();
    let text = text.replacen('{', "{\"buffers\":[{\"byteLength\":51}],", 1);
    assert_eq!(
        message(text.as_bytes()),
        "glTF: accessor 0: buffer 0 has no data: neither a URI nor, as buffer 0 of a .glb file \
         may, the binary chunk"
    );
}

#[test]
fn buffers_in_the_text_are_held_to_the_memory_limit() {
    let file = with_buffer(&base64_uri(), 51);
    // 68 letters of base64, and what stands before them.
    let least = base64_uri().len() - "data:".len();
    let read = |max_memory_bytes| {
        glb::read(
            &file,
            &Limits {
                max_memory_bytes,
                ..LIMITS
            },
        )
    };
    assert!(read(least).is_ok());
    let limit = least - 1;
    assert_eq!(read(limit), Err(ReadError::OutOfMemory { limit }));
}

#[test]
fn bad_indices_and_counts_are_refused() {
    assert_eq!(
        message(&with_indices(4, &[0, 1, 2, 0, 1, 4], |_| ())),
        "face 1 refers to vertex 4, but there are 4 vertices"
    );
    let error = message(&with_indices(4, &[0, 1, 2, 3], |_| ()));
    assert!(
        error.contains("4 indices, which is not a multiple of 3"),
        "{error}"
    );
    let floats = with_indices(4, &[0; 12], |document| {
        document["accessors"][1] =
            json!({ "bufferView": 1, "componentType": 5126, "count": 3, "type": "SCALAR" });
    });
    assert!(message(&floats).contains("not of unsigned whole numbers"));
}

#[test]
fn limits_hold_whatever_a_small_file_promises() {
    let huge = with_indices(4, &[0, 1, 2], |document| {
        document["accessors"][0] =
            json!({ "componentType": 5126, "count": 4_000_000_000_u64, "type": "VEC3" });
    });
    assert_eq!(
        read(&huge),
        Err(ReadError::LimitExceeded {
            what: "vertices",
            found: 4_000_000_000,
            limit: 100_000
        })
    );
    // A thousand nodes show the square.
    let many = with_indices(4, &[0, 1, 2], |document| {
        document["nodes"] = (0..1000).map(|_| json!({ "mesh": 0 })).collect();
    });
    let limits = Limits {
        max_faces: 500,
        ..LIMITS
    };
    assert_eq!(
        glb::read(&many, &limits),
        Err(ReadError::LimitExceeded {
            what: "faces",
            found: 501,
            limit: 500
        })
    );
}

#[test]
fn endless_work_is_refused() {
    let file = with_indices(0, &[0, 1, 2], |document| {
        let primitive = document["meshes"][0]["primitives"][0].clone();
        document["meshes"][0]["primitives"] = (0..1000).map(|_| primitive.clone()).collect();
        document["nodes"] = (0..1000).map(|_| json!({ "mesh": 0 })).collect();
    });
    assert!(message(&file).contains("more than 131072 primitives"));
    // Degenerate strips count, although they leave no faces.
    let file = with_indices(5, &[1; 100], |document| {
        document["nodes"] = (0..3000).map(|_| json!({ "mesh": 0 })).collect();
    });
    assert!(matches!(
        read(&file),
        Err(ReadError::LimitExceeded { what: "faces", .. })
    ));
}

#[test]
fn what_was_written_reads_back_exactly() {
    assert_eq!(
        read(&glb::write(&tetrahedron(), None)).unwrap(),
        tetrahedron()
    );
}

#[test]
fn a_wrapped_draco_file_reads_back() {
    let mesh = tetrahedron();
    let positions: Vec<[f32; 3]> = mesh
        .positions
        .iter()
        .map(|p| p.map(|value| value as f32))
        .collect();
    let view = MeshView {
        positions: &positions,
        point_vertices: None,
        faces: &mesh.faces,
        normals: mesh.normals.as_ref().map(|a| &a.values[..]),
        colors: mesh.colors.as_ref().map(|a| &a.values[..]),
        materials: None,
        texture_coordinates: mesh.texture_coordinates.as_ref().map(|a| &a.values[..]),
    };
    let encoded = encode_with_info(&view, &EncodeOptions::default()).unwrap();
    let parts = glb::DracoPart::split(&encoded.bytes, &LIMITS).unwrap();
    let back = read(&glb::wrap_draco(&parts, None)).unwrap();
    assert_eq!((back.positions.len(), back.faces.len()), (4, 4));
    let corner = back.positions.iter().position(|p| p[0] > 0.9).unwrap();
    assert_eq!(back.colors.unwrap().values[corner], [0, 255, 0, 255]);
    assert!(back.texture_coordinates.unwrap().values[corner][0] > 0.99);
    assert!(back.normals.unwrap().values[corner][0] > 0.99);
}

#[test]
fn a_draco_primitive_that_names_a_missing_attribute_is_refused() {
    let positions = [[0.0_f32; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let view = MeshView {
        positions: &positions,
        point_vertices: None,
        faces: &[[0, 1, 2]],
        normals: None,
        colors: None,
        materials: None,
        texture_coordinates: None,
    };
    let encoded = encode_with_info(&view, &EncodeOptions::default()).unwrap();
    let mut parts = glb::DracoPart::split(&encoded.bytes, &LIMITS).unwrap();
    parts[0].info.position_id = 9;
    let error = message(&glb::wrap_draco(&parts, None));
    assert_eq!(
        error,
        "the Draco mesh has no positions with the unique id 9"
    );
}
