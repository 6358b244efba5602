//! The bus of one process, in its memory.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, broadcast};
use tokio::time::{Instant, sleep_until, timeout};

use super::{BusError, Frame, Job, Position, Processed, StreamRecord};

/// How long a worker waits for a frame before it is told that there is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// Outcomes and records that a listener may be behind.
const BEHIND: usize = 4096;

/// Everything in memory.
#[derive(Debug, Clone)]
pub(super) struct InProcess {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    /// Something may be there to be pulled.
    changed: Notify,
    outcomes: broadcast::Sender<Processed>,
    records: broadcast::Sender<(String, StreamRecord)>,
    ack_wait: Duration,
    max_frames: usize,
}

#[derive(Debug, Default)]
struct State {
    next: u64,
    frames: BTreeMap<Position, Stored>,
    /// Each stream's last frame, also if it has been forgotten.
    last: BTreeMap<String, (Position, Frame)>,
    outcomes: BTreeMap<String, Processed>,
    records: BTreeMap<String, StreamRecord>,
}

#[derive(Debug)]
struct Stored {
    frame: Frame,
    deliveries: u64,
    /// When it may be given out; none once it has been processed.
    due: Option<Instant>,
}

/// A claim on a frame.
#[derive(Debug)]
pub(super) struct Ticket {
    shared: Arc<Shared>,
    position: Position,
    /// A claim that has run out does not count.
    deliveries: u64,
}

impl InProcess {
    pub fn new(ack_wait: Duration, max_frames: usize) -> Self {
        Self {
            shared: Arc::new(Shared {
                state: Mutex::default(),
                changed: Notify::new(),
                outcomes: broadcast::Sender::new(BEHIND),
                records: broadcast::Sender::new(BEHIND),
                ack_wait,
                max_frames,
            }),
        }
    }

    pub fn append(&self, frame: &Frame, behind: Option<Position>) -> Result<Position, BusError> {
        let mut state = self.shared.lock();
        let last = state.last.get(&frame.stream);
        if let Some((position, last)) = last
            && last.identity() == frame.identity()
        {
            return Ok(*position);
        }
        if last.map(|(position, _)| *position) != behind {
            return Err(BusError::Conflict);
        }
        if self.shared.max_frames <= state.frames.len() {
            return Err(BusError::Full);
        }
        state.next += 1;
        let position = Position(state.next);
        let stored = Stored {
            frame: frame.clone(),
            deliveries: 0,
            due: Some(Instant::now()),
        };
        state.frames.insert(position, stored);
        let last = (position, frame.clone());
        state.last.insert(frame.stream.clone(), last);
        drop(state);
        self.shared.changed.notify_one();
        Ok(position)
    }

    pub fn last(&self, stream: &str) -> Option<(Position, Frame)> {
        self.shared.lock().last.get(stream).cloned()
    }

    pub async fn pull(&self) -> Option<Job> {
        timeout(PATIENCE, async {
            loop {
                let next_due = match self.shared.take() {
                    Ok(job) => return job,
                    Err(next_due) => next_due,
                };
                let due = async {
                    match next_due {
                        Some(due) => sleep_until(due).await,
                        None => std::future::pending().await,
                    }
                };
                tokio::select! {
                    () = self.shared.changed.notified() => {}
                    () = due => {}
                }
            }
        })
        .await
        .ok()
    }

    pub fn frame(&self, position: Position) -> Option<Frame> {
        let state = self.shared.lock();
        state
            .frames
            .get(&position)
            .map(|stored| stored.frame.clone())
    }

    pub fn forget(&self, position: Position) {
        self.shared.lock().frames.remove(&position);
    }

    pub fn publish(&self, processed: &Processed) {
        let mut state = self.shared.lock();
        let last = state.outcomes.get(&processed.stream);
        let is_known = last
            .is_some_and(|last| (processed.instance, processed.seq) <= (last.instance, last.seq));
        if !is_known {
            let key = processed.stream.clone();
            state.outcomes.insert(key, processed.clone());
            // Fails if nobody listens.
            self.shared.outcomes.send(processed.clone()).ok();
        }
    }

    pub fn outcomes(&self) -> Outcomes {
        let state = self.shared.lock();
        Outcomes {
            first: state.outcomes.values().cloned().collect(),
            rest: self.shared.outcomes.subscribe(),
        }
    }

