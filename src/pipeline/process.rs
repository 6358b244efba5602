//! One frame, from its prepared mesh to what is delivered.

use std::sync::Arc;

use steadymesh_draco::{DecodeLimits, MeshView};
use steadymesh_geometry::simplification::{self, simplify};
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::{Output, Tracking};

use super::{PreparedFrame, Registered, Settings, Stage, StageObserver, measure, register};

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
    /// written; none for a first frame, if registration failed, or if there was no tracking to
    /// register it for.
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
    let attempt = previous
        .filter(|_| settings.tracking != Tracking::Off)
        .map(|previous| register(previous, current, &settings.registration));
    observer.ended(Stage::Register);
    let (registered, error) = match attempt.transpose() {
        Ok(registered) => (registered, None),
        Err(error) => (None, Some(error.to_string())),
    };
    let mut processed = process_registered(current, registered, settings, observer)?;
    processed.metrics.registration_error = error;
    Ok(processed)
}

/// What [`process`] does once the previous frame is registered.
///
/// Without tracking, `registered` takes no part in the simplification and the result is
/// measured against it all the same: this is how the original QEM is compared.
///
/// # Errors
///
/// [`ProcessFailed`] if Draco refuses its part.
pub fn process_registered(
    current: &PreparedFrame,
    registered: Option<Registered>,
    settings: &Settings,
    observer: &mut impl StageObserver,
) -> Result<ProcessedFrame, ProcessFailed> {
    let surface = registered.as_ref().map(|r| Arc::clone(&r.current_surface));
    let (registered, registration) = registered.map(|r| (r.mesh, r.figures)).unzip();
    let reference = registered
        .as_ref()
        .filter(|_| settings.tracking != Tracking::Off);
    let mut metrics = FrameMetrics {
        input: current.input().clone(),
        bbox_diagonal: current.bounds().diagonal(),
        tracking: reference.map_or(Tracking::Off, |_| settings.tracking),
        registration,
        ..FrameMetrics::default()
    };
    let options =
        simplification::Options::to_faces(settings.target.faces_of(current.mesh().face_count()));
    let simplified = simplify(current.mesh(), reference, &options);
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
        let current = (current.mesh(), surface.as_deref());
        measure::add_distances(&mut metrics, &mesh, current, registered.as_ref());
    }
    observer.ended(Stage::Measure);
    Ok(ProcessedFrame {
        metrics,
        draco,
        mesh,
        registered,
    })
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
