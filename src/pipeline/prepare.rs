//! The edge: from arrays that came from outside to a mesh that everything behind works on.

use std::sync::{Arc, OnceLock};

use steadymesh_geometry::mesh::repair::repair;
use steadymesh_geometry::mesh::{BoundingBox, InvalidMesh};
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_mesh_io::Mesh;
use steadymesh_proto::metrics::Input;

use super::attributes::{Attributes, CornerAttributes};
use super::{Stage, StageObserver};

/// The smallest number of faces of a frame: a closed surface has no fewer.
pub const MIN_FACES: usize = 4;

/// A frame as it was parsed, not checked yet.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RawFrame {
    /// The position of every point. Points at the same position become one vertex.
    pub positions: Vec<[f64; 3]>,
    /// The points at the corners of every face.
    pub faces: Vec<[u32; 3]>,
    /// What the points look like.
    pub attributes: Attributes,
    /// Points that stand for one vertex of the file with different attributes, but for the first
    /// of each vertex: they do not count as vertices.
    pub repeated_points: usize,
    /// Vertices of the file that have no point since no face refers to them.
    pub pointless_vertices: usize,
    /// Whether an image lies on it: its seams are kept where they are then, which costs closeness and
    /// steadiness and would be for nothing where nothing is to be seen.
    pub has_image: bool,
    /// The length of the body it came in, in bytes.
    pub byte_count: usize,
}

impl RawFrame {
    /// A mesh as it was read from `byte_count` bytes, with one value per point in every attribute.
    #[must_use]
    pub fn from_mesh(mesh: Mesh, byte_count: usize) -> Self {
        let has_image = mesh.image.is_some();
        let points = mesh.into_points();
        let mesh = points.mesh;
        Self {
            positions: mesh.positions,
            faces: mesh.faces,
            attributes: Attributes {
                normals: mesh.normals.map(|a| a.values),
                colors: mesh.colors.map(|a| a.values),
                texture_coordinates: mesh.texture_coordinates.map(|a| a.values),
                materials: mesh.materials.map(|a| a.values),
            },
            repeated_points: points.repeated,
            pointless_vertices: points.left_out,
            has_image,
            byte_count,
        }
    }
}

/// Why a frame cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UnusableFrame {
    /// A position or an index is not usable.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// An attribute must have one value per point.
    #[error("{found} {what} for {points} points")]
    AttributeCount {
        /// The attribute.
        what: &'static str,
        /// How many values it has.
        found: usize,
        /// How many points there are.
        points: usize,
    },
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
    attributes: Option<CornerAttributes>,
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
        check_counts(&raw.attributes, raw.positions.len())?;
        let positions = raw.positions.into_iter().map(Point::from).collect();
        let received = TriangleMesh::new(positions, raw.faces)?;
        let repaired = repair(&received);
        let (mut mesh, report) = (repaired.mesh, repaired.report);
        let mut attributes = None;
        if !raw.attributes.is_empty() {
            let has_materials = raw.attributes.materials.is_some();
            let mut of_corners = CornerAttributes::new(raw.attributes, repaired.corner_origins);
            if raw.has_image || has_materials {
                let wedges = of_corners.wedges(&mesh);
                mesh = mesh.with_wedges(wedges);
            } else {
                of_corners.leave_out_wedges(&mesh);
            }
            attributes = Some(of_corners);
        }
        observer.ended(Stage::Repair);
        let faces = mesh.face_count();
        if faces < MIN_FACES {
            return Err(UnusableFrame::TooFewFaces {
                faces,
                received: received.face_count(),
            });
        }
        let input = Input {
            vertices: received.vertex_count() + raw.pointless_vertices - raw.repeated_points,
            faces: received.face_count(),
            bytes: raw.byte_count,
            welded_vertices: report.welded_vertices.saturating_sub(raw.repeated_points),
            removed_faces: report.removed_faces(),
            non_manifold_edges: report.non_manifold_edges,
            unreferenced_vertices: report.unreferenced_vertices + raw.pointless_vertices,
        };
        Ok(Self {
            bounds: mesh.bounding_box(),
            mesh,
            attributes,
            surface: OnceLock::new(),
            input,
        })
    }

    /// The repaired mesh.
    #[must_use]
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// What the mesh's corners look like, if the frame said so.
    pub(super) fn attributes(&self) -> Option<&CornerAttributes> {
        self.attributes.as_ref()
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

fn check_counts(attributes: &Attributes, points: usize) -> Result<(), UnusableFrame> {
    let counts = [
        ("normals", attributes.normals.as_ref().map(Vec::len)),
        ("colors", attributes.colors.as_ref().map(Vec::len)),
        (
            "texture coordinates",
            attributes.texture_coordinates.as_ref().map(Vec::len),
        ),
        ("materials", attributes.materials.as_ref().map(Vec::len)),
    ];
    for (what, found) in counts {
        if let Some(found) = found.filter(|&found| found != points) {
            return Err(UnusableFrame::AttributeCount {
                what,
                found,
                points,
            });
        }
    }
    Ok(())
}
