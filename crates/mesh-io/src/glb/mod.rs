//! glTF 2.0, with its geometry and the image on it: the binary container GLB and, for reading, JSON text with
//! its buffers inside.
//!
//! Sources: "glTF 2.0 Specification" (Khronos Group, 2.0.1), and its extensions
//! `KHR_mesh_quantization` and `KHR_draco_mesh_compression`.

mod accessor;
mod buffers;
mod container;
mod data_uri;
mod document;
mod json_text;
mod primitive;
mod read;
mod scene;
mod texture;
mod transform;
mod wrap_draco;
mod write;

pub(crate) use json_text::has_top_level_key;
pub use read::read;
pub use wrap_draco::{DracoInfo, DracoPart, wrap_draco};
pub use write::write;

use crate::ReadError;

fn malformed(message: impl Into<String>) -> ReadError {
    ReadError::Glb {
        message: message.into(),
    }
}
