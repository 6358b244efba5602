//! Steadymesh: a server for volumetric video whose meshes do not flicker.

pub mod cli;
pub mod pipeline;
