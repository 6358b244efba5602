//! The bytes of a document's buffers.

use super::document::{Buffer, Document, entry};
use super::{data_uri, malformed};
use crate::{Limits, ReadError};
use std::borrow::Cow;
use steadymesh_proto::wording::counted;

/// The buffers of a document: the binary chunk, and those that stand in the text.
pub(super) struct Buffers<'a> {
    /// In the order of the document; `None` for one that is stored outside.
    data: Vec<Option<Cow<'a, [u8]>>>,
    total: usize,
}

impl<'a> Buffers<'a> {
    /// Gives buffer 0 the binary chunk, unless it has a URI, and decodes `data:` URIs.
    ///
    /// # Errors
    ///
    /// [`ReadError::OutOfMemory`] if the URIs are longer than the decoder's memory, and
    /// [`ReadError::Glb`] if one cannot be decoded.
    pub(super) fn of(
        document: &Document,
        bin: Option<&'a [u8]>,
        limits: &Limits,
    ) -> Result<Self, ReadError> {
        let limit = limits.max_memory_bytes;
        let mut encoded = 0_usize;
        let mut read = |(index, buffer): (usize, &Buffer)| {
            let Some(uri) = &buffer.uri else {
                return Ok(bin.filter(|_| index == 0).map(Cow::Borrowed));
            };
            let Some(payload) = data_uri::payload(uri.as_bytes()) else {
                return Ok(None);
            };
            // Decoding makes it shorter.
            encoded = encoded.saturating_add(payload.len());
            if limit < encoded {
                return Err(ReadError::OutOfMemory { limit });
            }
            let data = data_uri::decode(payload)
                .map_err(|wrong| malformed(format!("the data: URI of buffer {index} {wrong}")))?;
            Ok(Some(Cow::Owned(data)))
        };
        let data = document.buffers.0.iter().enumerate().map(&mut read);
        let data: Vec<_> = data.collect::<Result<_, _>>()?;
        let total = data.iter().flatten().map(|data| data.len()).sum();
        Ok(Self { data, total })
    }

    /// How many bytes all of them have.
    pub(super) fn total(&self) -> usize {
        self.total
    }

    /// As many bytes of buffer `index` as the document says it has.
    pub(super) fn bytes(&self, document: &Document, index: usize) -> Result<&[u8], ReadError> {
        let buffer = entry(&document.buffers, index, "buffer")?;
        let Some(Some(data)) = self.data.get(index) else {
            return Err(has_no_data(buffer, index));
        };
        data.get(..buffer.byte_length).ok_or_else(|| {
            let place = match buffer.uri {
                Some(_) => "its data: URI",
                None => "the binary chunk",
            };
            malformed(format!(
                "buffer {index} is to have {}, but {place} has {}",
                counted(buffer.byte_length as u64, "byte"),
                data.len()
            ))
        })
    }
}

fn has_no_data(buffer: &Buffer, index: usize) -> ReadError {
    let Some(uri) = &buffer.uri else {
        return malformed(format!(
            "buffer {index} has no data: neither a URI nor, as buffer 0 of a .glb file may, the \
             binary chunk"
        ));
    };
    let uri: String = uri.chars().filter(|c| !c.is_control()).take(40).collect();
    malformed(format!(
        "buffer {index} is stored outside, at \"{uri}\"; pack everything into one .glb file, or \
         into data: URIs"
    ))
}
