//! Registers a whole frame: rigid, then non-rigid (Eq. 9 of the Tracked QEM paper), then fine.

use nalgebra::Isometry3;

use crate::spatial::SurfacePoint;
use crate::{Point, TriangleMesh};

use super::error::MAX_SIZE_FACTOR;
use super::{RegistrationError, Target, membrane, nonrigid, rigid};

/// How a frame is registered.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// The rigid step.
    pub rigid: rigid::icp::Options,
    /// The non-rigid step.
    pub nonrigid: nonrigid::Options,
    /// The fine step.
    pub membrane: membrane::Options,
}

/// The previous frame, carried onto the current one: mesh^γ(k-1).
#[derive(Debug, Clone)]
pub struct Registration {
    /// The registered position of every vertex of the source.
    pub positions: Vec<Point>,
    /// The rigid step's motion, T^γ(k-1).
    pub rigid_motion: Isometry3<f64>,
    /// The rigid step's root mean square distance of source vertices to the target's surface.
    pub rigid_rmse: f64,
    /// Iterations of the rigid step.
    pub rigid_iterations: usize,
    /// Nodes of the deformation graph.
    pub node_count: usize,
    /// Rounds of the non-rigid step.
    pub rounds: usize,
    /// The share of the samples that had a correspondence at the end, 0 to 1.
    pub matched_share: f64,
    /// Whether the deformation was thrown away because the rigid motion alone fits better.
    pub rigid_only: bool,
    /// The point of the target's surface closest to every registered vertex, about: its distance is
    /// the vertex's residual.
    pub closest: Vec<SurfacePoint>,
}

impl Registration {
    /// The distance of every registered vertex to the target's surface.
    #[must_use]
    pub fn residuals(&self) -> Vec<f64> {
        self.closest.iter().map(|found| found.distance).collect()
    }
}

/// Carries `source` (frame k-1) onto `target` (frame k).
///
/// The deformation is thrown away if the rigid motion alone fits better, by the mean distance of
/// the samples to the target's surface.
///
/// # Errors
///
/// [`RegistrationError`] if a step fails; the caller then goes on without a reference.
pub fn register(
    source: &TriangleMesh,
    target: &Target,
    options: &Options,
) -> Result<Registration, RegistrationError> {
    check_size(source, target)?;
    let rigid = rigid::icp::register(source, target, &options.rigid)?;
    let moved = source
        .moved(&rigid.target_from_source)
        .map_err(|_| RegistrationError::NotFinite { step: "rigid" })?;
    let deformed = nonrigid::register(&moved, target, &options.nonrigid)?;
    let mut mesh = moved
        .with_positions(deformed.positions)
        .map_err(|_| RegistrationError::NotFinite { step: "non-rigid" })?;
    let mut closest = target.near_vertices_of(&mesh);
    let rigid_sum: f64 = deformed.samples.iter().map(|sample| sample.distance).sum();
    let deformed_sum: f64 = deformed
        .samples
        .iter()
        .map(|sample| closest[sample.vertex as usize].distance)
        .sum();
    let rigid_only = rigid_sum < deformed_sum;
    if rigid_only {
        mesh = moved;
        closest = target.near_vertices_of(&mesh);
    }
    membrane::settle(&mut mesh, &mut closest, target, &options.membrane);
    Ok(Registration {
        positions: mesh.positions().to_vec(),
        rigid_motion: rigid.target_from_source,
        rigid_rmse: rigid.rmse,
        rigid_iterations: rigid.iterations,
        node_count: deformed.node_count,
        rounds: deformed.rounds,
        matched_share: deformed.matched_share,
        rigid_only,
        closest,
    })
}

fn check_size(source: &TriangleMesh, target: &Target) -> Result<(), RegistrationError> {
    let (one, other) = (source.bounding_box().diagonal(), target.diagonal());
    let (smaller, larger) = (one.min(other), one.max(other));
    if larger <= MAX_SIZE_FACTOR * smaller {
        return Ok(());
    }
    Err(RegistrationError::SizeMismatch {
        factor: larger / smaller,
    })
}
