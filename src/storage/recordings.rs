//! All recordings of a store.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use futures_util::TryStreamExt;
use futures_util::stream::{self, StreamExt};
use object_store::path::Path;
use steadymesh_proto::recording::{Record, RecordingSummary};
use steadymesh_proto::stream::StreamConfig;
use tokio::sync::Semaphore;
use url::Url;

use crate::telemetry::Telemetry;

use super::layout::{Layout, Part, RecordingKey};
use super::manifest::Manifest;
use super::options::{MAX_SEGMENT, MIN_SEGMENT};
use super::reader::{ReadFailed, Recording, summarize};
use super::recorder::ROOM_UNIT;
use super::store::{self, Purpose, Store};
use super::{Options, Recorder, UnusableStore};

/// Recordings that are looked at side by side when all are listed.
const PARALLEL: usize = 8;
/// Indexes that are kept for who asks next.
const CACHED: usize = 32;
/// So long: what is recorded at this moment grows.
const FRESH: Duration = Duration::from_secs(1);

/// All recordings of a store.
#[derive(Debug)]
pub struct Recordings {
    pub(super) store: Store,
    pub(super) layout: Layout,
    pub(super) options: Arc<Options>,
    telemetry: Arc<Telemetry>,
    /// For the frames of all recordings that wait to be written, in [`ROOM_UNIT`]s.
    room: Arc<Semaphore>,
    /// Those that are being made here, and their last breath.
    live: Arc<Mutex<HashSet<RecordingKey>>>,
    opened: Mutex<HashMap<RecordingKey, (Instant, Arc<Recording>)>>,
}

impl Recordings {
    /// Opens the store.
    ///
    /// # Errors
    ///
    /// [`UnusableStore`].
    pub fn open(options: Options, telemetry: Arc<Telemetry>) -> Result<Self, UnusableStore> {
        if !(MIN_SEGMENT..=MAX_SEGMENT).contains(&options.segment) {
            return Err(UnusableStore::Segment {
                found: options.segment.as_secs_f64(),
            });
        }
        let store = store::open(&options.url, Purpose::Write)?;
        Ok(Self::within(store, options, telemetry))
    }

    /// Opens a store that is only read.
    ///
    /// # Errors
    ///
    /// [`UnusableStore`].
    pub fn open_to_read(url: &Url, telemetry: Arc<Telemetry>) -> Result<Self, UnusableStore> {
        let store = store::open(url, Purpose::Read)?;
        let options = Options {
            url: url.clone(),
            segment: MIN_SEGMENT,
            segment_bytes: 0,
            queue_bytes: 0,
            max_age: None,
            max_bytes: None,
            sweep_interval: Duration::MAX,
            farewell: Duration::ZERO,
        };
        Ok(Self::within(store, options, telemetry))
    }

    fn within(store: Store, options: Options, telemetry: Arc<Telemetry>) -> Self {
        // More would panic in the semaphore.
        let units = (options.queue_bytes / ROOM_UNIT).clamp(1, Semaphore::MAX_PERMITS);
        Self {
            layout: Layout::new(store.root.clone()),
            store,
            options: Arc::new(options),
            telemetry,
            room: Arc::new(Semaphore::new(units)),
            live: Arc::default(),
            opened: Mutex::default(),
        }
    }

    /// Starts a recording of a stream; must be called within a Tokio runtime. Nothing is stored
    /// before the first frame.
    #[must_use]
    pub fn record(&self, stream: &str, record: Record, config: &StreamConfig) -> Recorder {
        let recorder = Recorder::start(
            (&self.store, &self.layout),
            &self.options,
            self.telemetry.recording(stream),
            &self.room,
            (stream, record, config),
        );
        let (live, key) = (Arc::clone(&self.live), recorder.key().clone());
        lock(&live).insert(key.clone());
        let finished = recorder.finished();
        tokio::spawn(async move {
            finished.await;
            lock(&live).remove(&key);
        });
        recorder
    }

    /// Whether a recording is being made here.
    pub(super) fn is_live(&self, key: &RecordingKey) -> bool {
        lock(&self.live).contains(key)
    }

