//! A segment: a short stretch of one track, as one object of the store. `docs/recordings.md` has
//! its byte layout.
//!
//! It is written as a whole or not at all. What is in it stands at its end, so that it is built
//! without knowing what comes, and every part has a checksum.

use std::ops::Range;

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use steadymesh_proto::recording::{Gap, RecordedFrame};

const MAGIC: &[u8; 4] = b"SMSG";
const END_MAGIC: &[u8; 4] = b"GSMS";
const VERSION: u16 = 1;
const HEADER: [u8; 8] = {
    let [m0, m1, m2, m3] = *MAGIC;
    let [v0, v1] = VERSION.to_le_bytes();
    // The last two are flags, none of which is defined yet.
    [m0, m1, m2, m3, v0, v1, 0, 0]
};
/// Length and checksum of the footer, and the last four bytes.
pub(super) const TRAILER_BYTES: usize = 12;

/// Why bytes are not what a segment is made of.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidSegment {
    /// The first or last bytes are others, or it is of another version.
    #[error("it is not a segment of version {VERSION}")]
    NotASegment,
    /// The list of frames is not what was written.
    #[error("its list of frames is damaged")]
    Footer,
    /// A frame is not what was written.
    #[error("frame {seq} is damaged: its checksum is {found:08x} instead of {expected:08x}")]
    Frame {
        /// The frame's number.
        seq: u64,
        /// What was written.
        expected: u32,
        /// What is there.
        found: u32,
    },
}

/// What stands at the end of a segment.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(super) struct Footer {
    pub frames: Vec<Entry>,
    /// What is missing before the first of them, or between them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub gaps: Vec<Gap>,
}

/// One frame of a segment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Entry {
    #[serde(flatten)]
    pub frame: RecordedFrame,
    /// Where its body begins, from the segment's first byte.
    pub offset: u64,
    /// CRC-32 (IEEE 802.3) of its body.
    pub crc32: u32,
}

impl Entry {
    /// Where its body is.
    pub fn range(&self) -> Range<u64> {
        // The footer was written with these numbers; the sum of two that are not does not wrap.
        self.offset..self.offset.saturating_add(self.frame.bytes)
    }

    /// Checks a body that was read.
    pub fn check(&self, body: &[u8]) -> Result<(), InvalidSegment> {
        let found = crc32fast::hash(body);
        if found == self.crc32 && body.len() as u64 == self.frame.bytes {
            return Ok(());
        }
        Err(InvalidSegment::Frame {
            seq: self.frame.seq,
            expected: self.crc32,
            found,
        })
    }
}

/// A segment that is being filled. Bodies are not copied.
#[derive(Debug, Default)]
pub(super) struct Builder {
    bodies: Vec<Bytes>,
    footer: Footer,
    body_bytes: u64,
}

impl Builder {
    pub fn push(&mut self, frame: RecordedFrame, body: Bytes) {
        self.footer.frames.push(Entry {
            frame,
            offset: HEADER.len() as u64 + self.body_bytes,
            crc32: crc32fast::hash(&body),
        });
        self.body_bytes += body.len() as u64;
        self.bodies.push(body);
    }

    pub fn push_gap(&mut self, gap: Gap) {
        self.footer.gaps.push(gap);
    }

    /// Bytes of the frames so far.
    pub fn body_bytes(&self) -> u64 {
        self.body_bytes
    }

    /// The segment's bytes, in pieces, and what is in it.
    pub fn finish(self) -> (Vec<Bytes>, Footer) {
        // Names and numbers, which always serialize.
        let footer = serde_json::to_vec(&self.footer).unwrap_or_default();
        let mut end = Vec::with_capacity(footer.len() + TRAILER_BYTES);
        end.extend_from_slice(&footer);
        // A list of gigabytes is not made in the time that a segment lasts.
        let length = u32::try_from(footer.len()).unwrap_or(u32::MAX);
        end.extend_from_slice(&length.to_le_bytes());
        end.extend_from_slice(&crc32fast::hash(&footer).to_le_bytes());
        end.extend_from_slice(END_MAGIC);
        let mut pieces = Vec::with_capacity(self.bodies.len() + 2);
        pieces.push(Bytes::from_static(&HEADER));
        pieces.extend(self.bodies);
        pieces.push(Bytes::from(end));
        (pieces, self.footer)
    }
}

