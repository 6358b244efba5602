//! Pure numerics of Steadymesh: meshes, registration, simplification and their metrics.
//!
//! Everything here is a function of its arguments: no IO, no clock, no logging, no threads
//! of its own, and equal inputs give equal bits. Positions and distances are in the mesh's
//! own unit and in `f64`; thresholds are relative, so the unit never changes a result.

pub mod mesh;
pub mod metrics;
pub mod registration;
pub mod simplification;
pub mod spatial;

pub use mesh::TriangleMesh;
/// A point in space, in the mesh's own unit.
pub type Point = nalgebra::Point3<f64>;
/// A vector in space, in the mesh's own unit.
pub type Vector = nalgebra::Vector3<f64>;
/// Three vertex indices, counterclockwise seen from outside.
pub type Face = [u32; 3];
