//! The mesh that everything behind the edge works on: checked once, valid ever after.

use std::sync::{Arc, OnceLock};

use nalgebra::Isometry3;

use crate::{Face, Point, Vector};

use super::{BoundingBox, Rows, Wedges, adjacency, edges, normals};

/// The largest coordinate magnitude that is accepted, in the mesh's own unit.
///
/// Far above any capture volume, and low enough that every product formed here stays
/// finite in `f64` and every position in the `f32` that is delivered.
pub const MAX_COORDINATE: f64 = 1e18;

/// An indexed triangle mesh whose positions are finite and whose indices are in range.
///
/// The connectivity is otherwise free: see [`repair`](super::repair) for what makes a
/// captured frame fit for simplification.
///
/// A mesh does not change, so that copies share its arrays, and what is derived from them (normals,
/// neighbors) is computed once, when it is first asked for, and kept with it. Meshes that differ
/// in their positions alone share what depends on the faces.
#[derive(Clone)]
pub struct TriangleMesh {
    shape: Arc<Shape>,
    topology: Arc<Topology>,
}

/// Where the vertices are, and what follows from that and the faces.
struct Shape {
    positions: Vec<Point>,
    mean_edge: OnceLock<f64>,
    face_normals: OnceLock<Vec<Vector>>,
    vertex_normals: OnceLock<Vec<Vector>>,
}

/// The faces, and what follows from them alone.
struct Topology {
    faces: Vec<Face>,
    wedges: Option<Wedges>,
    vertex_faces: OnceLock<Rows>,
    vertex_neighbors: OnceLock<Rows>,
}

impl PartialEq for TriangleMesh {
    fn eq(&self, other: &Self) -> bool {
        self.positions() == other.positions() && self.faces() == other.faces()
    }
}

