//! Reads a recording: its index, its segments, its frames.

use std::sync::Arc;

use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt};
use object_store::ObjectStoreExt;
use steadymesh_proto::recording::{
    RecordedFrame, RecordingState, RecordingSummary, Track, TrackSummary,
};

use super::cursor::{Cursor, StoredFrame};
use super::index::{Page, Segment, Start, TrackIndex};
use super::layout::{Layout, Part, RecordingKey};
use super::manifest::Manifest;
use super::segment::{self, Entry, Footer, InvalidSegment, TRAILER_BYTES};
use super::store::Store;

/// Objects that are read at a time.
const PARALLEL: usize = 16;
/// What is read of a segment's end at first: its list of frames is rarely longer.
const TAIL_BYTES: u64 = 16 << 10;

/// Why something of a recording cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadFailed {
    /// There is none with this name.
    #[error("there is no recording {} of the stream {}", key.id, key.stream)]
    NoRecording {
        /// Which one.
        key: RecordingKey,
    },
    /// It does not have this track.
    #[error("the recording has no {} frames", track.name())]
    NoTrack {
        /// Which one.
        track: Track,
    },
    /// It has no such frame.
    #[error("the recording has no {} frame {seq}", track.name())]
    NoFrame {
        /// Of which track.
        track: Track,
        /// The frame's number.
        seq: u64,
    },
    /// It goes on, and cannot be deleted.
    #[error("the recording goes on: end it first")]
    GoesOn,
    /// An object is not what was written.
    #[error("{object} is damaged: {reason}")]
    Damaged {
        /// The object's name.
        object: String,
        /// What is wrong.
        reason: String,
    },
    /// An object has been taken away since the index was read.
    #[error("{object} has been taken away")]
    Gone {
        /// The object's name.
        object: String,
    },
    /// The store does not answer as it should.
    #[error("the store of recordings fails: {0}")]
    Store(#[source] Box<dyn std::error::Error + Send + Sync>),
}

impl From<object_store::Error> for ReadFailed {
    fn from(error: object_store::Error) -> Self {
        if let object_store::Error::NotFound { path, .. } = error {
            return Self::Gone { object: path };
        }
        Self::Store(Box::new(error))
    }
}

/// A recording that can be read. What is added to it after it was opened is not seen.
#[derive(Debug)]
pub struct Recording {
    key: RecordingKey,
    store: Store,
    layout: Layout,
    manifest: Manifest,
    /// Whether somebody adds to it at this moment.
    is_live: bool,
    raw: TrackIndex,
    output: TrackIndex,
}

impl Recording {
    pub(super) async fn open(
        (store, layout): (&Store, &Layout),
        key: &RecordingKey,
        is_live: bool,
    ) -> Result<Self, ReadFailed> {
        let manifest = Manifest::read(store, layout, key).await?;
        let index = async |track| {
            if manifest.record.has(track) {
                read_index(store, layout, key, track).await
            } else {
                Ok(TrackIndex::default())
            }
        };
        let (raw, output) = (index(Track::Raw).await?, index(Track::Output).await?);
        Ok(Self {
            key: key.clone(),
            store: store.clone(),
            layout: layout.clone(),
            manifest,
            is_live,
            raw,
            output,
        })
    }

    /// What there is of it.
    #[must_use]
    pub fn summary(&self) -> RecordingSummary {
        let track = |track| self.manifest.record.has(track);
        summarize(
            &self.key,
            &self.manifest,
            self.is_live,
            track(Track::Raw).then(|| self.raw.summary()),
            track(Track::Output).then(|| self.output.summary()),
        )
    }

    /// Starts reading a track.
    ///
    /// # Errors
    ///
    /// [`ReadFailed::NoTrack`].
    pub fn cursor(self: &Arc<Self>, track: Track, start: Start) -> Result<Cursor, ReadFailed> {
        if !self.manifest.record.has(track) {
            return Err(ReadFailed::NoTrack { track });
        }
        Ok(Cursor::new(Arc::clone(self), track, start))
    }

