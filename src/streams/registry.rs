//! All live streams, by name.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, SystemTime};

use arc_swap::ArcSwap;
use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use steadymesh_mesh_io::Limits;
use steadymesh_proto::recording::Record;
use steadymesh_proto::stream::{StreamConfig, StreamSummary};
use tokio::sync::mpsc;
use tokio_util::task::TaskTracker;

use crate::bus::Bus;
use crate::compute::ComputePool;
use crate::storage::Recordings;
use crate::telemetry::Telemetry;

use super::StreamName;
use super::events::{Events, Listener};
use super::history::HistoryLimits;
use super::intake::{Incoming, Intake};
use super::parts::{Parts, Request};
use super::relay::Relay;
use super::settings::{Configured, InvalidConfig, StreamRule};
use super::stream::Stream;
use super::task::Task;

/// How long a stream that a first frame has made is kept if that frame cannot be used: such
/// frames shall not fill the server with empty streams.
const UNUSED_TIMEOUT: Duration = Duration::from_secs(5);

/// Streams that were asked to end at once have done so within this time, recordings included.
const LAST_WAIT: Duration = Duration::from_secs(15);

/// How streams are kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Most streams at a time.
    pub max_streams: usize,
    /// Frames of a stream that may wait to be processed.
    pub queue_depth: usize,
    /// Frames of a stream that may be in work at a time.
    pub parallel_frames: usize,
    /// How much a stream remembers.
    pub history: HistoryLimits,
    /// How far a reader may fall behind before it is taken to the newest frame, in frames.
    pub subscriber_queue: usize,
    /// How long a publisher that vanished is expected back.
    pub linger: Duration,
    /// How long a stream without frames is kept.
    pub idle_timeout: Duration,
    /// How large a frame may be.
    pub limits: Limits,
    /// What a stream's configuration leaves out.
    pub defaults: StreamConfig,
    /// What comes before `defaults` for some streams; the first that matches counts.
    pub rules: Vec<StreamRule>,
    /// Whether there is a place for recordings.
    pub records: bool,
    /// Frames of a stream that may be on the bus without a known outcome.
    pub relayed_frames: usize,
}

impl Options {
    /// What `config` means for the stream of this name.
    fn configure(
        &self,
        name: &StreamName,
        config: &StreamConfig,
    ) -> Result<Configured, InvalidConfig> {
        let rule = self.rules.iter().find(|rule| rule.pattern.matches(name));
        let layers = [
            Some(config),
            rule.map(|rule| &rule.defaults),
            Some(&self.defaults),
        ];
        let layers: Vec<_> = layers.into_iter().flatten().collect();
        self.check_layers(&layers)
    }

    fn check_layers(&self, layers: &[&StreamConfig]) -> Result<Configured, InvalidConfig> {
        let configured = Configured::new(layers, self.limits.max_faces)?;
        if configured.record != Record::Off && !self.records {
            return Err(InvalidConfig::NoRecordings {
                found: configured.record,
            });
        }
        Ok(configured)
    }

    /// Checks the defaults.
    ///
    /// # Errors
    ///
    /// [`InvalidConfig`] names the value and its range.
    pub fn check(&self) -> Result<(), InvalidConfig> {
        self.check_layers(&[&self.defaults])?;
        for rule in &self.rules {
            self.check_layers(&[&rule.defaults, &self.defaults])?;
        }
        Ok(())
    }
}

/// Why a stream could not be made or changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NotConfigured {
    /// A value is not usable.
    #[error(transparent)]
    Invalid(#[from] InvalidConfig),
    /// There are as many streams as there may be.
    #[error("the limit on streams is reached, which is {limit}")]
    TooManyStreams {
        /// How many there may be.
        limit: usize,
    },
    /// The server is about to stop.
    #[error("the server is stopping")]
    Stopping,
}

/// All live streams. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Registry {
    pub(super) shared: Arc<Shared>,
}

/// Where a stream was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    Here,
    /// It was heard of on the bus.
    Bus {
        /// When it was made, in microseconds since 1970.
        instance: u64,
        /// Which configuration it has.
        revision: u64,
    },
}

#[derive(Debug)]
pub(super) struct Shared {
    streams: Mutex<BTreeMap<StreamName, Arc<Stream>>>,
    tasks: TaskTracker,
    pool: Arc<ComputePool>,
    telemetry: Arc<Telemetry>,
    recordings: Option<Arc<Recordings>>,
    /// Where frames are processed, if not here.
    pub(super) bus: Option<Bus>,
    /// The latest stream of each name that was heard of on the bus.
    pub(super) instances: Mutex<BTreeMap<StreamName, u64>>,
    events: Events,
    pub(super) options: ArcSwap<Options>,
}

