//! The series of one stream.

use std::time::Duration;

use prometheus::{
    Gauge, GaugeVec, Histogram, HistogramOpts, HistogramVec, IntCounter, IntCounterVec, IntGauge,
    IntGaugeVec, Opts, Registry,
};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::{Consistency, DistancePair, Quality, StageTimes};

use super::owners::{Owners, Ownership};

/// Around the 33 ms that a frame has at 30 frames per second, in seconds.
pub(super) const STAGE_BUCKETS: &[f64] = &[
    0.001, 0.002, 0.004, 0.008, 0.016, 0.033, 0.05, 0.066, 0.1, 0.2, 0.4, 0.8, 1.6,
];
/// From one frame at 30 per second to a queue that is far too long, in seconds.
const LATENCY_BUCKETS: &[f64] = &[
    0.016, 0.033, 0.05, 0.066, 0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.3, 2.0, 5.0, 10.0,
];
const LOSSES: [&str; 2] = ["overload", "failed"];
const SIDES: [&str; 2] = ["previous", "current"];

/// Every metric that has the label `stream`.
#[derive(Debug, Clone)]
pub(super) struct Families {
    received: IntCounterVec,
    published: IntCounterVec,
    dropped: IntCounterVec,
    rejected: IntCounterVec,
    bytes_in: IntCounterVec,
    bytes_out: IntCounterVec,
    skipped: IntCounterVec,
    registration_failures: IntCounterVec,
    resets: IntCounterVec,
    quality: IntCounterVec,
    queued: IntGaugeVec,
    subscribers: IntGaugeVec,
    latency: HistogramVec,
    stages: HistogramVec,
    surface_distance: GaugeVec,
    vertex_distance: GaugeVec,
    residual: GaugeVec,
    vertex_persistence: GaugeVec,
    edge_persistence: GaugeVec,
    flicker: GaugeVec,
}

impl Families {
    pub fn register(registry: &Registry) -> prometheus::Result<Self> {
        let of_stream = &["stream"][..];
        let counter = |name: &str, help: &str, labels: &[&str]| {
            let family = IntCounterVec::new(Opts::new(format!("steadymesh_{name}"), help), labels)?;
            registry.register(Box::new(family.clone())).map(|()| family)
        };
        let level = |name: &str, help: &str| {
            let opts = Opts::new(format!("steadymesh_{name}"), help);
            let family = IntGaugeVec::new(opts, of_stream)?;
            registry.register(Box::new(family.clone())).map(|()| family)
        };
        let gauge = |name: &str, help: &str, labels: &[&str]| {
            let family = GaugeVec::new(Opts::new(format!("steadymesh_{name}"), help), labels)?;
            registry.register(Box::new(family.clone())).map(|()| family)
        };
        let histogram = |name: &str, help: &str, labels: &[&str], buckets: &[f64]| {
            let opts = HistogramOpts::new(format!("steadymesh_{name}"), help);
            let family = HistogramVec::new(opts.buckets(buckets.to_vec()), labels)?;
            registry.register(Box::new(family.clone())).map(|()| family)
        };
        Ok(Self {
            received: counter("frames_received_total", "Frames accepted.", of_stream)?,
            published: counter("frames_published_total", "Frames that came out.", of_stream)?,
            dropped: counter(
                "frames_dropped_total",
                "Accepted frames that did not come out, by reason.",
                &["stream", "reason"],
            )?,
            rejected: counter(
                "frames_rejected_total",
                "Frames refused with a 4xx answer.",
                of_stream,
            )?,
            bytes_in: counter(
                "received_bytes_total",
                "Bytes of accepted frames.",
                of_stream,
            )?,
            bytes_out: counter(
                "published_bytes_total",
                "Draco bytes of published frames.",
                of_stream,
            )?,
            skipped: counter(
                "subscriber_skipped_frames_total",
                "Frames left out for readers that were too slow.",
                of_stream,
            )?,
            registration_failures: counter(
                "registration_failures_total",
                "Frames treated as first ones because registration failed.",
                of_stream,
            )?,
            resets: counter(
                "resets_total",
                "Frames treated as first ones although there was one before: registration failed, \
                 or it is another scene.",
                of_stream,
            )?,
            quality: counter(
                "frames_by_quality_total",
                "Frames that came out, by what was left out because they came too fast.",
                &["stream", "quality"],
            )?,
            queued: level("queued_frames", "Frames accepted and not out yet.")?,
            subscribers: level("subscribers", "Players connected.")?,
            latency: histogram(
                "frame_latency_seconds",
                "From the arrival of a whole frame to its publication or loss.",
                of_stream,
                LATENCY_BUCKETS,
            )?,
            stages: histogram(
                "stage_duration_seconds",
                "Time that a stage of processing took.",
                &["stream", "stage"],
                STAGE_BUCKETS,
            )?,
            surface_distance: gauge(
                "surface_distance_ratio",
                "Mean distance of the newest frame's vertices to the surface of the registered \
                 previous and of the current frame, as a share of the bounding-box diagonal.",
                &["stream", "reference"],
            )?,
            vertex_distance: gauge(
                "vertex_distance_ratio",
                "Mean distance of the newest frame's vertices to the nearest vertex of the \
                 registered previous and of the current frame, as a share of the bounding-box \
                 diagonal.",
                &["stream", "reference"],
            )?,
            residual: gauge(
                "registration_residual_ratio",
                "Mean distance of the registered previous frame to the newest frame's surface, \
                 as a share of the bounding-box diagonal.",
                of_stream,
            )?,
            vertex_persistence: gauge(
                "vertex_persistence_ratio",
                "Share of the newest frame's vertices that were there in the frame before, carried \
                 along by the registration.",
                of_stream,
            )?,
            edge_persistence: gauge(
                "edge_persistence_ratio",
                "Share of the previous frame's edges that are there again in the newest one.",
                of_stream,
            )?,
            flicker: gauge(
                "flicker_ratio",
                "Mean distance of the newest frame's surface and the one before, carried along by \
                 the registration, as a share of the bounding-box diagonal.",
                of_stream,
            )?,
        })
    }

