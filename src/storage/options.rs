//! Where recordings are kept, and how much of them.

use std::time::Duration;

use url::Url;

/// A shorter segment would be mostly names.
pub(super) const MIN_SEGMENT: Duration = Duration::from_millis(100);
/// A longer one would be lost in a crash.
pub(super) const MAX_SEGMENT: Duration = Duration::from_secs(60);

/// Where recordings are kept, and how much of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// A folder (`file:///…`) or what `object_store` knows: `s3://bucket/prefix`, `gs://…`, `az://…`.
    pub url: Url,
    /// How much of a stream one segment has: what a crash may lose.
    pub segment: Duration,
    /// A segment ends at so many bytes before its time.
    pub segment_bytes: u64,
    /// Bytes of frames that may wait to be written, over all streams.
    pub queue_bytes: usize,
    /// What is older is taken away; none keeps it.
    pub max_age: Option<Duration>,
    /// What is over it is taken away, oldest first; none keeps it.
    pub max_bytes: Option<u64>,
    /// How often it is looked at what is to be taken away.
    pub sweep_interval: Duration,
    /// How long the last frames may take to be written when a recording ends.
    pub farewell: Duration,
}

/// Why the store cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnusableStore {
    /// The address is not one of a store.
    #[error("recordings.url: {url} cannot be used: {reason}")]
    Url {
        /// The address, without what is secret.
        url: String,
        /// What is wrong.
        reason: String,
    },
    /// The folder cannot be made or written.
    #[error("recordings.url: the folder {folder} cannot be used: {reason}")]
    Folder {
        /// The folder.
        folder: String,
        /// What the system says.
        reason: std::io::Error,
    },
    /// Out of range.
    #[error(
        "recordings.segment_secs is {found}: it must be from {} to {}",
        MIN_SEGMENT.as_secs_f64(),
        MAX_SEGMENT.as_secs_f64()
    )]
    Segment {
        /// What was asked for.
        found: f64,
    },
}
