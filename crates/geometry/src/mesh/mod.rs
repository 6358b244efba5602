//! Triangle meshes: the type, its topology, and the repair that makes a captured frame usable.

mod adjacency;
mod bounds;
mod edges;
mod normals;
pub mod repair;
mod triangle_mesh;
mod wedges;

pub use adjacency::Rows;
pub use bounds::BoundingBox;
pub use edges::{Edge, EdgeTable};
pub use normals::face_normal;
pub use triangle_mesh::{InvalidMesh, MAX_COORDINATE, TriangleMesh};
pub use wedges::Wedges;