    /// What is known of at most `limit` frames from `start` on, and whether there are more.
    ///
    /// # Errors
    ///
    /// [`ReadFailed`].
    pub async fn frames(
        &self,
        track: Track,
        start: Start,
        limit: usize,
    ) -> Result<(Vec<RecordedFrame>, bool), ReadFailed> {
        if !self.manifest.record.has(track) {
            return Err(ReadFailed::NoTrack { track });
        }
        let mut frames = Vec::new();
        let mut position = self.index(track).position(start);
        while let Some(segment) = self.index(track).get(position) {
            let footer = self.footer(track, segment).await?;
            // What comes behind the first is wanted whatever its time: clocks are set.
            let has_begun = !frames.is_empty();
            let entries = footer.frames.into_iter();
            for entry in entries.skip_while(|e| !has_begun && !is_from(e, start)) {
                if frames.len() == limit {
                    return Ok((frames, true));
                }
                frames.push(entry.frame);
            }
            position += 1;
        }
        Ok((frames, false))
    }

    /// One frame.
    ///
    /// # Errors
    ///
    /// [`ReadFailed`].
    pub async fn frame(&self, track: Track, seq: u64) -> Result<StoredFrame, ReadFailed> {
        let missing = ReadFailed::NoFrame { track, seq };
        if !self.manifest.record.has(track) {
            return Err(ReadFailed::NoTrack { track });
        }
        let index = self.index(track);
        let Some(segment) = index.get(index.position(Start::Seq(seq))) else {
            return Err(missing);
        };
        let footer = self.footer(track, segment).await?;
        let mut entries = footer.frames.into_iter();
        let Some(entry) = entries.find(|entry| entry.frame.seq == seq) else {
            return Err(missing);
        };
        let path = self.path(track, segment);
        let body = self.store.objects.get_range(&path, entry.range()).await?;
        self.checked(track, segment, entry, body)
    }

    pub(super) fn index(&self, track: Track) -> &TrackIndex {
        match track {
            Track::Raw => &self.raw,
            Track::Output => &self.output,
        }
    }

    /// All of a segment.
    pub(super) async fn segment(
        &self,
        track: Track,
        segment: &Segment,
    ) -> Result<(Footer, Bytes), ReadFailed> {
        let object = self.store.objects.get(&self.path(track, segment)).await?;
        let bytes = object.bytes().await?;
        let footer = segment::read_whole(&bytes);
        Ok((
            footer.map_err(|error| self.damaged(track, segment, &error))?,
            bytes,
        ))
    }

    /// A frame with a body that has been read for it, if that is what was written.
    pub(super) fn checked(
        &self,
        track: Track,
        segment: &Segment,
        entry: Entry,
        body: Bytes,
    ) -> Result<StoredFrame, ReadFailed> {
        let checked = entry.check(&body);
        checked.map_err(|error| self.damaged(track, segment, &error))?;
        let frame = entry.frame;
        Ok(StoredFrame { frame, body })
    }

    async fn footer(&self, track: Track, segment: &Segment) -> Result<Footer, ReadFailed> {
        let path = self.path(track, segment);
        let read = read_footer(&self.store, &path, segment.length).await?;
        read.map_err(|error| self.damaged(track, segment, &error))
    }

    fn path(&self, track: Track, segment: &Segment) -> object_store::path::Path {
        let part = Part::Segment(track, segment.ordinal);
        self.layout.object(&self.key, part)
    }

    fn damaged(&self, track: Track, segment: &Segment, error: &InvalidSegment) -> ReadFailed {
        ReadFailed::Damaged {
            object: self.path(track, segment).to_string(),
            reason: error.to_string(),
        }
    }
}

/// Whether an entry is at `start` or after it.
pub(super) fn is_from(entry: &Entry, start: Start) -> bool {
    match start {
        Start::Seq(seq) => seq <= entry.frame.seq,
        Start::Time(time) => time <= entry.frame.time_us(),
    }
}

