//! Pictures of the results themselves, as SVG: consecutive wireframes, and distances as colours.
//!
//! [`view`] projects a mesh and finds which of its faces are seen, [`path`] writes what is drawn
//! in few bytes. Every mode is drawn with the same camera.

mod contact_sheet;
mod heat_map;
mod path;
mod view;

pub(super) use contact_sheet::contact_sheet;
pub(super) use heat_map::heat_map;