impl Registry {
    /// No streams yet. They are recorded in `recordings`, if there are any; their frames are
    /// processed elsewhere if there is a `bus`, and [`Registry::follow_bus`] was called.
    ///
    /// # Errors
    ///
    /// [`InvalidConfig`] if the defaults cannot be used.
    pub fn new(
        options: Options,
        pool: Arc<ComputePool>,
        telemetry: Arc<Telemetry>,
        recordings: Option<Arc<Recordings>>,
        bus: Option<Bus>,
    ) -> Result<Self, InvalidConfig> {
        options.check()?;
        Ok(Self {
            shared: Arc::new(Shared {
                streams: Mutex::default(),
                tasks: TaskTracker::new(),
                pool,
                telemetry,
                recordings,
                bus,
                instances: Mutex::default(),
                events: Events::default(),
                options: ArcSwap::from_pointee(options),
            }),
        })
    }

    /// Finds out whether new options can be taken.
    ///
    /// # Errors
    ///
    /// [`InvalidConfig`] if the defaults cannot be used.
    pub fn check(&self, options: &Options) -> Result<(), InvalidConfig> {
        let records = self.shared.recordings.is_some();
        let options = options.clone();
        Options { records, ..options }.check()
    }

    /// Takes new options, for streams that are made and configured from now on. They are
    /// expected to have been checked. Whether there are recordings stays what it was.
    pub fn reload(&self, options: Options) {
        let records = self.shared.recordings.is_some();
        let options = Options { records, ..options };
        self.shared.options.store(Arc::new(options));
    }

    /// Listens to what happens to streams, from now on.
    #[must_use]
    pub fn listen(&self) -> Listener {
        self.shared.events.listen()
    }

    /// The stream of this name.
    #[must_use]
    pub fn get(&self, name: &StreamName) -> Option<Arc<Stream>> {
        self.shared
            .lock()
            .get(name)
            .filter(|stream| !stream.has_ended())
            .cloned()
    }

    /// The stream of this name, made with the defaults if it is not there.
    ///
    /// # Errors
    ///
    /// [`NotConfigured::TooManyStreams`] and [`NotConfigured::Stopping`].
    pub fn get_or_create(&self, name: &StreamName) -> Result<Arc<Stream>, NotConfigured> {
        if let Some(stream) = self.get(name) {
            return Ok(stream);
        }
        let configured = self
            .shared
            .options
            .load()
            .configure(name, &StreamConfig::default())?;
        self.shared
            .insert(name, configured, UNUSED_TIMEOUT, Origin::Here)
            .map(|(stream, _)| stream)
    }

    /// Makes a stream, or changes the one that is there. The second value tells whether it is
    /// new.
    ///
    /// # Errors
    ///
    /// [`NotConfigured`].
    pub fn configure(
        &self,
        name: &StreamName,
        config: &StreamConfig,
    ) -> Result<(Arc<Stream>, bool), NotConfigured> {
        let configured = self.shared.options.load().configure(name, config)?;
        let (stream, is_new) = self.shared.insert(
            name,
            configured.clone(),
            self.shared.options.load().idle_timeout,
            Origin::Here,
        )?;
        if !is_new {
            stream.configure(configured);
        }
        Ok((stream, is_new))
    }

    /// Changes what is recorded of a stream, and nothing else; none if there is no such stream.
    ///
    /// # Errors
    ///
    /// [`NotConfigured::Invalid`] if the server keeps no recordings.
    pub fn record(
        &self,
        name: &StreamName,
        record: Record,
    ) -> Result<Option<Arc<Stream>>, NotConfigured> {
        let Some(stream) = self.get(name) else {
            return Ok(None);
        };
        if record != Record::Off && self.shared.recordings.is_none() {
            return Err(InvalidConfig::NoRecordings { found: record }.into());
        }
        let mut configured = (*stream.configured()).clone();
        configured.record = record;
        configured.config.record = Some(record);
        stream.configure(configured);
        Ok(Some(stream))
    }

    /// The recordings, if the server keeps any.
    #[must_use]
    pub fn recordings(&self) -> Option<&Arc<Recordings>> {
        self.shared.recordings.as_ref()
    }

    /// Ends a stream at once; false if there is none of this name.
    #[must_use]
    pub fn delete(&self, name: &StreamName) -> bool {
        let removed = self.shared.lock().remove(name);
        let Some(stream) = removed.filter(|stream| !stream.has_ended()) else {
            return false;
        };
        stream.request(Request::Delete);
        true
    }

    /// What there is to see of all streams, by name.
    #[must_use]
    pub fn list(&self) -> Vec<StreamSummary> {
        let streams: Vec<_> = self.shared.lock().values().cloned().collect();
        let live = streams.iter().filter(|stream| !stream.has_ended());
        live.map(|stream| stream.summary()).collect()
    }

    /// Takes no more frames, lets those that were accepted come out, and ends all streams;
    /// after `patience`, whatever is left of them.
    pub async fn shut_down(&self, patience: Duration) {
        self.shared.tasks.close();
        self.request_all(Request::Drain);
        if tokio::time::timeout(patience, self.shared.tasks.wait())
            .await
            .is_err()
        {
            tracing::warn!("frames are left unfinished: they took too long");
            self.request_all(Request::Abandon);
            // One that cannot end, because it waits for others, shall not keep the server.
            tokio::time::timeout(LAST_WAIT, self.shared.tasks.wait())
                .await
                .ok();
        }
    }

