//! The reference of Tracked QEM: the registered previous frame, and what it adds to an edge.

use crate::mesh::face_normal;
use crate::spatial::VertexTree;
use crate::{Point, TriangleMesh};

use super::Quadric;

/// mesh^γ(k-1), prepared: its vertices' quadrics and a tree to find them.
pub(super) struct Reference {
    positions: Vec<Point>,
    quadrics: Vec<Quadric>,
    tree: VertexTree,
}

/// What the reference adds to one edge: Q_δ(1) + Q_δ(2), and the barycenter m_δ if there is one.
pub(super) struct Tracked {
    pub quadric: Quadric,
    pub barycenter: Option<Point>,
}

impl Reference {
    /// The quadrics of `mesh`, over `positions` in the units of the simplification; `None` for a
    /// mesh without vertices.
    pub fn new(mesh: &TriangleMesh, positions: Vec<Point>) -> Option<Self> {
        let tree = VertexTree::new(&positions)?;
        let quadrics = vertex_quadrics(mesh, &positions);
        Some(Self {
            positions,
            quadrics,
            tree,
        })
    }

    /// Gathers the reference around the edge between `v1` and `v2`.
    ///
    /// Every vertex closer to an endpoint than the edge is long, strictly, adds its quadric; one
    /// that is near both counts twice (Eq. 11 to 13). The barycenter is the mean of both
    /// neighborhoods' means (Eq. 16), or that of the only one that is not empty.
    pub fn around_edge(&self, v1: &Point, v2: &Point) -> Tracked {
        let square = (v2 - v1).norm_squared();
        let middle = nalgebra::center(v1, v2);
        let mut quadric = Quadric::default();
        let mut sums = [(nalgebra::Vector3::zeros(), 0usize); 2];
        // One search around the middle finds both neighborhoods; the margin is for rounding.
        let reach = 1.5 * square.sqrt() * (1.0 + 1e-9);
        self.tree.visit_within(&middle, reach, |index| {
            let position = self.positions[index as usize];
            for (endpoint, (sum, count)) in [v1, v2].into_iter().zip(&mut sums) {
                if (position - endpoint).norm_squared() < square {
                    quadric += self.quadrics[index as usize];
                    *sum += position.coords;
                    *count += 1;
                }
            }
        });
        let [first, second] =
            sums.map(|(sum, count)| (0 < count).then(|| Point::from(sum / count as f64)));
        let barycenter = match (first, second) {
            (Some(first), Some(second)) => Some(nalgebra::center(&first, &second)),
            (one, other) => one.or(other),
        };
        Tracked {
            quadric,
            barycenter,
        }
    }
}

/// Q_v of every vertex: the planes of the faces around it, each with weight 1 (Eq. 5). Faces
/// without a normal add nothing.
pub(super) fn vertex_quadrics(mesh: &TriangleMesh, positions: &[Point]) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::default(); positions.len()];
    for face in mesh.faces() {
        let corners = face.map(|corner| positions[corner as usize]);
        if let Some(normal) = face_normal(corners) {
            let plane = Quadric::of_plane(&corners[0], &normal, 1.0);
            face.iter()
                .for_each(|&corner| quadrics[corner as usize] += plane);
        }
    }
    quadrics
}
