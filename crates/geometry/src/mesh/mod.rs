//! Triangle meshes: the type, its topology, and the repair that makes a captured frame usable.

mod adjacency;
mod bounds;
mod edges;
mod normals;
pub mod repair;
mod triangle_mesh;

pub use adjacency::{Rows, vertex_faces, vertex_neighbors};
pub use bounds::BoundingBox;
pub use edges::{Edge, EdgeTable, mean_edge};
pub use normals::{face_normal, face_normals, vertex_normals};
pub use triangle_mesh::{InvalidMesh, MAX_COORDINATE, TriangleMesh};
