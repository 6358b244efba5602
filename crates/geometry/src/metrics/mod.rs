//! Distances between meshes, summed up as in section 4.1 of the Tracked QEM paper.

mod consistency;
mod distances;
mod statistics;

pub use consistency::{Consistency, consistency};
pub use distances::{surface_distances, vertex_distances, vertex_to_surface_distances};
pub use statistics::DistanceStatistics;
