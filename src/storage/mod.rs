//! Recordings: what goes through a stream, kept in an object store, and played from there.
//!
//! [`Recordings`] is the store. A [`Recorder`] writes one recording: it takes frames without ever
//! waiting, and what the store does not take in time becomes a gap. A [`Recording`] is read with
//! a [`Cursor`].
//!
//! `docs/recordings.md` says how it is laid out. Nothing else here knows `object_store`.

mod cursor;
mod index;
mod layout;
mod manifest;
mod options;
mod reader;
mod recorder;
mod recordings;
mod retention;
mod segment;
mod store;
mod track_writer;

pub use cursor::{Cursor, StoredFrame};
pub use index::Start;
pub use layout::RecordingKey;
pub use options::{Options, UnusableStore};
pub use reader::{ReadFailed, Recording};
pub use recorder::{RawFrame, Recorder};
pub use recordings::Recordings;
pub use segment::InvalidSegment;

#[cfg(test)]
mod tests;
