//! What a stream is made of, and what it is asked to do.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize};
use std::time::{Duration, SystemTime};

use steadymesh_proto::stream::EndReason;

use crate::storage::Recordings;
use crate::telemetry::StreamMetrics;

use super::events::Events;
use super::history::HistoryLimits;
use super::{Configured, StreamName};

/// How far a stream has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Position {
    /// The newest frame whose outcome is known.
    pub newest_seq: Option<u64>,
    /// Why the stream has ended, if it has.
    pub end: Option<EndReason>,
}

/// What the task is asked to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Request {
    /// Go on.
    Run,
    /// Finish what has been accepted, and end.
    Drain,
    /// End at once.
    Delete,
    /// End at once, as other nodes have, which need not be told.
    Follow,
    /// End at once because the server does: other nodes go on.
    Abandon,
}

#[derive(Debug, Default)]
pub(super) struct Counters {
    pub received: AtomicU64,
    pub published: AtomicU64,
    pub dropped: AtomicU64,
    pub rejected: AtomicU64,
    pub bytes_in: AtomicU64,
    pub bytes_out: AtomicU64,
    /// Frames accepted and not out yet.
    pub queued: AtomicUsize,
}

/// What a stream starts with.
#[derive(Debug)]
pub(super) struct Parts {
    pub name: StreamName,
    pub configured: Configured,
    pub history: HistoryLimits,
    pub subscriber_queue: usize,
    /// How long a publisher that vanished is expected back.
    pub linger: Duration,
    pub metrics: StreamMetrics,
    /// Where it says what happens to it.
    pub events: Events,
    /// Where it is recorded.
    pub recordings: Option<Arc<Recordings>>,
    /// When it was made.
    pub created: SystemTime,
    /// Which configuration it begins with.
    pub revision: u64,
    /// Whether other nodes may have it too.
    pub is_shared: bool,
    /// Whether it is recorded from the first; else from its first frame that comes in here.
    pub records_at_once: bool,
}
