//! Takes away what is too old or too much, a page of segments at a time, oldest first; and closes
//! recordings that nobody did.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path as FilePath;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use futures_util::TryStreamExt;
use object_store::PutMode;
use object_store::path::Path;
use steadymesh_proto::recording::Track;
use tokio_util::sync::CancellationToken;

use super::index::Page;
use super::layout::{Part, RecordingKey, unix_us};
use super::manifest::{End, Manifest};
use super::reader::{ReadFailed, read_index};
use super::recordings::Recordings;

/// A recording to which nothing was added for so long, and that has no end, is nobody's. It may be
/// another server's, whose store is away.
const ABANDONED: Duration = Duration::from_secs(600);

/// Segments that are taken away together, with the page that has them.
#[derive(Debug, Default)]
struct Batch {
    segments: Vec<Path>,
    page: Option<Path>,
    bytes: u64,
    /// When the last of it was written.
    newest_us: u64,
}

/// All objects of a recording.
#[derive(Debug, Default)]
struct Objects {
    batches: BTreeMap<(Track, u32), Batch>,
    manifest: Option<Path>,
    newest_us: u64,
}

impl Objects {
    /// Whether nothing has been added for so long that nobody will.
    fn is_old(&self, now_us: u64) -> bool {
        let until = self.newest_us.saturating_add(ABANDONED.as_micros() as u64);
        until < now_us
    }
}

impl Recordings {
    /// Takes away what is to go, every `Options::sweep_interval`, until `stop`.
    pub async fn keep_tidy(self: Arc<Self>, stop: CancellationToken) {
        let mut ticks = tokio::time::interval(self.options.sweep_interval);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = ticks.tick() => {}
                () = stop.cancelled() => return,
            }
            if let Err(error) = self.sweep(SystemTime::now()).await {
                tracing::warn!(%error, "recordings could not be tidied up; the next time they will");
            }
        }
    }

    pub(super) async fn sweep(&self, now: SystemTime) -> Result<(), ReadFailed> {
        self.remove_leftovers(now).await;
        let now_us = unix_us(now);
        let mut recordings = self.objects().await?;
        let live = self.that_go_on(&recordings, now_us).await?;
        let goes_on = |key: &RecordingKey| live.contains(key);
        for (key, part) in to_remove(&recordings, &self.limits(now_us), goes_on) {
            let Some(objects) = recordings.get_mut(&key) else {
                continue;
            };
            let Some(batch) = objects.batches.remove(&part) else {
                continue;
            };
            tracing::info!(
                stream = %key.stream, recording = %key.id, bytes = batch.bytes,
                "the oldest of a recording is taken away"
            );
            // The index before what it points at.
            self.remove(batch.page.into_iter().collect()).await?;
            self.remove(batch.segments).await?;
            if objects.batches.is_empty() && !goes_on(&key) {
                self.remove(objects.manifest.take().into_iter().collect())
                    .await?;
            }
        }
        for (key, objects) in recordings {
            if objects.is_old(now_us) && objects.manifest.is_some() && !goes_on(&key) {
                self.close_abandoned(&key).await?;
            }
        }
        Ok(())
    }

    /// Recordings that somebody adds to: this server, or another that shares the store.
    async fn that_go_on(
        &self,
        recordings: &BTreeMap<RecordingKey, Objects>,
        now_us: u64,
    ) -> Result<BTreeSet<RecordingKey>, ReadFailed> {
        let mut live = BTreeSet::new();
        for (key, objects) in recordings {
            let goes_on = self.is_live(key)
                || !objects.is_old(now_us)
                    && match Manifest::read(&self.store, &self.layout, key).await {
                        Ok(manifest) => manifest.end.is_none(),
                        // Deleted meanwhile.
                        Err(ReadFailed::NoRecording { .. }) => false,
                        Err(error) => return Err(error),
                    };
            if goes_on {
                live.insert(key.clone());
            }
        }
        Ok(live)
    }

    fn limits(&self, now_us: u64) -> Limits {
        let age = |age: Duration| u64::try_from(age.as_micros()).unwrap_or(u64::MAX);
        Limits {
            oldest_us: self
                .options
                .max_age
                .map(|max| now_us.saturating_sub(age(max))),
            max_bytes: self.options.max_bytes,
        }
    }

    /// Everything that the store has.
    async fn objects(&self) -> Result<BTreeMap<RecordingKey, Objects>, ReadFailed> {
        let mut recordings: BTreeMap<RecordingKey, Objects> = BTreeMap::new();
        let root = self.layout.root().clone();
        let mut listed = self.store.objects.list(Some(&root));
        while let Some(object) = listed.try_next().await? {
            let Some((key, part)) = self.layout.parse(&object.location) else {
                continue;
            };
            let modified_us = u64::try_from(object.last_modified.timestamp_micros()).unwrap_or(0);
            let objects = recordings.entry(key).or_default();
            objects.newest_us = objects.newest_us.max(modified_us);
            let batch = match part {
                Part::Manifest => {
                    objects.manifest = Some(object.location);
                    continue;
                }
                Part::Segment(track, ordinal) => {
                    let batch = objects
                        .batches
                        .entry((track, Page::of(ordinal)))
                        .or_default();
                    batch.segments.push(object.location);
                    batch
                }
                Part::Page(track, page) => {
                    let batch = objects.batches.entry((track, page)).or_default();
                    batch.page = Some(object.location);
                    batch
                }
            };
            batch.bytes += object.size;
            batch.newest_us = batch.newest_us.max(modified_us);
        }
        Ok(recordings)
    }

    /// Writes the end of a recording whose server is gone.
    async fn close_abandoned(&self, key: &RecordingKey) -> Result<(), ReadFailed> {
        let mut manifest = Manifest::read(&self.store, &self.layout, key).await?;
        if manifest.end.is_some() {
            return Ok(());
        }
        let track = async |track| {
            if !manifest.record.has(track) {
                return Ok(None);
            }
            let index = read_index(&self.store, &self.layout, key, track).await?;
            Ok::<_, ReadFailed>(Some(index.summary()))
        };
        let (raw, output) = (track(Track::Raw).await?, track(Track::Output).await?);
        let last = [&raw, &output].into_iter().flatten();
        let ended_us = last.filter_map(|summary| summary.last_time_us).max();
        manifest.end = Some(End {
            reason: None,
            ended_us,
            raw,
            output,
        });
        tracing::info!(stream = %key.stream, recording = %key.id, "an abandoned recording is closed");
        manifest
            .write(&self.store, &self.layout, key, PutMode::Overwrite)
            .await?;
        Ok(())
    }

    /// A folder has what a server that was killed had begun to write.
    async fn remove_leftovers(&self, now: SystemTime) {
        let Some(folder) = self.store.folder.clone() else {
            return;
        };
        let removed = tokio::task::spawn_blocking(move || remove_staged(&folder, now)).await;
        if let Ok(Err(error)) = removed {
            tracing::warn!(%error, "unfinished files of recordings could not be removed");
        }
    }
}

