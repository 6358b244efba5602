//! Processes frames that gateways have put on the bus.
//!
//! Registering a frame takes the frame and its predecessor, which are on the bus, and nothing else:
//! any number of workers do it side by side. The rest waits for what became of the predecessor,
//! whoever made that, and so outcomes leave in order. A worker keeps nothing that another could not
//! find on the bus: one that dies costs the time until its frames are given to others.
//!
//! A frame that waits for its predecessor's outcome holds no thread, and no more than [`MAX_WAITING`]
//! are waited with: then nothing is taken from the bus. If that lasts, because a predecessor was with a
//! worker that died, one more is taken all the same, for the bus gives out first what comes again; if
//! it is not what the others wait for it goes back untouched.

mod board;
mod cache;
mod work;

use std::sync::Arc;
use std::time::Duration;

use steadymesh_mesh_io::Limits;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::{CancellationToken, DropGuard};
use tokio_util::task::TaskTracker;

use crate::bus::{Bus, BusError};
use crate::compute::ComputePool;
use crate::telemetry::Telemetry;

use board::Board;
use cache::Cache;

/// Frames that wait for their predecessor's outcome; each holds tens of megabytes.
const MAX_WAITING: usize = 4;
/// How often it is counted what waits on the bus.
const COUNT: Duration = Duration::from_secs(5);
/// Between two attempts to reach a bus that is away.
const RETRY: Duration = Duration::from_millis(300);

/// How a worker works.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How large a frame may be.
    pub limits: Limits,
    /// How soon the bus gives a frame to another worker if this one does not say that it is at it.
    pub ack_wait: Duration,
    /// After so long a frame of a `live` stream gives way to newer ones.
    pub live_max_age: Duration,
}

/// A worker. It works until [`Worker::shut_down`].
#[derive(Debug)]
pub struct Worker {
    stop: CancellationToken,
    tasks: TaskTracker,
    /// Frames in work hear of others until the last of them is through.
    _board: DropGuard,
}

/// What the work on all frames shares.
#[derive(Debug)]
struct Shared {
    bus: Bus,
    pool: Arc<ComputePool>,
    telemetry: Arc<Telemetry>,
    options: Options,
    board: Board,
    cache: Cache,
    /// For frames that are read and registered.
    threads: Arc<Semaphore>,
    /// For frames from when they are taken until they are answered for.
    places: Arc<Semaphore>,
}

/// What a frame is taken from the bus with.
#[derive(Debug)]
struct Permits {
    /// Given back when it is registered.
    thread: OwnedSemaphorePermit,
    /// None if there was no place: it may not wait.
    place: Option<OwnedSemaphorePermit>,
}

impl Worker {
    /// Starts working; must be called within a Tokio runtime.
    ///
    /// # Errors
    ///
    /// [`BusError`] if the bus cannot be listened to.
    pub async fn start(
        bus: Bus,
        pool: Arc<ComputePool>,
        telemetry: Arc<Telemetry>,
        options: Options,
    ) -> Result<Self, BusError> {
        let (outcomes, records) = (bus.outcomes().await?, bus.records().await?);
        let threads = pool.thread_count();
        let shared = Arc::new(Shared {
            bus,
            pool,
            telemetry,
            options,
            board: Board::default(),
            cache: Cache::new(threads),
            threads: Arc::new(Semaphore::new(threads)),
            places: Arc::new(Semaphore::new(threads + MAX_WAITING)),
        });
        let (stop, tasks) = (CancellationToken::new(), TaskTracker::new());
        let board = CancellationToken::new();
        tokio::spawn({
            let (shared, board) = (Arc::clone(&shared), board.clone());
            async move {
                tokio::select! {
                    () = shared.board.listen(outcomes, records) => {}
                    () = count_waiting(&shared) => {}
                    () = board.cancelled() => {}
                }
            }
        });
        tasks.spawn(pull(Arc::clone(&shared), tasks.clone(), stop.clone()));
        Ok(Self {
            stop,
            tasks,
            _board: board.drop_guard(),
        })
    }

    /// Takes no more frames, and finishes those that it has; after `patience` they are left to
    /// others.
    pub async fn shut_down(self, patience: Duration) {
        self.stop.cancel();
        self.tasks.close();
        if tokio::time::timeout(patience, self.tasks.wait())
            .await
            .is_err()
        {
            tracing::warn!("frames are left to other workers: they took too long");
        }
    }
}

/// Shows what waits on the bus, which tells whether there are enough workers.
async fn count_waiting(shared: &Shared) {
    let mut ticks = tokio::time::interval(COUNT);
    loop {
        ticks.tick().await;
        if let Some(waiting) = shared.bus.waiting().await {
            let waiting = i64::try_from(waiting).unwrap_or(i64::MAX);
            shared.telemetry.worker.waiting.set(waiting);
        }
    }
}

/// Takes frames as long as there are threads for them.
async fn pull(shared: Arc<Shared>, tasks: TaskTracker, stop: CancellationToken) {
    let mut is_away = false;
    loop {
        let permit = tokio::select! {
            permit = Arc::clone(&shared.threads).acquire_owned() => permit,
            () = stop.cancelled() => return,
        };
        // It is never closed.
        let Ok(thread) = permit else { return };
        let place = Arc::clone(&shared.places).acquire_owned();
        let place = tokio::select! {
            place = tokio::time::timeout(shared.options.ack_wait, place) => place,
            () = stop.cancelled() => return,
        };
        let place = place.ok().and_then(Result::ok);
        let permits = Permits { thread, place };
        let pulled = tokio::select! {
            pulled = shared.bus.pull() => pulled,
            // What was on its way is given to another worker.
            () = stop.cancelled() => return,
        };
        match pulled {
            Ok(Some(job)) => {
                is_away = false;
                let shared = Arc::clone(&shared);
                tasks.spawn(async move { work::handle(&shared, job, permits).await });
            }
            Ok(None) => is_away = false,
            Err(error) => {
                if !std::mem::replace(&mut is_away, true) {
                    tracing::warn!(%error, "no frames can be had");
                }
                tokio::time::sleep(RETRY).await;
            }
        }
    }
}
