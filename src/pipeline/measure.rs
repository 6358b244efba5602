//! The figures of section 4.1 of the Tracked QEM paper, as they are delivered.

use std::borrow::Cow;

use steadymesh_geometry::Point;
use steadymesh_geometry::metrics::{
    DistanceStatistics, surface_distances, vertex_distances, vertex_to_surface_distances,
};
use steadymesh_geometry::registration::Registration;
use steadymesh_geometry::spatial::{TriangleTree, VertexTree};
use steadymesh_proto::metrics::{self, DistancePair, FrameMetrics, Residual, Statistics};
use steadymesh_proto::stream::MetricsMode;

use super::{Output, PreparedFrame};

/// Fills in the distances of `output` to `current` and to `registered`, and those of `current`
/// to `output`.
///
/// `output`, the mesh that players see, after quantization, comes with its surface, and
/// `registered` is one. `mode` says from which vertices.
pub fn add_distances(
    metrics: &mut FrameMetrics,
    (output, output_surface): (&Output, &TriangleTree),
    (current, registered): (&PreparedFrame, Option<&TriangleTree>),
    mode: MetricsMode,
) {
    let from = measured_of(output.mesh.positions(), mode);
    let vertices = current.mesh().positions();
    let to_current = |surface| {
        let feet = output.feet_on(surface);
        let distances: Vec<f64> = feet.iter().map(|foot| foot.distance).collect();
        statistics(&distances)
    };
    let to_registered = |surface| {
        let distances = match &from {
            Cow::Borrowed(_) => vertex_to_surface_distances(&output.mesh, surface),
            Cow::Owned(some) => surface_distances(some, surface),
        };
        statistics(&distances)
    };
    metrics.surface_distance = pair(
        current.surface().map(|surface| to_current(surface)),
        registered.map(to_registered),
    );
    if mode == MetricsMode::Full {
        metrics.vertex_distance = pair(
            to_vertices(&from, vertices),
            registered.and_then(|surface| to_vertices(&from, surface.mesh().positions())),
        );
    }
    let to_output = match measured_of(vertices, mode) {
        Cow::Borrowed(_) => vertex_to_surface_distances(current.mesh(), output_surface),
        Cow::Owned(some) => surface_distances(&some, output_surface),
    };
    metrics.current_to_output = Some(statistics(&to_output));
}

/// Vertices measured from, at the most, where they are sampled: a mean of so many distances is
/// some percent from that of all. The trees cost as much as the distances, so nearest vertices are
/// left out.
const MAX_SAMPLES: usize = 1000;

/// How many points are measured from, at the most.
pub(super) fn max_samples(mode: MetricsMode) -> usize {
    match mode {
        MetricsMode::Sampled => MAX_SAMPLES,
        MetricsMode::Full | MetricsMode::Off => usize::MAX,
    }
}

/// Those of `points` that are measured from.
fn measured_of(points: &[Point], mode: MetricsMode) -> Cow<'_, [Point]> {
    let stride = points.len().div_ceil(max_samples(mode));
    if 1 < stride {
        points.iter().step_by(stride).copied().collect()
    } else {
        Cow::Borrowed(points)
    }
}

fn pair(current: Option<Statistics>, previous: Option<Statistics>) -> Option<DistancePair> {
    current.map(|current| DistancePair { previous, current })
}

/// From each of `points` to the nearest of `vertices`.
fn to_vertices(points: &[Point], vertices: &[Point]) -> Option<Statistics> {
    let vertices = VertexTree::new(vertices)?;
    Some(statistics(&vertex_distances(points, &vertices)))
}

/// How well the reference was registered.
pub(super) fn registration(registration: &Registration) -> metrics::Registration {
    let residuals = registration.residuals();
    let of_residuals = DistanceStatistics::of(&residuals);
    metrics::Registration {
        rigid_rmse: registration.rigid_rmse,
        residual: Residual {
            mean: of_residuals.mean,
            rms: of_residuals.rmse,
            p95: DistanceStatistics::quantile(&residuals, 0.95),
            max: of_residuals.max,
        },
        nodes: registration.node_count,
        iterations: registration.rounds,
    }
}

/// Sums up `distances`; all zero if there are none.
#[must_use]
pub fn statistics(distances: &[f64]) -> Statistics {
    let DistanceStatistics {
        count,
        mean,
        variance,
        std,
        mse,
        rmse,
        max,
    } = DistanceStatistics::of(distances);
    Statistics {
        mean,
        variance,
        std,
        mse,
        rmse,
        max,
        count,
    }
}
