//! Writes one recording, beside a stream that never waits for it.

use std::pin::pin;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use bytes::Bytes;
use futures_util::future::join_all;
use object_store::PutMode;
use steadymesh_proto::recording::{Gap, Record, RecordedFrame, RecordingEnd, Track, TrackSummary};
use steadymesh_proto::stream::{RecordingStatus, StreamConfig};
use steadymesh_proto::{DELIVERED_CONTENT_TYPE, FrameMetrics};
use tokio::sync::{OnceCell, Semaphore, mpsc, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::telemetry::RecordingMetrics;

use super::layout::{Layout, RecordingKey, unix_us};
use super::manifest::{End, Manifest};
use super::store::Store;
use super::track_writer::{Message, TrackWriter};
use super::{Options, track_writer};

/// What the room for waiting frames is counted in.
pub(super) const ROOM_UNIT: usize = 1024;

/// A frame as it came in.
#[derive(Debug)]
pub struct RawFrame {
    /// Its number.
    pub seq: u64,
    /// When it was captured, in microseconds since 1970, if the rig said so.
    pub capture_time_us: Option<u64>,
    /// What it is.
    pub content_type: &'static str,
    /// The body.
    pub body: Bytes,
}

/// Records one stretch of one stream. It takes frames without waiting: those for which there is no
/// room are counted, and become a gap in the recording.
///
/// Dropping it ends the recording as [`Recorder::finish`] does with
/// [`RecordingEnd::Stopped`].
#[derive(Debug)]
pub struct Recorder {
    shared: Arc<Shared>,
    lanes: Mutex<Lanes>,
    room: Arc<Semaphore>,
}

/// The ways to the writers of the tracks; none once the recording is being ended.
#[derive(Debug, Default)]
struct Lanes {
    raw: Option<Lane>,
    output: Option<Lane>,
}

#[derive(Debug)]
struct Lane {
    /// Has no bound of its own: each frame in it holds a part of the room, which has one.
    sender: mpsc::UnboundedSender<Message>,
    /// Frames that found no room since the last one that did.
    gap: Option<Gap>,
}

/// What the recorder, its writers and its readers share.
#[derive(Debug)]
pub(super) struct Shared {
    pub key: RecordingKey,
    pub store: Store,
    pub layout: Layout,
    pub options: Arc<Options>,
    pub metrics: RecordingMetrics,
    manifest: Manifest,
    manifest_written: OnceCell<()>,
    frames: AtomicU64,
    lost: AtomicU64,
    failing: Mutex<Option<String>>,
    /// Why it is to end.
    end: Mutex<RecordingEnd>,
    /// No more frames come.
    finishing: CancellationToken,
    /// There is no more time for those that are left.
    pub give_up: CancellationToken,
    done: watch::Sender<bool>,
}

impl Recorder {
    pub(super) fn start(
        (store, layout): (&Store, &Layout),
        options: &Arc<Options>,
        metrics: RecordingMetrics,
        room: &Arc<Semaphore>,
        (stream, record, config): (&str, Record, &StreamConfig),
    ) -> Self {
        let now = SystemTime::now();
        let shared = Arc::new(Shared {
            key: RecordingKey::begun_at(stream, now, salt()),
            store: store.clone(),
            layout: layout.clone(),
            options: Arc::clone(options),
            metrics,
            manifest: Manifest {
                version: Manifest::VERSION,
                started_us: unix_us(now),
                record,
                config: config.clone(),
                end: None,
            },
            manifest_written: OnceCell::new(),
            frames: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            failing: Mutex::default(),
            end: Mutex::new(RecordingEnd::Stopped),
            finishing: CancellationToken::new(),
            give_up: CancellationToken::new(),
            done: watch::Sender::new(false),
        });
        let mut writers = Vec::new();
        let mut lane = |track| {
            record.has(track).then(|| {
                let (sender, receiver) = mpsc::unbounded_channel();
                writers.push(TrackWriter::new(Arc::clone(&shared), track, receiver));
                Lane { sender, gap: None }
            })
        };
        let lanes = Lanes {
            raw: lane(Track::Raw),
            output: lane(Track::Output),
        };
        tokio::spawn(supervise(Arc::clone(&shared), writers));
        Self {
            shared,
            lanes: Mutex::new(lanes),
            room: Arc::clone(room),
        }
    }

    /// Which recording it is.
    #[must_use]
    pub fn key(&self) -> &RecordingKey {
        &self.shared.key
    }

    /// What it records.
    #[must_use]
    pub fn record(&self) -> Record {
        self.shared.manifest.record
    }

    /// How the stream was configured when it began.
    #[must_use]
    pub fn config(&self) -> &StreamConfig {
        &self.shared.manifest.config
    }

    /// What operators see of it.
    #[must_use]
    pub fn status(&self) -> RecordingStatus {
        RecordingStatus {
            id: self.shared.key.id.clone(),
            frames: self.shared.frames.load(Relaxed),
            lost_frames: self.shared.lost.load(Relaxed),
            failing: lock(&self.shared.failing).clone(),
        }
    }

    /// Takes a frame that came in.
    pub fn raw(&self, frame: RawFrame) {
        let RawFrame {
            seq,
            capture_time_us,
            content_type,
            body,
        } = frame;
        self.take(Track::Raw, (seq, capture_time_us), content_type, body);
    }

    /// Takes a frame that is out: the message that its readers get.
    pub fn output(&self, metrics: &FrameMetrics, message: &Bytes) {
        let stamps = (metrics.seq, metrics.capture_time_us);
        self.take(
            Track::Output,
            stamps,
            DELIVERED_CONTENT_TYPE,
            message.clone(),
        );
    }

    fn take(
        &self,
        track: Track,
        (seq, capture_time_us): (u64, Option<u64>),
        content_type: &str,
        body: Bytes,
    ) {
        let mut lanes = lock(&self.lanes);
        let lane = match track {
            Track::Raw => &mut lanes.raw,
            Track::Output => &mut lanes.output,
        };
        let Some(lane) = lane else {
            return;
        };
        let units = u32::try_from(body.len() / ROOM_UNIT + 1).unwrap_or(u32::MAX);
        let Ok(room) = Arc::clone(&self.room).try_acquire_many_owned(units) else {
            let gap = lane.gap.get_or_insert(Gap {
                first_seq: seq,
                last_seq: seq,
                frames: 0,
            });
            gap.last_seq = seq;
            gap.frames += 1;
            self.shared.count_lost(track, 1);
            return;
        };
        let frame = RecordedFrame {
            seq,
            capture_time_us,
            stored_us: unix_us(SystemTime::now()),
            content_type: content_type.to_owned(),
            bytes: body.len() as u64,
        };
        let message = Message {
            gap: lane.gap.take(),
            frame: Some((frame, body, room)),
            at: Instant::now(),
        };
        // A writer goes on until its lane is gone.
        lane.sender.send(message).ok();
    }

    /// Takes no more frames, and lets those be written that were taken.
    pub fn finish(&self, reason: RecordingEnd) {
        let mut lanes = std::mem::take(&mut *lock(&self.lanes));
        for lane in [&mut lanes.raw, &mut lanes.output].into_iter().flatten() {
            if let Some(gap) = lane.gap.take() {
                let message = Message {
                    gap: Some(gap),
                    frame: None,
                    at: Instant::now(),
                };
                lane.sender.send(message).ok();
            }
        }
        if !self.shared.finishing.is_cancelled() {
            *lock(&self.shared.end) = reason;
            self.shared.finishing.cancel();
        }
    }

    /// Waits until all that was taken has been written or given up; that takes no longer than
    /// `Options::farewell` after [`Recorder::finish`].
    pub fn finished(&self) -> impl Future<Output = ()> + use<> {
        let mut done = self.shared.done.subscribe();
        async move {
            // The sender is gone only with the task that writes.
            done.wait_for(|done| *done).await.ok();
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.finish(RecordingEnd::Stopped);
    }
}

impl Shared {
    /// Writes the manifest if that has not been done.
    pub async fn ensure_manifest(&self) -> Result<(), object_store::Error> {
        let write = async || {
            let written = self
                .manifest
                .write(&self.store, &self.layout, &self.key, PutMode::Create)
                .await;
            match written {
                // Of an attempt whose answer was lost.
                Err(object_store::Error::AlreadyExists { .. }) => Ok(()),
                written => written,
            }
        };
        self.manifest_written.get_or_try_init(write).await?;
        Ok(())
    }

    pub fn count_stored(&self, track: Track, frames: u64, bytes: u64) {
        self.frames.fetch_add(frames, Relaxed);
        self.metrics.stored(track, frames, bytes);
    }

    pub fn count_lost(&self, track: Track, frames: u64) {
        self.lost.fetch_add(frames, Relaxed);
        self.metrics.lost(track, frames);
    }

    /// Says that the store does not take what is written.
    pub fn fails(&self, error: &object_store::Error) {
        self.metrics.failed_writes.inc();
        let mut failing = lock(&self.failing);
        if failing.is_none() {
            self.metrics.failing.set(1);
            tracing::error!(
                stream = %self.key.stream, recording = %self.key.id, %error,
                "the recording cannot be written: the stream goes on, and what does not fit into \
                 recordings.queue_bytes meanwhile will be missing"
            );
        }
        *failing = Some(error.to_string());
    }

    /// Says that it takes it again.
    pub fn works(&self) {
        if lock(&self.failing).take().is_some() {
            self.metrics.failing.set(0);
            tracing::info!(
                stream = %self.key.stream, recording = %self.key.id,
                "the recording is being written again"
            );
        }
    }
}

/// Waits for the writers, and closes the recording.
async fn supervise(shared: Arc<Shared>, writers: Vec<TrackWriter>) {
    let out_of_time = async {
        shared.finishing.cancelled().await;
        tokio::time::sleep(shared.options.farewell).await;
    };
    let mut write = pin!(join_all(writers.into_iter().map(TrackWriter::run)));
    let written = tokio::select! {
        written = &mut write => written,
        () = out_of_time => {
            shared.give_up.cancel();
            write.await
        }
    };
    if shared.manifest_written.initialized() {
        close(&shared, &written).await;
    }
    shared.metrics.failing.set(0);
    shared.done.send_replace(true);
}

/// Writes into the manifest how the recording ended.
async fn close(shared: &Shared, written: &[(Track, TrackSummary)]) {
    let summary = |track| {
        let found = written.iter().find(|(which, _)| *which == track);
        found.map(|(_, summary)| summary.clone())
    };
    let mut manifest = shared.manifest.clone();
    manifest.end = Some(End {
        reason: Some(*lock(&shared.end)),
        ended_us: Some(unix_us(SystemTime::now())),
        raw: summary(Track::Raw),
        output: summary(Track::Output),
    });
    let write = || {
        let (store, layout) = (&shared.store, &shared.layout);
        manifest.write(store, layout, &shared.key, PutMode::Overwrite)
    };
    if !track_writer::persist(shared, write).await {
        tracing::error!(
            stream = %shared.key.stream, recording = %shared.key.id,
            "the end of the recording could not be written: it will look interrupted"
        );
    }
}

/// Tells recordings apart that begin within one second.
fn salt() -> u16 {
    let mut bytes = [0; 2];
    // Without it, two that begin together would be one: the second is refused by the store then.
    getrandom::fill(&mut bytes).ok();
    u16::from_le_bytes(bytes)
}

/// Nothing that panics is done under these locks.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
