//! Corners of faces that belong together: where a texture is cut, a vertex has several wedges.

use crate::{Face, TriangleMesh};

/// The wedges of a mesh.
///
/// A wedge is all the corners at one vertex that share their attributes. A vertex inside a chart
/// of a texture atlas has one, a vertex on a seam has one for each side of it.
///
/// # Source
///
/// The term is that of Hoppe, "Efficient implementation of progressive meshes", Computers &
/// Graphics 22(1), 1998, section 3.1, <https://doi.org/10.1016/S0097-8493(97)00081-2>.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wedges {
    /// For every face, the wedges at its corners.
    corners: Vec<Face>,
    /// The vertex of every wedge.
    vertices: Vec<u32>,
}

impl Wedges {
    /// Groups the corners of `mesh`: those at one vertex for which `key`, called with a face and a
    /// corner of it (0 to 2), is the same are one wedge. Wedges are numbered by vertex.
    #[must_use]
    pub fn by_key<K: PartialEq>(mesh: &TriangleMesh, key: impl Fn(usize, usize) -> K) -> Self {
        let mut corners = vec![[0; 3]; mesh.face_count()];
        let mut vertices = Vec::with_capacity(mesh.vertex_count());
        let mut here: Vec<(K, u32)> = Vec::new();
        for vertex in 0..mesh.vertex_count() as u32 {
            here.clear();
            for &face in mesh.vertex_faces().row(vertex as usize) {
                let face = face as usize;
                let of_face = mesh.faces()[face];
                for corner in (0..3).filter(|&corner| of_face[corner] == vertex) {
                    let key = key(face, corner);
                    let known = here.iter().find(|(other, _)| *other == key);
                    corners[face][corner] = known.map_or(vertices.len() as u32, |known| known.1);
                    if known.is_none() {
                        here.push((key, vertices.len() as u32));
                        vertices.push(vertex);
                    }
                }
            }
        }
        Self { corners, vertices }
    }

    /// Of parts that are known to fit together, as they come out of other wedges.
    pub(crate) fn from_valid(corners: Vec<Face>, vertices: Vec<u32>) -> Self {
        Self { corners, vertices }
    }

    /// For every face of the mesh, the wedges at its corners.
    #[must_use]
    pub fn corners(&self) -> &[Face] {
        &self.corners
    }

    /// For every wedge, its vertex.
    #[must_use]
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// The number of wedges.
    #[must_use]
    pub fn count(&self) -> usize {
        self.vertices.len()
    }
}
