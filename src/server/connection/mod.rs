//! Connections below HTTP: how many there may be, how long nothing may happen on one, and what
//! memory a message takes while it comes in.

mod cap;
mod inflow;
mod link;
mod timed;

pub(super) use cap::ConnectionCap;
pub(super) use inflow::Memory;
pub(super) use link::{Link, Patience};
pub(super) use timed::Timed;
