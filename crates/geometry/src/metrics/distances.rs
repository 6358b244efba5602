//! The two distances of section 4.1 of the Tracked QEM paper.

use crate::spatial::{SurfacePoint, TriangleTree, VertexTree, lowest_neighbors};
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

/// The same from all vertices of `mesh`: each is looked for where one of its neighbors was found.
#[must_use]
pub fn vertex_to_surface_distances(mesh: &TriangleMesh, surface: &TriangleTree) -> Vec<f64> {
    let found = vertex_closest_points(mesh, surface);
    found.iter().map(|nearest| nearest.distance).collect()
}

/// The closest points themselves, found in the same way.
#[must_use]
pub fn vertex_closest_points(mesh: &TriangleMesh, surface: &TriangleTree) -> Vec<SurfacePoint> {
    let mut found: Vec<SurfacePoint> = Vec::with_capacity(mesh.vertex_count());
    for (point, neighbor) in mesh.positions().iter().zip(lowest_neighbors(mesh)) {
        // A vertex that is its own lowest neighbor has not been looked for yet.
        found.push(match found.get(neighbor as usize) {
            Some(near) => surface.closest_from(point, near.face),
            None => surface.closest(point),
        });
    }
    found
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
