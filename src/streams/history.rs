//! What a stream remembers: its newest frames, ready to be sent again.

use std::collections::VecDeque;
use std::sync::Arc;

use bytes::Bytes;
use steadymesh_proto::{DeliveredFrame, FrameMetrics, InvalidDeliveredFrame};

/// A frame that is out.
#[derive(Debug)]
pub struct Delivered {
    /// Its figures.
    pub metrics: FrameMetrics,
    /// The binary message of `subscribe`, encoded once for all readers.
    pub message: Bytes,
    /// The Draco bytes: the end of `message`.
    pub mesh: Bytes,
    /// The image that [`FrameMetrics::texture`] says of, which is not in `message`. Frames with the
    /// same one share it.
    pub image: Option<Bytes>,
    /// How many frames of the stream came out before this one.
    ordinal: u64,
}

/// A frame as it is delivered.
#[derive(Debug)]
pub(super) struct Encoded {
    metrics: FrameMetrics,
    message: Bytes,
    mesh: Bytes,
    image: Option<Bytes>,
}

impl Encoded {
    /// Encodes what was made here.
    pub fn new(metrics: FrameMetrics, draco: &[u8], image: Option<Bytes>) -> Self {
        let frame = DeliveredFrame {
            metrics,
            mesh: draco,
            image: None,
        };
        let message = Bytes::from(frame.encode());
        Self {
            mesh: message.slice(message.len() - draco.len()..),
            message,
            metrics: frame.metrics,
            image,
        }
    }

    /// Reads what was encoded elsewhere.
    pub fn read(message: Bytes) -> Result<Self, InvalidDeliveredFrame> {
        let frame = DeliveredFrame::decode(&message)?;
        let Some(image) = frame.image else {
            return Ok(Self {
                mesh: message.slice_ref(frame.mesh),
                metrics: frame.metrics,
                image: None,
                message,
            });
        };
        let alone = Bytes::from(DeliveredFrame::without_image(&message, image));
        Ok(Self {
            mesh: alone.slice(alone.len() - frame.mesh.len()..),
            metrics: frame.metrics,
            // Not the whole message, of which it would be a part for as long as it is shared.
            image: Some(Bytes::copy_from_slice(image)),
            message: alone,
        })
    }
}

/// Why a frame that had been accepted did not come out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// A newer frame took its place, as the stream's `overload` setting asks for.
    Overload,
    /// A defect of the server.
    Failed,
}

impl Loss {
    /// The name under which it is counted.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Overload => "overload",
            Self::Failed => "failed",
        }
    }
}

/// What became of an accepted frame.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// It is out.
    Delivered(Arc<Delivered>),
    /// It is not coming.
    Lost(Loss),
}

/// How much a stream remembers. Its newest frame is remembered in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HistoryLimits {
    /// Most frames.
    pub frames: usize,
    /// Most bytes of their messages and images.
    pub bytes: usize,
}

/// The outcomes of a stream's newest frames, oldest first; what does not fit is forgotten,
/// oldest first.
#[derive(Debug)]
pub(super) struct History {
    /// Numbers are ascending, with gaps where the rig has left some out.
    entries: VecDeque<(u64, Outcome)>,
    limits: HistoryLimits,
    /// What the messages of all entries take, and the images, which follow each other.
    bytes: usize,
    delivered: u64,
}

impl History {
    pub fn new(limits: HistoryLimits) -> Self {
        Self {
            entries: VecDeque::with_capacity(limits.frames.min(1024)),
            limits,
            bytes: 0,
            delivered: 0,
        }
    }

    /// Adds the outcome of the next frame.
    pub fn push(&mut self, seq: u64, outcome: Outcome) {
        let entry = (seq, outcome);
        self.bytes += byte_count(&entry) + own_image(&entry, self.entries.back());
        self.entries.push_back(entry);
        while 1 < self.entries.len() && self.is_too_large() {
            if let Some(oldest) = self.entries.pop_front() {
                self.bytes -= byte_count(&oldest) + own_image(&oldest, self.entries.front());
            }
        }
    }

    fn is_too_large(&self) -> bool {
        let newest = || self.newest().map_or(0, |frame| frame.byte_count());
        self.limits.frames < self.entries.len()
            || (self.limits.bytes < self.bytes && newest() < self.bytes)
    }

