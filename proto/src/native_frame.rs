//! A frame as a rig sends it: a small envelope, then raw arrays.

use crate::wording::counted;
use serde::{Deserialize, Serialize};

const MAGIC: [u8; 4] = *b"SMF1";
const VERSION: u16 = 1;
/// The longest envelope of version 1 is 31 bytes; more is not read.
const MAX_ENVELOPE_BYTES: usize = 64;
/// Magic and envelope length.
const PREFIX_BYTES: usize = 8;

/// One mesh with what is known about its capture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NativeFrame {
    /// The frame's number in its stream, if the rig counts.
    pub seq: Option<u64>,
    /// When it was captured, in microseconds since 1970-01-01T00:00:00Z.
    pub capture_time_us: Option<u64>,
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices of every face, counterclockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// A unit normal per vertex.
    pub normals: Option<Vec<[f32; 3]>>,
    /// A color per vertex: red, green, blue, alpha.
    pub colors: Option<Vec<[u8; 4]>>,
    /// A texture coordinate per vertex.
    pub texture_coordinates: Option<Vec<[f32; 2]>>,
}

/// What a native frame's envelope says of its place in the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NativeStamps {
    /// The frame's number in its stream, if the rig counts.
    pub seq: Option<u64>,
    /// When it was captured, in microseconds since 1970-01-01T00:00:00Z.
    pub capture_time_us: Option<u64>,
}

/// Why bytes are not a native frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidNativeFrame {
    /// The first four bytes are others.
    #[error("a native frame starts with the bytes \"SMF1\"")]
    Magic,
    /// The body ends inside of the prefix or the envelope.
    #[error("the body ends after {}, inside of the envelope", counted(*.length as u64, "byte"))]
    Truncated {
        /// The body's length.
        length: usize,
    },
    /// The envelope does not have the layout of version 1.
    #[error("the envelope cannot be read: {reason}")]
    Envelope {
        /// What is wrong with it.
        reason: String,
    },
    /// A version that this implementation does not know.
    #[error("version {version} of the native frame, but only version 1 is known")]
    Version {
        /// The version found.
        version: u16,
    },
    /// The counts do not agree with the body's length.
    #[error(
        "the arrays of {} and {} with these attributes take {}, but the body has {found}",
        counted(u64::from(*.vertices), "vertex"),
        counted(u64::from(*.faces), "face"),
        counted(*.needed, "byte")
    )]
    Length {
        /// The envelope's vertex count.
        vertices: u32,
        /// The envelope's face count.
        faces: u32,
        /// Bytes that the arrays take.
        needed: u64,
        /// Bytes that follow the envelope.
        found: u64,
    },
}

/// Serialized by bincode's legacy configuration: integers of fixed width, little-endian; an
/// option is a byte 0 or 1 and then the value; a boolean is a byte 0 or 1.
#[derive(Debug, Serialize, Deserialize)]
struct Envelope {
    version: u16,
    seq: Option<u64>,
    capture_time_us: Option<u64>,
    vertex_count: u32,
    face_count: u32,
    has_normals: bool,
    has_colors: bool,
    has_texture_coordinates: bool,
}

impl Envelope {
    fn array_bytes(&self) -> u64 {
        let per_vertex = 12
            + if self.has_normals { 12 } else { 0 }
            + if self.has_colors { 4 } else { 0 }
            + if self.has_texture_coordinates { 8 } else { 0 };
        u64::from(self.vertex_count) * per_vertex + u64::from(self.face_count) * 12
    }
}

impl NativeFrame {
    /// Reads a frame. The counts are checked against the length of `bytes` before anything is
    /// allocated, so that memory stays within a small multiple of it.
    ///
    /// Positions may be any numbers and indices may be out of range: that is for whoever makes
    /// a mesh of them to check.
    ///
    /// # Errors
    ///
    /// [`InvalidNativeFrame`] says what is wrong.
    pub fn decode(bytes: &[u8]) -> Result<Self, InvalidNativeFrame> {
        let (envelope, arrays) = split(bytes)?;
        let (needed, found) = (envelope.array_bytes(), arrays.len() as u64);
        if needed != found {
            let Envelope {
                vertex_count: vertices,
                face_count: faces,
                ..
            } = envelope;
            return Err(InvalidNativeFrame::Length {
                vertices,
                faces,
                needed,
                found,
            });
        }
        let mut arrays = Arrays { rest: arrays };
        let vertices = envelope.vertex_count as usize;
        Ok(Self {
            seq: envelope.seq,
            capture_time_us: envelope.capture_time_us,
            positions: arrays.take(vertices, f32::from_le_bytes),
            normals: envelope
                .has_normals
                .then(|| arrays.take(vertices, f32::from_le_bytes)),
            colors: envelope
                .has_colors
                .then(|| arrays.take(vertices, |[byte]: [u8; 1]| byte)),
            texture_coordinates: envelope
                .has_texture_coordinates
                .then(|| arrays.take(vertices, f32::from_le_bytes)),
            faces: arrays.take(envelope.face_count as usize, u32::from_le_bytes),
        })
    }

