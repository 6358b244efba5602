//! The task that owns one stream: frames in, in order, frames out, in order.
//!
//! Frames are read and repaired as they come; each is processed as soon as it and its
//! predecessor are there and a thread is free, several at once if there are several threads;
//! they leave in the order in which they came. A frame that is held to the result before it, or
//! measured against that, is registered at once with others and then waits for it.
//!
//! Waiting frames are bounded by `queue_depth`. With `overload: lossless` a frame keeps its place
//! in the queue until it is started on, and when there is no place publishers are told to wait.
//! With `overload: live` it keeps it only until it has been read, and the oldest frame that has
//! been read gives way to the newest one. Before that happens, less is done for each frame: see
//! [`Ladder`].

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use bytes::Bytes;
use futures_util::StreamExt;
use futures_util::future::{BoxFuture, FutureExt, OptionFuture, join, ready};
use futures_util::stream::FuturesOrdered;
use steadymesh_mesh_io::Limits;
use steadymesh_proto::metrics::{Quality, StageTimes};
use steadymesh_proto::stream::{Accepted, EndReason, Overload};
use tokio::sync::{OwnedSemaphorePermit, mpsc, oneshot, watch};
use tracing::{Instrument, Span};

use crate::compute::{ComputePool, JobPanicked, Length};
use crate::pipeline::{Output, PreparedFrame};
use crate::processing::{self, Job, Lost, Outcome, Prepared, prepare};
use crate::storage::RawFrame;
use crate::textures::{self, Made, SourceImage};

use super::history::{Encoded, Loss};
use super::intake::{Incoming, Refused};
use super::ladder::Ladder;
use super::parts::Request;
use super::settings::Configured;
use super::stream::Stream;

/// What a task works with.
#[derive(Debug)]
pub(super) struct Task {
    pub stream: Arc<Stream>,
    pub intake: mpsc::Receiver<Incoming>,
    pub pool: Arc<ComputePool>,
    pub limits: Limits,
    pub queue_depth: usize,
    /// Frames that may be in work at a time; each of them takes tens of megabytes.
    pub parallel_frames: usize,
    /// How long a stream is kept before its first frame.
    pub first_frame_timeout: Duration,
    /// How long it is kept after its last.
    pub idle_timeout: Duration,
}

/// What is known of a frame beside its mesh.
#[derive(Debug, Clone, Copy)]
struct Stamps {
    seq: u64,
    capture_time_us: Option<u64>,
    arrived: Instant,
}

/// A frame's bytes as they came, for the recording.
struct Body {
    content_type: &'static str,
    byte_count: usize,
    /// None if it is not recorded.
    bytes: Option<Bytes>,
}

/// A body that has been read, with the way back to its sender.
struct Read {
    seq: Option<u64>,
    capture_time_us: Option<u64>,
    arrived: Instant,
    body: Body,
    reply: oneshot::Sender<Result<Accepted, Refused>>,
    place: OwnedSemaphorePermit,
    span: Span,
    prepared: Result<Prepared, Refused>,
}

/// An accepted frame that has not been started on.
struct Waiting {
    stamps: Stamps,
    frame: Arc<PreparedFrame>,
    image: Option<SourceImage>,
    times: StageTimes,
    span: Span,
    /// Given back when the frame is started on.
    _place: Option<OwnedSemaphorePermit>,
}

/// A frame that has been started on, or given up.
struct Done {
    stamps: Stamps,
    previous_seq: Option<u64>,
    quality: Quality,
    span: Span,
    outcome: Outcome,
    texture: Option<Made>,
}

/// Everything that changes while a stream lives.
#[derive(Default)]
struct State {
    reading: FuturesOrdered<BoxFuture<'static, Read>>,
    waiting: VecDeque<Waiting>,
    processing: FuturesOrdered<BoxFuture<'static, Done>>,
    /// How many of `processing` are jobs.
    busy: usize,
    previous: Option<(u64, Arc<PreparedFrame>)>,
    /// What becomes of it, once it is known; closed if it is lost.
    previous_output: Option<oneshot::Receiver<Output>>,
    latest_seq: Option<u64>,
    /// The image of the newest frame that has one.
    image: Option<textures::Newest>,
    ladder: Ladder,
}

impl Task {
    /// Runs until the stream ends.
    pub async fn run(mut self) {
        let mut requests = self.stream.requests();
        // One that came before this task did.
        requests.mark_changed();
        let mut state = State::default();
        let reason = self.work(&mut state, &mut requests).await;
        let unfinished = state.waiting.len() + state.processing.len();
        if 0 < unfinished {
            tracing::info!(stream = %self.stream.name(), unfinished, "frames discarded");
        }
        self.stream.counters.queued.store(0, Relaxed);
        self.stream.end(reason);
        tracing::info!(stream = %self.stream.name(), ?reason, "stream ended");
        // A frame that is being handed in at this moment would wait for an answer as long as
        // somebody holds the stream. None gets in once the intake is closed.
        self.intake.close();
        while self.intake.recv().await.is_some() {}
    }

