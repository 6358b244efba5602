//! What travels on the bus.

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use steadymesh_proto::stream::{DropReason, EndReason, StreamConfig};

/// Where a frame is in the log. They ascend in the order in which frames were appended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Position(pub u64);

/// The frame before, of the same stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Predecessor {
    /// Where it is, or was.
    pub position: Position,
    /// Its number.
    pub seq: u64,
}

/// A frame as it was accepted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// The stream's name.
    pub stream: String,
    /// Which stream of this name: when it was made, in microseconds since 1970.
    pub instance: u64,
    /// The frame's number.
    pub seq: u64,
    /// When it was captured, in microseconds since 1970, if the rig said so.
    pub capture_time_us: Option<u64>,
    /// When it was received, in microseconds since 1970.
    pub received_us: u64,
    /// What the body is.
    pub content_type: String,
    /// The frame before it; none for the first of an instance.
    pub predecessor: Option<Predecessor>,
    /// The body as the rig sent it.
    pub body: Bytes,
}

impl Frame {
    /// What tells it from any other frame of its stream, also from one that another gateway gave
    /// the same number at the same time.
    pub(super) fn identity(&self) -> (u64, u64, u64) {
        (self.instance, self.seq, self.received_us)
    }
}

/// What became of a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// It is out: a delivered frame (`proto/README.md`).
    Delivered(Bytes),
    /// It is not coming.
    Lost(DropReason),
}

/// A frame that has been processed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Processed {
    /// The stream's name.
    pub stream: String,
    /// As in [`Frame::instance`].
    pub instance: u64,
    /// The frame's number.
    pub seq: u64,
    /// What became of it.
    pub outcome: Outcome,
}

/// What every node knows of a stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamRecord {
    /// As in [`Frame::instance`].
    pub instance: u64,
    /// Which configuration of it: each is larger than the one before.
    pub revision: u64,
    /// How its frames are processed, defaults filled in.
    pub config: StreamConfig,
    /// Why it has ended; none while it lives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<EndReason>,
}

impl StreamRecord {
    /// Whether it comes after `last`, in whatever order they are heard.
    #[must_use]
    pub fn follows(&self, last: &Self) -> bool {
        let key = |record: &Self| (record.instance, record.ended.is_some(), record.revision);
        key(last) < key(self)
    }

    /// Whether a stream of the same name cannot begin because of this one.
    pub(super) fn is_in_the_way_of(&self, other: &Self) -> bool {
        self.ended.is_none() && self.instance != other.instance
    }
}

/// A message is not one of ours, or of another version.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a message of the bus cannot be read: {what} is missing or wrong")]
pub struct InvalidMessage {
    /// Which part of it.
    pub what: &'static str,
}
