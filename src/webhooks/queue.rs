//! Messages on their way to one endpoint.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use tokio::sync::Notify;

use super::Kind;

/// A message, the same for all endpoints.
#[derive(Debug)]
pub(super) struct Message {
    /// The same in every attempt, so that an endpoint can tell a repetition.
    pub id: String,
    pub kind: Kind,
    pub body: Bytes,
}

/// A bounded queue that drops its oldest message for a new one. What is being delivered stays in
/// it until it has been, so that a successor of the worker can go on.
#[derive(Debug)]
pub(super) struct Queue {
    state: Mutex<State>,
    /// Somebody should look again.
    changed: Notify,
}

#[derive(Debug)]
struct State {
    waiting: VecDeque<Arc<Message>>,
    current: Option<Arc<Message>>,
    capacity: usize,
    is_closed: bool,
}

impl Queue {
    pub fn new(capacity: usize) -> Self {
        Self {
            state: Mutex::new(State {
                waiting: VecDeque::new(),
                current: None,
                capacity,
                is_closed: false,
            }),
            changed: Notify::new(),
        }
    }

    /// Adds a message and returns how many were dropped for it.
    pub fn push(&self, message: Arc<Message>) -> usize {
        let mut state = self.lock();
        state.waiting.push_back(message);
        let dropped = state.shrink();
        drop(state);
        self.changed.notify_one();
        dropped
    }

    /// Changes the bound and returns how many messages were dropped for that.
    pub fn resize(&self, capacity: usize) -> usize {
        let mut state = self.lock();
        state.capacity = capacity;
        state.shrink()
    }

    /// Waits for the oldest message; none once the queue is closed and empty. It counts as
    /// undelivered until [`Self::done`].
    pub async fn next(&self) -> Option<Arc<Message>> {
        loop {
            {
                let mut state = self.lock();
                if state.current.is_none() {
                    state.current = state.waiting.pop_front();
                }
                if let Some(message) = &state.current {
                    return Some(Arc::clone(message));
                }
                if state.is_closed {
                    return None;
                }
            }
            self.changed.notified().await;
        }
    }

    /// The message that was taken last has been dealt with.
    pub fn done(&self) {
        self.lock().current = None;
    }

    /// Nothing more will come.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_one();
    }

    /// How many messages have not been dealt with.
    pub fn len(&self) -> usize {
        let state = self.lock();
        state.waiting.len() + usize::from(state.current.is_some())
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing that panics is done under this lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn shrink(&mut self) -> usize {
        let excess = self.waiting.len().saturating_sub(self.capacity);
        self.waiting.drain(..excess);
        excess
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(id: &str) -> Arc<Message> {
        Arc::new(Message {
            id: id.to_owned(),
            kind: Kind::Started,
            body: Bytes::new(),
        })
    }

    #[tokio::test]
    async fn the_oldest_waiting_message_is_dropped_but_not_the_one_being_delivered() {
        let queue = Queue::new(2);
        assert_eq!(queue.push(message("a")), 0);
        assert_eq!(queue.next().await.unwrap().id, "a");
        let dropped: Vec<_> = ["b", "c", "d"]
            .iter()
            .map(|id| queue.push(message(id)))
            .collect();
        assert_eq!((dropped, queue.len()), (vec![0, 0, 1], 3));
        // A successor begins with what its predecessor had not finished.
        assert_eq!(queue.next().await.unwrap().id, "a");
        queue.done();
        assert_eq!(queue.next().await.unwrap().id, "c");
        queue.done();
        queue.close();
        assert_eq!(queue.next().await.unwrap().id, "d");
        queue.done();
        assert!(queue.next().await.is_none());
    }
}
