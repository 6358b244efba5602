//! The undirected edges of a mesh and the faces on them.

use crate::{Face, TriangleMesh};

/// An undirected edge, the smaller vertex index first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Edge(pub u32, pub u32);

impl Edge {
    /// The edge between two vertices, in whichever order they are given.
    #[must_use]
    pub fn new(a: u32, b: u32) -> Self {
        Self(a.min(b), a.max(b))
    }

    /// The three edges of a face; edge `i` runs from corner `i` to corner `i + 1`.
    #[must_use]
    pub fn of_face([a, b, c]: Face) -> [Self; 3] {
        [Self::new(a, b), Self::new(b, c), Self::new(c, a)]
    }
}

/// Every edge of a mesh with the faces on it, edges ascending, faces ascending within an edge.
#[derive(Debug, Clone)]
pub struct EdgeTable {
    incidences: Vec<(Edge, u32)>,
}

impl EdgeTable {
    /// Collects the edges of `faces`. Degenerate faces contribute degenerate edges.
    #[must_use]
    pub fn of(faces: &[Face]) -> Self {
        let mut incidences = Vec::with_capacity(3 * faces.len());
        for (index, &face) in faces.iter().enumerate() {
            incidences.extend(Edge::of_face(face).map(|edge| (edge, index as u32)));
        }
        incidences.sort_unstable();
        Self { incidences }
    }

    /// The edges, each with the faces on it.
    pub fn iter(&self) -> impl Iterator<Item = (Edge, &[(Edge, u32)])> {
        self.incidences
            .chunk_by(|a, b| a.0 == b.0)
            .map(|chunk| (chunk[0].0, chunk))
    }

    /// The number of edges with just one face.
    #[must_use]
    pub fn boundary_count(&self) -> usize {
        self.iter().filter(|(_, faces)| faces.len() == 1).count()
    }

    /// The number of edges with more than two faces.
    #[must_use]
    pub fn non_manifold_count(&self) -> usize {
        self.iter().filter(|(_, faces)| 2 < faces.len()).count()
    }
}

/// The mean length of the edges of the faces, an edge counted once for every face on it; 0
/// without faces.
#[must_use]
pub fn mean_edge(mesh: &TriangleMesh) -> f64 {
    let perimeter = |face| {
        let [a, b, c] = mesh.triangle(face);
        (b - a).norm() + (c - b).norm() + (a - c).norm()
    };
    let sum: f64 = (0..mesh.face_count()).map(perimeter).sum();
    if mesh.face_count() == 0 {
        0.0
    } else {
        sum / (3 * mesh.face_count()) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_classified_by_how_many_faces_meet_there() {
        let table = EdgeTable::of(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        assert_eq!(table.non_manifold_count(), 1);
        assert_eq!(table.boundary_count(), 6);
    }
}
