//! Tells other services, by signed HTTP requests, what happens to streams.
//!
//! `Monitor` turns what streams say into notices, a queue per endpoint keeps them, and a worker
//! per endpoint delivers them in order, signed as Standard Webhooks has it. Nothing here is ever
//! waited for by a stream.

mod delivery;
mod hub;
mod monitor;
mod notice;
mod options;
mod queue;
mod secret;

pub use hub::{Prepared, Webhooks};
pub use notice::{Crossing, Details, Ending, Kind, Notice, Silence};
pub use options::{
    Address, Bound, EndpointOptions, Figure, InvalidAddress, Limit, Options, UnusableOptions,
};
pub use secret::{InvalidSecret, Secret};
