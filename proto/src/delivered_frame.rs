//! A simplified frame as a player receives it: its metrics, its Draco bytes, and its texture image
//! where that comes with it.

use crate::FrameMetrics;

const MAGIC: [u8; 4] = *b"SMDF";
const VERSION: u16 = 1;
const HEADER_BYTES: usize = 16;
/// Where the flags are.
const FLAGS: std::ops::Range<usize> = 6..8;
/// Of the flags: what follows the mesh is an image.
const HAS_IMAGE: u16 = 1;

/// One binary WebSocket message of `subscribe`.
#[derive(Debug, Clone, PartialEq)]
pub struct DeliveredFrame<'a> {
    /// The frame's figures.
    pub metrics: FrameMetrics,
    /// The simplified mesh, compressed by Draco.
    pub mesh: &'a [u8],
    /// The image that lies on it, if it comes with it: see [`FrameMetrics::texture`].
    pub image: Option<&'a [u8]>,
}

/// Why bytes are not a delivered frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidDeliveredFrame {
    /// The message is shorter than its header.
    #[error("{length} bytes are less than the header of {HEADER_BYTES}")]
    Truncated {
        /// The message's length.
        length: usize,
    },
    /// The first four bytes are others.
    #[error("a delivered frame starts with the bytes \"SMDF\"")]
    Magic,
    /// A version that this implementation does not know.
    #[error("version {version} of the delivered frame, but only version 1 is known")]
    Version {
        /// The version found.
        version: u16,
    },
    /// The two lengths do not add up to the message.
    #[error("{metrics} bytes of metrics and {mesh} of mesh, but the message has {found} for both")]
    Length {
        /// Bytes of metrics that the header promises.
        metrics: u32,
        /// Bytes of mesh that the header promises.
        mesh: u32,
        /// Bytes after the header.
        found: usize,
    },
    /// An image is announced, but nothing follows the mesh.
    #[error("an image is announced, but nothing follows the mesh")]
    NoImage,
    /// The metrics are not the JSON that they should be.
    #[error("the metrics cannot be read: {0}")]
    Metrics(#[from] serde_json::Error),
}

type Parts<'a> = (&'a [u8], &'a [u8], Option<&'a [u8]>);

