//! A frame's result, as the next frame is held to it.

use std::borrow::Cow;
use std::sync::Arc;

use steadymesh_draco::DecodeLimits;
use steadymesh_geometry::mesh::InvalidMesh;
use steadymesh_geometry::mesh::repair::weld_exact;
use steadymesh_geometry::spatial::{SurfacePoint, TriangleTree, closest_to_vertices};
use steadymesh_geometry::{Face, Point, TriangleMesh};

use super::ProcessFailed;

/// What became of a frame. Copies share the arrays.
#[derive(Debug, Clone)]
pub struct Output {
    /// The simplified mesh as players see it: decoded from Draco.
    pub mesh: TriangleMesh,
    /// The points of the frame's own surface that are closest to its vertices, if they are known:
    /// they are measured, and the next frame needs them again.
    pub(super) feet: Option<Arc<[SurfacePoint]>>,
}

impl Output {
    /// Reads what was delivered.
    ///
    /// # Errors
    ///
    /// [`ProcessFailed`] if it is no mesh in Draco.
    pub fn decode(draco: &[u8]) -> Result<Self, ProcessFailed> {
        // Our own bytes: the limits are there to be given, not to be reached.
        let limits = DecodeLimits {
            max_vertices: usize::MAX,
            max_faces: usize::MAX,
            max_memory_bytes: usize::MAX,
        };
        let decoded = steadymesh_draco::decode(draco, &limits)?;
        let positions = decoded
            .positions
            .iter()
            .map(|p| Point::from(p.map(f64::from)))
            .collect();
        let mesh = TriangleMesh::new(positions, decoded.faces)?;
        // Seams repeat vertices; what holds the next frame is the surface.
        Ok(
            if decoded.texture_coordinates.is_some() || decoded.materials.is_some() {
                welded(&mesh)?.into()
            } else {
                mesh.into()
            },
        )
    }

    /// With the points of `surface`, that of its frame, below its vertices.
    pub(super) fn on(surface: &TriangleTree, mesh: TriangleMesh) -> Self {
        Self {
            feet: Some(closest_to_vertices(&mesh, surface).into()),
            mesh,
        }
    }

    /// The points of its frame's surface below its vertices.
    pub(super) fn feet_on(&self, surface: &TriangleTree) -> Cow<'_, [SurfacePoint]> {
        match &self.feet {
            Some(feet) => Cow::Borrowed(feet),
            None => Cow::Owned(closest_to_vertices(&self.mesh, surface)),
        }
    }
}

impl From<TriangleMesh> for Output {
    fn from(mesh: TriangleMesh) -> Self {
        Self { mesh, feet: None }
    }
}

/// The same mesh with one vertex for all at exactly the same position.
fn welded(mesh: &TriangleMesh) -> Result<TriangleMesh, InvalidMesh> {
    let first = weld_exact(mesh.positions());
    let mut numbers = vec![0; first.len()];
    let mut positions = Vec::with_capacity(first.len());
    for (vertex, &first) in first.iter().enumerate() {
        numbers[vertex] = if first as usize == vertex {
            positions.push(mesh.positions()[vertex]);
            positions.len() as u32 - 1
        } else {
            numbers[first as usize]
        };
    }
    let renumbered = |face: &Face| face.map(|vertex| numbers[vertex as usize]);
    TriangleMesh::new(positions, mesh.faces().iter().map(renumbered).collect())
}
