//! The one door from async to CPU: a bounded pool of named threads.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use tokio::sync::{Semaphore, oneshot};

/// How many threads, and how much may wait for them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Threads for long jobs; short ones have half as many of their own, at least one.
    pub threads: usize,
    /// Jobs of either kind that may wait for a thread; whoever brings another one waits outside.
    pub queue: usize,
}

/// How long a job takes, roughly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// A few milliseconds, with somebody waiting for an answer: reading a frame.
    Short,
    /// As long as a frame: registering and simplifying it.
    Long,
}

/// Threads for everything that takes more than half a millisecond of CPU.
///
/// Tokio's own blocking pool grows to hundreds of threads and does not skip a job whose caller
/// has left; on a machine that is busy with geometry both would be felt by every stream.
///
/// Short jobs do not stand in line behind long ones: the operating system divides the cores
/// among both, so that a publisher gets its answer on a busy server too.
#[derive(Debug)]
pub struct ComputePool {
    short: Lane,
    long: Lane,
}

#[derive(Debug)]
struct Lane {
    threads: rayon::ThreadPool,
    slots: Arc<Semaphore>,
}

/// A job panicked, which is a defect; the pool goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the computation panicked")]
pub struct JobPanicked;

impl ComputePool {
    /// Starts the threads.
    ///
    /// # Errors
    ///
    /// If the system refuses a thread.
    pub fn new(options: Options) -> Result<Self, rayon::ThreadPoolBuildError> {
        let Options { threads, queue } = options;
        Ok(Self {
            short: Lane::new("short", threads.div_ceil(2), queue)?,
            long: Lane::new("long", threads, queue)?,
        })
    }

    /// The number of threads for long jobs.
    #[must_use]
    pub fn thread_count(&self) -> usize {
        self.long.threads.current_num_threads()
    }

    /// Runs `job` on the pool and waits for its result. Callers of one length take turns in the
    /// order in which they came.
    ///
    /// Dropping the future before the job starts skips the job, so a client that hangs up
    /// costs nothing. A job that has started runs to its end.
    ///
    /// # Errors
    ///
    /// [`JobPanicked`].
    pub async fn run<T: Send + 'static>(
        &self,
        length: Length,
        job: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, JobPanicked> {
        let lane = match length {
            Length::Short => &self.short,
            Length::Long => &self.long,
        };
        let slot = Arc::clone(&lane.slots).acquire_owned().await;
        let (sender, receiver) = oneshot::channel();
        let span = tracing::Span::current();
        lane.threads.spawn_fifo(move || {
            // Given back when the job is through, however it ends.
            let _slot = slot;
            if sender.is_closed() {
                return;
            }
            let outcome = catch_unwind(AssertUnwindSafe(|| span.in_scope(job)));
            if let Ok(result) = outcome {
                // Fails only if the caller left while the job ran.
                sender.send(result).ok();
            }
        });
        receiver.await.map_err(|_| JobPanicked)
    }
}

impl Lane {
    fn new(
        name: &'static str,
        threads: usize,
        queue: usize,
    ) -> Result<Self, rayon::ThreadPoolBuildError> {
        Ok(Self {
            threads: rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .thread_name(move |index| format!("{name}-{index}"))
                .build()?,
            slots: Arc::new(Semaphore::new(threads + queue)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc;

    fn pool(threads: usize, queue: usize) -> ComputePool {
        ComputePool::new(Options { threads, queue }).unwrap()
    }

    /// A long job that lasts until it is told to end.
    struct Blocker {
        release: mpsc::Sender<()>,
        job: tokio::task::JoinHandle<Result<Option<()>, JobPanicked>>,
    }

    impl Blocker {
        async fn of(pool: &Arc<ComputePool>) -> Self {
            let (release, blocked) = mpsc::channel();
            let pool = Arc::clone(pool);
            let job = async move { pool.run(Length::Long, move || blocked.recv().ok()).await };
            let job = tokio::spawn(job);
            tokio::task::yield_now().await;
            Self { release, job }
        }

        async fn end(self) {
            self.release.send(()).unwrap();
            self.job.await.unwrap().unwrap();
        }
    }

    #[tokio::test]
    async fn a_job_that_panics_is_an_error_and_the_pool_goes_on() {
        let pool = pool(1, 1);
        let outcome: Result<(), _> = pool.run(Length::Long, || panic!("a defect")).await;
        assert_eq!(outcome, Err(JobPanicked));
        assert_eq!(pool.run(Length::Long, || 2 + 2).await, Ok(4));
    }

    #[tokio::test]
    async fn a_short_job_does_not_wait_for_a_long_one() {
        let pool = Arc::new(pool(1, 1));
        let blocker = Blocker::of(&pool).await;
        assert_eq!(pool.run(Length::Short, || 7).await, Ok(7));
        blocker.end().await;
    }

    #[tokio::test]
    async fn a_job_whose_caller_has_left_is_skipped() {
        let pool = Arc::new(pool(1, 4));
        let blocker = Blocker::of(&pool).await;
        let runs = Arc::new(AtomicUsize::new(0));
        let left = tokio::spawn({
            let (pool, runs) = (Arc::clone(&pool), Arc::clone(&runs));
            async move {
                pool.run(Length::Long, move || runs.fetch_add(1, Ordering::Relaxed))
                    .await
            }
        });
        tokio::task::yield_now().await;
        left.abort();
        assert!(left.await.is_err());
        blocker.end().await;
        pool.run(Length::Long, || ()).await.unwrap();
        assert_eq!(runs.load(Ordering::Relaxed), 0);
    }

    #[tokio::test]
    async fn no_more_jobs_are_inside_than_threads_and_queue_allow() {
        let pool = Arc::new(pool(1, 1));
        let blocker = Blocker::of(&pool).await;
        let second = tokio::spawn({
            let pool = Arc::clone(&pool);
            async move { pool.run(Length::Long, || ()).await }
        });
        tokio::task::yield_now().await;
        assert_eq!(pool.long.slots.available_permits(), 0);
        blocker.end().await;
        second.await.unwrap().unwrap();
    }
}
