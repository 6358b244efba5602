//! Draco mesh compression: slices in, bytes out, and back.
//!
//! [`encode`] compresses a triangle mesh with libdraco's EdgeBreaker method and
//! [`decode`] reads any Draco mesh. Both are deterministic: equal inputs give
//! equal bytes. Neither panics or aborts on bad input, and a decode never holds
//! more than [`DecodeLimits::max_memory_bytes`] on the C++ heap.
//!
//! Draco calls "point" what this project calls vertex: one combination of a
//! position with its other attributes. EdgeBreaker does not keep the order of
//! points or faces; see [`encode`] for what else it changes.
//!
//! This is one of the two crates that contain `unsafe`; each block says why it is sound.
#![allow(unsafe_code)]

mod compact;
mod decode;
mod decoded;
mod encode;
mod header;
mod mesh;
mod status;

pub use decode::{
    AttributeIds, DecodeError, DecodeLimits, decode, decode_and_identify, decode_with_ids,
    last_decode_peak_bytes,
};
pub use encode::{EncodeError, EncodeOptions, Encoded, encode, encode_with_info};
pub use mesh::{DecodedMesh, MeshView};
