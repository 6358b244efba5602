//! Steadymesh: a server for volumetric video whose meshes do not flicker.

pub mod bus;
pub mod cli;
pub mod compute;
pub mod config;
pub mod evaluation;
pub mod otlp;
pub mod pipeline;
pub mod processing;
pub mod server;
pub mod stopwatch;
pub mod storage;
pub mod streams;
pub mod telemetry;
pub mod textures;
pub mod tls;
pub mod webhooks;
pub mod worker;