    async fn work(
        &mut self,
        state: &mut State,
        requests: &mut watch::Receiver<Request>,
    ) -> EndReason {
        let threads = self.pool.thread_count().min(self.parallel_frames);
        let idle = tokio::time::sleep(self.first_frame_timeout);
        tokio::pin!(idle);
        // Whether the intake is closed and empty.
        let mut closed = false;
        loop {
            tokio::select! {
                biased;
                // The stream, which holds the sender, lives as long as its task.
                Ok(()) = requests.changed() => match *requests.borrow() {
                    Request::Run => {}
                    Request::Drain => self.intake.close(),
                    Request::Delete | Request::Follow => return EndReason::Deleted,
                    Request::Abandon => return EndReason::Shutdown,
                },
                Some(done) = state.processing.next(), if !state.processing.is_empty() => {
                    let span = done.span.clone();
                    span.in_scope(|| self.finish(done, state));
                }
                Some(read) = state.reading.next(), if !state.reading.is_empty() => {
                    if self.admit(read, state) {
                        idle.as_mut().reset(tokio::time::Instant::now() + self.idle_timeout);
                    }
                }
                incoming = self.intake.recv(), if !closed && state.reading.len() < threads => {
                    match incoming {
                        Some(incoming) => state.reading.push_back(self.read(incoming, state.latest_seq)),
                        None => closed = true,
                    }
                }
                () = &mut idle, if state.is_empty() => {
                    if !self.stream.has_publisher() {
                        return EndReason::Idle;
                    }
                    idle.as_mut().reset(tokio::time::Instant::now() + self.idle_timeout);
                }
            }
            self.start(state, threads);
            self.press(state);
            if closed && state.is_empty() {
                return EndReason::Shutdown;
            }
        }
    }

