//! Registration: carries the previous frame onto the current one.
//!
//! [`rigid`] finds the rotation and translation (Eq. 1 and 7 of the Tracked QEM paper),
//! [`nonrigid`] the deformation that is left (Eq. 2, 3 and 8), [`membrane`] takes up what is too
//! small for that, and [`register`] runs one after the other (Eq. 9). The *source* is what moves,
//! the *target* what it moves onto.
//!
//! Lengths are in the mesh's own unit, angles in radians, arithmetic in `f64`.

mod carry;
mod error;
mod frame;
pub mod membrane;
pub mod nonrigid;
pub mod rigid;
mod robust_kernel;
mod rotation;
mod target;

pub use carry::{Carried, carry};
pub use error::RegistrationError;
pub use frame::{Options, Registration, register};
pub use robust_kernel::{welsch, welsch_weight};
pub use rotation::nearest_rotation;
pub use target::Target;