impl std::fmt::Debug for TriangleMesh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TriangleMesh")
            .field("positions", &self.positions())
            .field("faces", &self.faces())
            .finish()
    }
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
        check_positions(&positions)?;
        let vertex_count = positions.len();
        for (face, corners) in faces.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&i| vertex_count <= i as usize) {
                return Err(InvalidMesh::Index {
                    face,
                    index,
                    vertex_count,
                });
            }
        }
        Ok(Self::of(positions, Arc::new(Topology::of(faces))))
    }

    /// A mesh of parts that are known to be valid, as they come out of another mesh.
    pub(crate) fn from_valid(positions: Vec<Point>, faces: Vec<Face>) -> Self {
        debug_assert!(
            faces
                .iter()
                .flatten()
                .all(|&i| (i as usize) < positions.len())
        );
        Self::of(positions, Arc::new(Topology::of(faces)))
    }

    fn of(positions: Vec<Point>, topology: Arc<Topology>) -> Self {
        let shape = Shape {
            positions,
            mean_edge: OnceLock::new(),
            face_normals: OnceLock::new(),
            vertex_normals: OnceLock::new(),
        };
        Self {
            shape: Arc::new(shape),
            topology,
        }
    }

    /// The vertex positions, in the mesh's own unit.
    #[must_use]
    #[inline]
    pub fn positions(&self) -> &[Point] {
        &self.shape.positions
    }

    /// The faces, as vertex indices.
    #[must_use]
    #[inline]
    pub fn faces(&self) -> &[Face] {
        &self.topology.faces
    }

    /// The number of vertices.
    #[must_use]
    #[inline]
    pub fn vertex_count(&self) -> usize {
        self.positions().len()
    }

    /// The number of faces.
    #[must_use]
    #[inline]
    pub fn face_count(&self) -> usize {
        self.faces().len()
    }

    /// The corner positions of face `index`.
    ///
    /// # Panics
    ///
    /// If `index` is not below [`face_count`](Self::face_count).
    #[must_use]
    #[inline]
    pub fn triangle(&self, index: usize) -> [Point; 3] {
        let positions = self.positions();
        self.faces()[index].map(|corner| positions[corner as usize])
    }

    /// The axis-aligned bounding box; of no extent at the origin for a mesh without vertices.
    #[must_use]
    pub fn bounding_box(&self) -> BoundingBox {
        BoundingBox::of(self.positions())
    }

    /// What the corners of the faces share besides their vertices, if anybody has said so.
    #[must_use]
    pub fn wedges(&self) -> Option<&Wedges> {
        self.topology.wedges.as_ref()
    }

    /// The same mesh with these wedges, which are its own: they take part in its simplification,
    /// and in nothing else.
    ///
    /// # Panics
    ///
    /// If there are not as many of their faces as of the mesh's.
    #[must_use]
    pub fn with_wedges(mut self, wedges: Wedges) -> Self {
        assert_eq!(self.face_count(), wedges.corners().len(), "three a face");
        if let Some(topology) = Arc::get_mut(&mut self.topology) {
            topology.wedges = Some(wedges);
            return self;
        }
        let mut topology = Topology::of(self.faces().to_vec());
        topology.wedges = Some(wedges);
        Self {
            shape: self.shape,
            topology: Arc::new(topology),
        }
    }

    /// The same faces over moved vertices.
    ///
    /// # Errors
    ///
    /// [`InvalidMesh`] if a position is not usable.
    ///
    /// # Panics
    ///
    /// If there are not as many positions as vertices.
    pub fn with_positions(&self, positions: Vec<Point>) -> Result<Self, InvalidMesh> {
        assert_eq!(self.vertex_count(), positions.len(), "one for each vertex");
        check_positions(&positions)?;
        Ok(Self::of(positions, Arc::clone(&self.topology)))
    }

    /// The mesh moved as a whole. Its normals are those of this one, turned: whether anybody has asked
    /// for them must not show in a single bit.
    ///
    /// # Errors
    ///
    /// [`InvalidMesh`] if that takes a position out of range.
    pub fn moved(&self, motion: &Isometry3<f64>) -> Result<Self, InvalidMesh> {
        if *motion == Isometry3::identity() {
            return Ok(self.clone());
        }
        let positions = self.positions().iter().map(|p| motion * p).collect();
        let moved = self.with_positions(positions)?;
        let turned = self.vertex_normals().iter().map(|normal| motion * normal);
        // Nobody else has the new mesh yet.
        moved.shape.vertex_normals.set(turned.collect()).ok();
        Ok(moved)
    }

    /// The same mesh with every coordinate rounded to the `f32` in which frames are delivered.
    #[must_use]
    pub fn rounded_to_f32(&self) -> Self {
        let round = |c: f64| f64::from(c as f32);
        let positions = self.positions().iter().map(|p| p.map(round)).collect();
        Self::of(positions, Arc::clone(&self.topology))
    }

    /// The mean length of the edges, an edge counted once for every face on it; 0 without faces.
    #[must_use]
    pub fn mean_edge(&self) -> f64 {
        let make = || edges::mean_edge(self);
        *self.shape.mean_edge.get_or_init(make)
    }

    /// The unit normal of every face; zero where a face has none.
    #[must_use]
    pub fn face_normals(&self) -> &[Vector] {
        let make = || normals::face_normals(self);
        self.shape.face_normals.get_or_init(make)
    }

    /// The unit normal of every vertex, faces weighted by area; zero where none is defined.
    #[must_use]
    pub fn vertex_normals(&self) -> &[Vector] {
        let make = || normals::vertex_normals(self);
        self.shape.vertex_normals.get_or_init(make)
    }

    /// The faces around each vertex, in ascending order.
    #[must_use]
    pub fn vertex_faces(&self) -> &Rows {
        let make = || adjacency::vertex_faces(self);
        self.topology.vertex_faces.get_or_init(make)
    }

    /// The vertices that share an edge with each vertex (its one-ring), in ascending order.
    #[must_use]
    pub fn vertex_neighbors(&self) -> &Rows {
        let make = || adjacency::vertex_neighbors(self);
        self.topology.vertex_neighbors.get_or_init(make)
    }
}

impl Topology {
    fn of(faces: Vec<Face>) -> Self {
        Self {
            faces,
            wedges: None,
            vertex_faces: OnceLock::new(),
            vertex_neighbors: OnceLock::new(),
        }
    }
}

fn check_positions(positions: &[Point]) -> Result<(), InvalidMesh> {
    let vertex_count = positions.len();
    if u32::try_from(vertex_count).is_err() {
        return Err(InvalidMesh::TooManyVertices { vertex_count });
    }
    let usable = |p: &Point| p.iter().all(|c| c.abs() <= MAX_COORDINATE);
    match positions.iter().position(|p| !usable(p)) {
        None => Ok(()),
        Some(vertex) => {
            let p = positions[vertex];
            Err(InvalidMesh::Position {
                vertex,
                x: p.x,
                y: p.y,
                z: p.z,
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_of_a_moved_mesh_do_not_depend_on_who_asked_before() {
        let corners = [[0., 0., 0.], [1., 0., 0.3], [0., 1., 0.1], [0.2, 0.3, 1.]];
        let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let mesh = || {
            let positions = corners.map(Point::from).to_vec();
            TriangleMesh::new(positions, faces.clone()).unwrap()
        };
        let motion = Isometry3::new(Vector::new(3., -1., 2.), Vector::new(0.4, 0.9, -0.2));
        let (asked, new) = (mesh(), mesh());
        let before = asked.vertex_normals().to_vec();
        let (asked, new) = (asked.moved(&motion).unwrap(), new.moved(&motion).unwrap());
        assert_eq!(asked.vertex_normals(), new.vertex_normals());
        for (normal, before) in new.vertex_normals().iter().zip(before) {
            assert!((normal - motion * before).norm() < 1e-12);
        }
    }

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
