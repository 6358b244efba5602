//! Distances between meshes, summed up as in section 4.1 of the Tracked QEM paper, the errors of
//! point-cloud coding, and what comes back from one result to the next.

mod consistency;
mod distances;
mod point_errors;
mod statistics;
mod surface_samples;

pub use consistency::{
    Consistency, Persistence, consistency, consistency_with_surface, persistence,
};
pub use distances::{surface_distances, vertex_distances, vertex_to_surface_distances};
pub use point_errors::{OrientedPoints, PointErrors, point_errors, psnr};
pub use statistics::DistanceStatistics;
pub use surface_samples::{SurfaceSample, surface_samples};
