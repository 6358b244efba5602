//! One reader of a stream, and what it loses when it is slow.

use std::sync::Arc;
use std::time::Duration;

use steadymesh_proto::stream::EndReason;
use tokio::time::Instant;

use super::history::Delivered;
use super::parts::Position;
use super::stream::Stream;

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
    /// Whether there was no frame yet when it began, so that the first one is its first too.
    from_first: bool,
    /// When a paced reader is due its next frame.
    not_before: Option<Instant>,
}

/// A reader's seat: counted for as long as it is held.
#[derive(Debug)]
pub struct Seat {
    stream: Arc<Stream>,
}

impl Seat {
    pub(super) fn new(stream: Arc<Stream>) -> Self {
        Self { stream }
    }

    /// The stream.
    #[must_use]
    pub fn stream(&self) -> &Arc<Stream> {
        &self.stream
    }

    /// Starts reading the stream with its newest frame.
    #[must_use]
    pub fn subscribe(&self) -> Subscription {
        Subscription::new(Arc::clone(&self.stream), self.stream.subscriber_queue())
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.stream.metrics().subscribers.dec();
    }
}

impl Subscription {
    pub(super) fn new(stream: Arc<Stream>, max_behind: usize) -> Self {
        Self {
            position: stream.watch(),
            not_before: None,
            from_first: stream.newest().is_none(),
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

    /// What comes next if it is there already. The end is left to [`Subscription::next`].
    pub fn next_if_there(&mut self) -> Option<Delivery> {
        // A paced reader's next frame is not there before its time.
        if self.not_before.is_some() {
            return None;
        }
        self.try_next()
    }

    /// Like [`Subscription::next`], with at least `pace` between two frames: the newest one when
    /// its time has come. What lies between is not missed, for it was not wanted.
    ///
    /// Cancel safe.
    pub async fn next_paced(&mut self, pace: Duration) -> Delivery {
        if pace.is_zero() {
            return self.next().await;
        }
        if let Some(due) = self.not_before {
            let ended = self.stream.ended();
            tokio::select! {
                () = tokio::time::sleep_until(due) => {}
                // The frames that are left, and then the end.
                _ = ended => return self.next().await,
            }
        }
        if let Some((_, newest)) = self.stream.frames_after(self.last.as_ref()) {
            self.pending = Some(newest);
        }
        let delivery = self.next().await;
        if let Delivery::Frame(_) = delivery {
            let now = Instant::now();
            // From when it was due, so that ten of thirty frames a second are ten.
            let due = self.not_before.map_or(now, |due| due + pace);
            self.not_before = Some(due.max(now));
            if self.not_before == Some(now) {
                self.not_before = Some(now + pace);
            }
        }
        delivery
    }

    fn try_next(&mut self) -> Option<Delivery> {
        if let Some(frame) = self.pending.take() {
            return Some(self.deliver(frame));
        }
        let (next, newest) = self.stream.frames_after(self.last.as_ref())?;
        let missed = match &self.last {
            // A newcomer starts with the newest frame and has missed nothing.
            None => {
                let first = if self.from_first { next } else { newest };
                return Some(self.deliver(first));
            }
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