    fn request_all(&self, request: Request) {
        for stream in self.shared.lock().values() {
            stream.request(request);
        }
    }
}

impl Shared {
    fn later_than(&self, name: &StreamName) -> Option<u64> {
        let instances = self.instances.lock();
        let instances = instances.unwrap_or_else(PoisonError::into_inner);
        instances.get(name).copied()
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, BTreeMap<StreamName, Arc<Stream>>> {
        // Nothing that panics is done under this lock.
        self.streams.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes a stream if there is none of this name.
    pub(super) fn insert(
        self: &Arc<Self>,
        name: &StreamName,
        configured: Configured,
        first_frame_timeout: Duration,
        origin: Origin,
    ) -> Result<(Arc<Stream>, bool), NotConfigured> {
        let mut streams = self.lock();
        streams.retain(|_, stream| !stream.has_ended());
        if let Some(stream) = streams.get(name) {
            return Ok((Arc::clone(stream), false));
        }
        if self.tasks.is_closed() {
            return Err(NotConfigured::Stopping);
        }
        let options = self.options.load();
        let limit = options.max_streams;
        if limit <= streams.len() {
            return Err(NotConfigured::TooManyStreams { limit });
        }
        let depth = match &self.bus {
            Some(_) => options.relayed_frames,
            None => options.queue_depth,
        };
        let (intake, incoming) = Intake::new(depth);
        let parts = Parts {
            name: name.clone(),
            configured,
            history: options.history,
            subscriber_queue: options.subscriber_queue,
            linger: options.linger,
            metrics: self.telemetry.stream(name.as_str()),
            events: self.events.clone(),
            recordings: self.recordings.clone(),
            created: origin.created(self.later_than(name)),
            revision: origin.revision(),
            is_shared: self.bus.is_some(),
            records_at_once: origin == Origin::Here,
        };
        let stream = Arc::new(Stream::new(parts, intake));
        let task = self.task(&stream, incoming, &options, (first_frame_timeout, origin));
        streams.insert(name.clone(), Arc::clone(&stream));
        let (shared, remains) = (Arc::clone(self), Arc::downgrade(&stream));
        self.tasks.spawn(async move {
            task.await;
            if let Some(stream) = remains.upgrade() {
                // Its last frames are written before the server may end.
                stream.recording().ended().await;
            }
            shared.lock().retain(|_, stream| !stream.has_ended());
            if !shared.tasks.is_closed() {
                give_memory_back(&remains).await;
            }
        });
        tracing::info!(stream = %name, "stream created");
        Ok((stream, true))
    }
}

impl Shared {
    /// What runs as long as the stream lives.
    fn task(
        &self,
        stream: &Arc<Stream>,
        intake: mpsc::Receiver<Incoming>,
        options: &Options,
        (first_frame_timeout, origin): (Duration, Origin),
    ) -> BoxFuture<'static, ()> {
        let (stream, pool) = (Arc::clone(stream), Arc::clone(&self.pool));
        let (limits, idle_timeout) = (options.limits, options.idle_timeout);
        if let Some(bus) = self.bus.clone() {
            let relay = Relay {
                stream,
                bus,
                intake,
                pool,
                limits,
                first_frame_timeout,
                idle_timeout,
                is_known: origin != Origin::Here,
            };
            return relay.run().boxed();
        }
        let task = Task {
            stream,
            intake,
            pool,
            limits,
            queue_depth: options.queue_depth.max(1),
            parallel_frames: options.parallel_frames,
            first_frame_timeout,
            idle_timeout,
        };
        task.run().boxed()
    }
}

impl Origin {
    fn revision(self) -> u64 {
        match self {
            // The first of all.
            Self::Here => 1,
            Self::Bus { revision, .. } => revision,
        }
    }

    /// When it was made: of two of one name the later one counts, whatever the clocks say.
    fn created(self, later_than: Option<u64>) -> SystemTime {
        match self {
            Self::Here => {
                let after = later_than.map(|last| {
                    SystemTime::UNIX_EPOCH + Duration::from_micros(last.saturating_add(1))
                });
                after.map_or_else(SystemTime::now, |after| after.max(SystemTime::now()))
            }
            Self::Bus { instance, .. } => SystemTime::UNIX_EPOCH + Duration::from_micros(instance),
        }
    }
}

/// Gives back what an ended stream has taken, once its readers have left or have had their time.
async fn give_memory_back(remains: &Weak<Stream>) {
    const LOOK_AGAIN: Duration = Duration::from_millis(100);
    const MAX_LOOKS: u32 = 20;
    for _ in 0..MAX_LOOKS {
        if remains.strong_count() == 0 {
            break;
        }
        tokio::time::sleep(LOOK_AGAIN).await;
    }
    // Fails only if the server ends meanwhile, and the memory with it.
    tokio::task::spawn_blocking(steadymesh_heap::release)
        .await
        .ok();
}