impl<'a> DeliveredFrame<'a> {
    /// Reads a message.
    ///
    /// # Errors
    ///
    /// [`InvalidDeliveredFrame`] says what is wrong.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, InvalidDeliveredFrame> {
        let (metrics, mesh, image) = Self::parts(bytes)?;
        Ok(Self {
            metrics: serde_json::from_slice(metrics)?,
            mesh,
            image,
        })
    }

    /// The image of a message, if it has one, without reading the metrics.
    ///
    /// # Errors
    ///
    /// [`InvalidDeliveredFrame`] says what is wrong.
    pub fn image_of(bytes: &[u8]) -> Result<Option<&[u8]>, InvalidDeliveredFrame> {
        let (_, _, image) = DeliveredFrame::parts(bytes)?;
        Ok(image)
    }

    /// Metrics, mesh and image.
    fn parts(bytes: &'a [u8]) -> Result<Parts<'a>, InvalidDeliveredFrame> {
        let Some((header, body)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
            return Err(InvalidDeliveredFrame::Truncated {
                length: bytes.len(),
            });
        };
        if header[..4] != MAGIC {
            return Err(InvalidDeliveredFrame::Magic);
        }
        let version = u16::from_le_bytes([header[4], header[5]]);
        if version != VERSION {
            return Err(InvalidDeliveredFrame::Version { version });
        }
        let length_at = |at: usize| {
            u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]])
        };
        let (metrics, mesh) = (length_at(8), length_at(12));
        // Other flags are for later versions.
        let flags = u16::from_le_bytes([header[FLAGS.start], header[FLAGS.start + 1]]);
        let has_image = flags & HAS_IMAGE != 0;
        let (promised, found) = (u64::from(metrics) + u64::from(mesh), body.len() as u64);
        if found < promised || (promised < found && !has_image) {
            return Err(InvalidDeliveredFrame::Length {
                metrics,
                mesh,
                found: body.len(),
            });
        }
        if promised == found && has_image {
            return Err(InvalidDeliveredFrame::NoImage);
        }
        let (metrics, rest) = body.split_at(metrics as usize);
        let (mesh, image) = rest.split_at(mesh as usize);
        Ok((metrics, mesh, has_image.then_some(image)))
    }

    /// Writes the message.
    ///
    /// # Panics
    ///
    /// If the mesh has 4 GiB or more.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let metrics = serde_json::to_vec(&self.metrics)
            .expect("metrics are numbers and names, which always serialize");
        let length = |bytes: &[u8]| u32::try_from(bytes.len()).expect("a part is below 4 GiB");
        let image = self.image.unwrap_or(&[]);
        let length_of_all = HEADER_BYTES + metrics.len() + self.mesh.len() + image.len();
        let mut bytes = Vec::with_capacity(length_of_all);
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        let flags = if self.image.is_some() { HAS_IMAGE } else { 0 };
        bytes.extend_from_slice(&flags.to_le_bytes());
        bytes.extend_from_slice(&length(&metrics).to_le_bytes());
        bytes.extend_from_slice(&length(self.mesh).to_le_bytes());
        bytes.extend_from_slice(&metrics);
        bytes.extend_from_slice(self.mesh);
        bytes.extend_from_slice(image);
        bytes
    }

    /// Adds an image to a message that has none, without reading it.
    ///
    /// # Panics
    ///
    /// If `message` was not made by [`encode`](Self::encode) without an image.
    #[must_use]
    pub fn with_image(message: &[u8], image: &[u8]) -> Vec<u8> {
        assert_eq!(message[FLAGS], [0; 2], "a message without an image");
        let mut bytes = Vec::with_capacity(message.len() + image.len());
        bytes.extend_from_slice(message);
        bytes.extend_from_slice(image);
        bytes[FLAGS].copy_from_slice(&HAS_IMAGE.to_le_bytes());
        bytes
    }

    /// Leaves its image out of a message, without reading it.
    ///
    /// # Panics
    ///
    /// If `message` was not made by [`encode`](Self::encode) with this image.
    #[must_use]
    pub fn without_image(message: &[u8], image: &[u8]) -> Vec<u8> {
        let mut bytes = message[..message.len() - image.len()].to_vec();
        bytes[FLAGS].copy_from_slice(&0u16.to_le_bytes());
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_comes_back_as_it_was_written() {
        let metrics = FrameMetrics {
            seq: 3,
            bbox_diagonal: 1.8,
            ..FrameMetrics::default()
        };
        let frame = DeliveredFrame {
            metrics,
            mesh: b"DRACO and so on",
            image: None,
        };
        assert_eq!(DeliveredFrame::decode(&frame.encode()).unwrap(), frame);
    }

    #[test]
    fn an_image_follows_the_mesh_and_can_be_added_and_left_out() {
        let image: &[u8] = b"a JPEG";
        let with = DeliveredFrame {
            metrics: FrameMetrics::default(),
            mesh: b"DRACO",
            image: Some(image),
        };
        let without = DeliveredFrame {
            image: None,
            ..with.clone()
        };
        assert_eq!(DeliveredFrame::decode(&with.encode()).unwrap(), with);
        let of = |frame: &DeliveredFrame<'_>| {
            let message = frame.encode();
            DeliveredFrame::image_of(&message)
                .unwrap()
                .map(<[u8]>::to_vec)
        };
        assert_eq!((of(&with).as_deref(), of(&without)), (Some(image), None));
        let added = DeliveredFrame::with_image(&without.encode(), image);
        assert_eq!(added, with.encode());
        let left_out = DeliveredFrame::without_image(&added, image);
        assert_eq!(left_out, without.encode());
        let end = added.len() - image.len();
        assert!(matches!(
            DeliveredFrame::decode(&added[..end]),
            Err(InvalidDeliveredFrame::NoImage)
        ));
    }

    #[test]
    fn the_golden_message_with_an_image_is_read_as_documented() {
        let golden = include_bytes!("../vectors/delivered_frame_with_image.bin");
        let frame = DeliveredFrame::decode(golden).unwrap();
        let texture = frame.metrics.texture.unwrap();
        assert_eq!((texture.width, texture.height), (2048, 1024));
        assert_eq!(
            (frame.mesh, frame.image),
            (&b"DRACO"[..], Some(&b"\x89PNG"[..]))
        );
    }

    #[test]
    fn the_golden_message_is_read_as_documented() {
        let golden = include_bytes!("../vectors/delivered_frame.bin");
        let frame = DeliveredFrame::decode(golden).unwrap();
        assert_eq!((frame.metrics.seq, frame.metrics.output.faces), (41, 4000));
        assert_eq!(frame.mesh, b"DRACO");
    }

    #[test]
    fn a_message_cut_short_is_refused() {
        let golden = include_bytes!("../vectors/delivered_frame.bin");
        for length in 0..golden.len() {
            assert!(
                DeliveredFrame::decode(&golden[..length]).is_err(),
                "{length} bytes"
            );
        }
    }
}
