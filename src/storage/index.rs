//! What a track has, segment by segment: pages of an index, and what is read from them.
//!
//! A page is written anew after each of its segments, and only once that is stored: the index may
//! be behind the data, never ahead of it.

use serde::{Deserialize, Serialize};
use steadymesh_proto::recording::{Gap, TrackSummary};

use super::segment::Footer;

/// Segments of a page: about a minute of them. What retention takes away, it takes page by page.
pub(super) const PAGE_SEGMENTS: u32 = 64;

/// One page of an index.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Page {
    pub version: u32,
    pub segments: Vec<Segment>,
}

/// What the index knows of a segment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Segment {
    /// The segments of a track are counted from 0.
    pub ordinal: u32,
    /// The object's length.
    pub length: u64,
    pub frames: u64,
    /// Of the frames.
    pub bytes: u64,
    pub first_seq: Option<u64>,
    pub last_seq: Option<u64>,
    pub first_time_us: Option<u64>,
    pub last_time_us: Option<u64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gaps: Vec<Gap>,
}

impl Page {
    pub const VERSION: u32 = 1;

    pub fn new(segments: Vec<Segment>) -> Self {
        let version = Self::VERSION;
        Self { version, segments }
    }

    /// The page that segment `ordinal` is on.
    pub fn of(ordinal: u32) -> u32 {
        ordinal / PAGE_SEGMENTS
    }
}

impl Segment {
    pub fn new(ordinal: u32, length: u64, footer: &Footer) -> Self {
        let (first, last) = (footer.frames.first(), footer.frames.last());
        Self {
            ordinal,
            length,
            frames: footer.frames.len() as u64,
            bytes: footer.frames.iter().map(|entry| entry.frame.bytes).sum(),
            first_seq: first.map(|entry| entry.frame.seq),
            last_seq: last.map(|entry| entry.frame.seq),
            first_time_us: first.map(|entry| entry.frame.time_us()),
            last_time_us: last.map(|entry| entry.frame.time_us()),
            gaps: footer.gaps.clone(),
        }
    }
}

/// Where in a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// At the first frame with this number or a later one.
    Seq(u64),
    /// At the first frame of this time or a later one, in microseconds since 1970.
    Time(u64),
}

/// All segments of a track, in order.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct TrackIndex {
    segments: Vec<Segment>,
}

impl TrackIndex {
    /// From the pages' segments, in order.
    pub fn new(segments: Vec<Segment>) -> Self {
        Self { segments }
    }

    /// The segment that counts `position`th, from 0.
    pub fn get(&self, position: usize) -> Option<&Segment> {
        self.segments.get(position)
    }

    /// The position of the first segment that may have a frame from `start` on.
    pub fn position(&self, start: Start) -> usize {
        let is_before = |segment: &Segment| match start {
            Start::Seq(seq) => segment.last_seq.is_none_or(|last| last < seq),
            Start::Time(time) => segment.last_time_us.is_none_or(|last| last < time),
        };
        // Times may go back where a rig's clock was set: the first segment that is late enough.
        let found = self.segments.iter().position(|segment| !is_before(segment));
        found.unwrap_or(self.segments.len())
    }

    pub fn last_ordinal(&self) -> Option<u32> {
        self.segments.last().map(|segment| segment.ordinal)
    }

    pub fn push(&mut self, segment: Segment) {
        self.segments.push(segment);
    }

    pub fn summary(&self) -> TrackSummary {
        let mut summary = TrackSummary::default();
        for segment in &self.segments {
            add(&mut summary, segment);
        }
        summary
    }
}

/// Counts a segment in.
pub(super) fn add(summary: &mut TrackSummary, segment: &Segment) {
    summary.segments += 1;
    summary.frames += segment.frames;
    summary.bytes += segment.bytes;
    summary.first_seq = summary.first_seq.or(segment.first_seq);
    summary.last_seq = segment.last_seq.or(summary.last_seq);
    summary.first_time_us = summary.first_time_us.or(segment.first_time_us);
    summary.last_time_us = segment.last_time_us.or(summary.last_time_us);
    summary.gaps.extend_from_slice(&segment.gaps);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(ordinal: u32, seqs: Option<(u64, u64)>) -> Segment {
        Segment {
            ordinal,
            length: 100,
            frames: 2,
            bytes: 50,
            first_seq: seqs.map(|seqs| seqs.0),
            last_seq: seqs.map(|seqs| seqs.1),
            first_time_us: seqs.map(|seqs| seqs.0 * 10),
            last_time_us: seqs.map(|seqs| seqs.1 * 10),
            gaps: Vec::new(),
        }
    }

    #[test]
    fn a_place_is_found_by_number_and_by_time() {
        let index = TrackIndex::new(vec![
            segment(3, Some((10, 19))),
            // Nothing but a gap.
            segment(4, None),
            segment(5, Some((25, 30))),
        ]);
        for (seq, position) in [(0, 0), (19, 0), (20, 2), (30, 2), (31, 3)] {
            assert_eq!(index.position(Start::Seq(seq)), position, "frame {seq}");
            assert_eq!(index.position(Start::Time(seq * 10)), position);
        }
        let summary = index.summary();
        assert_eq!((summary.first_seq, summary.last_seq), (Some(10), Some(30)));
        assert_eq!(summary.segments, 3);
    }
}
