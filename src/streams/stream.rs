//! A live stream, as everybody but its task sees it.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use bytes::Bytes;
use steadymesh_mesh_io::{Format, ReadError};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::stream::{Accepted, EndReason, StreamCounters, StreamState, StreamSummary};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc, oneshot, watch};

use crate::pipeline::UnusableFrame;
use crate::stopwatch::microseconds;
use crate::telemetry::StreamMetrics;

use super::history::{Delivered, History, Loss, Outcome};
use super::{Configured, StreamName, Subscription};

/// A stream is called live for so long after its last frame.
const LIVE_FOR: Duration = Duration::from_secs(5);

/// A frame's body on its way in.
#[derive(Debug)]
pub struct Submission {
    /// The body.
    pub bytes: Bytes,
    /// What it is.
    pub format: Format,
    /// The frame's number, if the rig counts.
    pub seq: Option<u64>,
    /// When it was captured, in microseconds since 1970, if the rig says so.
    pub capture_time_us: Option<u64>,
    /// When the whole body was there.
    pub arrived: Instant,
}

/// Why a frame did not get into the stream.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Refused {
    /// As many frames as the stream may hold are waiting already.
    #[error("the stream's queue is full: frames come faster than they are processed")]
    QueueFull,
    /// The stream has ended or is about to.
    #[error("the stream has ended")]
    Ended,
    /// The body is not a mesh in this format, or too large a one.
    #[error(transparent)]
    Unreadable(#[from] ReadError),
    /// It is a mesh, but not one that can be worked on.
    #[error(transparent)]
    Unusable(#[from] UnusableFrame),
    /// Numbers ascend.
    #[error("the frame's number is {seq}, but frame {latest} has already been accepted")]
    SeqGoesBack {
        /// The frame's number.
        seq: u64,
        /// The newest accepted one.
        latest: u64,
    },
    /// A defect.
    #[error("the frame could not be read because of a defect of the server")]
    Panicked,
}

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
}

