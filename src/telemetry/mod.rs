//! What operators see: the log, traces, and what Prometheus scrapes.
//!
//! The consistency figures themselves are computed in `geometry`; here they are only shown.

pub mod log;
mod owners;
mod recording_metrics;
mod registry;
mod stream_metrics;
pub mod traces;
mod webhook_metrics;
mod worker_metrics;

pub use recording_metrics::RecordingMetrics;
pub use registry::Telemetry;
pub use stream_metrics::StreamMetrics;
pub use webhook_metrics::EndpointMetrics;
pub use worker_metrics::WorkerMetrics;
