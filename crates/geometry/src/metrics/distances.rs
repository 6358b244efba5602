//! The two distances of section 4.1 of the Tracked QEM paper.

use crate::Point;
use crate::spatial::{TriangleTree, VertexTree};

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
