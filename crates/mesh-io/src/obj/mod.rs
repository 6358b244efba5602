//! Wavefront OBJ: vertices, faces, texture coordinates, normals and the usual
//! extension for vertex colors.
//!
//! Materials, groups, smoothing and everything else is skipped. Positions keep the
//! numbering of their `v` records; texture coordinates and normals have their own.
//!
//! Source: "Object Files (.obj)", appendix B1 of the Wavefront Advanced Visualizer manual.

mod colors;
mod face;
mod read;
mod write;

pub use read::read;
pub use write::write;
