//! The one door from async to CPU: a bounded pool of named threads.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use tokio::sync::{Semaphore, oneshot};

/// How many threads, and how much may wait for them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Threads that compute.
    pub threads: usize,
    /// Jobs that may wait for a thread; whoever brings another one waits outside.
    pub queue: usize,
}

/// Threads for everything that takes more than half a millisecond of CPU.
///
/// Tokio's own blocking pool grows to hundreds of threads and does not skip a job whose caller
/// has left; on a machine that is busy with geometry both would be felt by every stream.
#[derive(Debug)]
pub struct ComputePool {
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
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(options.threads)
            .thread_name(|index| format!("compute-{index}"))
            .build()?;
        let slots = Arc::new(Semaphore::new(options.threads + options.queue));
        Ok(Self { threads, slots })
    }

    /// The number of threads.
    #[must_use]
    pub fn thread_count(&self) -> usize {
        self.threads.current_num_threads()
    }

    /// Runs `job` on the pool and waits for its result. Callers take turns in the order in
    /// which they came.
    ///
    /// Dropping the future before the job starts skips the job, so a client that hangs up
    /// costs nothing. A job that has started runs to its end.
    ///
    /// # Errors
    ///
    /// [`JobPanicked`].
    pub async fn run<T: Send + 'static>(
        &self,
        job: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, JobPanicked> {
        let slot = Arc::clone(&self.slots).acquire_owned().await;
        let (sender, receiver) = oneshot::channel();
        let span = tracing::Span::current();
        self.threads.spawn_fifo(move || {
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc;

    fn pool(threads: usize, queue: usize) -> ComputePool {
        ComputePool::new(Options { threads, queue }).unwrap()
    }

    #[tokio::test]
    async fn a_job_that_panics_is_an_error_and_the_pool_goes_on() {
        let pool = pool(1, 1);
        let outcome: Result<(), _> = pool.run(|| panic!("a defect")).await;
        assert_eq!(outcome, Err(JobPanicked));
        assert_eq!(pool.run(|| 2 + 2).await, Ok(4));
    }

    #[tokio::test]
    async fn a_job_whose_caller_has_left_is_skipped() {
        let pool = Arc::new(pool(1, 4));
        let (release, blocked) = mpsc::channel::<()>();
        let blocker = tokio::spawn({
            let pool = Arc::clone(&pool);
            async move { pool.run(move || blocked.recv().ok()).await }
        });
        tokio::task::yield_now().await;
        let runs = Arc::new(AtomicUsize::new(0));
        let left = tokio::spawn({
            let (pool, runs) = (Arc::clone(&pool), Arc::clone(&runs));
            async move { pool.run(move || runs.fetch_add(1, Ordering::Relaxed)).await }
        });
        tokio::task::yield_now().await;
        left.abort();
        assert!(left.await.is_err());
        release.send(()).unwrap();
        blocker.await.unwrap().unwrap();
        pool.run(|| ()).await.unwrap();
        assert_eq!(runs.load(Ordering::Relaxed), 0);
    }

    #[tokio::test]
    async fn no_more_jobs_are_inside_than_threads_and_queue_allow() {
        let pool = Arc::new(pool(1, 1));
        let (release, blocked) = mpsc::channel::<()>();
        let blocker = tokio::spawn({
            let pool = Arc::clone(&pool);
            async move { pool.run(move || blocked.recv().ok()).await }
        });
        tokio::task::yield_now().await;
        let second = tokio::spawn({
            let pool = Arc::clone(&pool);
            async move { pool.run(|| ()).await }
        });
        tokio::task::yield_now().await;
        assert_eq!(pool.slots.available_permits(), 0);
        release.send(()).unwrap();
        blocker.await.unwrap().unwrap();
        second.await.unwrap().unwrap();
    }
}