    pub fn begin(&self, stream: &str, record: &StreamRecord) -> Result<(), BusError> {
        let last = self.shared.lock().records.get(stream).cloned();
        if last.is_some_and(|last| last.is_in_the_way_of(record)) {
            return Err(BusError::Conflict);
        }
        self.announce(stream, record);
        Ok(())
    }

    pub fn announce(&self, stream: &str, record: &StreamRecord) {
        let mut state = self.shared.lock();
        let last = state.records.get(stream);
        if last.is_some_and(|last| !record.follows(last)) {
            return;
        }
        state.records.insert(stream.to_owned(), record.clone());
        let sent = (stream.to_owned(), record.clone());
        self.shared.records.send(sent).ok();
    }

    pub fn records(&self) -> Records {
        let state = self.shared.lock();
        let first = state.records.iter();
        Records {
            first: first
                .map(|(stream, record)| (stream.clone(), record.clone()))
                .collect(),
            rest: self.shared.records.subscribe(),
        }
    }

    pub fn waiting(&self) -> u64 {
        let state = self.shared.lock();
        let waits = |stored: &&Stored| stored.due.is_some() && stored.deliveries == 0;
        state.frames.values().filter(waits).count() as u64
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing that panics is done under this lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A frame that is due, or when the next one is.
    fn take(self: &Arc<Self>) -> Result<Job, Option<Instant>> {
        let now = Instant::now();
        let mut state = self.lock();
        let mut next_due = None;
        for (position, stored) in &mut state.frames {
            let Some(due) = stored.due else {
                continue;
            };
            if now < due {
                next_due = next_due.map_or(Some(due), |next: Instant| Some(next.min(due)));
                continue;
            }
            stored.due = Some(now + self.ack_wait);
            stored.deliveries += 1;
            let job = Job {
                frame: stored.frame.clone(),
                position: *position,
                deliveries: stored.deliveries,
                ticket: super::Ticket::InProcess(Ticket {
                    shared: Arc::clone(self),
                    position: *position,
                    deliveries: stored.deliveries,
                }),
            };
            // There may be more for whoever else waits.
            self.changed.notify_one();
            return Ok(job);
        }
        Err(next_due)
    }
}

impl Ticket {
    pub fn done(&self) {
        self.change(|stored| stored.due = None);
    }

    pub fn put_back(&self, delay: Duration) {
        self.change(|stored| stored.due = Some(Instant::now() + delay));
        self.shared.changed.notify_one();
    }

    pub fn keep(&self) {
        let ack_wait = self.shared.ack_wait;
        self.change(|stored| stored.due = Some(Instant::now() + ack_wait));
    }

    fn change(&self, change: impl FnOnce(&mut Stored)) {
        let mut state = self.shared.lock();
        let stored = state.frames.get_mut(&self.position);
        if let Some(stored) = stored.filter(|stored| stored.deliveries == self.deliveries) {
            change(stored);
        }
    }
}

/// See [`super::Outcomes`].
#[derive(Debug)]
pub(super) struct Outcomes {
    first: VecDeque<Processed>,
    rest: broadcast::Receiver<Processed>,
}

impl Outcomes {
    pub async fn next(&mut self) -> Processed {
        if let Some(first) = self.first.pop_front() {
            return first;
        }
        receive(&mut self.rest).await
    }
}

/// See [`super::Records`].
#[derive(Debug)]
pub(super) struct Records {
    first: VecDeque<(String, StreamRecord)>,
    rest: broadcast::Receiver<(String, StreamRecord)>,
}

impl Records {
    pub async fn next(&mut self) -> (String, StreamRecord) {
        if let Some(first) = self.first.pop_front() {
            return first;
        }
        receive(&mut self.rest).await
    }
}

/// A listener that is thousands behind misses the oldest.
async fn receive<T: Clone>(receiver: &mut broadcast::Receiver<T>) -> T {
    loop {
        match receiver.recv().await {
            Ok(value) => return value,
            Err(broadcast::error::RecvError::Lagged(missed)) => {
                tracing::warn!(missed, "a listener of the bus is too slow");
            }
            // The bus is gone, and with it everybody who could say something.
            Err(broadcast::error::RecvError::Closed) => std::future::pending().await,
        }
    }
}
