//! What a source is registered onto: a surface ready for queries.

use crate::mesh::{EdgeTable, face_normals};
use crate::spatial::{SurfacePoint, TriangleTree};
use crate::{Point, TriangleMesh, Vector};

use super::RegistrationError;

/// The current frame, prepared once for all the searches that registration makes on it.
#[derive(Debug)]
pub struct Target {
    tree: TriangleTree,
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
        let mean_edge = EdgeTable::of(mesh.faces()).mean_length(mesh);
        let diagonal = mesh.bounding_box().diagonal();
        let sum: Vector = mesh.positions().iter().map(|p| p.coords).sum();
        let centroid = Point::from(sum / mesh.vertex_count() as f64);
        Ok(Self {
            tree,
            normals: face_normals(mesh),
            mean_edge,
            diagonal,
            centroid,
        })
    }

    /// The closest point of the surface, and the unit normal of the face it is on.
    #[must_use]
    pub fn closest(&self, query: &Point) -> (SurfacePoint, Vector) {
        let found = self.tree.closest(query);
        (found, self.normals[found.face as usize])
    }

    /// The same, told a face that is probably near (see [`TriangleTree::closest_from`]).
    #[must_use]
    pub fn closest_from(&self, query: &Point, guess: u32) -> (SurfacePoint, Vector) {
        let found = self.tree.closest_from(query, guess);
        (found, self.normals[found.face as usize])
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
