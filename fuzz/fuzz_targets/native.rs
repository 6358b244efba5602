//! Any bytes as native.

#![no_main]

use libfuzzer_sys::fuzz_target;
use steadymesh_mesh_io::{Format, Limits, read};

const LIMITS: Limits = Limits {
    max_vertices: 100_000,
    max_faces: 200_000,
    max_memory_bytes: 64 << 20,
};

fuzz_target!(|bytes: &[u8]| {
    let Ok(mesh) = read(bytes, Format::Native, &LIMITS) else {
        return;
    };
    // What the reader promises of a mesh that it accepts.
    assert!(!mesh.positions.is_empty() && !mesh.faces.is_empty());
    assert!(mesh.positions.iter().flatten().all(|c| c.is_finite()));
    let count = mesh.positions.len() as u32;
    assert!(mesh.faces.iter().flatten().all(|&index| index < count));
});
