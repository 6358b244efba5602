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
        sort(&mut incidences);
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

/// Sorts by the first vertex into buckets, and then what little is in each of them.
fn sort(incidences: &mut Vec<(Edge, u32)>) {
    let last = incidences.iter().map(|(edge, _)| edge.0).max();
    let vertex_count = last.map_or(0, |last| last as usize + 1);
    // Faces of a few vertices among very many would need more buckets than they are worth.
    if incidences.len() < vertex_count {
        incidences.sort_unstable();
        return;
    }
    let mut next = vec![0; vertex_count + 1];
    for (edge, _) in &*incidences {
        next[edge.0 as usize + 1] += 1;
    }
    for vertex in 0..vertex_count {
        next[vertex + 1] += next[vertex];
    }
    let mut sorted = vec![(Edge(0, 0), 0); incidences.len()];
    for &(edge, face) in &*incidences {
        let place: &mut usize = &mut next[edge.0 as usize];
        sorted[*place] = (edge, face);
        *place += 1;
    }
    // Every bucket's start has moved on to its end.
    let mut start = 0;
    for &end in &next[..vertex_count] {
        sorted[start..end].sort_unstable();
        start = end;
    }
    *incidences = sorted;
}

/// [`TriangleMesh::mean_edge`].
pub(super) fn mean_edge(mesh: &TriangleMesh) -> f64 {
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

    #[test]
    fn edges_are_in_order_whether_their_vertices_are_few_or_far_apart() {
        for far in [9, 4_000_000_000] {
            let faces = [[3, far, 1], [0, 3, 1], [2, 1, 0], [far, 3, 0]];
            let table = EdgeTable::of(&faces);
            let incidences: Vec<_> = table.iter().flat_map(|(_, on)| on.to_vec()).collect();
            assert!(incidences.is_sorted());
            assert_eq!(incidences.len(), 12);
        }
    }
}