/// What there is to see of a recording.
pub(super) fn summarize(
    key: &RecordingKey,
    manifest: &Manifest,
    is_live: bool,
    raw: Option<TrackSummary>,
    output: Option<TrackSummary>,
) -> RecordingSummary {
    let end = manifest.end.as_ref();
    let is_complete = end.is_some_and(|end| end.reason.is_some());
    RecordingSummary {
        stream: key.stream.clone(),
        id: key.id.clone(),
        state: if is_complete {
            RecordingState::Complete
        } else if is_live {
            RecordingState::Recording
        } else {
            RecordingState::Interrupted
        },
        started_us: manifest.started_us,
        ended_us: end.and_then(|end| end.ended_us),
        config: manifest.config.clone(),
        raw,
        output,
    }
}

/// Reads the pages of a track's index, and what has been stored since the last was written.
pub(super) async fn read_index(
    store: &Store,
    layout: &Layout,
    key: &RecordingKey,
    track: Track,
) -> Result<TrackIndex, ReadFailed> {
    let folder = layout.track(key, track);
    let objects: Vec<_> = store.objects.list(Some(&folder)).try_collect().await?;
    let (mut pages, mut stored) = (Vec::new(), Vec::new());
    for object in objects {
        match layout.parse(&object.location) {
            Some((_, Part::Page(_, number))) => pages.push((number, object.location)),
            Some((_, Part::Segment(_, ordinal))) => {
                stored.push((ordinal, object.location, object.size));
            }
            _ => {}
        }
    }
    pages.sort_by_key(|page| page.0);
    stored.sort_by_key(|segment| segment.0);
    let reads = pages
        .into_iter()
        .map(|(_, path)| async move { read_page(store, &path).await });
    let read: Vec<Page> = futures_util::stream::iter(reads)
        .buffered(PARALLEL)
        .try_collect()
        .await?;
    let mut index = TrackIndex::new(read.into_iter().flat_map(|page| page.segments).collect());
    // Of a writer that was killed between the two, or that is about to write its page.
    let last = index.last_ordinal();
    for (ordinal, path, size) in stored {
        if last.is_none_or(|last| last < ordinal) {
            // One that cannot be read is not in the index: nothing points at it.
            if let Ok(footer) = read_footer(store, &path, size).await? {
                index.push(Segment::new(ordinal, size, &footer));
            }
        }
    }
    Ok(index)
}

async fn read_page(store: &Store, path: &object_store::path::Path) -> Result<Page, ReadFailed> {
    let bytes = store.objects.get(path).await?.bytes().await?;
    let damaged = |reason: String| ReadFailed::Damaged {
        object: path.to_string(),
        reason,
    };
    let page: Page = serde_json::from_slice(&bytes).map_err(|error| damaged(error.to_string()))?;
    if page.version == Page::VERSION {
        Ok(page)
    } else {
        Err(damaged(format!("it is of version {}", page.version)))
    }
}

/// Reads the list of a segment's frames without the frames.
async fn read_footer(
    store: &Store,
    path: &object_store::path::Path,
    length: u64,
) -> Result<Result<Footer, InvalidSegment>, ReadFailed> {
    let start = length.saturating_sub(TAIL_BYTES);
    let tail = store.objects.get_range(path, start..length).await?;
    let (footer_bytes, crc32) = match segment::read_trailer(&tail) {
        Ok(trailer) => trailer,
        Err(error) => return Ok(Err(error)),
    };
    let wanted = footer_bytes as usize + TRAILER_BYTES;
    let footer = if wanted <= tail.len() {
        tail.slice(tail.len() - wanted..tail.len() - TRAILER_BYTES)
    } else {
        let end = length.saturating_sub(TRAILER_BYTES as u64);
        let Some(start) = end.checked_sub(u64::from(footer_bytes)) else {
            return Ok(Err(InvalidSegment::NotASegment));
        };
        store.objects.get_range(path, start..end).await?
    };
    Ok(segment::read_footer(&footer, crc32, length))
}