    /// Reads the stamps only, which costs nothing however large the frame is.
    ///
    /// # Errors
    ///
    /// [`InvalidNativeFrame`] if prefix or envelope cannot be read.
    pub fn stamps(bytes: &[u8]) -> Result<NativeStamps, InvalidNativeFrame> {
        let (envelope, _) = split(bytes)?;
        Ok(NativeStamps {
            seq: envelope.seq,
            capture_time_us: envelope.capture_time_us,
        })
    }

    /// Writes the frame.
    ///
    /// # Panics
    ///
    /// If an attribute has another length than `positions`, or a count is beyond 32 bits.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let vertex_count = u32::try_from(self.positions.len()).expect("vertices fit in 32 bits");
        let same_length = |length: Option<usize>| {
            assert!(
                length.is_none_or(|l| l == self.positions.len()),
                "one value per vertex"
            );
            length.is_some()
        };
        let envelope = Envelope {
            version: VERSION,
            seq: self.seq,
            capture_time_us: self.capture_time_us,
            vertex_count,
            face_count: u32::try_from(self.faces.len()).expect("faces fit in 32 bits"),
            has_normals: same_length(self.normals.as_ref().map(Vec::len)),
            has_colors: same_length(self.colors.as_ref().map(Vec::len)),
            has_texture_coordinates: same_length(self.texture_coordinates.as_ref().map(Vec::len)),
        };
        let header = bincode::serde::encode_to_vec(&envelope, bincode::config::legacy())
            .expect("an envelope of plain integers always serializes");
        let array_bytes = usize::try_from(envelope.array_bytes()).unwrap_or(0);
        let mut bytes = Vec::with_capacity(PREFIX_BYTES + header.len() + array_bytes);
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&(header.len() as u32).to_le_bytes());
        bytes.extend_from_slice(&header);
        put(&mut bytes, &self.positions, f32::to_le_bytes);
        put(
            &mut bytes,
            self.normals.as_deref().unwrap_or(&[]),
            f32::to_le_bytes,
        );
        put(
            &mut bytes,
            self.colors.as_deref().unwrap_or(&[]),
            |byte: u8| [byte],
        );
        put(
            &mut bytes,
            self.texture_coordinates.as_deref().unwrap_or(&[]),
            f32::to_le_bytes,
        );
        put(&mut bytes, &self.faces, u32::to_le_bytes);
        bytes
    }
}

/// The envelope, and the bytes after it.
fn split(bytes: &[u8]) -> Result<(Envelope, &[u8]), InvalidNativeFrame> {
    let truncated = InvalidNativeFrame::Truncated {
        length: bytes.len(),
    };
    let (magic, rest) = bytes.split_first_chunk::<4>().ok_or(truncated.clone())?;
    if *magic != MAGIC {
        return Err(InvalidNativeFrame::Magic);
    }
    let (length, rest) = rest.split_first_chunk::<4>().ok_or(truncated.clone())?;
    let length = u32::from_le_bytes(*length) as usize;
    let (envelope, arrays) = rest.split_at_checked(length).ok_or(truncated)?;
    Ok((decode_envelope(envelope)?, arrays))
}

fn decode_envelope(bytes: &[u8]) -> Result<Envelope, InvalidNativeFrame> {
    let refused = |reason: String| InvalidNativeFrame::Envelope { reason };
    // The version comes first, so that a later layout is refused by its name.
    if let Some((version, _)) = bytes.split_first_chunk::<2>() {
        let version = u16::from_le_bytes(*version);
        if version != VERSION {
            return Err(InvalidNativeFrame::Version { version });
        }
    }
    // Without a limit a hostile length aborts the process.
    let configuration = bincode::config::legacy().with_limit::<MAX_ENVELOPE_BYTES>();
    let (envelope, consumed) = bincode::serde::decode_from_slice(bytes, configuration)
        .map_err(|error| refused(what_is_wrong(&error)))?;
    if consumed != bytes.len() {
        let rest = (bytes.len() - consumed) as u64;
        return Err(refused(format!("it is {} too long", counted(rest, "byte"))));
    }
    Ok(envelope)
}

/// What bincode says, which writes its errors as programmers see them.
fn what_is_wrong(error: &bincode::error::DecodeError) -> String {
    use bincode::error::DecodeError;
    match error {
        DecodeError::UnexpectedEnd { additional } => {
            format!("it is {} too short", counted(*additional as u64, "byte"))
        }
        DecodeError::InvalidBooleanValue(value) => {
            format!("a yes or no is {value}, not 0 or 1")
        }
        DecodeError::UnexpectedVariant { found, .. } => {
            format!("a value that may be left out begins with {found}, not with 0 or 1")
        }
        DecodeError::LimitExceeded => format!("it is longer than {MAX_ENVELOPE_BYTES} bytes"),
        other => other.to_string(),
    }
}