/// A submission with the way back to whoever sent it.
#[derive(Debug)]
pub(super) struct Incoming {
    pub submission: Submission,
    pub reply: oneshot::Sender<Result<Accepted, Refused>>,
    pub place: OwnedSemaphorePermit,
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

/// A live stream. Its task does the work; this is what the task shares with publishers,
/// subscribers and operators.
#[derive(Debug)]
pub struct Stream {
    name: StreamName,
    created: SystemTime,
    intake: mpsc::Sender<Incoming>,
    places: Arc<Semaphore>,
    request: watch::Sender<Request>,
    position: watch::Sender<Position>,
    configured: Mutex<Arc<Configured>>,
    history: Mutex<History>,
    last_arrival: Mutex<Option<Instant>>,
    pub(super) counters: Counters,
    metrics: StreamMetrics,
    subscriber_queue: usize,
}

/// What a stream starts with.
#[derive(Debug)]
pub(super) struct Parts {
    pub name: StreamName,
    pub configured: Configured,
    pub history: usize,
    pub subscriber_queue: usize,
    pub metrics: StreamMetrics,
}

/// A place in a stream's queue, taken before the body is read.
#[derive(Debug)]
pub struct Place {
    place: OwnedSemaphorePermit,
    intake: mpsc::Sender<Incoming>,
}

impl Place {
    /// Hands in a frame, and waits until it has been accepted or refused. Frames are taken in
    /// the order of these calls.
    ///
    /// # Errors
    ///
    /// [`Refused`] says why the frame does not take part.
    pub async fn submit(self, submission: Submission) -> Result<Accepted, Refused> {
        let (reply, accepted) = oneshot::channel();
        let incoming = Incoming {
            submission,
            reply,
            place: self.place,
        };
        // The channel holds as many as there are places, so it is never full.
        if self.intake.try_send(incoming).is_err() {
            return Err(Refused::Ended);
        }
        // A task that ends drops what it has not answered.
        accepted.await.unwrap_or(Err(Refused::Ended))
    }
}

impl Stream {
    /// The channel's capacity is the number of places in the queue.
    pub(super) fn new(parts: Parts, intake: mpsc::Sender<Incoming>) -> Self {
        Self {
            name: parts.name,
            created: SystemTime::now(),
            places: Arc::new(Semaphore::new(intake.max_capacity())),
            intake,
            request: watch::Sender::new(Request::Run),
            position: watch::Sender::new(Position::default()),
            configured: Mutex::new(Arc::new(parts.configured)),
            history: Mutex::new(History::new(parts.history)),
            last_arrival: Mutex::new(None),
            counters: Counters::default(),
            metrics: parts.metrics,
            subscriber_queue: parts.subscriber_queue,
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &StreamName {
        &self.name
    }

    /// Takes a place in the queue.
    ///
    /// # Errors
    ///
    /// [`Refused::QueueFull`] and [`Refused::Ended`].
    pub fn reserve(&self) -> Result<Place, Refused> {
        if self.intake.is_closed() {
            return Err(Refused::Ended);
        }
        let place = Arc::clone(&self.places).try_acquire_owned();
        Ok(Place {
            place: place.map_err(|_| Refused::QueueFull)?,
            intake: self.intake.clone(),
        })
    }

    /// Counts a frame that was refused.
    pub fn count_rejected(&self) {
        self.counters.rejected.fetch_add(1, Relaxed);
        self.metrics.rejected.inc();
    }

    /// Starts reading the stream with its newest frame.
    #[must_use]
    pub fn subscribe(self: &Arc<Self>) -> Subscription {
        Subscription::new(Arc::clone(self), self.subscriber_queue)
    }

    /// Waits until the outcome of frame `seq` is known; none if the stream ended before, or
    /// does not remember it any more.
    pub async fn outcome(&self, seq: u64) -> Option<Outcome> {
        let is_known =
            |position: &Position| Some(seq) <= position.newest_seq || position.end.is_some();
        self.watch().wait_for(is_known).await.ok()?;
        self.find(seq)
    }

    /// The outcome of frame `seq`, if the stream remembers it.
    #[must_use]
    pub fn find(&self, seq: u64) -> Option<Outcome> {
        self.history().find(seq).cloned()
    }

    /// The newest frame that is out.
    #[must_use]
    pub fn newest(&self) -> Option<Arc<Delivered>> {
        self.history().newest().cloned()
    }

    /// The newest `count` frames that are out, oldest first.
    #[must_use]
    pub fn last(&self, count: usize) -> Vec<Arc<Delivered>> {
        self.history().last(count)
    }

    /// How its frames are processed.
    #[must_use]
    pub fn configured(&self) -> Arc<Configured> {
        Arc::clone(&lock(&self.configured))
    }

    /// Changes how its frames are processed, from the next one that is started on.
    pub fn configure(&self, configured: Configured) {
        *lock(&self.configured) = Arc::new(configured);
    }

    /// Whether it has ended.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.position.borrow().end.is_some()
    }

    /// What operators and players see of it.
    #[must_use]
    pub fn summary(&self) -> StreamSummary {
        let counters = &self.counters;
        let last_arrival = *lock(&self.last_arrival);
        let is_live = last_arrival.is_some_and(|at| at.elapsed() < LIVE_FOR);
        let created = self.created.duration_since(SystemTime::UNIX_EPOCH);
        StreamSummary {
            stream: self.name.to_string(),
            state: if is_live {
                StreamState::Live
            } else {
                StreamState::Idle
            },
            config: self.configured().config.clone(),
            counters: StreamCounters {
                received: counters.received.load(Relaxed),
                published: counters.published.load(Relaxed),
                dropped: counters.dropped.load(Relaxed),
                rejected: counters.rejected.load(Relaxed),
                bytes_in: counters.bytes_in.load(Relaxed),
                bytes_out: counters.bytes_out.load(Relaxed),
            },
            subscribers: usize::try_from(self.metrics.subscribers.get()).unwrap_or_default(),
            queued: counters.queued.load(Relaxed),
            latest_seq: self.newest().map(|frame| frame.metrics.seq),
            created_us: microseconds(created.unwrap_or_default()),
        }
    }

    pub(super) fn metrics(&self) -> &StreamMetrics {
        &self.metrics
    }

    pub(super) fn request(&self, request: Request) {
        // A deletion is not taken back by a later drain.
        self.request.send_if_modified(|current| {
            let changes = *current == Request::Run
                || (*current, request) == (Request::Drain, Request::Delete);
            if changes {
                *current = request;
            }
            changes
        });
    }

    pub(super) fn requests(&self) -> watch::Receiver<Request> {
        self.request.subscribe()
    }

    pub(super) fn watch(&self) -> watch::Receiver<Position> {
        self.position.subscribe()
    }

    /// The next frame after `last` that is out, and the newest one; none if there is none.
    pub(super) fn frames_after(
        &self,
        last: Option<&Arc<Delivered>>,
    ) -> Option<(Arc<Delivered>, Arc<Delivered>)> {
        let history = self.history();
        let next = history.after(last.map(|frame| frame.metrics.seq))?;
        Some((Arc::clone(next), Arc::clone(history.newest()?)))
    }

    pub(super) fn count_received(&self, byte_count: usize, arrived: Instant) {
        *lock(&self.last_arrival) = Some(arrived);
        self.counters.received.fetch_add(1, Relaxed);
        self.counters.bytes_in.fetch_add(byte_count as u64, Relaxed);
        self.metrics.received.inc();
        self.metrics.bytes_in.inc_by(byte_count as u64);
    }

    /// Makes a frame known to readers and to whoever waits for it.
    pub(super) fn deliver(&self, metrics: FrameMetrics, draco: &[u8]) -> Arc<Delivered> {
        let frame = self.history().deliver(metrics, draco);
        self.counters.published.fetch_add(1, Relaxed);
        self.counters
            .bytes_out
            .fetch_add(draco.len() as u64, Relaxed);
        self.metrics.observe(&frame.metrics);
        self.advance();
        frame
    }

    /// Makes it known that an accepted frame will not come out.
    pub(super) fn lose(&self, seq: u64, loss: Loss, after: Duration) {
        self.history().push(seq, Outcome::Lost(loss));
        self.counters.dropped.fetch_add(1, Relaxed);
        self.metrics.lost(loss.as_str(), after);
        self.advance();
    }

    pub(super) fn end(&self, reason: EndReason) {
        self.position
            .send_modify(|position| position.end = Some(reason));
    }

    fn advance(&self) {
        let newest_seq = self.history().newest_seq();
        self.position
            .send_modify(|position| position.newest_seq = newest_seq);
    }

    fn history(&self) -> MutexGuard<'_, History> {
        lock(&self.history)
    }
}

/// Nothing that panics is done under these locks, so a poisoned one is as good as new.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
