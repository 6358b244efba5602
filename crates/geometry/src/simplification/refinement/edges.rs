//! Faces whose edges can be flipped.

use crate::{Face, TriangleMesh};

/// Faces, and which are around each vertex.
pub(super) struct FlippableFaces {
    faces: Vec<Face>,
    /// The wedges at the faces' corners, if there are any.
    wedges: Option<Vec<Face>>,
    around: Vec<Vec<u32>>,
}

/// Two faces over one edge, whose other corners a flip would connect.
///
/// ```text
///     v            v
///    / \          /|\
///   r---s   to   r | s
///    \ /          \|/
///     u            u
/// ```
#[derive(Debug, Clone, Copy)]
pub(super) struct Quad {
    /// `(u, s, r)`, and after the flip `(u, s, v)`.
    pub first: u32,
    /// `(v, r, s)`, and after the flip `(u, v, r)`.
    pub second: u32,
    /// The corners u, s, v, r, in the direction of the faces.
    pub corners: [u32; 4],
}

/// A flip leaves no vertex with fewer faces than this.
const MIN_VALENCE: usize = 3;

impl FlippableFaces {
    pub fn new(mesh: &TriangleMesh) -> Self {
        let around = mesh.vertex_faces();
        Self {
            faces: mesh.faces().to_vec(),
            wedges: mesh.wedges().map(|wedges| wedges.corners().to_vec()),
            around: (0..mesh.vertex_count())
                .map(|vertex| around.row(vertex).to_vec())
                .collect(),
        }
    }

    /// The faces, and the wedges at their corners if there are any.
    pub fn into_parts(self) -> (Vec<Face>, Option<Vec<Face>>) {
        (self.faces, self.wedges)
    }

    /// Whether two vertices share an edge.
    pub fn are_connected(&self, u: u32, v: u32) -> bool {
        let mut around = self.around[u as usize].iter();
        around.any(|&face| self.faces[face as usize].contains(&v))
    }

    /// The faces between `u` and `v`, which share no edge, if flipping the edge between those
    /// would connect them and leave a manifold.
    pub fn quad_between(&self, u: u32, v: u32) -> Option<Quad> {
        for &first in &self.around[u as usize] {
            let (s, r) = opposite(self.faces[first as usize], u)?;
            let mut others = self.around[s as usize]
                .iter()
                .filter(|&&face| face != first && self.faces[face as usize].contains(&r));
            let (Some(&second), None) = (others.next(), others.next()) else {
                continue;
            };
            if opposite(self.faces[second as usize], v) != Some((r, s)) {
                continue;
            }
            // A flip across a seam would put faces on both sides of it.
            let is_seam = |vertex| {
                let [first, second] = [first, second].map(|face| self.wedge(face, vertex));
                first != second
            };
            if is_seam(s) || is_seam(r) {
                return None;
            }
            let loses = |vertex: u32| MIN_VALENCE < self.around[vertex as usize].len();
            return (loses(s) && loses(r)).then_some(Quad {
                first,
                second,
                corners: [u, s, v, r],
            });
        }
        None
    }

    /// The wedge of a face at one of its vertices, if there are wedges.
    fn wedge(&self, face: u32, vertex: u32) -> Option<u32> {
        let corners = self.wedges.as_ref()?[face as usize];
        let place = self.faces[face as usize]
            .iter()
            .position(|&c| c == vertex)?;
        Some(corners[place])
    }

    /// Flips the edge between s and r to one between u and v.
    pub fn flip(&mut self, quad: &Quad) {
        let Quad {
            first,
            second,
            corners: [u, s, v, r],
        } = *quad;
        if let [Some(of_u), Some(of_s), Some(of_v), Some(of_r)] = [
            self.wedge(first, u),
            self.wedge(first, s),
            self.wedge(second, v),
            self.wedge(second, r),
        ] && let Some(wedges) = &mut self.wedges
        {
            wedges[first as usize] = [of_u, of_s, of_v];
            wedges[second as usize] = [of_u, of_v, of_r];
        }
        self.faces[first as usize] = [u, s, v];
        self.faces[second as usize] = [u, v, r];
        self.around[u as usize].push(second);
        self.around[v as usize].push(first);
        self.around[s as usize].retain(|&face| face != second);
        self.around[r as usize].retain(|&face| face != first);
    }
}

/// The other two corners, in the face's direction, if `vertex` is one of them.
fn opposite([a, b, c]: Face, vertex: u32) -> Option<(u32, u32)> {
    if a == vertex {
        Some((b, c))
    } else if b == vertex {
        Some((c, a))
    } else if c == vertex {
        Some((a, b))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;

    fn faces(faces: &[Face]) -> FlippableFaces {
        let mesh = TriangleMesh::new(vec![Point::origin(); 6], faces.to_vec()).unwrap();
        FlippableFaces::new(&mesh)
    }

    /// A square, u = 0, s = 1, v = 2, r = 3, with faces around it so that its corners may lose one.
    const RING: [Face; 6] = [
        [0, 1, 3],
        [2, 3, 1],
        [1, 0, 4],
        [1, 4, 2],
        [3, 2, 5],
        [3, 5, 0],
    ];

    #[test]
    fn a_flipped_edge_connects_what_was_opposite_and_can_be_flipped_back() {
        let mut ring = faces(&RING);
        assert!(!ring.are_connected(0, 2));
        let quad = ring.quad_between(0, 2).unwrap();
        ring.flip(&quad);
        assert!(ring.are_connected(0, 2) && !ring.are_connected(1, 3));
        let back = ring.quad_between(1, 3).unwrap();
        ring.flip(&back);
        let sorted = |mut faces: Vec<Face>| {
            for face in &mut faces {
                let first = (0..3).min_by_key(|&corner| face[corner]).unwrap_or(0);
                face.rotate_left(first);
            }
            faces.sort_unstable();
            faces
        };
        assert_eq!(sorted(ring.into_parts().0), sorted(RING.to_vec()));
    }

    #[test]
    fn an_edge_is_not_flipped_where_a_vertex_would_lose_its_third_face() {
        assert!(faces(&RING[..4]).quad_between(0, 2).is_none());
    }

    #[test]
    fn an_edge_whose_faces_turn_against_each_other_is_not_flipped() {
        let mut turned = RING;
        turned[1] = [2, 1, 3];
        assert!(faces(&turned).quad_between(0, 2).is_none());
    }
}
