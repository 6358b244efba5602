//! What this worker has made itself, so that it need not be made again.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::bus::Position;
use crate::pipeline::{Output, PreparedFrame};

/// The newest frames and results, by where the frame is on the bus.
#[derive(Debug)]
pub(super) struct Cache {
    frames: Mutex<VecDeque<(Position, Arc<PreparedFrame>)>>,
    outputs: Mutex<VecDeque<(Position, Output)>>,
    capacity: usize,
}

impl Cache {
    /// For a worker with so many threads: each frame takes tens of megabytes.
    pub fn new(threads: usize) -> Self {
        Self {
            frames: Mutex::default(),
            outputs: Mutex::default(),
            capacity: 2 * threads + 2,
        }
    }

    pub fn frame(&self, position: Position) -> Option<Arc<PreparedFrame>> {
        find(&self.frames, position)
    }

    pub fn keep_frame(&self, position: Position, frame: &Arc<PreparedFrame>) {
        self.keep(&self.frames, position, Arc::clone(frame));
    }

    pub fn output(&self, position: Position) -> Option<Output> {
        find(&self.outputs, position)
    }

    pub fn keep_output(&self, position: Position, output: &Output) {
        self.keep(&self.outputs, position, output.clone());
    }

    fn keep<T>(&self, kept: &Mutex<VecDeque<(Position, T)>>, position: Position, value: T) {
        let mut kept = lock(kept);
        kept.retain(|(at, _)| *at != position);
        kept.push_back((position, value));
        if self.capacity < kept.len() {
            kept.pop_front();
        }
    }
}

fn find<T: Clone>(kept: &Mutex<VecDeque<(Position, T)>>, position: Position) -> Option<T> {
    let kept = lock(kept);
    let mut found = kept.iter().filter(|(at, _)| *at == position);
    found.next().map(|(_, value)| value.clone())
}

/// Nothing that panics is done under these locks.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
