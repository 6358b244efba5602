//! The two distances of section 4.1 of the Tracked QEM paper.

use crate::spatial::{SurfacePoint, TriangleTree, VertexTree};
use crate::{Face, Point};

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

/// The same for all `points` of a mesh with these `faces`: a vertex is looked for where one of
/// its neighbors was found, which takes half the time.
///
/// # Panics
///
/// If a face refers to a point that does not exist.
#[must_use]
pub fn vertex_to_surface_distances(
    points: &[Point],
    faces: &[Face],
    surface: &TriangleTree,
) -> Vec<f64> {
    let found = vertex_closest_points(points, faces, surface);
    found.iter().map(|nearest| nearest.distance).collect()
}

/// The closest points themselves, found in the same way.
///
/// # Panics
///
/// If a face refers to a point that does not exist.
#[must_use]
pub fn vertex_closest_points(
    points: &[Point],
    faces: &[Face],
    surface: &TriangleTree,
) -> Vec<SurfacePoint> {
    let mut lowest_neighbors: Vec<u32> = (0..points.len() as u32).collect();
    for face in faces {
        let lowest = face[0].min(face[1]).min(face[2]);
        for &corner in face {
            let neighbor = &mut lowest_neighbors[corner as usize];
            *neighbor = lowest.min(*neighbor);
        }
    }
    let mut found: Vec<SurfacePoint> = Vec::with_capacity(points.len());
    for (point, neighbor) in points.iter().zip(lowest_neighbors) {
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
