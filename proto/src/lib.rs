//! The wire contract: what a capture rig sends and what a player receives.
//!
//! - [`NativeFrame`]: one frame on its way in, as raw arrays.
//! - [`Bundle`]: a mesh in any format with its texture image.
//! - [`DeliveredFrame`]: one simplified frame on its way out, Draco bytes with its metrics
//!   and, where it has one, its texture image.
//! - [`stream`]: configuration, state, answers and control messages, in JSON.
//! - [`recording`]: what is recorded, and what a player of it may ask for, in JSON.
//! - [`metrics`]: the figures that come with every frame.
//! - [`wording`]: numbers in messages to people.
//!
//! `README.md` of this crate is the normative byte layout, for rigs and players in other
//! languages; `vectors/` holds messages that every implementation is tested against.
//! Everything here is pure: bytes to values and back.

mod bundle;
mod delivered_frame;
pub mod metrics;
mod native_frame;
pub mod recording;
pub mod stream;
pub mod wording;

pub use bundle::{Bundle, InvalidBundle};
pub use delivered_frame::{DeliveredFrame, InvalidDeliveredFrame};
pub use metrics::FrameMetrics;
pub use native_frame::{InvalidNativeFrame, NativeFrame, NativeStamps};

/// The WebSocket subprotocol of `subscribe`.
pub const SUBPROTOCOL: &str = "steadymesh.v1";
/// The content type of a [`NativeFrame`].
pub const NATIVE_CONTENT_TYPE: &str = "application/vnd.steadymesh.frame";
/// The content type of a [`Bundle`].
pub const BUNDLE_CONTENT_TYPE: &str = "application/vnd.steadymesh.bundle";
/// The content type of a [`DeliveredFrame`].
pub const DELIVERED_CONTENT_TYPE: &str = "application/vnd.steadymesh.delivered-frame";
