//! Nearest things in space: a k-d tree over points and a tree of boxes over triangles.

mod box_tree;
mod closest_point;
mod point_tree;
mod triangle_pack;
mod triangle_tree;
mod vertex_tree;

pub(crate) use closest_point::Feature;
pub use closest_point::{barycentric, closest_point_on_triangle};
pub use point_tree::PointTree;
pub use triangle_tree::{SurfacePoint, TriangleTree};
pub use vertex_tree::VertexTree;
