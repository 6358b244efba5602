//! One reader of a stream, and what it loses when it is slow.

use std::sync::Arc;

use steadymesh_proto::stream::EndReason;

use super::history::Delivered;
use super::stream::{Position, Stream};

/// What a reader is to be told next.
#[derive(Debug)]
pub enum Delivery {
    /// A frame.
    Frame(Arc<Delivered>),
    /// The reader was too slow: this many frames are left out before the next one.
    Skipped(u64),
    /// Nothing more will come.
    End(EndReason),
}

/// A place in a stream, starting with its newest frame.
///
/// It holds no frames of its own: readers walk along what the stream remembers anyway, so
/// that any number of them costs nothing. One that has fallen further behind than the
/// stream's `subscriber_queue` goes on with the newest frame.
#[derive(Debug)]
pub struct Subscription {
    stream: Arc<Stream>,
    position: tokio::sync::watch::Receiver<Position>,
    last: Option<Arc<Delivered>>,
    /// The newest frame, to be sent after the reader has been told what it missed.
    pending: Option<Arc<Delivered>>,
    max_behind: u64,
}

impl Subscription {
    pub(super) fn new(stream: Arc<Stream>, max_behind: usize) -> Self {
        stream.metrics().subscribers.inc();
        Self {
            position: stream.watch(),
            stream,
            last: None,
            pending: None,
            max_behind: max_behind as u64,
        }
    }

    /// Waits for what comes next.
    ///
    /// Cancel safe: dropping the future loses nothing.
    pub async fn next(&mut self) -> Delivery {
        loop {
            // Marks the position as seen before looking, so that no change is missed.
            let end = self.position.borrow_and_update().end;
            if let Some(delivery) = self.try_next() {
                return delivery;
            }
            if let Some(reason) = end {
                return Delivery::End(reason);
            }
            // The sender lives as long as the stream, which this subscription holds.
            if self.position.changed().await.is_err() {
                return Delivery::End(EndReason::Shutdown);
            }
        }
    }

    fn try_next(&mut self) -> Option<Delivery> {
        if let Some(frame) = self.pending.take() {
            return Some(self.deliver(frame));
        }
        let (next, newest) = self.stream.frames_after(self.last.as_ref())?;
        let missed = match &self.last {
            // A newcomer starts with the newest frame and has missed nothing.
            None => return Some(self.deliver(newest)),
            Some(last) => {
                let behind = newest.frames_since(last);
                let forgotten = next.frames_since(last);
                if behind < self.max_behind && forgotten == 0 {
                    return Some(self.deliver(next));
                }
                behind
            }
        };
        self.stream.metrics().skipped.inc_by(missed);
        self.pending = Some(newest);
        Some(Delivery::Skipped(missed))
    }

    fn deliver(&mut self, frame: Arc<Delivered>) -> Delivery {
        self.last = Some(Arc::clone(&frame));
        Delivery::Frame(frame)
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        self.stream.metrics().subscribers.dec();
    }
}
