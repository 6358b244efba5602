//! Whether the same vertices and edges come back from one result to the next.

use crate::mesh::{Edge, EdgeTable};
use crate::spatial::{TriangleTree, VertexTree, closest_to_vertices};
use crate::{Point, TriangleMesh};

use super::surface_distances;

/// How much of the previous result, carried along, is found again in the next one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Consistency {
    /// The share of the next result's vertices that are within a tenth of its mean edge of a
    /// carried vertex, 0 to 1.
    pub vertex_persistence: f64,
    /// The share of the carried edges that are there again between the vertices of the next
    /// result that are nearest to their ends, 0 to 1.
    pub edge_persistence: f64,
    /// The mean distance between the two surfaces: from the vertices and face centers of each to
    /// the other one, and the mean of both directions. In the meshes' unit.
    pub flicker: f64,
}

/// Which parts of a mesh were there before.
#[derive(Debug, Clone, PartialEq)]
pub struct Persistence {
    /// Of each vertex of the next result: whether it is within a tenth of its mean edge of a
    /// carried one.
    pub vertices: Vec<bool>,
    /// The edges of the next result, ascending, and whether each is a carried edge found again.
    pub edges: Vec<(Edge, bool)>,
    /// The share of the carried edges that were found again, 0 to 1. Several may have become one.
    pub found_edge_share: f64,
}

/// A vertex persists within this share of the mean edge.
const PERSISTENCE_RADIUS: f64 = 0.1;

/// Compares `carried`, the previous result at its carried positions, with `next`.
///
/// `None` if one of them has no faces.
#[must_use]
pub fn consistency(carried: &TriangleMesh, next: &TriangleMesh) -> Option<Consistency> {
    consistency_with_surface(carried, &TriangleTree::new(next)?, usize::MAX)
}

/// The same where the surface of `next` is there already, and with the flicker from at most about
/// `max_samples` of the vertices and face centers of each.
#[must_use]
pub fn consistency_with_surface(
    carried: &TriangleMesh,
    next_surface: &TriangleTree,
    max_samples: usize,
) -> Option<Consistency> {
    let next = next_surface.mesh();
    let carried_surface = TriangleTree::new(carried)?;
    let persistence = persistence(carried, next)?;
    let persisting = persistence.vertices.iter().filter(|persists| **persists);
    let to_next = mean_distance(carried, next_surface, max_samples);
    let to_carried = mean_distance(next, &carried_surface, max_samples);
    Some(Consistency {
        vertex_persistence: persisting.count() as f64 / next.vertex_count() as f64,
        edge_persistence: persistence.found_edge_share,
        flicker: (to_next + to_carried) / 2.0,
    })
}

/// Finds `carried`, the previous result at its carried positions, again in `next`.
///
/// `None` if one of them has no faces.
#[must_use]
pub fn persistence(carried: &TriangleMesh, next: &TriangleMesh) -> Option<Persistence> {
    let carried_vertices = VertexTree::new(carried.positions())?;
    let radius = PERSISTENCE_RADIUS * next.mean_edge();
    let persists = |vertex: &Point| carried_vertices.nearest(vertex).1 <= radius;
    let vertices = next.positions().iter().map(persists).collect();

    let next_vertices = VertexTree::new(next.positions())?;
    let matches: Vec<u32> = carried
        .positions()
        .iter()
        .map(|vertex| next_vertices.nearest(vertex).0)
        .collect();
    let before = EdgeTable::of(carried.faces());
    let table = EdgeTable::of(next.faces());
    let mut edges: Vec<(Edge, bool)> = table.iter().map(|(edge, _)| (edge, false)).collect();
    let (mut found, mut count) = (0, 0);
    for (edge, _) in before.iter() {
        count += 1;
        let (a, b) = (matches[edge.0 as usize], matches[edge.1 as usize]);
        if a == b {
            continue;
        }
        if let Ok(place) = edges.binary_search_by_key(&Edge::new(a, b), |(edge, _)| *edge) {
            edges[place].1 = true;
            found += 1;
        }
    }
    (0 < count).then(|| Persistence {
        vertices,
        edges,
        found_edge_share: f64::from(found) / f64::from(count),
    })
}

