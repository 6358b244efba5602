//! The series of what is recorded of one stream.

use prometheus::{IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry};
use steadymesh_proto::recording::Track;

use super::owners::{Owners, Ownership};

/// Every metric of recordings, by stream.
#[derive(Debug, Clone)]
pub(super) struct Families {
    frames: IntCounterVec,
    bytes: IntCounterVec,
    lost: IntCounterVec,
    failed_writes: IntCounterVec,
    failing: IntGaugeVec,
}

/// The series of the recordings of one stream, which end with the last of them.
#[derive(Debug)]
pub struct RecordingMetrics {
    tracks: [TrackMetrics; 2],
    /// Attempts to write that the store refused.
    pub failed_writes: IntCounter,
    /// 1 while the store refuses what is written.
    pub failing: IntGauge,
    families: Families,
    /// The next recording of a stream may begin before the last frames of one are written.
    owner: Ownership,
}

#[derive(Debug)]
struct TrackMetrics {
    frames: IntCounter,
    bytes: IntCounter,
    lost: IntCounter,
}

impl Families {
    pub fn register(registry: &Registry) -> prometheus::Result<Self> {
        let counter = |name: &str, help: &str, labels: &[&str]| {
            let opts = Opts::new(format!("steadymesh_recording_{name}_total"), help);
            let family = IntCounterVec::new(opts, labels)?;
            registry.register(Box::new(family.clone())).map(|()| family)
        };
        let failing = IntGaugeVec::new(
            Opts::new(
                "steadymesh_recording_failing",
                "Whether the store refuses what is recorded: 1 or 0.",
            ),
            &["stream"],
        )?;
        registry.register(Box::new(failing.clone()))?;
        let track = &["stream", "track"][..];
        Ok(Self {
            frames: counter("frames", "Frames that were recorded.", track)?,
            bytes: counter("bytes", "Bytes of the frames that were recorded.", track)?,
            lost: counter(
                "lost_frames",
                "Frames that could not be recorded: the store was full, slow or away.",
                track,
            )?,
            failed_writes: counter(
                "failed_writes",
                "Attempts to write that the store refused.",
                &["stream"],
            )?,
            failing,
        })
    }
}

impl RecordingMetrics {
    pub(super) fn new(families: &Families, owners: &Owners, stream: &str) -> Self {
        let tracks = Track::ALL.map(|track| {
            let labels = &[stream, track.name()];
            TrackMetrics {
                frames: families.frames.with_label_values(labels),
                bytes: families.bytes.with_label_values(labels),
                lost: families.lost.with_label_values(labels),
            }
        });
        Self {
            tracks,
            failed_writes: families.failed_writes.with_label_values(&[stream]),
            failing: families.failing.with_label_values(&[stream]),
            families: families.clone(),
            owner: owners.take(stream, || {}),
        }
    }

    /// Counts frames that were stored.
    pub fn stored(&self, track: Track, frames: u64, bytes: u64) {
        let series = self.track(track);
        series.frames.inc_by(frames);
        series.bytes.inc_by(bytes);
    }

    /// Counts frames that could not be.
    pub fn lost(&self, track: Track, frames: u64) {
        self.track(track).lost.inc_by(frames);
    }

    fn track(&self, track: Track) -> &TrackMetrics {
        let [raw, output] = &self.tracks;
        match track {
            Track::Raw => raw,
            Track::Output => output,
        }
    }
}

impl Families {
    fn remove(&self, stream: &str) {
        // A series that is not there is not missed.
        for track in Track::ALL {
            for family in [&self.frames, &self.bytes, &self.lost] {
                family.remove_label_values(&[stream, track.name()]).ok();
            }
        }
        self.failed_writes.remove_label_values(&[stream]).ok();
        self.failing.remove_label_values(&[stream]).ok();
    }
}

impl Drop for RecordingMetrics {
    fn drop(&mut self) {
        self.owner
            .give_up(|| self.families.remove(self.owner.name()));
    }
}
