//! The points of a surface that a mesh's vertices stand on.

use crate::{Point, TriangleMesh};

use super::{SurfacePoint, TriangleTree, straight_walk};

/// What is so much further from the surface than its neighbor may have been led to another sheet.
const LARGEST_GROWTH: f64 = 3.0;

/// For every vertex of `mesh` the point of `surface` below it, on the sheet on which its neighbors
/// are: found by walking from where a neighbor's was. Where the way ends on no face, further away
/// than `reach`, or much further away than the neighbor and than `sure`, it is the closest point of
/// all: neighbors may be on the surface by chance.
pub(crate) fn near_vertices(
    mesh: &TriangleMesh,
    surface: &TriangleTree,
    (sure, reach): (f64, f64),
) -> Vec<SurfacePoint> {
    from_neighbors(mesh, surface, |position, near| {
        match straight_walk(surface.mesh(), position, near.face) {
            Ok(below)
                if below.distance <= (LARGEST_GROWTH * near.distance).max(sure).min(reach) =>
            {
                below
            }
            Ok(SurfacePoint { face, .. }) | Err(face) => surface.closest_from(position, face),
        }
    })
}

/// The point of `surface` closest to every vertex of `mesh`, each looked for from where a neighbor's
/// was found.
#[must_use]
pub fn closest_to_vertices(mesh: &TriangleMesh, surface: &TriangleTree) -> Vec<SurfacePoint> {
    from_neighbors(mesh, surface, |position, near| {
        surface.closest_from(position, near.face)
    })
}

/// What `look` finds for every vertex of `mesh`, given its position and what it found for a neighbor.
fn from_neighbors(
    mesh: &TriangleMesh,
    surface: &TriangleTree,
    look: impl Fn(&Point, &SurfacePoint) -> SurfacePoint,
) -> Vec<SurfacePoint> {
    let mut found: Vec<SurfacePoint> = Vec::with_capacity(mesh.vertex_count());
    for (position, neighbor) in mesh.positions().iter().zip(lowest_neighbors(mesh)) {
        found.push(match found.get(neighbor as usize) {
            Some(near) => look(position, near),
            // A vertex that is lower than its neighbors.
            None => surface.closest(position),
        });
    }
    found
}

/// The lowest-numbered neighbor of every vertex, or the vertex itself where that is lower.
fn lowest_neighbors(mesh: &TriangleMesh) -> Vec<u32> {
    let mut lowest: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    for face in mesh.faces() {
        let first = face[0].min(face[1]).min(face[2]);
        for &corner in face {
            let neighbor = &mut lowest[corner as usize];
            *neighbor = first.min(*neighbor);
        }
    }
    lowest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two waves, one above the other, as one mesh.
    fn waves(lift: f64) -> TriangleMesh {
        const SIDE: u32 = 30;
        let corners = (0..2 * SIDE * SIDE).map(|k| (k / SIDE % SIDE, k % SIDE, k / SIDE / SIDE));
        let positions = corners.map(|(x, y, sheet)| {
            let (x, y) = (f64::from(x), f64::from(y));
            Point::new(x, y, 0.6 * (0.3 * x).sin() + f64::from(sheet) + lift)
        });
        let cells =
            (0..2 * SIDE * SIDE).filter(|k| k % SIDE < SIDE - 1 && k / SIDE % SIDE < SIDE - 1);
        let faces = cells.flat_map(|k| {
            let [a, b, c, d] = [k, k + SIDE, k + SIDE + 1, k + 1];
            [[a, b, c], [a, c, d]]
        });
        TriangleMesh::new(positions.collect(), faces.collect()).unwrap()
    }

    #[test]
    fn close_to_a_surface_the_points_below_are_about_the_closest_and_never_closer() {
        let surface = TriangleTree::new(&waves(0.0)).unwrap();
        let mesh = waves(0.05);
        let (below, closest) = (
            near_vertices(&mesh, &surface, (0.015, 0.15)),
            closest_to_vertices(&mesh, &surface),
        );
        let mut sums = (0.0, 0.0);
        for (below, closest) in below.iter().zip(&closest) {
            assert!(closest.distance <= below.distance + 1e-12);
            sums = (sums.0 + below.distance, sums.1 + closest.distance);
        }
        assert!(sums.0 < 1.01 * sums.1, "{sums:?}");
    }

    #[test]
    fn beyond_its_reach_a_walk_does_not_count() {
        let surface = TriangleTree::new(&waves(0.0)).unwrap();
        // Nearer to the upper wave than to the one that its neighbors' walk is on.
        let mesh = waves(0.8);
        let found = near_vertices(&mesh, &surface, (0.015, 0.15));
        let closest = closest_to_vertices(&mesh, &surface);
        for (found, closest) in found.iter().zip(&closest) {
            assert!((found.distance - closest.distance).abs() < 1e-12);
        }
    }
}
