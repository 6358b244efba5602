//! What is known of streams and of the newest outcomes, from the bus.

use std::collections::{HashMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use crate::bus::{Outcome, Outcomes, Processed, Records, StreamRecord};

/// Outcomes that are remembered of a stream: a frame asks for that of the one before it.
const REMEMBERED: usize = 4;

/// What is written up for all frames in work.
#[derive(Debug, Default)]
pub(super) struct Board {
    streams: Mutex<HashMap<String, Known>>,
    /// How often something was written.
    changes: watch::Sender<u64>,
}

#[derive(Debug, Default)]
struct Known {
    record: Option<StreamRecord>,
    outcomes: VecDeque<Processed>,
}

/// What became of a frame, as far as it is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Fate {
    /// Nothing yet.
    Open,
    /// This.
    Known(Outcome),
    /// It is so long ago that it is not remembered.
    Past,
}

impl Board {
    /// Writes up what is heard. Ends with its future.
    pub async fn listen(&self, mut outcomes: Outcomes, mut records: Records) {
        loop {
            tokio::select! {
                processed = outcomes.next() => self.write_outcome(processed),
                (stream, record) = records.next() => self.write_record(stream, record),
            }
        }
    }

    pub fn write_outcome(&self, processed: Processed) {
        {
            let mut streams = self.lock();
            let known = streams.entry(processed.stream.clone()).or_default();
            let is_new = known
                .outcomes
                .back()
                .is_none_or(|last| (last.instance, last.seq) < (processed.instance, processed.seq));
            if !is_new {
                return;
            }
            known.outcomes.push_back(processed);
            if REMEMBERED < known.outcomes.len() {
                known.outcomes.pop_front();
            }
        }
        self.changes.send_modify(|changes| *changes += 1);
    }

    fn write_record(&self, stream: String, record: StreamRecord) {
        {
            let mut streams = self.lock();
            let known = streams.entry(stream).or_default();
            let last = known.record.as_ref();
            if last.is_some_and(|last| !record.follows(last)) {
                return;
            }
            if record.ended.is_some() {
                // Nothing is asked of it any more; its record says so to frames that are left.
                known.outcomes.retain(|o| record.instance < o.instance);
            }
            known.record = Some(record);
        }
        self.changes.send_modify(|changes| *changes += 1);
    }

    /// Waits until the record of this stream of the name, or of a later one, is known.
    pub async fn record(&self, stream: &str, instance: u64) -> StreamRecord {
        let mut changes = self.changes.subscribe();
        loop {
            let known = self
                .lock()
                .get(stream)
                .and_then(|known| known.record.clone());
            if let Some(record) = known.filter(|record| instance <= record.instance) {
                return record;
            }
            // The board outlives all who read it.
            changes.changed().await.ok();
        }
    }

    /// What became of a frame.
    pub fn fate(&self, stream: &str, instance: u64, seq: u64) -> Fate {
        let streams = self.lock();
        let Some(known) = streams.get(stream) else {
            return Fate::Open;
        };
        let own = known.outcomes.iter().filter(|o| o.instance == instance);
        let mut newest = None;
        for processed in own {
            if processed.seq == seq {
                return Fate::Known(processed.outcome.clone());
            }
            newest = newest.max(Some(processed.seq));
        }
        if newest.is_some_and(|newest| seq < newest) {
            Fate::Past
        } else {
            Fate::Open
        }
    }

    /// Waits until something is known of a frame.
    pub async fn settled(&self, stream: &str, instance: u64, seq: u64) -> Fate {
        let mut changes = self.changes.subscribe();
        loop {
            match self.fate(stream, instance, seq) {
                Fate::Open => {
                    changes.changed().await.ok();
                }
                fate => return fate,
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, Known>> {
        // Nothing that panics is done under this lock.
        self.streams.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;

    fn processed(instance: u64, seq: u64) -> Processed {
        Processed {
            stream: "a".to_owned(),
            instance,
            seq,
            outcome: Outcome::Delivered(Bytes::from(seq.to_string())),
        }
    }

    #[test]
    fn what_became_of_a_frame_is_open_known_or_past() {
        let board = Board::default();
        assert_eq!(board.fate("a", 1, 0), Fate::Open);
        for seq in [0, 2, 4, 6, 8] {
            board.write_outcome(processed(1, seq));
        }
        assert_eq!(board.fate("a", 1, 8), Fate::Known(processed(1, 8).outcome));
        assert_eq!(board.fate("a", 1, 0), Fate::Past);
        assert_eq!(board.fate("a", 1, 9), Fate::Open);
        // A stream that was made anew begins anew, and what is older does not come after it.
        board.write_outcome(processed(2, 0));
        board.write_outcome(processed(1, 10));
        assert_eq!(board.fate("a", 2, 0), Fate::Known(processed(2, 0).outcome));
        assert_eq!(board.fate("a", 1, 10), Fate::Open);
    }
}
