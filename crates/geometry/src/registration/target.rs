//! What a source is registered onto: a surface ready for queries.

use std::sync::Arc;

use crate::spatial::{SurfacePoint, TriangleTree, near_vertices};
use crate::{Point, TriangleMesh, Vector};

use super::RegistrationError;

/// The current frame, prepared once for all the searches that registration makes on it.
#[derive(Debug)]
pub struct Target {
    mesh: TriangleMesh,
    tree: Arc<TriangleTree>,
    diagonal: f64,
    centroid: Point,
}

/// How close, in mean edges, a point straight below counts without a look at the rest.
const NEAR: f64 = 0.15;

/// The same for a vertex that is much further away than its neighbor.
const SURE: f64 = 0.015;

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
        let diagonal = mesh.bounding_box().diagonal();
        let sum: Vector = mesh.positions().iter().map(|p| p.coords).sum();
        let centroid = Point::from(sum / mesh.vertex_count() as f64);
        Self {
            mesh: mesh.clone(),
            tree,
            diagonal,
            centroid,
        }
    }

    /// The closest point of the surface, and the unit normal of the face it is on.
    #[must_use]
    pub fn closest(&self, query: &Point) -> (SurfacePoint, Vector) {
        let found = self.tree.closest(query);
        (found, self.normal(found.face))
    }

    /// About the same, found by walking from `guess` to the face that `query` is straight above, if
    /// that is closer than `limit` and a seventh of a mean edge. Where the way ends otherwise, the
    /// closest point of all.
    ///
    /// # Panics
    ///
    /// If there is no such face.
    pub(super) fn closest_near(&self, query: &Point, guess: u32, limit: f64) -> SurfacePoint {
        let near = limit.min(NEAR * self.mean_edge());
        self.tree.below_or_closest(query, guess, near)
    }

    /// The same for every vertex of `mesh`, from where a neighbor's was found.
    pub(super) fn near_vertices_of(&self, mesh: &TriangleMesh) -> Vec<SurfacePoint> {
        let distances = (SURE * self.mean_edge(), NEAR * self.mean_edge());
        near_vertices(mesh, &self.tree, distances)
    }

    /// The unit normal of a face; zero if it has none.
    ///
    /// # Panics
    ///
    /// If there is no such face.
    #[must_use]
    pub fn normal(&self, face: u32) -> Vector {
        self.mesh.face_normals()[face as usize]
    }

    /// The tree over the surface.
    #[must_use]
    pub fn surface(&self) -> &TriangleTree {
        &self.tree
    }

    /// The mean length of the target's edges.
    #[must_use]
    pub fn mean_edge(&self) -> f64 {
        self.mesh.mean_edge()
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
