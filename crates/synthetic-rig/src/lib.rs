//! A synthetic capture rig: an animated figure, meshed from scratch in every
//! frame as a real rig does, whose true motion is known exactly.
//!
//! [`Rig::frame`] gives a frame: about 20,000 vertices whose number and
//! connectivity differ in every frame, with a little sensor noise. Every vertex
//! comes with its material point, and [`Rig::move_to`] says where a material
//! point is in any frame.
//!
//! The figure is 1.8 m tall, in metres, y up, and stands near the origin with
//! its soles at about y = 0, facing +z. It walks on the spot, waves and looks
//! about in a loop of 4 s.
//!
//! Pure and deterministic: frame `index` depends on the options and the index
//! only. Transcendental functions come from the `libm` crate, not from the
//! operating system, so the bits are the same on every platform with IEEE 754
//! arithmetic.

mod animation;
mod blocks;
mod body;
mod implicit;
mod noise;
mod polygonize;
mod rig;
mod skeleton;
mod topology;

pub use rig::{Frame, MAX_NOISE, MAX_VERTEX_COUNT, MIN_VERTEX_COUNT, Options, OptionsError, Rig};
