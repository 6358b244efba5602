//! The figures of section 4.1 of the Tracked QEM paper, as they are delivered.

use steadymesh_geometry::TriangleMesh;
use steadymesh_geometry::metrics::{
    DistanceStatistics, surface_distances, vertex_distances, vertex_to_surface_distances,
};
use steadymesh_geometry::registration::Registration;
use steadymesh_geometry::spatial::{TriangleTree, VertexTree};
use steadymesh_proto::metrics::{self, DistancePair, FrameMetrics, Residual, Statistics};

/// Fills in the distances of `output` to `current` and to `registered`, and those of `current`
/// to `output`.
///
/// `output` is the mesh that players see, after quantization. `current_surface` is `current`'s, if
/// there is one already. Meshes without faces, which do not come this far, leave the figures out.
pub(super) fn add_distances(
    metrics: &mut FrameMetrics,
    output: &TriangleMesh,
    (current, current_surface): (&TriangleMesh, Option<&TriangleTree>),
    registered: Option<&TriangleMesh>,
) {
    let to_previous = registered.and_then(|mesh| to_mesh(output, (mesh, None)));
    let (previous_surface, previous_vertices) = to_previous.unzip();
    if let Some((surface, vertices)) = to_mesh(output, (current, current_surface)) {
        metrics.surface_distance = Some(DistancePair {
            previous: previous_surface,
            current: surface,
        });
        metrics.vertex_distance = Some(DistancePair {
            previous: previous_vertices,
            current: vertices,
        });
    }
    metrics.current_to_output = TriangleTree::new(output)
        .map(|tree| vertex_to_surface_distances(current.positions(), current.faces(), &tree))
        .map(|distances| statistics(&distances));
}

/// From each vertex of `output` to the surface of `mesh`, and to its vertices.
fn to_mesh(
    output: &TriangleMesh,
    (mesh, surface): (&TriangleMesh, Option<&TriangleTree>),
) -> Option<(Statistics, Statistics)> {
    let mut built = None;
    let surface = match surface {
        Some(surface) => surface,
        None => built.insert(TriangleTree::new(mesh)?),
    };
    let vertices = VertexTree::new(mesh.positions())?;
    Some((
        statistics(&surface_distances(output.positions(), surface)),
        statistics(&vertex_distances(output.positions(), &vertices)),
    ))
}

/// How well the reference was registered.
pub(super) fn registration(registration: &Registration) -> metrics::Registration {
    let of_residuals = DistanceStatistics::of(&registration.residuals);
    metrics::Registration {
        rigid_rmse: registration.rigid_rmse,
        residual: Residual {
            mean: of_residuals.mean,
            rms: of_residuals.rmse,
            p95: DistanceStatistics::quantile(&registration.residuals, 0.95),
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