    /// Parses and repairs a body on the pool.
    fn read(&self, incoming: Incoming, latest_seq: Option<u64>) -> BoxFuture<'static, Read> {
        let Incoming {
            submission,
            reply,
            place,
            span,
        } = incoming;
        span.record("stream", self.stream.name().as_str());
        let (seq, capture_time_us) = (submission.seq, submission.capture_time_us);
        let arrived = submission.arrived;
        let records = self.stream.recording().takes_raw();
        let body = Body {
            content_type: submission.format.content_type(),
            byte_count: submission.bytes.len(),
            bytes: records.then(|| submission.bytes.clone()),
        };
        let within = span.clone();
        let read = move |prepared| Read {
            seq,
            capture_time_us,
            arrived,
            body,
            reply,
            place,
            span,
            prepared,
        };
        if let Some(refused) = seq.and_then(|seq| goes_back(seq, latest_seq)) {
            return ready(read(Err(refused))).boxed();
        }
        let (pool, limits) = (Arc::clone(&self.pool), self.limits);
        async move {
            let prepared = pool
                .run(Length::Short, move || {
                    prepare(&submission.bytes, submission.format, &limits)
                })
                .await;
            read(match prepared {
                Ok(prepared) => prepared.map_err(Refused::from),
                Err(JobPanicked) => Err(Refused::Panicked),
            })
        }
        .instrument(within)
        .boxed()
    }

    /// Lets a frame that could be read take part; false if it is refused, or does already.
    fn admit(&self, read: Read, state: &mut State) -> bool {
        let refused_again = read.seq.and_then(|seq| goes_back(seq, state.latest_seq));
        let prepared = match refused_again {
            Some(refused) => Err(refused),
            None => read.prepared,
        };
        let Prepared {
            frame,
            image,
            times,
        } = match prepared {
            Ok(prepared) => prepared,
            Err(refused) => {
                let answer = match refused {
                    // Sent again because an answer was lost: it is in already.
                    Refused::SeqGoesBack { seq, latest } if seq == latest => Ok(Accepted {
                        seq,
                        queued: self.stream.counters.queued.load(Relaxed),
                        duplicate: true,
                    }),
                    refused => Err(refused),
                };
                // Whoever has left does not want to know.
                read.reply.send(answer).ok();
                return false;
            }
        };
        let seq = read.seq.unwrap_or_else(|| {
            state
                .latest_seq
                .map_or(0, |latest| latest.saturating_add(1))
        });
        state.latest_seq = Some(seq);
        read.span.record("seq", seq);
        let overload = self.stream.configured().overload;
        if overload == Overload::Live && self.queue_depth <= state.waiting.len() {
            self.drop_oldest(state);
        }
        let stamps = Stamps {
            seq,
            capture_time_us: read.capture_time_us,
            arrived: read.arrived,
        };
        let frame = Arc::new(frame);
        state.waiting.push_back(Waiting {
            stamps,
            frame,
            image,
            times,
            span: read.span,
            _place: (overload == Overload::Lossless).then_some(read.place),
        });
        self.stream
            .count_received(seq, read.body.byte_count, read.arrived);
        if let Some(body) = read.body.bytes {
            self.stream.recording().raw(RawFrame {
                seq,
                capture_time_us: read.capture_time_us,
                content_type: read.body.content_type,
                body,
            });
        }
        let queued = self.stream.counters.queued.fetch_add(1, Relaxed) + 1;
        self.stream.metrics().queued.set(queued as i64);
        let accepted = Accepted {
            seq,
            queued,
            duplicate: false,
        };
        read.reply.send(Ok(accepted)).ok();
        true
    }

    /// Makes room for a newer frame. The loss takes its turn like a frame, so that outcomes
    /// become known in order.
    fn drop_oldest(&self, state: &mut State) {
        if let Some(oldest) = state.waiting.pop_front() {
            let done = Done {
                stamps: oldest.stamps,
                previous_seq: None,
                quality: Quality::default(),
                span: oldest.span,
                outcome: Err(Lost::Overload),
                texture: None,
            };
            state.processing.push_back(ready(done).boxed());
        }
    }

    /// Lets a live stream leave out what it must, so that the frames that wait get their turn.
    fn press(&self, state: &mut State) {
        let configured = self.stream.configured();
        if configured.overload == Overload::Live {
            let steps = configured.settings.qualities().len() - 1;
            state
                .ladder
                .press(state.waiting.len(), self.queue_depth, steps);
        }
    }

    /// Starts on as many waiting frames as there are threads for.
    fn start(&self, state: &mut State, threads: usize) {
        while state.busy < threads {
            let Some(Waiting {
                stamps,
                frame,
                image,
                times,
                span,
                ..
            }) = state.waiting.pop_front()
            else {
                return;
            };
            state.busy += 1;
            let previous = state.previous.replace((stamps.seq, Arc::clone(&frame)));
            let (previous_seq, previous) = previous.unzip();
            let (sender, output) = oneshot::channel();
            let configured = self.stream.configured();
            let quality = quality(&mut state.ladder, state.waiting.len(), &configured);
            let job = Job {
                pool: Arc::clone(&self.pool),
                settings: configured.settings.at(quality),
                frame,
                previous,
                times,
            };
            let previous_output = state.previous_output.replace(output);
            let making = image.map(|image| {
                let before = state.image.take();
                let newest = textures::begin(&self.pool, image, configured.texture, before);
                state.image.insert(newest).making()
            });
            state.processing.push_back(Box::pin(async move {
                let outcome = job.run(previous_output).instrument(span.clone());
                let (outcome, texture) = join(outcome, OptionFuture::from(making)).await;
                if let Ok((processed, _)) = &outcome {
                    // Whoever comes next may do without.
                    sender.send(processed.output.clone()).ok();
                }
                Done {
                    stamps,
                    previous_seq,
                    quality,
                    span,
                    outcome,
                    texture,
                }
            }));
        }
    }

    /// Lets a frame out.
    fn finish(&self, done: Done, state: &mut State) {
        let Done {
            stamps,
            previous_seq,
            quality,
            outcome,
            texture,
            ..
        } = done;
        let stream = &self.stream;
        let queued = stream.counters.queued.fetch_sub(1, Relaxed) - 1;
        stream.metrics().queued.set(queued as i64);
        if !matches!(outcome, Err(Lost::Overload)) {
            state.busy -= 1;
        }
        let loss = match outcome {
            Ok((processed, times)) => {
                let stamps = processing::Stamps {
                    seq: stamps.seq,
                    capture_time_us: stamps.capture_time_us,
                    quality,
                    previous_seq,
                    times,
                    latency: stamps.arrived.elapsed(),
                };
                let metrics = stamps.stamp(processed.metrics, texture.as_ref());
                let texture = texture.and_then(Result::ok).flatten();
                let image = texture.map(|texture| texture.bytes.clone());
                stream.deliver(Encoded::new(metrics, &processed.draco, image));
                return;
            }
            Err(Lost::Overload) => Loss::Overload,
            Err(Lost::Failed(error)) => {
                tracing::error!(stream = %stream.name(), seq = stamps.seq, %error, "frame lost");
                Loss::Failed
            }
            Err(Lost::Panicked) => {
                tracing::error!(stream = %stream.name(), seq = stamps.seq, "frame lost: a panic");
                Loss::Failed
            }
        };
        stream.lose(stamps.seq, loss, Some(stamps.arrived.elapsed()));
    }
}

/// The quality of the next frame.
fn quality(ladder: &mut Ladder, waiting: usize, configured: &Configured) -> Quality {
    match configured.overload {
        Overload::Live => ladder.start(waiting, &configured.settings.qualities()),
        Overload::Lossless => Quality::Full,
    }
}

impl State {
    fn is_empty(&self) -> bool {
        self.reading.is_empty() && self.waiting.is_empty() && self.processing.is_empty()
    }
}

/// Numbers ascend; one that does not is refused, or has been accepted before.
fn goes_back(seq: u64, latest: Option<u64>) -> Option<Refused> {
    let latest = latest?;
    (seq <= latest).then_some(Refused::SeqGoesBack { seq, latest })
}