/// From the vertices and face centers of `from`, or at most about `max_samples` of them.
fn mean_distance(from: &TriangleMesh, to: &TriangleTree, max_samples: usize) -> f64 {
    let count = from.vertex_count() + from.face_count();
    let stride = count.div_ceil(max_samples.max(1));
    let center = |face: usize| {
        let [a, b, c] = from.triangle(face).map(|corner| corner.coords);
        Point::from((a + b + c) / 3.0)
    };
    if 1 < stride {
        let vertices = from.positions().iter().copied();
        let samples = vertices.chain((0..from.face_count()).map(center));
        let samples: Vec<Point> = samples.step_by(stride).collect();
        return surface_distances(&samples, to).iter().sum::<f64>() / samples.len() as f64;
    }
    let vertices = closest_to_vertices(from, to);
    let of_vertices = vertices.iter().map(|found| found.distance);
    // A center is looked for where one of its corners was found.
    let of_centers = from.faces().iter().enumerate().map(|(index, face)| {
        let near = vertices[face[0] as usize].face;
        to.closest_from(&center(index), near).distance
    });
    let sum: f64 = of_vertices.chain(of_centers).sum();
    sum / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    /// A unit square of two triangles, cut along one diagonal or the other.
    fn square(other_diagonal: bool) -> TriangleMesh {
        let corners = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        let faces = if other_diagonal {
            vec![[0, 1, 3], [1, 2, 3]]
        } else {
            vec![[0, 1, 2], [0, 2, 3]]
        };
        TriangleMesh::new(corners.map(Point::from).to_vec(), faces).unwrap()
    }

    #[test]
    fn the_same_mesh_persists_wholly_and_does_not_flicker() {
        let found = consistency(&square(false), &square(false)).unwrap();
        assert_eq!(
            (found.vertex_persistence, found.edge_persistence),
            (1.0, 1.0)
        );
        // Face centers are a rounding off their faces.
        assert!(found.flicker < 1e-15);
    }

    #[test]
    fn a_flipped_diagonal_is_one_of_five_edges() {
        let found = consistency(&square(false), &square(true)).unwrap();
        assert!((found.edge_persistence - 0.8).abs() < 1e-12);
        assert_eq!(found.vertex_persistence, 1.0);
    }

    #[test]
    fn a_lifted_mesh_flickers_by_its_height() {
        let mesh = square(false);
        let lifted = mesh.positions().iter().map(|p| p + Vector::z() * 0.5);
        let lifted = mesh.with_positions(lifted.collect()).unwrap();
        let found = consistency(&mesh, &lifted).unwrap();
        assert_eq!((found.vertex_persistence, found.flicker), (0.0, 0.5));
        assert_eq!(found.edge_persistence, 1.0);
    }

    #[test]
    fn a_flicker_from_some_samples_is_about_that_from_all() {
        let grid = |height: &dyn Fn(f64) -> f64| {
            let at = |k: u32| (f64::from(k / 20), f64::from(k % 20));
            let positions = (0..400).map(at).map(|(x, y)| Point::new(x, y, height(x)));
            let faces = (0..380).filter(|k| k % 20 != 19).flat_map(|k| {
                let [a, b, c, d] = [k, k + 20, k + 21, k + 1];
                [[a, b, c], [a, c, d]]
            });
            TriangleMesh::new(positions.collect(), faces.collect()).unwrap()
        };
        let (flat, wavy) = (grid(&|_| 0.0), grid(&|x| 0.3 + 0.1 * x.sin()));
        let surface = TriangleTree::new(&wavy).unwrap();
        let flicker = |samples| {
            consistency_with_surface(&flat, &surface, samples)
                .unwrap()
                .flicker
        };
        let (all, some) = (flicker(usize::MAX), flicker(100));
        assert!(
            all != some && (all / some - 1.0).abs() < 0.05,
            "{all} {some}"
        );
    }

    #[test]
    fn the_edge_that_was_flipped_is_the_one_that_was_not_there_before() {
        let found = persistence(&square(false), &square(true)).unwrap();
        assert_eq!(found.vertices, [true; 4]);
        for (edge, was_there) in found.edges {
            assert_eq!(was_there, edge != Edge::new(1, 3), "{edge:?}");
        }
    }
}