    /// Ends all series of a stream.
    fn remove(&self, name: &str) {
        let counters = [
            &self.received,
            &self.published,
            &self.rejected,
            &self.bytes_in,
            &self.bytes_out,
            &self.skipped,
            &self.registration_failures,
            &self.resets,
        ];
        // A series that is not there, as after a second removal, is not missed.
        for family in counters {
            family.remove_label_values(&[name]).ok();
        }
        for reason in LOSSES {
            self.dropped.remove_label_values(&[name, reason]).ok();
        }
        for quality in Quality::ALL {
            self.quality
                .remove_label_values(&[name, quality.name()])
                .ok();
        }
        for family in [&self.queued, &self.subscribers] {
            family.remove_label_values(&[name]).ok();
        }
        self.latency.remove_label_values(&[name]).ok();
        for (stage, _) in stages(&StageTimes::default()) {
            self.stages.remove_label_values(&[name, stage]).ok();
        }
        for family in [&self.surface_distance, &self.vertex_distance] {
            for side in SIDES {
                family.remove_label_values(&[name, side]).ok();
            }
        }
        let of_stream = [
            &self.residual,
            &self.vertex_persistence,
            &self.edge_persistence,
            &self.flicker,
        ];
        for family in of_stream {
            family.remove_label_values(&[name]).ok();
        }
    }
}

impl Families {
    /// Series of a stream that has just begun: none of a predecessor's, and those of what may be
    /// lost there from the first, at 0.
    fn begin(&self, name: &str) {
        self.remove(name);
        for reason in LOSSES {
            self.dropped.with_label_values(&[name, reason]).reset();
        }
        for quality in Quality::ALL {
            let of_quality = &[name, quality.name()];
            self.quality.with_label_values(of_quality).reset();
        }
        for family in [&self.registration_failures, &self.resets] {
            family.with_label_values(&[name]).reset();
        }
    }
}

/// The series of one stream, which end when this is dropped.
#[derive(Debug)]
pub struct StreamMetrics {
    /// Frames accepted.
    pub received: IntCounter,
    /// Frames refused.
    pub rejected: IntCounter,
    /// Bytes of accepted frames.
    pub bytes_in: IntCounter,
    /// Frames left out for slow readers.
    pub skipped: IntCounter,
    /// Frames accepted and not out yet.
    pub queued: IntGauge,
    /// Players connected.
    pub subscribers: IntGauge,
    published: IntCounter,
    bytes_out: IntCounter,
    latency: Histogram,
    families: Families,
    /// A stream that is still held by its last reader may have a successor of the same name.
    owner: Ownership,
}

