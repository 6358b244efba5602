//! What is recorded of a stream.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use steadymesh_proto::recording::{Record, RecordingEnd, Track};
use steadymesh_proto::stream::{EndReason, RecordingStatus};

use crate::storage::{RawFrame, Recorder, RecordingKey, Recordings};

use super::{Configured, Delivered, StreamName};

/// The recording of a stream, where there is one: each time that it is configured to record
/// something else, the next begins.
#[derive(Debug)]
pub struct Tape {
    recordings: Option<Arc<Recordings>>,
    recorder: Mutex<Option<Arc<Recorder>>>,
}

impl Tape {
    pub(super) fn new(recordings: Option<Arc<Recordings>>) -> Self {
        Self {
            recordings,
            recorder: Mutex::default(),
        }
    }

    /// Whether something is or was recorded.
    pub(super) fn has_begun(&self) -> bool {
        self.lock().is_some()
    }

    /// Begins a recording if another thing is to be recorded than is, or with other settings: those
    /// of a recording hold for all of it.
    pub(super) fn configure(&self, name: &StreamName, configured: &Configured) {
        let mut recorder = self.lock();
        let record = configured.record;
        let goes_on = match recorder.as_ref() {
            None => record == Record::Off,
            Some(recorder) => {
                recorder.record() == record && *recorder.config() == configured.config
            }
        };
        if goes_on {
            return;
        }
        if let Some(last) = recorder.take() {
            last.finish(RecordingEnd::Stopped);
        }
        if record != Record::Off
            && let Some(recordings) = &self.recordings
        {
            let begun = recordings.record(name.as_str(), record, &configured.config);
            *recorder = Some(Arc::new(begun));
        }
    }

    /// The recording that is being made, or the last one of a stream that has ended.
    #[must_use]
    pub fn key(&self) -> Option<RecordingKey> {
        self.lock().as_ref().map(|recorder| recorder.key().clone())
    }

    pub(super) fn status(&self) -> Option<RecordingStatus> {
        self.lock().as_ref().map(|recorder| recorder.status())
    }

    /// Whether the frames that come in are recorded.
    pub(super) fn takes_raw(&self) -> bool {
        let recorder = self.lock();
        recorder
            .as_ref()
            .is_some_and(|recorder| recorder.record().has(Track::Raw))
    }

    pub(super) fn raw(&self, frame: RawFrame) {
        if let Some(recorder) = &*self.lock() {
            recorder.raw(frame);
        }
    }

    pub(super) fn output(&self, frame: &Delivered) {
        let recorder = self.lock().clone();
        let takes = |recorder: &Arc<Recorder>| recorder.record().has(Track::Output);
        if let Some(recorder) = recorder.filter(takes) {
            recorder.output(&frame.metrics, &frame.message_with_image());
        }
    }

    pub(super) fn finish(&self, reason: EndReason) {
        if let Some(recorder) = &*self.lock() {
            recorder.finish(reason.into());
        }
    }

    /// Waits until all of a recording that is finished has been written or given up.
    pub(super) async fn ended(&self) {
        let recorder = self.lock().clone();
        if let Some(recorder) = recorder {
            recorder.finished().await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Arc<Recorder>>> {
        // Nothing that panics is done under this lock.
        self.recorder.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
