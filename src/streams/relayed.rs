//! Frames that a gateway has put on the bus, until their outcomes are known.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{Notify, OwnedSemaphorePermit};

use crate::bus::Position;

/// A frame on the bus.
#[derive(Debug)]
struct Pending {
    seq: u64,
    claim: Claim,
    /// Where it is, once it is there.
    position: Option<Position>,
}

/// When a frame arrived, and its place in the stream's queue.
pub(super) type Claim = (Instant, OwnedSemaphorePermit);

/// Those that were accepted here, in the order of their numbers. Each has a place in the stream's
/// queue, which is their bound.
#[derive(Debug, Default)]
pub(super) struct Relayed {
    pending: Mutex<VecDeque<Pending>>,
    settled: Notify,
}

impl Relayed {
    /// A frame is on the bus, or about to be.
    pub fn push(&self, seq: u64, claim: Claim) {
        self.lock().push_back(Pending {
            seq,
            claim,
            position: None,
        });
    }

    /// A frame is on the bus.
    pub fn stored(&self, seq: u64, position: Position) {
        let mut pending = self.lock();
        let found = pending.iter_mut().find(|pending| pending.seq == seq);
        if let Some(found) = found {
            found.position = Some(position);
        }
    }

    /// The oldest frame, if it has waited for longer than `patience`.
    pub fn overdue(&self, patience: Duration) -> Option<(u64, Position)> {
        let pending = self.lock();
        let first = pending.front()?;
        let is_overdue = patience < first.claim.0.elapsed();
        is_overdue.then_some((first.seq, first.position?))
    }

    /// A frame did not get onto the bus.
    pub fn take_back(&self, seq: u64) -> Option<Claim> {
        let mut pending = self.lock();
        let at = pending.iter().position(|pending| pending.seq == seq)?;
        let taken = pending.remove(at).map(|pending| pending.claim);
        drop(pending);
        self.settled.notify_waiters();
        taken
    }

    /// The outcome of a frame is known, and so are those before it; when it arrived, if it was
    /// accepted here.
    pub fn settle(&self, seq: u64) -> Option<Instant> {
        let mut pending = self.lock();
        let mut arrived = None;
        while pending.front().is_some_and(|first| first.seq <= seq) {
            let first = pending.pop_front();
            arrived = first
                .filter(|first| first.seq == seq)
                .map(|first| first.claim.0);
        }
        drop(pending);
        self.settled.notify_waiters();
        arrived
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.lock().len()
    }

    /// Waits until the outcomes of all of them are known.
    pub async fn all_settled(&self) {
        loop {
            let settled = self.settled.notified();
            if self.len() == 0 {
                return;
            }
            settled.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Pending>> {
        // Nothing that panics is done under this lock.
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
