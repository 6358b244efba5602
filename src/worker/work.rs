//! What a worker does with one frame.

use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use bytes::Bytes;
use futures_util::future::{OptionFuture, join};
use steadymesh_mesh_io::Format;
use steadymesh_proto::DeliveredFrame;
use steadymesh_proto::metrics::{Quality, StageTimes};
use steadymesh_proto::stream::{DropReason, Overload, StreamConfig};
use tokio::sync::OwnedSemaphorePermit;

use crate::bus::{BusError, Frame, Job, Outcome, Position, Processed};
use crate::compute::Length;
use crate::pipeline::{Output, PreparedFrame, Settings};
use crate::processing::{self, Lost, Prepared, Stamps, prepare};
use crate::streams::Configured;
use crate::textures::{self, SourceImage};

use super::board::Fate;
use super::{Permits, RETRY, Shared};

/// A frame that has been given out so often has taken its workers with it, and is lost.
const MAX_DELIVERIES: u64 = 16;
/// A frame of a stream that nobody has announced within this time goes back.
const UNKNOWN: Duration = Duration::from_secs(2);
/// A frame that goes back comes again after this time.
const BACK: Duration = Duration::from_millis(250);

/// Why a frame was not processed.
enum Stop {
    /// It is known already what became of it, or nobody wants to know.
    NotWanted,
    /// Another attempt may do better.
    Later(&'static str),
    /// No attempt will: it cannot be read.
    Unreadable(String),
    /// The bus is away.
    Bus(BusError),
}

impl From<BusError> for Stop {
    fn from(error: BusError) -> Self {
        Self::Bus(error)
    }
}

/// What a frame is processed with.
struct Inputs {
    frame: Arc<PreparedFrame>,
    image: Option<SourceImage>,
    times: StageTimes,
    previous: Option<(Position, u64, Arc<PreparedFrame>)>,
}

/// Processes a frame, tells what became of it, and answers for it. Whatever goes wrong, the frame
/// comes again.
pub(super) async fn handle(shared: &Shared, job: Job, permits: Permits) {
    let Permits { thread, place } = permits;
    if place.is_none() && !is_its_turn(shared, &job.frame) {
        drop(thread);
        job.put_back(BACK).await;
        return;
    }
    let keep = async {
        loop {
            tokio::time::sleep(shared.options.ack_wait / 3).await;
            job.keep().await;
        }
    };
    let done = tokio::select! {
        done = process(shared, &job, thread) => done,
        () = keep => return,
    };
    let (stream, seq) = (job.frame.stream.clone(), job.frame.seq);
    let predecessor = job.frame.predecessor;
    let answered = match done {
        Ok(()) | Err(Stop::NotWanted) => {
            if let Some(before) = predecessor
                && let Err(error) = shared.bus.forget(before.position).await
            {
                tracing::debug!(%error, "a frame is left on the bus until it is too old");
            }
            job.done().await
        }
        Err(Stop::Later(reason)) => {
            tracing::debug!(%stream, seq, reason, "a frame goes back to the bus");
            job.put_back(BACK).await;
            Ok(())
        }
        Err(Stop::Bus(error)) => Err(error),
        // Has become an outcome before.
        Err(Stop::Unreadable(_)) => Ok(()),
    };
    if let Err(error) = answered {
        tracing::debug!(%stream, seq, %error, "a frame will come again");
    }
}

async fn process(shared: &Shared, job: &Job, permit: OwnedSemaphorePermit) -> Result<(), Stop> {
    let frame = &job.frame;
    let config = wanted(shared, frame).await?;
    let computed = match Configured::new(&[&config], shared.options.limits.max_faces) {
        Err(error) => {
            tracing::error!(stream = %frame.stream, %error, "its configuration cannot be used");
            Err(DropReason::Failed)
        }
        Ok(configured) => match reason_to_leave(shared, job, &configured) {
            Some(reason) => Err(reason),
            None => compute(shared, job, &configured, permit).await?,
        },
    };
    let outcome = match computed {
        Ok(message) => Outcome::Delivered(message),
        Err(reason) => {
            // In its turn, like any other.
            await_turn(shared, frame).await?;
            Outcome::Lost(reason)
        }
    };
    let processed = Processed {
        stream: frame.stream.clone(),
        instance: frame.instance,
        seq: frame.seq,
        outcome,
    };
    tell(shared, &processed).await?;
    // Not heard from the bus first: the next frame may be here already.
    shared.board.write_outcome(processed);
    Ok(())
}

/// How the frame's stream is configured, if it is still wanted that something becomes of the frame.
async fn wanted(shared: &Shared, frame: &Frame) -> Result<StreamConfig, Stop> {
    let record = shared.board.record(&frame.stream, frame.instance);
    let record = tokio::time::timeout(UNKNOWN, record).await;
    let record = record.map_err(|_| Stop::Later("nobody has announced its stream"))?;
    let is_over = record.instance == frame.instance && record.ended.is_some();
    let fate = shared.board.fate(&frame.stream, frame.instance, frame.seq);
    if is_over || frame.instance < record.instance || fate != Fate::Open {
        return Err(Stop::NotWanted);
    }
    Ok(record.config)
}

/// Why a frame is not worked on.
fn reason_to_leave(shared: &Shared, job: &Job, configured: &Configured) -> Option<DropReason> {
    let Frame { stream, seq, .. } = &job.frame;
    if MAX_DELIVERIES < job.deliveries {
        let deliveries = job.deliveries;
        tracing::error!(%stream, seq, deliveries, "frame lost: no worker survives it");
        return Some(DropReason::Failed);
    }
    let is_late = shared.options.live_max_age < age(&job.frame);
    (configured.overload == Overload::Live && is_late).then_some(DropReason::Overload)
}

/// Registers at once, then waits for its turn, then does the rest. Gives the message that players
/// get, or why there is none.
async fn compute(
    shared: &Shared,
    job: &Job,
    configured: &Configured,
    permit: OwnedSemaphorePermit,
) -> Result<Result<Bytes, DropReason>, Stop> {
    let frame = &job.frame;
    let quality = quality(configured, age(frame), shared.options.live_max_age);
    let settings = configured.settings.at(quality);
    let inputs = match inputs(shared, job, &settings).await {
        Ok(inputs) => inputs,
        Err(Stop::Unreadable(reason)) => {
            tracing::error!(stream = %frame.stream, seq = frame.seq, reason, "frame lost");
            return Ok(Err(DropReason::Failed));
        }
        Err(stop) => return Err(stop),
    };
    let previous = inputs.previous.as_ref();
    let previous_seq = previous.map(|(_, seq, _)| *seq);
    let mut work = processing::Job {
        pool: Arc::clone(&shared.pool),
        settings,
        frame: inputs.frame,
        previous: previous.map(|(_, _, frame)| Arc::clone(frame)),
        times: inputs.times,
    };
    let making = OptionFuture::from(inputs.image.map(|image| {
        let (pool, settings) = (&shared.pool, configured.texture);
        textures::begin(pool, image, settings, None).making()
    }));
    let registration = match work.register().await {
        Ok(registration) => registration,
        Err(lost) => return Ok(Err(failed(frame, &lost))),
    };
    drop(permit);
    let before = await_turn(shared, frame).await?;
    // Without a permit, which may be with whoever waits for the next frame: the pool has as many
    // threads as there are, and those who come last, this one's successors, wait for it.
    let output = match (work.wants_output(&registration), before) {
        (true, Some(Outcome::Delivered(message))) => {
            let position = inputs.previous.as_ref().map(|(position, ..)| *position);
            output(shared, position, message).await
        }
        _ => None,
    };
    let finished = join(work.finish(registration, output), making);
    let (finished, texture) = finished.await;
    let (processed, times) = match finished {
        Ok(done) => done,
        Err(lost) => return Ok(Err(failed(frame, &lost))),
    };
    shared.cache.keep_output(job.position, &processed.output);
    let stamps = Stamps {
        seq: frame.seq,
        capture_time_us: frame.capture_time_us,
        quality,
        previous_seq,
        times,
        latency: age(frame),
    };
    let metrics = stamps.stamp(processed.metrics, texture.as_ref());
    shared.telemetry.worker.processed(&metrics);
    let texture = texture.and_then(Result::ok).flatten();
    let frame = DeliveredFrame {
        metrics,
        mesh: &processed.draco,
        image: texture.as_ref().map(|texture| &*texture.bytes),
    };
    Ok(Ok(frame.encode().into()))
}

fn failed(frame: &Frame, lost: &Lost) -> DropReason {
    tracing::error!(stream = %frame.stream, seq = frame.seq, ?lost, "frame lost");
    DropReason::Failed
}

/// The frame and its predecessor, from this worker's memory or from the bus.
async fn inputs(shared: &Shared, job: &Job, settings: &Settings) -> Result<Inputs, Stop> {
    let read = async |frame: &Frame, position: Position| {
        let prepared = prepared(shared, frame).await.map_err(Stop::Unreadable)?;
        let frame = Arc::new(prepared.frame);
        shared.cache.keep_frame(position, &frame);
        Ok::<_, Stop>((frame, prepared.times, prepared.image))
    };
    let (frame, times, image) = read(&job.frame, job.position).await?;
    let previous = match job.frame.predecessor.filter(|_| settings.registers()) {
        None => None,
        Some(before) => match shared.cache.frame(before.position) {
            Some(previous) => Some((before.position, before.seq, previous)),
            // One that is gone was too old: this frame begins anew.
            None => match shared.bus.frame(before.position).await? {
                None => None,
                Some(previous) => read(&previous, before.position)
                    .await
                    .ok()
                    .map(|(previous, ..)| (before.position, before.seq, previous)),
            },
        },
    };
    Ok(Inputs {
        frame,
        image,
        times,
        previous,
    })
}

/// Parses and repairs a frame that a gateway has found to be a good one.
async fn prepared(shared: &Shared, frame: &Frame) -> Result<Prepared, String> {
    let format = Format::from_content_type(&frame.content_type);
    let format = format.ok_or_else(|| format!("its type is {}", frame.content_type))?;
    let (body, limits) = (frame.body.clone(), shared.options.limits);
    let run = shared
        .pool
        .run(Length::Short, move || prepare(&body, format, &limits));
    match run.await {
        Ok(Ok(prepared)) => Ok(prepared),
        Ok(Err(error)) => Err(error.to_string()),
        Err(panicked) => Err(panicked.to_string()),
    }
}

/// Waits until it is known what became of the frame before: it is this one's turn. None if there
/// is none, or if it is gone.
async fn await_turn(shared: &Shared, frame: &Frame) -> Result<Option<Outcome>, Stop> {
    let Some(before) = frame.predecessor else {
        return Ok(None);
    };
    let (stream, instance) = (frame.stream.as_str(), frame.instance);
    match shared.board.fate(stream, instance, before.seq) {
        Fate::Known(outcome) => return Ok(Some(outcome)),
        Fate::Past => return Err(Stop::NotWanted),
        Fate::Open => {}
    }
    loop {
        let settled = shared.board.settled(stream, instance, before.seq);
        match tokio::time::timeout(shared.options.ack_wait, settled).await {
            Ok(Fate::Known(outcome)) => return Ok(Some(outcome)),
            Ok(_) => return Err(Stop::NotWanted),
            // It may have become too old on the bus: then nothing will be heard of it.
            Err(_) => {
                let is_gone = shared.bus.frame(before.position).await?.is_none();
                let is_open = shared.board.fate(stream, instance, before.seq) == Fate::Open;
                if is_gone && is_open {
                    return Ok(None);
                }
            }
        }
    }
}

/// Whether nothing has to be waited for.
fn is_its_turn(shared: &Shared, frame: &Frame) -> bool {
    frame.predecessor.is_none_or(|before| {
        let fate = shared.board.fate(&frame.stream, frame.instance, before.seq);
        fate != Fate::Open
    })
}

/// Tells what became of a frame, unless another worker has meanwhile.
async fn tell(shared: &Shared, processed: &Processed) -> Result<(), Stop> {
    let (stream, instance, seq) = (&processed.stream, processed.instance, processed.seq);
    let mut is_first = true;
    loop {
        if shared.board.fate(stream, instance, seq) != Fate::Open {
            return Err(Stop::NotWanted);
        }
        let Err(error) = shared.bus.publish(processed).await else {
            return Ok(());
        };
        if std::mem::take(&mut is_first) {
            tracing::warn!(%stream, seq, %error, "what became of a frame cannot be told yet");
        }
        tokio::time::sleep(RETRY).await;
    }
}

/// What became of the frame before, as a mesh.
async fn output(shared: &Shared, position: Option<Position>, message: Bytes) -> Option<Output> {
    let position = position?;
    if let Some(output) = shared.cache.output(position) {
        return Some(output);
    }
    let decode = move || {
        let frame = DeliveredFrame::decode(&message).ok()?;
        Output::decode(frame.mesh).ok()
    };
    shared.pool.run(Length::Short, decode).await.ok().flatten()
}

/// How long ago a frame was received, by this machine's clock; nothing if that is behind.
fn age(frame: &Frame) -> Duration {
    let received = UNIX_EPOCH + Duration::from_micros(frame.received_us);
    SystemTime::now()
        .duration_since(received)
        .unwrap_or_default()
}

/// The quality of a frame that has waited so long: less is done for one of a `live` stream before
/// it gives way.
fn quality(configured: &Configured, age: Duration, max_age: Duration) -> Quality {
    if configured.overload != Overload::Live {
        return Quality::Full;
    }
    let qualities = configured.settings.qualities();
    let share = age.as_secs_f64() / max_age.as_secs_f64().max(1e-9);
    // In full up to a quarter of the time that there is.
    let step = ((share - 0.25).max(0.0) / 0.75 * qualities.len() as f64).ceil() as usize;
    let step = step.min(qualities.len() - 1);
    qualities.get(step).copied().unwrap_or_default()
}
