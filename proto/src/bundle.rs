//! A frame with its texture image: a mesh in any format, and then the image.

use serde::{Deserialize, Serialize};

use crate::wording::counted;

const MAGIC: [u8; 4] = *b"SMB1";
const VERSION: u16 = 1;
/// The longest envelope of version 1 is 24 bytes; more is not read.
const MAX_ENVELOPE_BYTES: usize = 64;
/// Magic and envelope length.
const PREFIX_BYTES: usize = 8;

/// One mesh and the image that lies on it, as their files have them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bundle<'a> {
    /// The frame's number in its stream, if the rig counts.
    pub seq: Option<u64>,
    /// When it was captured, in microseconds since 1970-01-01T00:00:00Z.
    pub capture_time_us: Option<u64>,
    /// The mesh, in any of the other formats.
    pub mesh: &'a [u8],
    /// The image, in any of the formats that textures may have.
    pub image: &'a [u8],
}

/// Why bytes are not a bundle.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidBundle {
    /// The first four bytes are others.
    #[error("a bundle starts with the bytes \"SMB1\"")]
    Magic,
    /// The body ends inside of the prefix or the envelope.
    #[error("the body ends after {}, inside of the envelope", counted(*.length as u64, "byte"))]
    Truncated {
        /// The body's length.
        length: usize,
    },
    /// The envelope does not have the layout of version 1.
    #[error("the envelope cannot be read: it has {} instead of 8, 16 or 24", counted(*.length as u64, "byte"))]
    Envelope {
        /// Its length.
        length: usize,
    },
    /// A version that this implementation does not know.
    #[error("version {version} of the bundle, but only version 1 is known")]
    Version {
        /// The version found.
        version: u16,
    },
    /// The mesh does not fit into the body.
    #[error("a mesh of {mesh} bytes is promised, but {} are left", counted(*.found as u64, "byte"))]
    MeshLength {
        /// The mesh's length, as the envelope has it.
        mesh: u32,
        /// Bytes after the envelope.
        found: usize,
    },
    /// Nothing follows the mesh.
    #[error("there is no image after the mesh; a frame without one is sent as it is")]
    NoImage,
}

/// As that of a native frame: integers of fixed width, little-endian; an option is a byte 0 or 1
/// and then the value.
#[derive(Debug, Serialize, Deserialize)]
struct Envelope {
    version: u16,
    seq: Option<u64>,
    capture_time_us: Option<u64>,
    mesh_bytes: u32,
}

impl<'a> Bundle<'a> {
    /// Reads a bundle, without looking at the mesh or the image.
    ///
    /// # Errors
    ///
    /// [`InvalidBundle`] says what is wrong.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, InvalidBundle> {
        let truncated = InvalidBundle::Truncated {
            length: bytes.len(),
        };
        let (magic, rest) = bytes.split_first_chunk::<4>().ok_or(truncated.clone())?;
        if *magic != MAGIC {
            return Err(InvalidBundle::Magic);
        }
        let (length, rest) = rest.split_first_chunk::<4>().ok_or(truncated.clone())?;
        let length = u32::from_le_bytes(*length) as usize;
        let (envelope, rest) = rest.split_at_checked(length).ok_or(truncated)?;
        let envelope = decode_envelope(envelope)?;
        let split = rest.split_at_checked(envelope.mesh_bytes as usize);
        let (mesh, image) = split.ok_or(InvalidBundle::MeshLength {
            mesh: envelope.mesh_bytes,
            found: rest.len(),
        })?;
        if image.is_empty() {
            return Err(InvalidBundle::NoImage);
        }
        Ok(Self {
            seq: envelope.seq,
            capture_time_us: envelope.capture_time_us,
            mesh,
            image,
        })
    }

    /// Writes the bundle.
    ///
    /// # Panics
    ///
    /// If the mesh has 4 GiB or more.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let envelope = Envelope {
            version: VERSION,
            seq: self.seq,
            capture_time_us: self.capture_time_us,
            mesh_bytes: u32::try_from(self.mesh.len()).expect("a mesh is below 4 GiB"),
        };
        let envelope = bincode::serde::encode_to_vec(&envelope, bincode::config::legacy())
            .expect("an envelope of plain integers always serializes");
        let length = PREFIX_BYTES + envelope.len() + self.mesh.len() + self.image.len();
        let mut bytes = Vec::with_capacity(length);
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&(envelope.len() as u32).to_le_bytes());
        bytes.extend_from_slice(&envelope);
        bytes.extend_from_slice(self.mesh);
        bytes.extend_from_slice(self.image);
        bytes
    }
}

fn decode_envelope(bytes: &[u8]) -> Result<Envelope, InvalidBundle> {
    // The version comes first, so that a later layout is refused by its name.
    if let Some((version, _)) = bytes.split_first_chunk::<2>() {
        let version = u16::from_le_bytes(*version);
        if version != VERSION {
            return Err(InvalidBundle::Version { version });
        }
    }
    let refused = InvalidBundle::Envelope {
        length: bytes.len(),
    };
    // Without a limit a hostile length aborts the process.
    let configuration = bincode::config::legacy().with_limit::<MAX_ENVELOPE_BYTES>();
    match bincode::serde::decode_from_slice(bytes, configuration) {
        Ok((envelope, consumed)) if consumed == bytes.len() => Ok(envelope),
        _ => Err(refused),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUNDLE: Bundle<'static> = Bundle {
        seq: Some(7),
        capture_time_us: None,
        mesh: b"v 0 0 0",
        image: b"a JPEG",
    };

    #[test]
    fn a_bundle_comes_back_as_it_was_written() {
        assert_eq!(Bundle::decode(&BUNDLE.encode()), Ok(BUNDLE));
    }

    #[test]
    fn the_golden_bundle_is_read_as_documented() {
        let golden = include_bytes!("../vectors/bundle.bin");
        let bundle = Bundle::decode(golden).unwrap();
        assert_eq!((bundle.seq, bundle.capture_time_us), (Some(7), None));
        assert!(bundle.mesh.starts_with(b"v 0 0 0\n"));
        assert_eq!(bundle.image, b"\x89PNG");
        assert_eq!(bundle.encode(), golden);
    }

    #[test]
    fn a_bundle_cut_short_is_refused_up_to_its_image() {
        let bytes = BUNDLE.encode();
        for length in 0..=bytes.len() - BUNDLE.image.len() {
            assert!(Bundle::decode(&bytes[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let bytes = BUNDLE.encode();
        let mut later = bytes.clone();
        later[8] = 2;
        let version = Err(InvalidBundle::Version { version: 2 });
        assert_eq!(Bundle::decode(&later), version);
        let mut long = bytes.clone();
        // The last four bytes of the envelope, before the mesh.
        let at = bytes.len() - BUNDLE.image.len() - BUNDLE.mesh.len() - 4;
        long[at..at + 4].fill(0xff);
        let message = Bundle::decode(&long).unwrap_err().to_string();
        assert_eq!(
            message,
            "a mesh of 4294967295 bytes is promised, but 13 bytes are left"
        );
        let mut option = bytes;
        option[10] = 9;
        assert!(matches!(
            Bundle::decode(&option),
            Err(InvalidBundle::Envelope { .. })
        ));
    }
}
