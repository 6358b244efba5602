//! Nearest things in space: a k-d tree over points and a tree of boxes over triangles.

mod box_tree;
mod closest_point;
mod near_vertices;
mod point_tree;
mod straight_walk;
mod triangle_pack;
mod triangle_tree;
mod vertex_tree;

pub use closest_point::{barycentric, closest_point_on_triangle};
pub use near_vertices::closest_to_vertices;
pub(crate) use near_vertices::near_vertices;
pub use point_tree::PointTree;
pub(crate) use straight_walk::straight_walk;
pub use triangle_tree::{SurfacePoint, TriangleTree};
pub use vertex_tree::VertexTree;