    /// What there is, of one stream or of all, by stream and then by time.
    ///
    /// # Errors
    ///
    /// [`ReadFailed`]. A recording that cannot be read is left out, and logged.
    pub async fn list(&self, stream: Option<&str>) -> Result<Vec<RecordingSummary>, ReadFailed> {
        let mut keys = Vec::new();
        let streams = match stream {
            Some(stream) => vec![stream.to_owned()],
            None => self.folders(self.layout.root()).await?,
        };
        for stream in streams {
            let ids = self.folders(&self.layout.stream(&stream)).await?;
            let ids = ids.into_iter().filter(|id| RecordingKey::is_id(id));
            keys.extend(ids.map(|id| RecordingKey {
                stream: stream.clone(),
                id,
            }));
        }
        keys.sort();
        let summaries = stream::iter(keys.into_iter().map(async |key| self.summary(&key).await));
        let summaries = summaries.buffered(PARALLEL).filter_map(async |summary| {
            summary.unwrap_or_else(|error| {
                tracing::warn!(%error, "a recording cannot be listed");
                None
            })
        });
        Ok(summaries.collect().await)
    }

    /// None if it has gone meanwhile.
    async fn summary(&self, key: &RecordingKey) -> Result<Option<RecordingSummary>, ReadFailed> {
        let manifest = match Manifest::read(&self.store, &self.layout, key).await {
            Err(ReadFailed::NoRecording { .. }) => return Ok(None),
            manifest => manifest?,
        };
        // Without looking into its index: it is written down.
        if let Some(end) = &manifest.end
            && self.options.max_age.is_none()
            && self.options.max_bytes.is_none()
        {
            let (raw, output) = (end.raw.clone(), end.output.clone());
            return Ok(Some(summarize(key, &manifest, false, raw, output)));
        }
        Ok(Some(self.find(key).await?.summary()))
    }

    /// A recording. What has been added in the last second may be missing.
    ///
    /// # Errors
    ///
    /// [`ReadFailed`].
    pub async fn find(&self, key: &RecordingKey) -> Result<Arc<Recording>, ReadFailed> {
        if !RecordingKey::is_id(&key.id) {
            return Err(ReadFailed::NoRecording { key: key.clone() });
        }
        let cached = lock(&self.opened).get(key).cloned();
        if let Some((at, recording)) = cached
            && at.elapsed() < FRESH
        {
            return Ok(recording);
        }
        let place = (&self.store, &self.layout);
        let opened = Recording::open(place, key, self.is_live(key)).await;
        let mut cache = lock(&self.opened);
        cache.retain(|_, (at, _)| at.elapsed() < FRESH);
        let recording = Arc::new(opened?);
        if cache.len() < CACHED {
            cache.insert(key.clone(), (Instant::now(), Arc::clone(&recording)));
        }
        Ok(recording)
    }

    /// Deletes a recording.
    ///
    /// # Errors
    ///
    /// [`ReadFailed::GoesOn`] for one that is being made here.
    pub async fn delete(&self, key: &RecordingKey) -> Result<(), ReadFailed> {
        if self.is_live(key) {
            return Err(ReadFailed::GoesOn);
        }
        if !RecordingKey::is_id(&key.id) {
            return Err(ReadFailed::NoRecording { key: key.clone() });
        }
        let folder = self.layout.recording(key);
        let found: Vec<_> = self.store.objects.list(Some(&folder)).try_collect().await?;
        if found.is_empty() {
            return Err(ReadFailed::NoRecording { key: key.clone() });
        }
        lock(&self.opened).remove(key);
        let paths = found.into_iter().map(|object| object.location);
        // The index before what it points at.
        let (segments, rest) = paths.partition(|path| {
            let part = self.layout.parse(path).map(|(_, part)| part);
            matches!(part, Some(Part::Segment(..)))
        });
        self.remove(rest).await?;
        self.remove(segments).await
    }

    /// Deletes objects; those that are gone already are not missed.
    pub(super) async fn remove(&self, paths: Vec<Path>) -> Result<(), ReadFailed> {
        let paths = stream::iter(paths).map(Ok).boxed();
        let mut deleted = self.store.objects.delete_stream(paths);
        while let Some(deleted) = deleted.next().await {
            match deleted {
                Ok(_) | Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    async fn folders(&self, within: &Path) -> Result<Vec<String>, ReadFailed> {
        let listed = self.store.objects.list_with_delimiter(Some(within)).await?;
        let names = listed.common_prefixes.iter();
        Ok(names
            .filter_map(|path| path.filename().map(ToOwned::to_owned))
            .collect())
    }
}

/// Nothing that panics is done under these locks.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
