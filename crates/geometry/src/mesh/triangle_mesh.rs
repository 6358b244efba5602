//! The mesh that everything behind the edge works on: checked once, valid ever after.

use crate::{Face, Point};

use super::BoundingBox;

/// The largest coordinate magnitude that is accepted, in the mesh's own unit.
///
/// Far above any capture volume, and low enough that every product formed here stays
/// finite in `f64` and every position in the `f32` that is delivered.
pub const MAX_COORDINATE: f64 = 1e18;

/// An indexed triangle mesh whose positions are finite and whose indices are in range.
///
/// The connectivity is otherwise free: see [`repair`](super::repair) for what makes a
/// captured frame fit for simplification.
#[derive(Debug, Clone, PartialEq)]
pub struct TriangleMesh {
    positions: Vec<Point>,
    faces: Vec<Face>,
}

/// Why positions and faces do not make a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidMesh {
    /// A coordinate is NaN, infinite, or beyond [`MAX_COORDINATE`].
    #[error(
        "vertex {vertex} is at ({x}, {y}, {z}): coordinates must be finite and below {MAX_COORDINATE:e}"
    )]
    Position {
        /// Index of the vertex, from 0.
        vertex: usize,
        /// Its x coordinate.
        x: f64,
        /// Its y coordinate.
        y: f64,
        /// Its z coordinate.
        z: f64,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} refers to vertex {index}, counted from 0, of {vertex_count}")]
    Index {
        /// Index of the face, from 0.
        face: usize,
        /// The vertex index that is out of range.
        index: u32,
        /// How many vertices there are.
        vertex_count: usize,
    },
    /// Vertex indices are 32 bits wide.
    #[error("{vertex_count} vertices, but indices are 32 bits wide")]
    TooManyVertices {
        /// How many vertices there are.
        vertex_count: usize,
    },
}

impl TriangleMesh {
    /// Checks `positions` and `faces` and makes a mesh of them.
    ///
    /// # Errors
    ///
    /// [`InvalidMesh`] names the first vertex or face that is not usable.
    pub fn new(positions: Vec<Point>, faces: Vec<Face>) -> Result<Self, InvalidMesh> {
        let vertex_count = positions.len();
        if u32::try_from(vertex_count).is_err() {
            return Err(InvalidMesh::TooManyVertices { vertex_count });
        }
        let usable = |p: &Point| p.iter().all(|c| c.abs() <= MAX_COORDINATE);
        if let Some(vertex) = positions.iter().position(|p| !usable(p)) {
            let p = positions[vertex];
            return Err(InvalidMesh::Position {
                vertex,
                x: p.x,
                y: p.y,
                z: p.z,
            });
        }
        for (face, corners) in faces.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&i| vertex_count <= i as usize) {
                return Err(InvalidMesh::Index {
                    face,
                    index,
                    vertex_count,
                });
            }
        }
        Ok(Self { positions, faces })
    }

    /// A mesh of parts that are known to be valid, as they come out of another mesh.
    pub(crate) fn from_valid(positions: Vec<Point>, faces: Vec<Face>) -> Self {
        debug_assert!(
            faces
                .iter()
                .flatten()
                .all(|&i| (i as usize) < positions.len())
        );
        Self { positions, faces }
    }

    /// The vertex positions, in the mesh's own unit.
    #[must_use]
    pub fn positions(&self) -> &[Point] {
        &self.positions
    }

    /// The faces, as vertex indices.
    #[must_use]
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// The number of vertices.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// The number of faces.
    #[must_use]
    pub fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// The corner positions of face `index`.
    ///
    /// # Panics
    ///
    /// If `index` is not below [`face_count`](Self::face_count).
    #[must_use]
    pub fn triangle(&self, index: usize) -> [Point; 3] {
        self.faces[index].map(|corner| self.positions[corner as usize])
    }

    /// The axis-aligned bounding box; of no extent at the origin for a mesh without vertices.
    #[must_use]
    pub fn bounding_box(&self) -> BoundingBox {
        BoundingBox::of(&self.positions)
    }

    /// The same faces over moved vertices.
    ///
    /// # Errors
    ///
    /// [`InvalidMesh`] if a position is not usable or a vertex is missing.
    pub fn with_positions(&self, positions: Vec<Point>) -> Result<Self, InvalidMesh> {
        Self::new(positions, self.faces.clone())
    }

    /// The same mesh with every coordinate rounded to the `f32` in which frames are delivered.
    #[must_use]
    pub fn rounded_to_f32(&self) -> Self {
        let round = |c: f64| f64::from(c as f32);
        let positions = self.positions.iter().map(|p| p.map(round)).collect();
        Self {
            positions,
            faces: self.faces.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_names_the_vertex_that_is_not_a_number() {
        let positions = vec![Point::origin(), Point::new(0.0, f64::NAN, 0.0)];
        let error = TriangleMesh::new(positions, vec![]).unwrap_err();
        assert!(matches!(error, InvalidMesh::Position { vertex: 1, .. }));
    }

    #[test]
    fn a_mesh_names_the_face_whose_index_is_out_of_range() {
        let positions = vec![Point::origin(); 3];
        let error = TriangleMesh::new(positions, vec![[0, 1, 2], [0, 1, 3]]).unwrap_err();
        assert_eq!(
            error,
            InvalidMesh::Index {
                face: 1,
                index: 3,
                vertex_count: 3
            }
        );
    }
}
