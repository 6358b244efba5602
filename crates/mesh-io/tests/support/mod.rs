//! What several test files use.
#![allow(dead_code, reason = "each test file uses a part")]
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "this is test code"
)]

use serde_json::{Value, json};
use std::path::PathBuf;
use steadymesh_mesh_io::{Attribute, Limits, Mesh};

pub const LIMITS: Limits = Limits {
    max_vertices: 100_000,
    max_faces: 200_000,
    max_memory_bytes: 256 << 20,
};

/// A tetrahedron with all attributes.
pub fn tetrahedron() -> Mesh {
    Mesh {
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        normals: Some(Attribute::per_vertex(vec![
            [0.0, 0.0, -1.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
        ])),
        colors: Some(Attribute::per_vertex(vec![
            [255, 0, 0, 255],
            [0, 255, 0, 255],
            [0, 0, 255, 255],
            [9, 8, 7, 255],
        ])),
        materials: None,
        texture_coordinates: Some(Attribute::per_vertex(vec![
            [0.0, 0.0],
            [1.0, 0.0],
            [0.0, 1.0],
            [0.25, 0.75],
        ])),
        image: None,
    }
}

/// A GLB file of these two chunks; the length of buffer 0 is filled in.
pub fn glb(mut document: Value, bin: &[u8]) -> Vec<u8> {
    if document["buffers"].is_null() {
        document["buffers"] = json!([{ "byteLength": bin.len() }]);
    }
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let length = 12 + 8 + json.len() + 8 + bin.len();
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((length as u32).to_le_bytes());
    for (kind, data) in [(b"JSON", json), (b"BIN\0", bin)] {
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(data);
    }
    bytes
}

pub fn floats(values: &[f32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

/// A folder of real captures, or `None` with a message that the test was skipped.
pub fn captures(folder: &str) -> Option<Vec<PathBuf>> {
    let root = std::env::var_os("STEADYMESH_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let Ok(entries) = std::fs::read_dir(root.join(folder)) else {
        println!(
            "skipped: there are no captures in {}",
            root.join(folder).display()
        );
        return None;
    };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    Some(paths)
}
