//! What a connection's stream and the handlers behind it know of each other.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::sync::OwnedSemaphorePermit;
use tokio::time::Instant;

use super::inflow::{Inflow, Memory};
use crate::server::error::Problem;

/// How long nothing may happen.
#[derive(Debug, Clone, Copy)]
pub(in crate::server) struct Patience {
    /// Until a request's head is complete, from its first byte, or from the connection's
    /// beginning for the first one.
    pub head: Duration,
    /// Between two requests.
    pub idle: Duration,
    /// Until the client takes some of what is sent to it.
    pub send: Duration,
}

/// One connection. Handlers find it in the extensions of their request.
#[derive(Debug, Clone)]
pub(in crate::server) struct Link(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    phase: Phase,
    since: Instant,
    /// What is received is counted, once this is there.
    inflow: Option<Inflow>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// No request is there.
    Idle,
    /// A request's head is due.
    Head,
    /// A request is being received or answered, with time limits of its own.
    Busy,
    /// It is a WebSocket connection now, with time limits of its own.
    Upgraded,
}

/// A request, until its answer has been handed over.
#[derive(Debug)]
pub(super) struct Answering(Link);

impl Link {
    pub(super) fn new() -> Self {
        Self(Arc::new(Mutex::new(State {
            phase: Phase::Head,
            since: Instant::now(),
            inflow: None,
        })))
    }

    /// When the connection is to end unless something is received; none if that is not
    /// the connection's business. While a request is there, this is when to ask again.
    pub(super) fn deadline(&self, patience: &Patience) -> Option<Instant> {
        let state = self.lock();
        match state.phase {
            Phase::Idle => Some(state.since + patience.idle),
            Phase::Head => Some(state.since + patience.head),
            Phase::Busy => Some(Instant::now() + patience.idle),
            Phase::Upgraded => None,
        }
    }

    /// Something has been received.
    pub(super) fn received(&self, byte_count: usize) {
        let mut state = self.lock();
        if let Some(inflow) = &mut state.inflow {
            inflow.received(byte_count);
        }
        if state.phase == Phase::Idle {
            state.enter(Phase::Head);
        }
    }

    /// Some of an answer has been sent, perhaps of one that was handed over long ago.
    pub(super) fn sent(&self) {
        let mut state = self.lock();
        if state.phase == Phase::Idle {
            state.since = Instant::now();
        }
    }

    /// A request is there, until the result is dropped.
    pub(super) fn begin(&self) -> Answering {
        self.lock().enter(Phase::Busy);
        Answering(self.clone())
    }

    /// HTTP is over.
    pub(super) fn upgraded(&self) {
        self.lock().enter(Phase::Upgraded);
    }

    /// Whether messages have their own time limits.
    pub(super) fn is_upgraded(&self) -> bool {
        self.lock().phase == Phase::Upgraded
    }

    /// Ready when there is memory for what has been received.
    pub(super) fn poll_room(&self, context: &mut Context<'_>) -> Poll<()> {
        match &mut self.lock().inflow {
            Some(inflow) => inflow.poll_room(context),
            None => Poll::Ready(()),
        }
    }

    /// From now on what is received counts against this memory, and nothing more is received
    /// while there is none.
    pub fn count_against(&self, memory: &Memory) {
        self.lock().inflow = Some(Inflow::new(memory));
    }

    /// What is received counts no more.
    pub fn stop_counting(&self) {
        self.lock().inflow = None;
    }

    /// The memory of a message that is complete; the next one begins at nothing.
    ///
    /// # Errors
    ///
    /// 503 if there is none.
    pub fn take_memory(&self) -> Result<Option<OwnedSemaphorePermit>, Problem> {
        match &mut self.lock().inflow {
            Some(inflow) => inflow.take(),
            None => Ok(None),
        }
    }

    /// Waits until a message has waited for memory for so long, or is larger than all of it.
    pub async fn starved(&self, patience: Duration) {
        let need = self.lock().inflow.as_ref().map(Inflow::need);
        match need {
            Some(need) => super::inflow::starved(need, patience).await,
            None => std::future::pending().await,
        }
    }

    /// Nothing that panics is done under this lock.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn enter(&mut self, phase: Phase) {
        self.phase = phase;
        self.since = Instant::now();
    }
}

impl Drop for Answering {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        if state.phase == Phase::Busy {
            state.enter(Phase::Idle);
        }
    }
}
