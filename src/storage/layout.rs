//! What objects are called. `docs/recordings.md` shows it as a tree.

use std::time::{Duration, SystemTime};

use object_store::path::Path;
use steadymesh_proto::recording::Track;

/// Which recording: its stream's name, and when it began.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RecordingKey {
    /// The stream's name.
    pub stream: String,
    /// As in [`RecordingSummary::id`](steadymesh_proto::recording::RecordingSummary::id).
    pub id: String,
}

impl RecordingKey {
    const ID_LENGTH: usize = "20261129T215703Z-3f9a".len();

    /// Of a recording that begins now.
    pub(super) fn begun_at(stream: &str, now: SystemTime, salt: u16) -> Self {
        let text = humantime::format_rfc3339_seconds(now).to_string();
        let time: String = text.chars().filter(|c| !matches!(c, '-' | ':')).collect();
        Self {
            stream: stream.to_owned(),
            id: format!("{time}-{salt:04x}"),
        }
    }

    /// Checks that a text can be an id: others are not looked for.
    #[must_use]
    pub fn is_id(text: &str) -> bool {
        let allowed = |b: u8| b.is_ascii_hexdigit() || matches!(b, b'T' | b'Z' | b'-');
        text.len() == Self::ID_LENGTH && text.bytes().all(allowed)
    }
}

/// One object of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Manifest,
    Segment(Track, u32),
    Page(Track, u32),
}

/// Where the recordings are within their store.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    root: Path,
}

const MANIFEST: &str = "recording.json";
const SEGMENT: &str = "segment";
const PAGE: &str = "index.json";

impl Layout {
    pub fn new(root: Path) -> Self {
        Self { root }
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    pub fn stream(&self, stream: &str) -> Path {
        self.root.clone().join(stream)
    }

    pub fn recording(&self, key: &RecordingKey) -> Path {
        self.stream(&key.stream).join(key.id.as_str())
    }

    pub fn track(&self, key: &RecordingKey, track: Track) -> Path {
        self.recording(key).join(track.name())
    }

    pub fn object(&self, key: &RecordingKey, part: Part) -> Path {
        match part {
            Part::Manifest => self.recording(key).join(MANIFEST),
            Part::Segment(track, ordinal) => self
                .track(key, track)
                .join(format!("{ordinal:08}.{SEGMENT}")),
            Part::Page(track, page) => self.track(key, track).join(format!("{page:06}.{PAGE}")),
        }
    }

    /// What an object is; none if it is not part of a recording.
    pub fn parse(&self, path: &Path) -> Option<(RecordingKey, Part)> {
        let parts: Vec<_> = path.prefix_match(&self.root)?.collect();
        let text = |at: usize| parts.get(at).map(AsRef::as_ref);
        let key = RecordingKey {
            stream: text(0)?.to_owned(),
            id: text(1).filter(|id| RecordingKey::is_id(id))?.to_owned(),
        };
        let track = |name| Track::ALL.into_iter().find(|track| track.name() == name);
        let part = match (parts.len(), text(2)?) {
            (3, MANIFEST) => Part::Manifest,
            (4, name) => {
                let (number, kind) = text(3)?.split_once('.')?;
                let number = number.parse().ok()?;
                match kind {
                    SEGMENT => Part::Segment(track(name)?, number),
                    PAGE => Part::Page(track(name)?, number),
                    _ => return None,
                }
            }
            _ => return None,
        };
        Some((key, part))
    }
}

/// Microseconds since 1970; 0 before.
pub(super) fn unix_us(time: SystemTime) -> u64 {
    let since = time.duration_since(SystemTime::UNIX_EPOCH);
    u64::try_from(since.unwrap_or(Duration::ZERO).as_micros()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> RecordingKey {
        let now = SystemTime::UNIX_EPOCH + Duration::from_secs(1_796_000_223);
        RecordingKey::begun_at("rig-1", now, 0x3f)
    }

    #[test]
    fn a_recording_is_called_after_its_beginning() {
        assert_eq!(key().id, "20261130T005703Z-003f");
        assert!(RecordingKey::is_id(&key().id));
        for text in ["", "..", "latest", "20261129T215703Z-3f9/"] {
            assert!(!RecordingKey::is_id(text), "{text}");
        }
    }

    #[test]
    fn what_an_object_is_can_be_told_from_its_name() {
        let layout = Layout::new(Path::from("studio/recordings"));
        for part in [
            Part::Manifest,
            Part::Segment(Track::Raw, 7),
            Part::Page(Track::Output, 123_456),
        ] {
            let path = layout.object(&key(), part);
            assert_eq!(layout.parse(&path), Some((key(), part)), "{path}");
        }
        for other in ["studio/other/x", "studio/recordings/rig-1/notes.txt"] {
            assert_eq!(layout.parse(&Path::from(other)), None, "{other}");
        }
    }
}
