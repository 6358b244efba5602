//! A live stream, as everybody but its task sees it.

use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use steadymesh_proto::stream::{EndReason, StreamCounters, StreamState, StreamSummary};
use tokio::sync::{Notify, watch};
use tokio_util::sync::CancellationToken;

use crate::stopwatch::microseconds;
use crate::storage::RawFrame;
use crate::telemetry::StreamMetrics;

use super::events::{Events, Life};
use super::history::{Delivered, Encoded, History, Loss, Outcome};
use super::intake::Intake;
use super::parts::{Counters, Parts, Position, Request};
use super::publisher_slot::PublisherSlot;
use super::relayed::Relayed;
use super::tape::Tape;
use super::{Configured, Occupied, Place, Publication, Refused, Seat, Session, StreamName};

/// A stream is called live for so long after its last frame.
const LIVE_FOR: Duration = Duration::from_secs(5);

/// A live stream. Its task does the work; this is what the task shares with publishers,
/// subscribers and operators.
#[derive(Debug)]
pub struct Stream {
    name: StreamName,
    created: SystemTime,
    begun: Instant,
    intake: Intake,
    publisher: Mutex<PublisherSlot>,
    linger: Duration,
    request: watch::Sender<Request>,
    position: watch::Sender<Position>,
    configured: Mutex<Arc<Configured>>,
    history: Mutex<History>,
    last_arrival: Mutex<Option<Instant>>,
    last_outcome: Mutex<Option<Instant>>,
    latest_accepted: Mutex<Option<u64>>,
    pub(super) counters: Counters,
    metrics: StreamMetrics,
    subscriber_queue: usize,
    events: Events,
    tape: Tape,
    /// Frames on the bus whose outcome is not known.
    relayed: Relayed,
    is_known: watch::Sender<bool>,
    revision: Mutex<u64>,
    records_at_once: bool,
    /// The configuration was changed here, which other nodes are to be told.
    changed: Notify,
}

