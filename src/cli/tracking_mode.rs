//! The tracking modes as they are typed.

use clap::ValueEnum;
use steadymesh_proto::metrics::Tracking;

/// How frames are simplified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum TrackingMode {
    /// The original QEM.
    Off,
    /// The formulas of the Tracked QEM paper.
    Paper,
    /// The previous result, carried along, anchors the new one.
    Robust,
}

impl From<TrackingMode> for Tracking {
    fn from(mode: TrackingMode) -> Self {
        match mode {
            TrackingMode::Off => Self::Off,
            TrackingMode::Paper => Self::Paper,
            TrackingMode::Robust => Self::Robust,
        }
    }
}
