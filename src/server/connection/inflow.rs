//! Memory for frames that are being received.

use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::timeout;
use tokio_util::sync::PollSemaphore;

use crate::server::error::Problem;

/// What frames that are being received may take together, in kibibytes.
#[derive(Debug, Clone)]
pub(in crate::server) struct Memory {
    kibibytes: Arc<Semaphore>,
    limit: usize,
}

impl Memory {
    pub fn new(limit: usize) -> Self {
        let kibibytes = (limit >> 10).clamp(1, Semaphore::MAX_PERMITS);
        Self {
            kibibytes: Arc::new(Semaphore::new(kibibytes)),
            limit,
        }
    }

    /// Sets so many bytes aside until the result is dropped.
    ///
    /// # Errors
    ///
    /// 503 if they are not there.
    pub fn reserve(&self, bytes: usize) -> Result<OwnedSemaphorePermit, Problem> {
        let kibibytes = Arc::clone(&self.kibibytes);
        let reserved = kibibytes.try_acquire_many_owned(to_kibibytes(bytes));
        reserved.map_err(|_| {
            Problem::over_limit(format!(
                "frames that are being received take the {} bytes that limits.memory_bytes \
                 allows: try again in a moment",
                self.limit
            ))
        })
    }
}

/// How a message that is being received stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Need {
    Nothing,
    /// It waits for memory that others have.
    Memory,
    /// It is larger than all that there is.
    Impossible,
}

/// Counts a message while it is being received. It may be ahead of its memory by what is read at
/// a time, which is a few hundred kilobytes at most.
pub(super) struct Inflow {
    memory: Memory,
    waiting: PollSemaphore,
    reserved: Option<OwnedSemaphorePermit>,
    received: usize,
    need: watch::Sender<Need>,
}

impl Inflow {
    pub fn new(memory: &Memory) -> Self {
        Self {
            memory: memory.clone(),
            waiting: PollSemaphore::new(Arc::clone(&memory.kibibytes)),
            reserved: None,
            received: 0,
            need: watch::Sender::new(Need::Nothing),
        }
    }

    pub fn received(&mut self, byte_count: usize) {
        self.received += byte_count;
    }

    /// Ready when there is memory for what has been received.
    pub fn poll_room(&mut self, context: &mut Context<'_>) -> Poll<()> {
        let missing = self.missing();
        if missing == 0 {
            return Poll::Ready(());
        }
        let need = match self
            .waiting
            .poll_acquire_many(context, to_kibibytes(missing))
        {
            Poll::Ready(Some(permit)) => {
                self.keep(permit);
                Need::Nothing
            }
            // The semaphore is never closed.
            Poll::Ready(None) => Need::Nothing,
            Poll::Pending if self.memory.limit < self.received => Need::Impossible,
            Poll::Pending => Need::Memory,
        };
        self.need.send_if_modified(|known| {
            let changes = *known != need;
            *known = need;
            changes
        });
        if need == Need::Nothing {
            Poll::Ready(())
        } else {
            Poll::Pending
        }
    }

    /// The memory of a message that is complete.
    pub fn take(&mut self) -> Result<Option<OwnedSemaphorePermit>, Problem> {
        let missing = self.missing();
        self.received = 0;
        let rest = match missing {
            0 => None,
            missing => Some(self.memory.reserve(missing)),
        };
        let reserved = self.reserved.take();
        match rest.transpose()? {
            None => Ok(reserved),
            Some(mut rest) => {
                if let Some(reserved) = reserved {
                    rest.merge(reserved);
                }
                Ok(Some(rest))
            }
        }
    }

    pub fn need(&self) -> watch::Receiver<Need> {
        self.need.subscribe()
    }

    fn missing(&self) -> usize {
        let reserved = self.reserved.as_ref();
        let reserved = reserved.map_or(0, |permit| permit.num_permits() << 10);
        self.received.saturating_sub(reserved)
    }

    fn keep(&mut self, permit: OwnedSemaphorePermit) {
        match &mut self.reserved {
            Some(reserved) => reserved.merge(permit),
            None => self.reserved = Some(permit),
        }
    }
}

impl std::fmt::Debug for Inflow {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Inflow")
            .field("received", &self.received)
            .finish_non_exhaustive()
    }
}

/// Waits until a message has waited for so long, or waits in vain.
pub(super) async fn starved(mut need: watch::Receiver<Need>, patience: Duration) {
    loop {
        let found = need.wait_for(|need| *need != Need::Nothing).await;
        match found.map(|need| *need) {
            Ok(Need::Impossible) => return,
            Ok(_) => {}
            // Nobody counts any more.
            Err(_) => return std::future::pending().await,
        }
        let relief = need.wait_for(|need| *need != Need::Memory);
        if timeout(patience, relief).await.is_err() {
            return;
        }
    }
}

fn to_kibibytes(bytes: usize) -> u32 {
    u32::try_from(bytes.div_ceil(1024)).unwrap_or(u32::MAX)
}
