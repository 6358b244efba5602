//! Simplification by edge collapse under quadric error metrics: the original QEM, and Tracked
//! QEM, which takes the registered previous frame into account.
//!
//! - [`Quadric`]: the sum of squared distances to planes (Eq. 4 to 6).
//! - `tracked`: the reference's quadrics around an edge (Eq. 10 to 14, 16).
//! - `placement`: where the merged vertex goes (Eq. 15, section 3.3, Algorithm 1).
//! - `connectivity`: the mesh as it shrinks; which collapses keep it a manifold.
//! - `surroundings`: the faces around an edge that may be collapsed.
//! - `edge_costs`: what collapsing many edges costs, about.
//! - `attribute_costs`: what is lost of colors, normals and texture coordinates, if that is asked.
//! - `greedy`, `queue`: the cheapest edge first, for the paper's mode.
//! - `passes`, `ranking`: nearly that order at half the time, for all others.
//! - [`anchors`]: what the previous result holds the new one by.
//! - [`refinement`]: flips and fits what collapsing edges has left.
//! - `seams`: which collapses leave the texture's charts apart.
//! - [`surface_origins`]: where on the original the result's attributes come from.
//! - [`chart_origins`]: the same, and the seams, for a result that was made without regard to them.
//! - [`simplify`], [`simplify_anchored`]: collapses edges until the target is reached.
//!
//! All modes share all but the order: without reference and anchors it is the original QEM.

pub mod anchors;
mod attribute_costs;
mod chart_origins;
mod connectivity;
mod edge_collapse;
mod edge_costs;
mod faces_around;
mod greedy;
mod normalization;
mod passes;
mod placement;
mod quadric;
mod queue;
mod ranking;
pub mod refinement;
mod seams;
mod surface_origins;
mod surroundings;
mod tracked;

pub use anchors::Anchors;
pub use attribute_costs::{AttributeField, CHANNELS};
pub use chart_origins::chart_origins;
pub use edge_collapse::{NO_WEDGE, Options, Simplified, simplify, simplify_anchored};
pub use quadric::Quadric;
pub use surface_origins::{SurfaceOrigin, surface_origins};

#[cfg(test)]
mod tests;
