//! What the targets for mesh formats have in common.

use steadymesh_mesh_io::{Format, Limits, read};

const LIMITS: Limits = Limits {
    max_vertices: 100_000,
    max_faces: 200_000,
    max_memory_bytes: 64 << 20,
};

/// Reads any bytes as `format`, and holds the reader to what it promises of a mesh that it
/// accepts.
pub fn read_as(format: Format, bytes: &[u8]) {
    let Ok(mesh) = read(bytes, format, &LIMITS) else {
        return;
    };
    assert!(!mesh.positions.is_empty() && !mesh.faces.is_empty());
    assert!(mesh.positions.iter().flatten().all(|c| c.is_finite()));
    let count = mesh.positions.len() as u32;
    assert!(mesh.faces.iter().flatten().all(|&index| index < count));
}
