//! Makes a captured frame fit for registration and simplification.
//!
//! Captured frames come with texture seams that cut the surface (each chart has its own copy
//! of a vertex), a few faces without area, and a few edges with three or four faces. In order:
//!
//! 1. [`weld`]: vertices at exactly the same position become one.
//! 2. [`faces`]: faces that name a vertex twice, and all but the first of the faces over the
//!    same three vertices, are dropped.
//! 3. [`needles`]: a face whose corners lie on one line gives way to its neighbor by an edge
//!    flip, so that nothing tears.
//! 4. [`non_manifold`]: sheets that merely touch along an edge are taken apart there.
//! 5. Vertices that no face refers to are dropped.
//!
//! The surface stays where it was: apart from step 4's last resort, which drops the smallest
//! face on an edge that cannot be taken apart, no point is added to it or removed from it.

mod faces;
mod needles;
mod non_manifold;
mod weld;

use crate::{Face, TriangleMesh};

pub use weld::weld_exact;

/// What [`repair`] found and did, in counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RepairReport {
    /// Vertices merged into another one at exactly the same position.
    pub welded_vertices: usize,
    /// Faces dropped because two corners are one vertex or all three lie on one line.
    pub degenerate_faces: usize,
    /// Faces dropped because an earlier face has the same three vertices.
    pub duplicate_faces: usize,
    /// Faces without area that an edge flip turned into one with area.
    pub flipped_faces: usize,
    /// Edges found with more than two faces.
    pub non_manifold_edges: usize,
    /// Vertices added in taking sheets apart along such edges.
    pub split_vertices: usize,
    /// Faces dropped where such an edge could not be taken apart.
    pub non_manifold_faces: usize,
    /// Vertices dropped because no face refers to them.
    pub unreferenced_vertices: usize,
}

impl RepairReport {
    /// All faces that were dropped, for whatever reason.
    #[must_use]
    pub fn removed_faces(&self) -> usize {
        self.degenerate_faces + self.duplicate_faces + self.non_manifold_faces
    }
}

/// A repaired mesh, and where its parts came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Repaired {
    /// The mesh: no duplicate positions except along opened sheets, no degenerate or duplicate
    /// faces, at most two faces on an edge, every vertex used.
    pub mesh: TriangleMesh,
    /// For every face of `mesh`, the vertices of the input at its corners. Charts of a texture
    /// atlas have different ones at the same vertex: this is what finds the seams again.
    pub corner_origins: Vec<Face>,
    /// What was done.
    pub report: RepairReport,
}

/// Repairs `mesh` as the [module](self) says. Deterministic; the order of vertices and faces
/// is kept.
#[must_use]
pub fn repair(mesh: &TriangleMesh) -> Repaired {
    let mut report = RepairReport::default();
    // Until the last step faces keep the input's vertices as corners; `welded` says which of
    // those are one.
    let welded = weld_exact(mesh.positions());
    report.welded_vertices = welded
        .iter()
        .enumerate()
        .filter(|&(i, &first)| i as u32 != first)
        .count();
    let mut corners = mesh.faces().to_vec();
    faces::drop_degenerate(&mut corners, &welded, &mut report);
    faces::drop_duplicates(&mut corners, &welded, &mut report);
    needles::flip_needles(mesh.positions(), &mut corners, &welded, &mut report);
    let split = non_manifold::separate(mesh.positions(), &mut corners, &welded, &mut report);
    compact(mesh, corners, &split, report)
}

/// Numbers the vertices in use in the order of the input, copies made by splitting last.
fn compact(
    mesh: &TriangleMesh,
    corner_origins: Vec<Face>,
    split: &non_manifold::Separated,
    mut report: RepairReport,
) -> Repaired {
    const UNUSED: u32 = u32::MAX;
    let mut used = vec![false; split.vertex_origins.len()];
    for &vertex in split.faces.iter().flatten() {
        used[vertex as usize] = true;
    }
    let mut numbers = vec![UNUSED; used.len()];
    let mut positions = Vec::with_capacity(used.len());
    for (vertex, _) in used.iter().enumerate().filter(|(_, used)| **used) {
        numbers[vertex] = positions.len() as u32;
        positions.push(mesh.positions()[split.vertex_origins[vertex] as usize]);
    }
    report.split_vertices = split.vertex_origins.len() - mesh.vertex_count();
    let kept = positions.len();
    report.unreferenced_vertices =
        mesh.vertex_count() + report.split_vertices - report.welded_vertices - kept;
    let faces = split
        .faces
        .iter()
        .map(|face| face.map(|v| numbers[v as usize]))
        .collect();
    Repaired {
        mesh: TriangleMesh::from_valid(positions, faces),
        corner_origins,
        report,
    }
}

#[cfg(test)]
mod tests;
