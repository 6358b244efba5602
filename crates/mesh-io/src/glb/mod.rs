//! GLB: the binary container of glTF 2.0, with its geometry only.
//!
//! Sources: "glTF 2.0 Specification" (Khronos Group, 2.0.1), and its extensions
//! `KHR_mesh_quantization` and `KHR_draco_mesh_compression`.

mod accessor;
mod container;
mod document;
mod primitive;
mod read;
mod scene;
mod transform;
mod wrap_draco;
mod write;

pub use read::read;
pub use wrap_draco::{DracoInfo, wrap_draco};
pub use write::write;

use crate::ReadError;

fn malformed(message: impl Into<String>) -> ReadError {
    ReadError::Glb {
        message: message.into(),
    }
}
