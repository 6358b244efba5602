//! The server over real sockets, as rigs, players and operators use it.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "this is test code"
)]

// Before those that use its macro.
#[macro_use]
#[path = "../support/nats.rs"]
mod nats;

mod bad_input;
mod cluster;
mod connections;
mod control;
mod frames;
mod ingest;
mod log;
mod operations;
mod process;
mod publish;
mod recordings;
mod security;
mod subscribe;
mod support;
mod textures;
mod traces;
mod tracking;
mod webhooks;
