//! What happens to streams, for whoever wants to tell others.
//!
//! Plain values in two channels: the lives of streams, which are few and matter, and the figures
//! of every frame, which are many and soon replaced. A listener that is too slow misses the
//! oldest; no stream ever waits for one.

use std::time::SystemTime;

use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::Statistics;
use steadymesh_proto::stream::EndReason;
use tokio::sync::broadcast;

use super::StreamName;

/// Starts and ends that a listener may be behind.
const LIVES: usize = 1024;
/// Frames that a listener may be behind: half a second of 64 streams at 30 per second.
const FRAMES: usize = 1024;

/// A stream's first frame is out, or it has ended.
#[derive(Debug, Clone)]
pub struct LifeEvent {
    /// Which stream.
    pub stream: StreamName,
    /// When.
    pub at: SystemTime,
    /// What has happened.
    pub life: Life,
}

/// What happens once to a stream.
#[derive(Debug, Clone)]
pub enum Life {
    /// Its first frame is out.
    Started {
        /// The frame's number.
        seq: u64,
    },
    /// It has ended. A stream that never had a frame out ends without saying so.
    Ended {
        /// Why.
        reason: EndReason,
        /// Frames that came out.
        published: u64,
        /// Accepted frames that did not.
        dropped: u64,
        /// The newest frame's number.
        latest_seq: Option<u64>,
    },
}

/// A frame is out.
#[derive(Debug, Clone)]
pub struct FrameEvent {
    /// Which stream's.
    pub stream: StreamName,
    /// Its number.
    pub seq: u64,
    /// How consistent it is.
    pub figures: Figures,
}

/// The consistency figures of a frame; a figure that was not measured is none. Distances are
/// means, as a share of the bounding-box diagonal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Figures {
    /// From the frame's vertices to the surface of the registered previous frame.
    pub surface_distance_previous: Option<f64>,
    /// From the frame's vertices to the surface of the frame that came in.
    pub surface_distance_current: Option<f64>,
    /// From the registered previous frame to the surface of the frame that came in.
    pub registration_residual: Option<f64>,
    /// The share of vertices that were there in the previous frame, from 0 to 1.
    pub vertex_persistence: Option<f64>,
    /// Between the surface of the previous result, carried along, and this one.
    pub flicker: Option<f64>,
}

impl Figures {
    /// Those of a frame.
    #[must_use]
    pub fn of(metrics: &FrameMetrics) -> Self {
        let diagonal = metrics.bbox_diagonal;
        let share = |length: f64| (0.0 < diagonal).then(|| length / diagonal);
        let mean = |distance: &Statistics| share(distance.mean);
        let surface = metrics.surface_distance.as_ref();
        let consistency = metrics.consistency.as_ref();
        Self {
            surface_distance_previous: surface.and_then(|pair| mean(pair.previous.as_ref()?)),
            surface_distance_current: surface.and_then(|pair| mean(&pair.current)),
            registration_residual: metrics
                .registration
                .as_ref()
                .and_then(|registration| share(registration.residual.mean)),
            vertex_persistence: consistency.map(|figures| figures.vertex_persistence),
            flicker: consistency.and_then(|figures| share(figures.flicker)),
        }
    }
}

/// Where streams say what happens to them. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Events {
    lives: broadcast::Sender<LifeEvent>,
    frames: broadcast::Sender<FrameEvent>,
}

/// Hears all that happens from its making on.
#[derive(Debug)]
pub struct Listener {
    /// Starts and ends.
    pub lives: broadcast::Receiver<LifeEvent>,
    /// Frames.
    pub frames: broadcast::Receiver<FrameEvent>,
}

impl Default for Events {
    fn default() -> Self {
        Self {
            lives: broadcast::Sender::new(LIVES),
            frames: broadcast::Sender::new(FRAMES),
        }
    }
}

impl Events {
    /// Listens from now on.
    #[must_use]
    pub fn listen(&self) -> Listener {
        Listener {
            lives: self.lives.subscribe(),
            frames: self.frames.subscribe(),
        }
    }

    pub(super) fn life(&self, stream: &StreamName, life: Life) {
        let (stream, at) = (stream.clone(), SystemTime::now());
        // Fails only if nobody listens.
        self.lives.send(LifeEvent { stream, at, life }).ok();
    }

    pub(super) fn frame(&self, stream: &StreamName, metrics: &FrameMetrics) {
        if self.frames.receiver_count() == 0 {
            return;
        }
        let event = FrameEvent {
            stream: stream.clone(),
            seq: metrics.seq,
            figures: Figures::of(metrics),
        };
        self.frames.send(event).ok();
    }
}