impl Stream {
    pub(super) fn new(parts: Parts, intake: Intake) -> Self {
        let tape = Tape::new(parts.recordings);
        if parts.records_at_once {
            tape.configure(&parts.name, &parts.configured);
        }
        Self {
            tape,
            name: parts.name,
            created: parts.created,
            begun: Instant::now(),
            intake,
            publisher: Mutex::default(),
            linger: parts.linger,
            request: watch::Sender::new(Request::Run),
            position: watch::Sender::new(Position::default()),
            configured: Mutex::new(Arc::new(parts.configured)),
            history: Mutex::new(History::new(parts.history)),
            last_arrival: Mutex::default(),
            last_outcome: Mutex::default(),
            latest_accepted: Mutex::default(),
            counters: Counters::default(),
            metrics: parts.metrics,
            subscriber_queue: parts.subscriber_queue,
            events: parts.events,
            relayed: Relayed::default(),
            is_known: watch::Sender::new(!parts.is_shared),
            revision: Mutex::new(parts.revision),
            records_at_once: parts.records_at_once,
            changed: Notify::new(),
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &StreamName {
        &self.name
    }

    /// Takes a place in the queue, for frames that come without a connection of their own.
    ///
    /// # Errors
    ///
    /// [`Refused::Occupied`] if the stream has a publisher by connection and this is no
    /// `takeover`, [`Refused::QueueFull`] and [`Refused::Ended`].
    pub fn reserve(&self, takeover: bool) -> Result<Place, Refused> {
        lock(&self.publisher).pass(takeover, Instant::now())?;
        self.intake.reserve()
    }

    /// Takes the publisher's place.
    ///
    /// # Errors
    ///
    /// [`Occupied`] if another publisher has it and this is no `takeover`.
    pub fn publish(
        self: &Arc<Self>,
        session: Session,
        takeover: bool,
    ) -> Result<Publication, Occupied> {
        let claim = lock(&self.publisher).claim(session.clone(), takeover, Instant::now());
        Ok(Publication::new(Arc::clone(self), session, claim?))
    }

    pub(super) fn intake(&self) -> &Intake {
        &self.intake
    }

    /// Whether a publisher is connected or expected back.
    pub(super) fn has_publisher(&self) -> bool {
        lock(&self.publisher).is_held(Instant::now())
    }

    /// Whether the queue has no place at this moment.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.intake.free_places() == 0
    }

    pub(super) fn release_publisher(&self, claim: &CancellationToken, comes_back: bool) {
        let keep = comes_back.then_some(self.linger);
        lock(&self.publisher).release(claim, keep, Instant::now());
    }

    /// Counts a frame that was refused.
    pub fn count_rejected(&self) {
        self.counters.rejected.fetch_add(1, Relaxed);
        self.metrics.rejected.inc();
    }

    /// Takes a reader's seat; none if `limit` of them are taken.
    #[must_use]
    pub fn take_seat(self: &Arc<Self>, limit: usize) -> Option<Seat> {
        let subscribers = &self.metrics.subscribers;
        subscribers.inc();
        // Made first, so that it is given back in either case.
        let seat = Seat::new(Arc::clone(self));
        (subscribers.get() <= i64::try_from(limit).unwrap_or(i64::MAX)).then_some(seat)
    }

    pub(super) fn subscriber_queue(&self) -> usize {
        self.subscriber_queue
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

    /// The newest frame with the image of this name.
    #[must_use]
    pub fn textured(&self, id: &str) -> Option<Arc<Delivered>> {
        self.history().texture(id).cloned()
    }

    /// The newest frame that is out.
    #[must_use]
    pub fn newest(&self) -> Option<Arc<Delivered>> {
        self.history().newest().cloned()
    }

    /// The numbers of the oldest and the newest frame that are out and remembered.
    #[must_use]
    pub fn remembered(&self) -> Option<(u64, u64)> {
        let history = self.history();
        let (oldest, newest) = (history.after(None)?, history.newest()?);
        Some((oldest.metrics.seq, newest.metrics.seq))
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
        {
            let mut revision = lock(&self.revision);
            // Later than any that is known, also where another node's clock is ahead.
            *revision = (*revision + 1).max(now_us());
            self.put(configured);
        }
        self.changed.notify_one();
    }

    /// Which configuration it has.
    pub(super) fn revision(&self) -> u64 {
        *lock(&self.revision)
    }

    /// Waits until the configuration has been changed here.
    pub(super) async fn changed(&self) {
        self.changed.notified().await;
    }

    /// Takes a configuration of another node, unless it is older than the one that is there.
    pub(super) fn take_configuration(&self, configured: Configured, newer: u64) {
        let mut revision = lock(&self.revision);
        if *revision < newer {
            *revision = newer;
            self.put(configured);
        }
    }

    fn put(&self, configured: Configured) {
        if self.tape.has_begun() || self.records_at_once {
            self.tape.configure(&self.name, &configured);
        }
        *lock(&self.configured) = Arc::new(configured);
    }

    /// Whether it has ended.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.position.borrow().end.is_some()
    }

    /// Waits until it has ended.
    pub fn ended(&self) -> impl Future<Output = EndReason> + use<> {
        let mut position = self.watch();
        async move {
            let ended = position.wait_for(|position| position.end.is_some()).await;
            // A stream that is gone without having ended went with its server.
            ended
                .ok()
                .and_then(|position| position.end)
                .unwrap_or(EndReason::Shutdown)
        }
    }

    /// Waits until it is known how far the stream has come: at once, unless other nodes have it too.
    pub async fn known(&self) {
        // The sender is part of this.
        self.is_known
            .subscribe()
            .wait_for(|known| *known)
            .await
            .ok();
    }

    /// It is known now: to the frame of this number, if there is one.
    pub(super) fn is_known_to(&self, seq: Option<u64>) {
        {
            let mut latest = lock(&self.latest_accepted);
            *latest = (*latest).max(seq);
        }
        self.is_known.send_replace(true);
    }

    /// The newest number that has been accepted.
    #[must_use]
    pub fn latest_accepted(&self) -> Option<u64> {
        *lock(&self.latest_accepted)
    }

    /// What operators and players see of it.
    #[must_use]
    pub fn summary(&self) -> StreamSummary {
        let counters = &self.counters;
        let last_arrival = *lock(&self.last_arrival);
        let last_seen = last_arrival.max(*lock(&self.last_outcome));
        let is_live = last_seen.is_some_and(|at| at.elapsed() < LIVE_FOR) || self.has_publisher();
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
            created_us: self.created_us(),
            recording: self.tape.status(),
        }
    }

    /// What is recorded of it.
    #[must_use]
    pub fn recording(&self) -> &Tape {
        &self.tape
    }

    /// When it was made, in microseconds since 1970.
    #[must_use]
    pub fn created_us(&self) -> u64 {
        let created = self.created.duration_since(SystemTime::UNIX_EPOCH);
        microseconds(created.unwrap_or_default())
    }