/// Reads the last bytes of a segment: how long its footer is, and the footer's checksum.
pub(super) fn read_trailer(tail: &[u8]) -> Result<(u32, u32), InvalidSegment> {
    let trailer = tail
        .last_chunk::<TRAILER_BYTES>()
        .ok_or(InvalidSegment::NotASegment)?;
    let [l0, l1, l2, l3, c0, c1, c2, c3, magic @ ..] = *trailer;
    if &magic != END_MAGIC {
        return Err(InvalidSegment::NotASegment);
    }
    let length = u32::from_le_bytes([l0, l1, l2, l3]);
    Ok((length, u32::from_le_bytes([c0, c1, c2, c3])))
}

/// Reads a footer. `segment_bytes` is the length of all of the segment: no frame may claim to be
/// where it is not.
pub(super) fn read_footer(
    footer: &[u8],
    crc32: u32,
    segment_bytes: u64,
) -> Result<Footer, InvalidSegment> {
    if crc32fast::hash(footer) != crc32 {
        return Err(InvalidSegment::Footer);
    }
    let footer: Footer = serde_json::from_slice(footer).map_err(|_| InvalidSegment::Footer)?;
    let fits = |entry: &Entry| {
        let range = entry.range();
        HEADER.len() as u64 <= range.start && range.end <= segment_bytes
    };
    if footer.frames.iter().all(fits) {
        Ok(footer)
    } else {
        Err(InvalidSegment::Footer)
    }
}

/// Reads a whole segment.
pub(super) fn read_whole(bytes: &[u8]) -> Result<Footer, InvalidSegment> {
    if !bytes.starts_with(&HEADER[..6]) {
        return Err(InvalidSegment::NotASegment);
    }
    let (length, crc32) = read_trailer(bytes)?;
    let end = bytes.len() - TRAILER_BYTES;
    let start = end.checked_sub(length as usize);
    let start = start.ok_or(InvalidSegment::NotASegment)?;
    read_footer(&bytes[start..end], crc32, bytes.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(seq: u64, body: &[u8]) -> RecordedFrame {
        RecordedFrame {
            seq,
            capture_time_us: Some(seq * 33_333),
            stored_us: 5,
            content_type: "model/ply".to_owned(),
            bytes: body.len() as u64,
        }
    }

    fn written(bodies: &[Vec<u8>]) -> Vec<u8> {
        let mut builder = Builder::default();
        builder.push_gap(Gap {
            first_seq: 1,
            last_seq: 3,
            frames: 2,
        });
        for (seq, body) in bodies.iter().enumerate() {
            builder.push(frame(seq as u64 + 4, body), Bytes::from(body.clone()));
        }
        builder.finish().0.concat()
    }

    #[test]
    fn frames_come_back_as_they_were_written() {
        let bodies = [b"one".to_vec(), Vec::new(), b"three".to_vec()];
        let bytes = written(&bodies);
        let footer = read_whole(&bytes).unwrap();
        assert_eq!(footer.gaps[0].frames, 2);
        for (entry, body) in footer.frames.iter().zip(&bodies) {
            let range = entry.range();
            let found = &bytes[range.start as usize..range.end as usize];
            assert_eq!(found, body);
            entry.check(found).unwrap();
        }
        assert_eq!(footer.frames[2].frame, frame(6, b"three"));
    }

    #[test]
    fn a_frame_that_was_changed_is_named() {
        let bytes = written(&[b"body".to_vec()]);
        let footer = read_whole(&bytes).unwrap();
        let error = footer.frames[0].check(b"bodY").unwrap_err();
        assert!(error.to_string().starts_with("frame 4 is damaged"));
    }

    #[test]
    fn a_segment_cut_short_is_none() {
        let bytes = written(&[b"body".to_vec()]);
        for length in 0..bytes.len() {
            assert!(read_whole(&bytes[..length]).is_err(), "{length} bytes");
        }
    }

    proptest! {
        #[test]
        fn no_damage_goes_unseen(at in any::<prop::sample::Index>(), flip in 1u8..) {
            let bodies = [b"one body".to_vec(), b"another".to_vec()];
            let mut bytes = written(&bodies);
            let at = at.index(bytes.len());
            // The two bytes of flags are free.
            prop_assume!(!(6..8).contains(&at));
            bytes[at] ^= flip;
            let seen = match read_whole(&bytes) {
                Err(_) => true,
                Ok(footer) => footer.frames.iter().any(|entry| {
                    let range = entry.range();
                    entry.check(&bytes[range.start as usize..range.end as usize]).is_err()
                }),
            };
            prop_assert!(seen, "byte {at}");
        }
    }
}