    /// Adds a frame that is out.
    pub fn deliver(&mut self, frame: Encoded) -> Arc<Delivered> {
        // One that is there already is kept once.
        let before = self
            .newest()
            .filter(|newest| newest.metrics.texture == frame.metrics.texture);
        let shared = before.and_then(|newest| newest.image.clone());
        let delivered = Arc::new(Delivered {
            image: shared.or(frame.image),
            metrics: frame.metrics,
            message: frame.message,
            mesh: frame.mesh,
            ordinal: self.delivered,
        });
        self.delivered += 1;
        let seq = delivered.metrics.seq;
        self.push(seq, Outcome::Delivered(Arc::clone(&delivered)));
        delivered
    }

    /// The outcome of the frame with this number, if it is remembered.
    pub fn find(&self, seq: u64) -> Option<&Outcome> {
        let at = self.entries.binary_search_by_key(&seq, |entry| entry.0);
        at.ok().map(|index| &self.entries[index].1)
    }

    /// The number of the newest frame whose outcome is known.
    pub fn newest_seq(&self) -> Option<u64> {
        self.entries.back().map(|entry| entry.0)
    }

    /// The oldest frame after number `seq` that is out, or the oldest of all.
    pub fn after(&self, seq: Option<u64>) -> Option<&Arc<Delivered>> {
        let start = self
            .entries
            .partition_point(|entry| seq.is_some_and(|seq| entry.0 <= seq));
        self.entries.range(start..).find_map(delivered)
    }

    /// The newest image of this name, with its figures.
    pub fn texture(&self, id: &str) -> Option<&Arc<Delivered>> {
        let mut newest_first = self.entries.iter().rev().filter_map(delivered);
        newest_first.find(|frame| {
            let texture = frame.metrics.texture.as_ref();
            texture.is_some_and(|texture| texture.id == id)
        })
    }

    /// The newest frame that is out.
    pub fn newest(&self) -> Option<&Arc<Delivered>> {
        self.entries.iter().rev().find_map(delivered)
    }

    /// The newest `count` frames that are out, oldest first.
    pub fn last(&self, count: usize) -> Vec<Arc<Delivered>> {
        let newest_first = self.entries.iter().rev().filter_map(delivered);
        let mut frames: Vec<_> = newest_first.take(count).cloned().collect();
        frames.reverse();
        frames
    }
}

impl Delivered {
    /// The message with the image, if there is one.
    #[must_use]
    pub fn message_with_image(&self) -> Bytes {
        match &self.image {
            Some(image) => DeliveredFrame::with_image(&self.message, image).into(),
            None => self.message.clone(),
        }
    }

    fn byte_count(&self) -> usize {
        self.message.len() + self.image.as_ref().map_or(0, Bytes::len)
    }

    /// How many frames came out between `earlier` and this one.
    pub(super) fn frames_since(&self, earlier: &Self) -> u64 {
        self.ordinal.saturating_sub(earlier.ordinal + 1)
    }
}

fn byte_count(entry: &(u64, Outcome)) -> usize {
    delivered(entry).map_or(0, |frame| frame.message.len())
}

/// The length of an entry's image, unless its neighbour has the same.
fn own_image(entry: &(u64, Outcome), neighbour: Option<&(u64, Outcome)>) -> usize {
    let image = |entry| delivered(entry).and_then(|frame| frame.image.as_ref());
    let Some(own) = image(entry) else { return 0 };
    let is_shared = neighbour
        .and_then(image)
        .is_some_and(|other| other.as_ptr() == own.as_ptr());
    if is_shared { 0 } else { own.len() }
}