    pub(super) fn metrics(&self) -> &StreamMetrics {
        &self.metrics
    }

    pub(super) fn request(&self, request: Request) {
        // A deletion is not taken back by a later drain.
        self.request.send_if_modified(|current| {
            let changes = *current == Request::Run
                || (*current, request) == (Request::Drain, Request::Delete)
                || (*current, request) == (Request::Drain, Request::Follow)
                || (*current, request) == (Request::Drain, Request::Abandon);
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

    pub(super) fn count_received(&self, seq: u64, byte_count: usize, arrived: Instant) {
        *lock(&self.latest_accepted) = Some(seq);
        *lock(&self.last_arrival) = Some(arrived);
        self.counters.received.fetch_add(1, Relaxed);
        self.counters.bytes_in.fetch_add(byte_count as u64, Relaxed);
        self.metrics.received.inc();
        self.metrics.bytes_in.inc_by(byte_count as u64);
    }

    /// Frames on the bus whose outcome is not known.
    pub(super) fn relayed(&self) -> &Relayed {
        &self.relayed
    }

    /// The newest frame whose outcome is known.
    pub(super) fn newest_outcome(&self) -> Option<u64> {
        self.history().newest_seq()
    }

    /// Records a frame that came in here.
    pub(super) fn record_raw(&self, frame: RawFrame) {
        // Of a stream that was heard of on the bus, the recording begins with the first frame
        // that is published here.
        self.tape.configure(&self.name, &self.configured());
        self.tape.raw(frame);
    }

    /// Makes a frame known that was processed elsewhere; it is recorded where it was accepted.
    pub(super) fn deliver_relayed(&self, frame: Encoded, is_own: bool) {
        *lock(&self.last_outcome) = Some(Instant::now());
        self.make_known(frame, is_own);
    }

    /// Makes a frame known to readers and to whoever waits for it.
    pub(super) fn deliver(&self, frame: Encoded) {
        self.make_known(frame, true);
    }

    /// Shows how many frames are accepted and not out yet.
    pub(super) fn show_queued(&self, queued: usize) {
        self.counters.queued.store(queued, Relaxed);
        self.metrics.queued.set(queued as i64);
    }

    /// How long ago it was made, or heard of.
    pub(super) fn age(&self) -> Duration {
        self.begun.elapsed()
    }

    /// Whether no frame has ever been accepted.
    pub(super) fn is_unused(&self) -> bool {
        lock(&self.latest_accepted).is_none()
    }

    /// How long ago its last frame came in or out here; none if none has.
    pub(super) fn quiet_for(&self) -> Option<Duration> {
        let last = (*lock(&self.last_arrival)).max(*lock(&self.last_outcome));
        last.map(|last| last.elapsed())
    }

    fn make_known(&self, frame: Encoded, records: bool) {
        let frame = self.history().deliver(frame);
        if self.counters.published.fetch_add(1, Relaxed) == 0 {
            let seq = frame.metrics.seq;
            self.events.life(&self.name, Life::Started { seq });
        }
        self.events.frame(&self.name, &frame.metrics);
        if records {
            self.tape.output(&frame);
        }
        self.counters
            .bytes_out
            .fetch_add(frame.mesh.len() as u64, Relaxed);
        self.metrics.observe(&frame.metrics);
        self.advance();
    }

    /// Makes it known that an accepted frame will not come out; `after` which time, if it was accepted
    /// here.
    pub(super) fn lose(&self, seq: u64, loss: Loss, after: Option<Duration>) {
        self.history().push(seq, Outcome::Lost(loss));
        self.counters.dropped.fetch_add(1, Relaxed);
        self.metrics.lost(loss.as_str(), after);
        // The frame's own, if traces are collected.
        tracing::Span::current().record("lost", loss.as_str());
        self.advance();
    }

    pub(super) fn end(&self, reason: EndReason) {
        self.position
            .send_modify(|position| position.end = Some(reason));
        self.tape.finish(reason);
        let published = self.counters.published.load(Relaxed);
        if 0 < published {
            let life = Life::Ended {
                reason,
                published,
                dropped: self.counters.dropped.load(Relaxed),
                latest_seq: self.newest().map(|frame| frame.metrics.seq),
            };
            self.events.life(&self.name, life);
        }
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

fn now_us() -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    microseconds(since.unwrap_or_default())
}

/// Nothing that panics is done under these locks, so a poisoned one is as good as new.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
