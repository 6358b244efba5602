//! One frame, from its prepared mesh to what is delivered.

use steadymesh_draco::MeshView;
use steadymesh_geometry::TriangleMesh;
use steadymesh_geometry::mesh::Wedges;
use steadymesh_geometry::simplification::{
    self, Anchors, Simplified, anchors, simplify, simplify_anchored,
};
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::{self, Tracking};
use steadymesh_proto::stream::MetricsMode;

use super::attributes::Attributes;
use super::register::CarriedOutput;
use super::{Output, PreparedFrame, Registered, Settings, Stage, StageObserver, measure, register};

/// What becomes of a frame.
#[derive(Debug, Clone)]
pub struct ProcessedFrame {
    /// The frame's figures, but for its sequence numbers and times, which the caller knows.
    pub metrics: FrameMetrics,
    /// The simplified mesh in Draco.
    pub draco: Vec<u8>,
    /// The simplified mesh, as players see it.
    pub output: Output,
    /// The previous frame, registered onto this one, in the precision in which it can be
    /// written; none for a first frame, after a reset, or if neither tracking nor the metrics
    /// had a use for it.
    pub registered: Option<TriangleMesh>,
}

impl ProcessedFrame {
    /// Says that the previous frame, which was there, could not be registered.
    pub fn set_registration_error(&mut self, error: String) {
        self.metrics.registration_error = Some(error);
        self.metrics.reset = Some(REGISTRATION_FAILED.to_owned());
    }
}

/// The reason of a reset without a registration.
pub const REGISTRATION_FAILED: &str = "registration failed";

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

/// What a frame may be consistent with.
#[derive(Debug, Clone, Copy)]
pub struct Previous<'a> {
    /// The frame before.
    pub frame: &'a PreparedFrame,
    /// What became of it.
    pub output: Option<&'a Output>,
}

/// Registers the previous frame onto `current`, simplifies `current` and measures the result.
///
/// A registration that fails, or that finds a scene cut, does not lose the frame: it is simplified
/// without the previous one, and its metrics say why.
///
/// # Errors
///
/// [`ProcessFailed`] if Draco refuses its part.
pub fn process(
    current: &PreparedFrame,
    previous: Option<Previous<'_>>,
    settings: &Settings,
    observer: &mut impl StageObserver,
) -> Result<ProcessedFrame, ProcessFailed> {
    let attempt = previous
        .filter(|_| settings.registers())
        .map(|previous| register(previous.frame, current, &settings.registration));
    observer.ended(Stage::Register);
    let (registered, error) = match attempt.transpose() {
        Ok(registered) => (registered, None),
        Err(error) => (None, Some(error.to_string())),
    };
    let output = previous.and_then(|previous| previous.output);
    let mut processed = process_registered(current, registered, output, settings, observer)?;
    if let Some(error) = error {
        processed.set_registration_error(error);
    }
    Ok(processed)
}

/// What [`process`] does once the previous frame is registered: several frames may be registered
/// at once, while this needs the one before's output if [`Settings::carries_output`].
///
/// After a scene cut `registered` and `previous_output` are of no use, and the frame is a first
/// one. Without tracking, `registered` takes no part in the simplification and the result is
/// measured against it all the same: this is how the original QEM is compared.
///
/// # Errors
///
/// [`ProcessFailed`] if Draco refuses its part.
pub fn process_registered(
    current: &PreparedFrame,
    registered: Option<Registered>,
    previous_output: Option<&Output>,
    settings: &Settings,
    observer: &mut impl StageObserver,
) -> Result<ProcessedFrame, ProcessFailed> {
    let cut = registered.as_ref().and_then(Registered::scene_cut);
    let figures = registered.as_ref().map(|r| r.figures.clone());
    let registered = registered.filter(|_| cut.is_none());
    let carried = registered
        .as_ref()
        .zip(previous_output.filter(|_| settings.carries_output()))
        .map(|(registered, output)| registered.carry(output));
    let (registered, registered_surface) = registered.map(|r| (r.mesh, r.surface)).unzip();
    let mut metrics = FrameMetrics {
        input: current.input().clone(),
        bbox_diagonal: current.bounds().diagonal(),
        registration: figures,
        reset: cut.map(|cut| cut.to_string()),
        ..FrameMetrics::default()
    };
    let hold = match (settings.tracking, &registered) {
        (Tracking::Paper, Some(registered)) => Hold::Reference(registered),
        (Tracking::Robust, _) => hold_by_anchors(carried.as_ref(), current, settings),
        _ => Hold::Nothing,
    };
    let mut simplified;
    (simplified, metrics.tracking) = hold.simplify(current, settings);
    let attributes = current.attributes().zip(current.surface());
    let attributes = attributes.map(|(a, surface)| a.of_simplified(surface, &mut simplified));
    observer.ended(Stage::Simplify);

    let (draco, mesh) = encode(&simplified.mesh, attributes.as_ref(), settings)?;
    metrics.output = metrics::Output {
        vertices: mesh.vertex_count(),
        points: simplified
            .mesh
            .wedges()
            .map_or(mesh.vertex_count(), Wedges::count),
        faces: mesh.face_count(),
        bytes: draco.len(),
        target_reached: simplified.target_reached,
    };
    observer.ended(Stage::Encode);

    let output = match current.surface() {
        Some(surface) if settings.carries_output() => Output::on(surface, mesh),
        Some(_) | None => Output::from(mesh),
    };
    let measured = settings.metrics != MetricsMode::Off;
    // A mesh without faces, which does not come this far, has no figures.
    if let Some(surface) = measured.then(|| TriangleTree::new(&output.mesh)).flatten() {
        let previous = registered_surface.as_deref();
        measure::add_distances(
            &mut metrics,
            (&output, &surface),
            (current, previous),
            settings.metrics,
        );
        metrics.consistency =
            carried.and_then(|carried| carried.consistency(&surface, settings.metrics));
    }
    observer.ended(Stage::Measure);
    Ok(ProcessedFrame {
        metrics,
        draco,
        output,
        registered,
    })
}

