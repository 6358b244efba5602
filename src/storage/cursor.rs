//! Reads a track frame by frame.

use std::collections::VecDeque;
use std::sync::Arc;

use bytes::Bytes;
use steadymesh_proto::recording::{RecordedFrame, Track};

use super::index::{Segment, Start};
use super::reader::{ReadFailed, Recording, is_from};
use super::segment::Entry;

/// A frame of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredFrame {
    /// What is known of it.
    pub frame: RecordedFrame,
    /// Its bytes: what the rig sent, or a delivered frame.
    pub body: Bytes,
}

/// A place in a track. One segment is in memory at a time.
#[derive(Debug)]
pub struct Cursor {
    recording: Arc<Recording>,
    track: Track,
    start: Start,
    /// The segment to be read next.
    position: usize,
    segment: Option<(Segment, Bytes)>,
    /// Whether the frame to begin with has been found.
    has_begun: bool,
    /// Frames of it that have not been given.
    entries: VecDeque<Entry>,
}

impl Cursor {
    pub(super) fn new(recording: Arc<Recording>, track: Track, start: Start) -> Self {
        Self {
            position: recording.index(track).position(start),
            recording,
            track,
            start,
            segment: None,
            has_begun: false,
            entries: VecDeque::new(),
        }
    }

    /// The next frame; none after the last.
    ///
    /// # Errors
    ///
    /// [`ReadFailed`]. What comes after a damaged frame or segment can still be read.
    pub async fn next(&mut self) -> Result<Option<StoredFrame>, ReadFailed> {
        loop {
            if let Some((segment, bytes)) = &self.segment
                && let Some(entry) = self.entries.pop_front()
            {
                let range = entry.range();
                // Within the segment, as was checked when its list was read.
                let body = bytes.slice(range.start as usize..range.end as usize);
                return self
                    .recording
                    .checked(self.track, segment, entry, body)
                    .map(Some);
            }
            let index = self.recording.index(self.track);
            let Some(segment) = index.get(self.position).cloned() else {
                return Ok(None);
            };
            self.position += 1;
            let (footer, bytes) = self.recording.segment(self.track, &segment).await?;
            let entries = footer.frames.into_iter();
            // What comes behind the first is wanted whatever its time: clocks are set.
            let (has_begun, start) = (self.has_begun, self.start);
            self.entries = entries
                .skip_while(|entry| !has_begun && !is_from(entry, start))
                .collect();
            self.has_begun |= !self.entries.is_empty();
            self.segment = Some((segment, bytes));
        }
    }
}
