//! Everything that Prometheus scrapes.

use prometheus::{Encoder, IntCounter, IntCounterVec, IntGauge, Opts, Registry, TextEncoder};

use super::owners::Owners;
use super::recording_metrics::{self, RecordingMetrics};
use super::stream_metrics::{Families, StreamMetrics};
use super::webhook_metrics::{self, EndpointMetrics};
use super::worker_metrics::WorkerMetrics;

/// The metrics of one server. They belong to it: two servers in one process do not mix.
#[derive(Debug)]
pub struct Telemetry {
    registry: Registry,
    families: Families,
    /// Players connected, over all streams.
    pub connections: IntGauge,
    /// Connections to the public listener.
    pub open_connections: IntGauge,
    /// Connections that were over a limit.
    pub refused_connections: IntCounter,
    /// Of this process's worker, if it has one.
    pub worker: WorkerMetrics,
    denied: IntCounterVec,
    owners: Owners,
    webhooks: webhook_metrics::Families,
    recordings: recording_metrics::Families,
    recording_owners: Owners,
}

impl Telemetry {
    /// Registers everything that does not belong to a stream.
    ///
    /// # Errors
    ///
    /// If two metrics have one name, which is a defect.
    pub fn new() -> prometheus::Result<Self> {
        let registry = Registry::new();
        let build_info = IntGauge::with_opts(
            prometheus::Opts::new("steadymesh_build_info", "The running version, always 1.")
                .const_label("version", env!("CARGO_PKG_VERSION")),
        )?;
        build_info.set(1);
        registry.register(Box::new(build_info))?;
        let connections = IntGauge::new(
            "steadymesh_subscriber_connections",
            "Players connected by WebSocket, over all streams.",
        )?;
        registry.register(Box::new(connections.clone()))?;
        let open_connections = IntGauge::new(
            "steadymesh_connections",
            "Connections to the public listener.",
        )?;
        registry.register(Box::new(open_connections.clone()))?;
        let refused_connections = IntCounter::new(
            "steadymesh_connections_refused_total",
            "Connections that were over a limit.",
        )?;
        registry.register(Box::new(refused_connections.clone()))?;
        let denied = IntCounterVec::new(
            Opts::new(
                "steadymesh_denied_total",
                "Requests refused for their credential, by reason.",
            ),
            &["reason"],
        )?;
        registry.register(Box::new(denied.clone()))?;
        #[cfg(target_os = "linux")]
        registry.register(Box::new(
            prometheus::process_collector::ProcessCollector::for_self(),
        ))?;
        let families = Families::register(&registry)?;
        let webhooks = webhook_metrics::Families::register(&registry)?;
        let worker = WorkerMetrics::register(&registry)?;
        let recordings = recording_metrics::Families::register(&registry)?;
        Ok(Self {
            registry,
            families,
            connections,
            open_connections,
            refused_connections,
            denied,
            worker,
            owners: Owners::default(),
            webhooks,
            recordings,
            recording_owners: Owners::default(),
        })
    }

    /// The series of a new stream. They end with the value that is returned.
    #[must_use]
    pub fn stream(&self, name: &str) -> StreamMetrics {
        StreamMetrics::new(&self.families, &self.owners, name)
    }

    /// The series of a new recording of a stream. They end with the value that is returned.
    #[must_use]
    pub fn recording(&self, stream: &str) -> RecordingMetrics {
        RecordingMetrics::new(&self.recordings, &self.recording_owners, stream)
    }

    /// The series of a webhook's endpoint. They end with the value that is returned.
    #[must_use]
    pub fn endpoint(&self, name: &str) -> EndpointMetrics {
        EndpointMetrics::new(&self.webhooks, name)
    }

    /// Counts a request that was refused for its credential; reasons are a few fixed words.
    pub fn count_denied(&self, reason: &'static str) {
        self.denied.with_label_values(&[reason]).inc();
    }

    /// The text that Prometheus scrapes, and its content type.
    #[must_use]
    pub fn scrape(&self) -> (String, String) {
        let encoder = TextEncoder::new();
        let mut text = Vec::new();
        // Writing to memory does not fail, and names were checked when they were registered.
        if let Err(error) = encoder.encode(&self.registry.gather(), &mut text) {
            tracing::error!(%error, "metrics could not be written");
        }
        let text = String::from_utf8_lossy(&text).into_owned();
        (text, encoder.format_type().to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_of_a_stream_end_with_it() {
        let telemetry = Telemetry::new().unwrap();
        let stream = telemetry.stream("a");
        stream.received.inc();
        assert!(
            telemetry
                .scrape()
                .0
                .contains(r#"steadymesh_frames_received_total{stream="a"} 1"#)
        );
        drop(stream);
        assert!(!telemetry.scrape().0.contains(r#"stream="a""#));
    }

    #[test]
    fn a_stream_that_lingers_does_not_take_its_successors_series_away() {
        let telemetry = Telemetry::new().unwrap();
        let first = telemetry.stream("a");
        first.received.inc();
        let second = telemetry.stream("a");
        drop(first);
        let text = telemetry.scrape().0;
        assert!(
            text.contains(r#"steadymesh_frames_received_total{stream="a"} 0"#),
            "{text}"
        );
        drop(second);
    }
}