fn delivered(entry: &(u64, Outcome)) -> Option<&Arc<Delivered>> {
    match &entry.1 {
        Outcome::Delivered(frame) => Some(frame),
        Outcome::Lost(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use steadymesh_proto::metrics::Texture;

    fn remembering(frames: usize) -> History {
        History::new(HistoryLimits {
            frames,
            bytes: usize::MAX,
        })
    }

    fn deliver(history: &mut History, seq: u64) -> Arc<Delivered> {
        let metrics = FrameMetrics {
            seq,
            ..FrameMetrics::default()
        };
        let draco = format!("mesh {seq}");
        history.deliver(Encoded::new(metrics, draco.as_bytes(), None))
    }

    #[test]
    fn the_oldest_frames_are_forgotten() {
        let mut history = remembering(3);
        for seq in [2, 4, 6, 8] {
            deliver(&mut history, seq);
        }
        assert!(history.find(2).is_none());
        assert!(history.find(5).is_none());
        assert!(matches!(history.find(4), Some(Outcome::Delivered(_))));
        let last: Vec<_> = history.last(2).iter().map(|f| f.metrics.seq).collect();
        assert_eq!(last, [6, 8]);
    }

    #[test]
    fn the_oldest_frames_give_way_to_bytes_too_and_the_newest_stays() {
        let size = deliver(&mut remembering(1), 1).message.len();
        let mut history = History::new(HistoryLimits {
            frames: 100,
            bytes: 3 * size,
        });
        for seq in 1..=9 {
            deliver(&mut history, seq);
        }
        let last: Vec<_> = history.last(99).iter().map(|f| f.metrics.seq).collect();
        assert_eq!(last, [7, 8, 9]);
        history.limits.bytes = 1;
        deliver(&mut history, 10);
        history.push(11, Outcome::Lost(Loss::Overload));
        assert!(history.find(9).is_none());
        assert_eq!(history.newest().map(|frame| frame.metrics.seq), Some(10));
    }

    fn deliver_textured(history: &mut History, seq: u64, id: &str) -> Arc<Delivered> {
        let texture = Texture {
            id: id.to_owned(),
            ..Texture::default()
        };
        let metrics = FrameMetrics {
            seq,
            texture: Some(texture),
            ..FrameMetrics::default()
        };
        let image = Bytes::from(vec![7; 1000]);
        history.deliver(Encoded::new(metrics, b"mesh", Some(image)))
    }

    #[test]
    fn an_image_is_kept_once_and_counted_once() {
        let mut history = remembering(3);
        let first = deliver_textured(&mut history, 1, "a");
        let message = first.message.len();
        for (seq, id, images) in [
            (2, "a", 1),
            (3, "b", 2),
            (4, "b", 2),
            (5, "b", 1),
            (6, "a", 2),
        ] {
            deliver_textured(&mut history, seq, id);
            let frames = history.entries.len();
            assert_eq!(history.bytes, frames * message + images * 1000, "{seq}");
        }
        history.push(7, Outcome::Lost(Loss::Failed));
        history.push(8, Outcome::Lost(Loss::Failed));
        history.push(9, Outcome::Lost(Loss::Failed));
        assert_eq!(history.bytes, 0);
    }

    #[test]
    fn an_image_is_found_by_its_name_and_read_from_other_nodes() {
        let mut history = remembering(3);
        let frame = deliver_textured(&mut history, 1, "a");
        let message = frame.message_with_image();
        let mut other = remembering(3);
        let read = other.deliver(Encoded::read(message.clone()).unwrap());
        assert_eq!((&read.message, &read.image), (&frame.message, &frame.image));
        assert_eq!(read.message_with_image(), message);
        assert_eq!(&read.mesh[..], b"mesh");
        let found = other.texture("a").map(|frame| frame.metrics.seq);
        assert_eq!((found, other.texture("b").is_none()), (Some(1), true));
    }

    #[test]
    fn a_lost_frame_is_known_as_lost_and_skipped_by_readers() {
        let mut history = remembering(9);
        let first = deliver(&mut history, 0);
        history.push(1, Outcome::Lost(Loss::Overload));
        let third = deliver(&mut history, 2);
        assert!(matches!(
            history.find(1),
            Some(Outcome::Lost(Loss::Overload))
        ));
        assert_eq!(history.after(Some(0)).unwrap().metrics.seq, 2);
        assert_eq!(third.frames_since(&first), 0);
    }

    #[test]
    fn the_mesh_is_the_end_of_the_message() {
        let frame = deliver(&mut remembering(1), 7);
        assert_eq!(&frame.mesh[..], b"mesh 7");
        assert_eq!(
            DeliveredFrame::decode(&frame.message).unwrap().mesh,
            b"mesh 7"
        );
    }
}
