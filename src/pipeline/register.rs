//! The previous frame, carried onto the current one.

use std::sync::Arc;

use steadymesh_geometry::TriangleMesh;
use steadymesh_geometry::metrics::consistency_with_surface;
use steadymesh_geometry::registration::{self, Carried, RegistrationError, Target};
use steadymesh_geometry::spatial::TriangleTree;
use steadymesh_proto::metrics;
use steadymesh_proto::stream::MetricsMode;

use super::scene_cut::{SceneCut, Surface, scene_cut};
use super::{Output, PreparedFrame, measure};

/// A previous frame that has been registered onto the current one.
#[derive(Debug, Clone)]
pub struct Registered {
    /// The previous frame's faces at their registered positions, in the precision in which
    /// they can be written.
    pub mesh: TriangleMesh,
    /// How well it fits.
    pub figures: metrics::Registration,
    /// That of the previous frame as it was.
    source_surface: Arc<TriangleTree>,
    /// That of `mesh`.
    pub(super) surface: Arc<TriangleTree>,
    /// For every vertex a face of the current frame that is near.
    near: Vec<u32>,
    pub(super) scene_cut: Option<SceneCut>,
}

impl Registered {
    /// Why it is of no use although it could be computed; none if it is.
    #[must_use]
    pub fn scene_cut(&self) -> Option<SceneCut> {
        self.scene_cut
    }

    /// Carries the previous frame's result along.
    #[must_use]
    pub fn carry(&self, previous: &Output) -> CarriedOutput {
        let source = self.source_surface.as_ref();
        let feet = previous.feet_on(source);
        let points = previous.mesh.positions();
        let vertices = registration::carry(points, &feet, (source.mesh(), &self.mesh), &self.near);
        let positions = vertices.iter().map(|vertex| vertex.position).collect();
        CarriedOutput {
            mesh: previous.mesh.with_positions(positions).ok(),
            vertices,
        }
    }
}

/// A previous frame's result, carried along by the registration.
#[derive(Debug, Clone)]
pub struct CarriedOutput {
    pub(super) vertices: Vec<Carried>,
    /// None if a position is not finite.
    mesh: Option<TriangleMesh>,
}

impl CarriedOutput {
    /// The result at its carried positions; none if one of them is not finite.
    #[must_use]
    pub fn mesh(&self) -> Option<&TriangleMesh> {
        self.mesh.as_ref()
    }

    /// What of it is found again in the output that has this surface; none if there is nothing to
    /// compare. `mode` says from where the flicker is measured.
    #[must_use]
    pub fn consistency(
        &self,
        output: &TriangleTree,
        mode: MetricsMode,
    ) -> Option<metrics::Consistency> {
        let max_samples = measure::max_samples(mode);
        let found = consistency_with_surface(self.mesh.as_ref()?, output, max_samples)?;
        Some(metrics::Consistency {
            vertex_persistence: found.vertex_persistence,
            edge_persistence: found.edge_persistence,
            flicker: found.flicker,
        })
    }
}

/// Registers `previous` onto `current`, with the previous frame's connectivity.
///
/// # Errors
///
/// [`RegistrationError`] if the frames do not allow it; a bad fit is a result.
pub fn register(
    previous: &PreparedFrame,
    current: &PreparedFrame,
    options: &registration::Options,
) -> Result<Registered, RegistrationError> {
    let surface_of = |frame: &PreparedFrame, which| {
        let surface = frame.surface().cloned();
        surface.ok_or(RegistrationError::Empty { which })
    };
    let source_surface = surface_of(previous, "source")?;
    let current_surface = surface_of(current, "target")?;
    let target = Target::of_surface(current.mesh(), Arc::clone(&current_surface));
    let found = registration::register(previous.mesh(), &target, options)?;
    let figures = measure::registration(&found);
    let near: Vec<u32> = found.closest.iter().map(|closest| closest.face).collect();
    let mesh = previous
        .mesh()
        .with_positions(found.positions)
        .map_err(|_| RegistrationError::NotFinite { step: "non-rigid" })?;
    // Rounded before it is used, so that what is written is what was measured.
    let mesh = mesh.rounded_to_f32();
    let surface = source_surface.refitted(&mesh);
    let cut = scene_cut(
        &Surface {
            now: &surface,
            captured: previous.mesh(),
            near: &near,
        },
        &Surface {
            now: &current_surface,
            captured: current.mesh(),
            near: &[],
        },
        current.bounds().diagonal(),
    );
    Ok(Registered {
        mesh,
        figures,
        source_surface,
        surface: Arc::new(surface),
        near,
        scene_cut: cut,
    })
}