/// What holds a frame's simplification.
enum Hold<'a> {
    Nothing,
    Reference(&'a TriangleMesh),
    /// None, for a frame of its own, and the surface of the frame.
    Anchors(Option<Anchors>, &'a TriangleTree),
}

impl Hold<'_> {
    fn simplify(&self, current: &PreparedFrame, settings: &Settings) -> (Simplified, Tracking) {
        let mesh = current.mesh();
        let target = settings.target.faces_of(mesh.face_count());
        let mut options = simplification::Options::to_faces(target);
        options.refines = settings.refines;
        options.attributes = current
            .attributes()
            .and_then(|attributes| attributes.field(settings.attribute_weight));
        match self {
            Self::Nothing => (simplify(mesh, None, &options), Tracking::Off),
            Self::Reference(reference) => {
                (simplify(mesh, Some(reference), &options), Tracking::Paper)
            }
            Self::Anchors(Some(anchors), surface) => (
                simplify_anchored(surface, anchors, &options),
                Tracking::Robust,
            ),
            Self::Anchors(None, surface) => (
                simplify_anchored(surface, &Anchors::default(), &options),
                Tracking::Off,
            ),
        }
    }
}

fn hold_by_anchors<'a>(
    carried: Option<&CarriedOutput>,
    current: &'a PreparedFrame,
    settings: &Settings,
) -> Hold<'a> {
    let Some(surface) = current.surface() else {
        return Hold::Nothing;
    };
    let options = &anchors::Options::with_strength(settings.tracking_strength.get());
    let anchors = carried.and_then(|carried| {
        let previous = (carried.vertices.as_slice(), carried.mesh()?.faces());
        Some(Anchors::new(previous, surface, options))
    });
    Hold::Anchors(anchors, surface)
}

/// Compresses a mesh with the attributes of its wedges, and reads it back as players will see it.
fn encode(
    mesh: &TriangleMesh,
    attributes: Option<&Attributes>,
    settings: &Settings,
) -> Result<(Vec<u8>, TriangleMesh), ProcessFailed> {
    let positions: Vec<[f32; 3]> = mesh
        .positions()
        .iter()
        .map(|p| p.coords.map(|c| c as f32).into())
        .collect();
    let wedges = mesh.wedges().filter(|_| attributes.is_some());
    let view = MeshView {
        positions: &positions,
        point_vertices: wedges.map(Wedges::vertices),
        faces: wedges.map_or(mesh.faces(), Wedges::corners),
        normals: attributes.and_then(|a| a.normals.as_deref()),
        colors: attributes.and_then(|a| a.colors.as_deref()),
        texture_coordinates: attributes.and_then(|a| a.texture_coordinates.as_deref()),
        materials: attributes.and_then(|a| a.materials.as_deref()),
    };
    let bytes = steadymesh_draco::encode(&view, &settings.draco)?;
    let decoded = Output::decode(&bytes)?.mesh;
    Ok((bytes, decoded))
}
