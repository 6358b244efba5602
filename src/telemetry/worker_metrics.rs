//! The series of a worker.

use prometheus::{HistogramOpts, HistogramVec, IntCounter, IntGauge, Registry};
use steadymesh_proto::FrameMetrics;

use super::stream_metrics::{STAGE_BUCKETS, seconds, stages};

/// What a worker does, over all streams: which they are, gateways know.
#[derive(Debug)]
pub struct WorkerMetrics {
    /// Frames on the bus that no worker has taken.
    pub waiting: IntGauge,
    processed: IntCounter,
    stages: HistogramVec,
}

impl WorkerMetrics {
    pub(super) fn register(registry: &Registry) -> prometheus::Result<Self> {
        let processed = IntCounter::new(
            "steadymesh_worker_frames_total",
            "Frames that this worker has processed.",
        )?;
        registry.register(Box::new(processed.clone()))?;
        let waiting = IntGauge::new(
            "steadymesh_bus_waiting_frames",
            "Frames on the bus that no worker has taken, as this worker sees it.",
        )?;
        registry.register(Box::new(waiting.clone()))?;
        let opts = HistogramOpts::new(
            "steadymesh_worker_stage_seconds",
            "How long each stage of a frame took on this worker.",
        );
        let stages = HistogramVec::new(opts.buckets(STAGE_BUCKETS.to_vec()), &["stage"])?;
        registry.register(Box::new(stages.clone()))?;
        Ok(Self {
            waiting,
            processed,
            stages,
        })
    }

    /// Shows a frame that has been processed.
    pub fn processed(&self, metrics: &FrameMetrics) {
        self.processed.inc();
        for (stage, microseconds) in stages(&metrics.stage_us) {
            let series = self.stages.with_label_values(&[stage]);
            series.observe(seconds(microseconds));
        }
    }
}
