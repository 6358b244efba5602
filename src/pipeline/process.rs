//! One frame, from its prepared mesh to what is delivered.

use steadymesh_draco::{DecodeLimits, MeshView};
use steadymesh_geometry::registration::{self, Registration, RegistrationError, Target};
use steadymesh_geometry::simplification::{self, simplify};
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::{Output, Tracking};

use super::{PreparedFrame, Settings, Stage, StageObserver, measure};

/// What becomes of a frame.
#[derive(Debug, Clone)]
pub struct ProcessedFrame {
    /// The frame's figures, but for its sequence numbers and times, which the caller knows.
    pub metrics: FrameMetrics,
    /// The simplified mesh in Draco.
    pub draco: Vec<u8>,
    /// The simplified mesh as players see it: decoded from `draco`.
    pub mesh: TriangleMesh,
    /// The previous frame, registered onto this one, in the precision in which it can be
    /// written; none for a first frame, without tracking, or if registration failed.
    pub registered: Option<TriangleMesh>,
}

/// Why a frame that passed the edge could not be processed: a defect, not a bad frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessFailed {
    /// Draco refused the simplified mesh.
    #[error("the simplified mesh could not be compressed: {0}")]
    Encode(#[from] steadymesh_draco::EncodeError),
    /// Draco could not read what it wrote.
    #[error("the compressed mesh could not be read back: {0}")]
    Decode(#[from] steadymesh_draco::DecodeError),
    /// What Draco read back is not a mesh.
    #[error("the compressed mesh is not one: {0}")]
    Mesh(#[from] steadymesh_geometry::mesh::InvalidMesh),
}

/// Registers `previous` onto `current`, simplifies `current` and measures the result.
///
/// A registration that fails does not lose the frame: it is simplified without tracking, and
/// its metrics say why.
///
/// # Errors
///
/// [`ProcessFailed`] if Draco refuses its part.
pub fn process(
    current: &PreparedFrame,
    previous: Option<&PreparedFrame>,
    settings: &Settings,
    observer: &mut impl StageObserver,
) -> Result<ProcessedFrame, ProcessFailed> {
    let mut metrics = FrameMetrics {
        input: current.input().clone(),
        bbox_diagonal: current.bounds().diagonal(),
        ..FrameMetrics::default()
    };
    let registered = match previous {
        Some(previous) if settings.tracking == Tracking::Paper => {
            register(previous, current, settings, &mut metrics)
        }
        _ => None,
    };
    observer.ended(Stage::Register);

    let options =
        simplification::Options::to_faces(settings.target.faces_of(current.mesh().face_count()));
    let simplified = simplify(current.mesh(), registered.as_ref(), &options);
    observer.ended(Stage::Simplify);

    let (draco, mesh) = encode(&simplified.mesh, settings)?;
    metrics.output = Output {
        vertices: mesh.vertex_count(),
        faces: mesh.face_count(),
        bytes: draco.len(),
        target_reached: simplified.target_reached,
    };
    observer.ended(Stage::Encode);

    if settings.measure {
        measure::add_distances(&mut metrics, &mesh, current.mesh(), registered.as_ref());
    }
    observer.ended(Stage::Measure);
    Ok(ProcessedFrame {
        metrics,
        draco,
        mesh,
        registered,
    })
}

/// The registered previous frame; what there is to say of it goes into `metrics`.
fn register(
    previous: &PreparedFrame,
    current: &PreparedFrame,
    settings: &Settings,
    metrics: &mut FrameMetrics,
) -> Option<TriangleMesh> {
    let attempt = || -> Result<(TriangleMesh, Registration), RegistrationError> {
        let target = Target::new(current.mesh())?;
        let found = registration::register(previous.mesh(), &target, &settings.registration)?;
        let mesh = previous
            .mesh()
            .with_positions(found.positions.clone())
            .map_err(|_| RegistrationError::NotFinite { step: "non-rigid" })?;
        // Rounded before it is used, so that what is written is what was measured.
        Ok((mesh.rounded_to_f32(), found))
    };
    match attempt() {
        Ok((mesh, found)) => {
            metrics.tracking = Tracking::Paper;
            metrics.registration = Some(measure::registration(&found));
            Some(mesh)
        }
        Err(error) => {
            metrics.registration_error = Some(error.to_string());
            None
        }
    }
}

/// Compresses a mesh, and reads it back as players will see it.
fn encode(
    mesh: &TriangleMesh,
    settings: &Settings,
) -> Result<(Vec<u8>, TriangleMesh), ProcessFailed> {
    let positions: Vec<[f32; 3]> = mesh
        .positions()
        .iter()
        .map(|p| p.coords.map(|c| c as f32).into())
        .collect();
    let view = MeshView {
        positions: &positions,
        faces: mesh.faces(),
        normals: None,
        colors: None,
        texture_coordinates: None,
    };
    let bytes = steadymesh_draco::encode(&view, &settings.draco)?;
    // Our own bytes: the limits are there to be given, not to be reached.
    let limits = DecodeLimits {
        max_vertices: usize::MAX,
        max_faces: usize::MAX,
        max_memory_bytes: usize::MAX,
    };
    let decoded = steadymesh_draco::decode(&bytes, &limits)?;
    let positions = decoded
        .positions
        .iter()
        .map(|p| Point::from(p.map(f64::from)))
        .collect();
    Ok((bytes, TriangleMesh::new(positions, decoded.faces)?))
}