/// What may stay.
#[derive(Debug, Clone, Copy)]
struct Limits {
    oldest_us: Option<u64>,
    max_bytes: Option<u64>,
}

/// What has to go, oldest first. What is being written at this moment stays: the newest page of
/// each track of a live recording.
fn to_remove(
    recordings: &BTreeMap<RecordingKey, Objects>,
    limits: &Limits,
    is_live: impl Fn(&RecordingKey) -> bool,
) -> Vec<(RecordingKey, (Track, u32))> {
    let mut batches = Vec::new();
    let mut bytes = 0;
    for (key, objects) in recordings {
        let live = is_live(key);
        let newest: BTreeSet<(Track, u32)> = Track::ALL
            .iter()
            .filter_map(|track| {
                let mut pages = objects.batches.keys().filter(|(which, _)| which == track);
                pages.next_back().copied()
            })
            .collect();
        for (part, batch) in &objects.batches {
            bytes += batch.bytes;
            if !(live && newest.contains(part)) {
                batches.push((batch.newest_us, key, *part, batch.bytes));
            }
        }
    }
    batches.sort();
    let mut gone = Vec::new();
    for (newest_us, key, part, size) in batches {
        let is_old = limits.oldest_us.is_some_and(|oldest| newest_us < oldest);
        if is_old || limits.max_bytes.is_some_and(|max| max < bytes) {
            bytes -= size;
            gone.push((key.clone(), part));
        }
    }
    gone
}

/// Removes files that a put left behind when its process was killed: `NAME#NUMBER`, as
/// `object_store` calls what it has not finished.
fn remove_staged(folder: &FilePath, now: SystemTime) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        // May have been finished meanwhile.
        let Ok(metadata) = entry.metadata() else {
            continue;
        };
        if metadata.is_dir() {
            remove_staged(&entry.path(), now)?;
            continue;
        }
        let name = entry.file_name();
        let staged = name
            .to_str()
            .and_then(|name| name.rsplit_once('#'))
            .is_some_and(|(name, number)| {
                (name.ends_with(".segment") || name.ends_with(".json"))
                    && !number.is_empty()
                    && number.bytes().all(|b| b.is_ascii_digit())
            });
        let age = metadata.modified().ok().map(|at| now.duration_since(at));
        let is_old = age.is_some_and(|age| age.is_ok_and(|age| ABANDONED < age));
        if staged && is_old {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(id: &str) -> RecordingKey {
        RecordingKey {
            stream: "rig".to_owned(),
            id: id.to_owned(),
        }
    }

    fn batch(bytes: u64, newest_us: u64) -> Batch {
        Batch {
            bytes,
            newest_us,
            ..Batch::default()
        }
    }

    fn recordings() -> BTreeMap<RecordingKey, Objects> {
        let mut old = Objects::default();
        old.batches.insert((Track::Raw, 0), batch(100, 10));
        old.batches.insert((Track::Raw, 1), batch(100, 20));
        let mut new = Objects::default();
        new.batches.insert((Track::Raw, 0), batch(100, 30));
        new.batches.insert((Track::Output, 0), batch(10, 31));
        BTreeMap::from([(key("a"), old), (key("b"), new)])
    }

    #[test]
    fn what_is_too_much_goes_oldest_first() {
        let gone = |max_bytes| {
            let limits = Limits {
                oldest_us: None,
                max_bytes: Some(max_bytes),
            };
            to_remove(&recordings(), &limits, |_| false)
        };
        assert_eq!(gone(310), []);
        assert_eq!(gone(309), [(key("a"), (Track::Raw, 0))]);
        assert_eq!(gone(110).len(), 2);
        assert_eq!(gone(0).len(), 4);
    }

    #[test]
    fn what_is_too_old_goes() {
        let limits = Limits {
            oldest_us: Some(21),
            max_bytes: None,
        };
        let gone = to_remove(&recordings(), &limits, |_| false);
        let expected = [(key("a"), (Track::Raw, 0)), (key("a"), (Track::Raw, 1))];
        assert_eq!(gone, expected);
    }

    #[test]
    fn what_is_being_written_stays() {
        let limits = Limits {
            oldest_us: Some(100),
            max_bytes: Some(0),
        };
        let gone = to_remove(&recordings(), &limits, |_| true);
        assert_eq!(gone, [(key("a"), (Track::Raw, 0))]);
    }
}