/// What is left of the arrays, whose total length has been checked.
struct Arrays<'a> {
    rest: &'a [u8],
}

impl Arrays<'_> {
    fn take<T: Copy, const N: usize, const B: usize>(
        &mut self,
        count: usize,
        from_le_bytes: fn([u8; B]) -> T,
    ) -> Vec<[T; N]> {
        let (taken, rest) = self.rest.split_at(count * N * B);
        self.rest = rest;
        let scalar = |chunk: &[u8]| from_le_bytes(std::array::from_fn(|i| chunk[i]));
        taken
            .chunks_exact(N * B)
            .map(|item| std::array::from_fn(|i| scalar(&item[i * B..(i + 1) * B])))
            .collect()
    }
}

fn put<T: Copy, const N: usize, const B: usize>(
    bytes: &mut Vec<u8>,
    items: &[[T; N]],
    to_le_bytes: fn(T) -> [u8; B],
) {
    for scalar in items.as_flattened() {
        bytes.extend_from_slice(&to_le_bytes(*scalar));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_with_an_envelope_is_said_in_words() {
        let envelope = |bytes: &[u8]| {
            let length = (bytes.len() as u32).to_le_bytes();
            let frame = [&MAGIC[..], &length, bytes].concat();
            NativeFrame::decode(&frame).unwrap_err().to_string()
        };
        let good = [&[1, 0, 0, 0][..], &[0; 8], &[0; 3]].concat();
        for (bytes, expected) in [
            (&good[..good.len() - 1], "it is 1 byte too short"),
            (&[&good[..], &[0, 0]].concat(), "it is 2 bytes too long"),
            (
                &[&good[..good.len() - 1], &[7]].concat(),
                "a yes or no is 7, not 0 or 1",
            ),
            (
                &[&[1, 0, 9][..], &good].concat(),
                "a value that may be left out begins with 9, not with 0 or 1",
            ),
        ] {
            let expected = format!("the envelope cannot be read: {expected}");
            assert_eq!(envelope(bytes), expected);
        }
        assert_eq!(
            envelope(&[&[1, 0, 0, 0, 1][..], &[0; 10]].concat()),
            "the arrays of 1 vertex and 0 faces with these attributes take 12 bytes, but the body \
             has 0"
        );
    }

    #[test]
    fn the_stamps_can_be_read_without_the_arrays() {
        let frame = NativeFrame {
            seq: Some(7),
            capture_time_us: Some(1_700_000_000_000_000),
            ..NativeFrame::default()
        };
        let stamps = NativeFrame::stamps(&frame.encode()).unwrap();
        assert_eq!(
            (stamps.seq, stamps.capture_time_us),
            (frame.seq, frame.capture_time_us)
        );
        assert!(NativeFrame::stamps(b"SMF1").is_err());
    }
    use proptest::prelude::*;

    fn frame() -> NativeFrame {
        NativeFrame {
            seq: Some(7),
            capture_time_us: Some(1_700_000_000_000_000),
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            faces: vec![[0, 1, 2]],
            normals: None,
            colors: Some(vec![[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]]),
            texture_coordinates: None,
        }
    }

    #[test]
    fn the_golden_frame_reads_and_writes_as_documented() {
        let golden = include_bytes!("../vectors/native_frame.bin");
        assert_eq!(NativeFrame::decode(golden).unwrap(), frame());
        assert_eq!(frame().encode(), golden);
    }

    #[test]
    fn counts_that_the_body_cannot_hold_are_refused_before_anything_is_allocated() {
        let mut bytes = frame().encode();
        // The vertex count, after magic, length, version and two options.
        bytes[28..32].copy_from_slice(&u32::MAX.to_le_bytes());
        let error = NativeFrame::decode(&bytes).unwrap_err();
        assert!(matches!(
            error,
            InvalidNativeFrame::Length {
                vertices: u32::MAX,
                ..
            }
        ));
    }

    #[test]
    fn a_later_version_is_refused_by_its_name() {
        let mut bytes = frame().encode();
        bytes[8] = 2;
        let error = NativeFrame::decode(&bytes).unwrap_err();
        assert_eq!(error, InvalidNativeFrame::Version { version: 2 });
    }

    proptest! {
        /// Whatever arrives, reading ends with a frame or an error.
        #[test]
        fn no_bytes_make_reading_panic(
            edits in prop::collection::vec((0usize..200, any::<u8>()), 0..20),
            length in 0usize..200,
        ) {
            let mut bytes = frame().encode();
            for (at, value) in edits {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = value;
                }
            }
            bytes.truncate(length);
            if let Ok(frame) = NativeFrame::decode(&bytes) {
                prop_assert!(frame.positions.len() * 12 <= bytes.len());
            }
        }
    }
}
