//! The edge: from arrays that came from outside to a mesh that everything behind works on.

use std::sync::{Arc, OnceLock};

use steadymesh_geometry::mesh::repair::repair;
use steadymesh_geometry::mesh::{BoundingBox, InvalidMesh};
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_proto::metrics::Input;

use super::{Stage, StageObserver};

/// The smallest number of faces of a frame: a closed surface has no fewer.
pub const MIN_FACES: usize = 4;

/// A frame as it was parsed, not checked yet.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RawFrame {
    /// Vertex positions.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices of every face.
    pub faces: Vec<[u32; 3]>,
    /// The length of the body it came in, in bytes.
    pub byte_count: usize,
}

/// Why a frame cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UnusableFrame {
    /// A position or an index is not usable.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// Too little is left to be simplified or registered.
    #[error(
        "too few usable faces: {faces} of {received}, the others being degenerate or duplicate; a \
         frame needs at least {MIN_FACES}"
    )]
    TooFewFaces {
        /// Faces after repair.
        faces: usize,
        /// Faces as received.
        received: usize,
    },
}

/// A frame that has passed the edge.
#[derive(Debug, Clone)]
pub struct PreparedFrame {
    mesh: TriangleMesh,
    /// Made when it is first asked for: it takes part in this frame's registration and in the
    /// next one's.
    surface: OnceLock<Option<Arc<TriangleTree>>>,
    bounds: BoundingBox,
    input: Input,
}

impl PreparedFrame {
    /// Checks and repairs a frame.
    ///
    /// # Errors
    ///
    /// [`UnusableFrame`] names the vertex, face or count that is not usable.
    pub fn new(raw: RawFrame, observer: &mut impl StageObserver) -> Result<Self, UnusableFrame> {
        let positions = raw.positions.into_iter().map(Point::from).collect();
        let received = TriangleMesh::new(positions, raw.faces)?;
        let repaired = repair(&received);
        observer.ended(Stage::Repair);
        let (faces, mesh, report) = (repaired.mesh.face_count(), repaired.mesh, repaired.report);
        if faces < MIN_FACES {
            return Err(UnusableFrame::TooFewFaces {
                faces,
                received: received.face_count(),
            });
        }
        let input = Input {
            vertices: received.vertex_count(),
            faces: received.face_count(),
            bytes: raw.byte_count,
            welded_vertices: report.welded_vertices,
            removed_faces: report.removed_faces(),
            non_manifold_edges: report.non_manifold_edges,
            unreferenced_vertices: report.unreferenced_vertices,
        };
        Ok(Self {
            bounds: mesh.bounding_box(),
            mesh,
            surface: OnceLock::new(),
            input,
        })
    }

    /// The repaired mesh.
    #[must_use]
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// The tree over the repaired mesh's surface; none if it has no faces, which does not come
    /// this far.
    pub(super) fn surface(&self) -> Option<&Arc<TriangleTree>> {
        let make = || TriangleTree::new(&self.mesh).map(Arc::new);
        self.surface.get_or_init(make).as_ref()
    }

    /// The repaired mesh's bounding box.
    #[must_use]
    pub fn bounds(&self) -> BoundingBox {
        self.bounds
    }

    /// What came in, and what repair did to it.
    #[must_use]
    pub fn input(&self) -> &Input {
        &self.input
    }
}
