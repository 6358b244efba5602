//! What a stream remembers: its newest frames, ready to be sent again.

use std::collections::VecDeque;
use std::sync::Arc;

use bytes::Bytes;
use steadymesh_proto::{DeliveredFrame, FrameMetrics};

/// A frame that is out.
#[derive(Debug)]
pub struct Delivered {
    /// Its figures.
    pub metrics: FrameMetrics,
    /// The binary message of `subscribe`, encoded once for all readers.
    pub message: Bytes,
    /// The Draco bytes: the end of `message`.
    pub mesh: Bytes,
    /// How many frames of the stream came out before this one.
    ordinal: u64,
}

/// Why a frame that had been accepted did not come out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// A newer frame took its place, as the stream's `overload` setting asks for.
    Overload,
    /// A defect of the server.
    Failed,
}

impl Loss {
    /// The name under which it is counted.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Overload => "overload",
            Self::Failed => "failed",
        }
    }
}

/// What became of an accepted frame.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// It is out.
    Delivered(Arc<Delivered>),
    /// It is not coming.
    Lost(Loss),
}

/// The outcomes of a stream's newest frames, oldest first; what does not fit is forgotten,
/// oldest first.
#[derive(Debug)]
pub(super) struct History {
    /// Numbers are ascending, with gaps where the rig has left some out.
    entries: VecDeque<(u64, Outcome)>,
    capacity: usize,
    delivered: u64,
}

impl History {
    pub fn new(capacity: usize) -> Self {
        Self {
            entries: VecDeque::with_capacity(capacity.min(1024)),
            capacity: capacity.max(1),
            delivered: 0,
        }
    }

    /// Adds the outcome of the next frame.
    pub fn push(&mut self, seq: u64, outcome: Outcome) {
        if self.entries.len() == self.capacity {
            self.entries.pop_front();
        }
        self.entries.push_back((seq, outcome));
    }

    /// Encodes a frame and adds it.
    pub fn deliver(&mut self, metrics: FrameMetrics, draco: &[u8]) -> Arc<Delivered> {
        let frame = DeliveredFrame {
            metrics,
            mesh: draco,
        };
        let message = Bytes::from(frame.encode());
        let delivered = Arc::new(Delivered {
            mesh: message.slice(message.len() - draco.len()..),
            message,
            metrics: frame.metrics,
            ordinal: self.delivered,
        });
        self.delivered += 1;
        let seq = delivered.metrics.seq;
        self.push(seq, Outcome::Delivered(Arc::clone(&delivered)));
        delivered
    }

    /// The outcome of the frame with this number, if it is remembered.
    pub fn find(&self, seq: u64) -> Option<&Outcome> {
        let at = self.entries.binary_search_by_key(&seq, |entry| entry.0);
        at.ok().map(|index| &self.entries[index].1)
    }

    /// The number of the newest frame whose outcome is known.
    pub fn newest_seq(&self) -> Option<u64> {
        self.entries.back().map(|entry| entry.0)
    }

    /// The oldest frame after number `seq` that is out, or the oldest of all.
    pub fn after(&self, seq: Option<u64>) -> Option<&Arc<Delivered>> {
        let start = self
            .entries
            .partition_point(|entry| seq.is_some_and(|seq| entry.0 <= seq));
        self.entries.range(start..).find_map(delivered)
    }

    /// The newest frame that is out.
    pub fn newest(&self) -> Option<&Arc<Delivered>> {
        self.entries.iter().rev().find_map(delivered)
    }

    /// The newest `count` frames that are out, oldest first.
    pub fn last(&self, count: usize) -> Vec<Arc<Delivered>> {
        let newest_first = self.entries.iter().rev().filter_map(delivered);
        let mut frames: Vec<_> = newest_first.take(count).cloned().collect();
        frames.reverse();
        frames
    }
}

impl Delivered {
    /// How many frames came out between `earlier` and this one.
    pub(super) fn frames_since(&self, earlier: &Self) -> u64 {
        self.ordinal.saturating_sub(earlier.ordinal + 1)
    }
}

fn delivered(entry: &(u64, Outcome)) -> Option<&Arc<Delivered>> {
    match &entry.1 {
        Outcome::Delivered(frame) => Some(frame),
        Outcome::Lost(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deliver(history: &mut History, seq: u64) -> Arc<Delivered> {
        let metrics = FrameMetrics {
            seq,
            ..FrameMetrics::default()
        };
        history.deliver(metrics, format!("mesh {seq}").as_bytes())
    }

    #[test]
    fn the_oldest_frames_are_forgotten() {
        let mut history = History::new(3);
        for seq in [2, 4, 6, 8] {
            deliver(&mut history, seq);
        }
        assert!(history.find(2).is_none());
        assert!(history.find(5).is_none());
        assert!(matches!(history.find(4), Some(Outcome::Delivered(_))));
        let last: Vec<_> = history.last(2).iter().map(|f| f.metrics.seq).collect();
        assert_eq!(last, [6, 8]);
    }

    #[test]
    fn a_lost_frame_is_known_as_lost_and_skipped_by_readers() {
        let mut history = History::new(9);
        let first = deliver(&mut history, 0);
        history.push(1, Outcome::Lost(Loss::Overload));
        let third = deliver(&mut history, 2);
        assert!(matches!(
            history.find(1),
            Some(Outcome::Lost(Loss::Overload))
        ));
        assert_eq!(history.after(Some(0)).unwrap().metrics.seq, 2);
        assert_eq!(third.frames_since(&first), 0);
    }

    #[test]
    fn the_mesh_is_the_end_of_the_message() {
        let frame = deliver(&mut History::new(1), 7);
        assert_eq!(&frame.mesh[..], b"mesh 7");
        assert_eq!(
            DeliveredFrame::decode(&frame.message).unwrap().mesh,
            b"mesh 7"
        );
    }
}
