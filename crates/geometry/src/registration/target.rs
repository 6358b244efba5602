//! What a source is registered onto: a surface ready for queries.

use std::sync::Arc;

use crate::mesh::{face_normals, mean_edge};
use crate::spatial::{SurfacePoint, TriangleTree};
use crate::{Point, TriangleMesh, Vector};

use super::RegistrationError;

/// The current frame, prepared once for all the searches that registration makes on it.
#[derive(Debug)]
pub struct Target {
    tree: Arc<TriangleTree>,
    normals: Vec<Vector>,
    mean_edge: f64,
    diagonal: f64,
    centroid: Point,
}

impl Target {
    /// Prepares `mesh`.
    ///
    /// # Errors
    ///
    /// [`RegistrationError::Empty`] if it has no faces.
    pub fn new(mesh: &TriangleMesh) -> Result<Self, RegistrationError> {
        let tree = TriangleTree::new(mesh).ok_or(RegistrationError::Empty { which: "target" })?;
        Ok(Self::of_surface(mesh, Arc::new(tree)))
    }

    /// The same with the tree over the surface of `mesh` that is there already.
    #[must_use]
    pub fn of_surface(mesh: &TriangleMesh, tree: Arc<TriangleTree>) -> Self {
        let mean_edge = mean_edge(mesh);
        let diagonal = mesh.bounding_box().diagonal();
        let sum: Vector = mesh.positions().iter().map(|p| p.coords).sum();
        let centroid = Point::from(sum / mesh.vertex_count() as f64);
        Self {
            tree,
            normals: face_normals(mesh),
            mean_edge,
            diagonal,
            centroid,
        }
    }

    /// The closest point of the surface, and the unit normal of the face it is on.
    #[must_use]
    pub fn closest(&self, query: &Point) -> (SurfacePoint, Vector) {
        let found = self.tree.closest(query);
        (found, self.normals[found.face as usize])
    }

    /// The unit normal of a face; zero if it has none.
    ///
    /// # Panics
    ///
    /// If there is no such face.
    #[must_use]
    pub fn normal(&self, face: u32) -> Vector {
        self.normals[face as usize]
    }

    /// The tree over the surface.
    #[must_use]
    pub fn surface(&self) -> &TriangleTree {
        &self.tree
    }

    /// The mean length of the target's edges.
    #[must_use]
    pub fn mean_edge(&self) -> f64 {
        self.mean_edge
    }

    /// The diagonal of the target's bounding box.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        self.diagonal
    }

    /// The mean of the target's vertices.
    #[must_use]
    pub fn centroid(&self) -> Point {
        self.centroid
    }
}
