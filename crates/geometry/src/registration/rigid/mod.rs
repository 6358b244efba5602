//! Rigid registration: the rotation and translation that carry a source point set onto a
//! target (Eq. 1 and 7 of the Tracked QEM paper).
//!
//! [`fit_rigid`] solves for known correspondences in closed form, [`fit_point_to_plane`] in one
//! linearised step; [`icp::register`] finds the correspondences by iterating them.

mod closed_form;
pub mod icp;
mod point_to_plane;

pub use closed_form::fit_rigid;
pub use point_to_plane::fit_point_to_plane;

/// Pairs below this number do not determine a rigid motion.
pub const MIN_CORRESPONDENCES: usize = 3;
