//! The two distances of section 4.1 of the Tracked QEM paper.

use crate::spatial::{TriangleTree, VertexTree, closest_to_vertices};
use crate::{Point, TriangleMesh};

/// Mesh-surface distance: from each of `points` to the closest point of a surface, exactly.
///
/// Section 4.1, item 1 ("cloud-mesh"): with the vertices of the simplified mesh as `points`
/// and the surface of frame k or of the registered frame k-1.
#[must_use]
pub fn surface_distances(points: &[Point], surface: &TriangleTree) -> Vec<f64> {
    points
        .iter()
        .map(|point| surface.closest(point).distance)
        .collect()
}

/// The same from all vertices of `mesh`, in less time.
#[must_use]
pub fn vertex_to_surface_distances(mesh: &TriangleMesh, surface: &TriangleTree) -> Vec<f64> {
    let found = closest_to_vertices(mesh, surface);
    found.iter().map(|nearest| nearest.distance).collect()
}

/// Nearest-vertex distance: from each of `points` to the closest vertex of a mesh.
///
/// Section 4.1, item 2 ("cloud-cloud").
#[must_use]
pub fn vertex_distances(points: &[Point], vertices: &VertexTree) -> Vec<f64> {
    points
        .iter()
        .map(|point| vertices.nearest(point).1)
        .collect()
}