impl StreamMetrics {
    pub(super) fn new(families: &Families, owners: &Owners, name: &str) -> Self {
        let of_stream = &[name];
        let owner = owners.take(name, || families.begin(name));
        Self {
            received: families.received.with_label_values(of_stream),
            rejected: families.rejected.with_label_values(of_stream),
            bytes_in: families.bytes_in.with_label_values(of_stream),
            skipped: families.skipped.with_label_values(of_stream),
            queued: families.queued.with_label_values(of_stream),
            subscribers: families.subscribers.with_label_values(of_stream),
            published: families.published.with_label_values(of_stream),
            bytes_out: families.bytes_out.with_label_values(of_stream),
            latency: families.latency.with_label_values(of_stream),
            families: families.clone(),
            owner,
        }
    }

    /// Shows a frame that has come out.
    pub fn observe(&self, metrics: &FrameMetrics) {
        if !self.owner.holds() {
            return;
        }
        let name = self.owner.name();
        self.published.inc();
        self.bytes_out.inc_by(metrics.output.bytes as u64);
        self.latency.observe(seconds(metrics.latency_us));
        for (stage, microseconds) in stages(&metrics.stage_us) {
            let series = self.families.stages.with_label_values(&[name, stage]);
            series.observe(seconds(microseconds));
        }
        let quality = &[name, metrics.quality.name()];
        self.families.quality.with_label_values(quality).inc();
        if metrics.registration_error.is_some() {
            self.families
                .registration_failures
                .with_label_values(&[name])
                .inc();
        }
        if metrics.reset.is_some() {
            self.families.resets.with_label_values(&[name]).inc();
        }
        let diagonal = metrics.bbox_diagonal;
        if let Some(registration) = &metrics.registration {
            let residual = self.families.residual.with_label_values(&[name]);
            set_ratio(&residual, registration.residual.mean, diagonal);
        }
        self.show_distances(
            &self.families.surface_distance,
            metrics.surface_distance.as_ref(),
            diagonal,
        );
        self.show_distances(
            &self.families.vertex_distance,
            metrics.vertex_distance.as_ref(),
            diagonal,
        );
        if let Some(consistency) = &metrics.consistency {
            self.show_consistency(consistency, diagonal);
        }
    }

    /// Counts a frame that was lost `after` it had arrived, if that is known. It is in the histogram
    /// of latencies too, so that losing frames does not make it look better.
    pub fn lost(&self, reason: &str, after: Option<Duration>) {
        if !self.owner.holds() {
            return;
        }
        self.families
            .dropped
            .with_label_values(&[self.owner.name(), reason])
            .inc();
        if let Some(after) = after {
            self.latency.observe(after.as_secs_f64());
        }
    }

    fn show_distances(&self, family: &GaugeVec, distances: Option<&DistancePair>, diagonal: f64) {
        let Some(distances) = distances else { return };
        let name = self.owner.name();
        let current = family.with_label_values(&[name, "current"]);
        set_ratio(&current, distances.current.mean, diagonal);
        if let Some(previous) = &distances.previous {
            let series = family.with_label_values(&[name, "previous"]);
            set_ratio(&series, previous.mean, diagonal);
        }
    }

    fn show_consistency(&self, consistency: &Consistency, diagonal: f64) {
        let of_stream = &[self.owner.name()];
        let Families {
            vertex_persistence,
            edge_persistence,
            flicker,
            ..
        } = &self.families;
        vertex_persistence
            .with_label_values(of_stream)
            .set(consistency.vertex_persistence);
        edge_persistence
            .with_label_values(of_stream)
            .set(consistency.edge_persistence);
        let flicker = flicker.with_label_values(of_stream);
        set_ratio(&flicker, consistency.flicker, diagonal);
    }
}

impl Drop for StreamMetrics {
    fn drop(&mut self) {
        self.owner
            .give_up(|| self.families.remove(self.owner.name()));
    }
}

pub(super) fn stages(times: &StageTimes) -> [(&'static str, u64); 6] {
    [
        ("parse", times.parse),
        ("repair", times.repair),
        ("register", times.register),
        ("simplify", times.simplify),
        ("measure", times.measure),
        ("encode", times.encode),
    ]
}

pub(super) fn seconds(microseconds: u64) -> f64 {
    Duration::from_micros(microseconds).as_secs_f64()
}

fn set_ratio(series: &Gauge, length: f64, diagonal: f64) {
    if 0.0 < diagonal {
        series.set(length / diagonal);
    }
}
