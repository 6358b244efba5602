//! Bytes to triangle meshes and back, over slices: never opens a file.
//!
//! [`sniff`] tells a format from its bytes and [`read`] parses it into a [`Mesh`]
//! that is known to be usable: at least one vertex and one face, every coordinate
//! finite and within the range of a 32-bit float, every index in range. Nothing is
//! repaired: duplicate vertices and degenerate faces stay.
//!
//! One module per format: [`obj`], [`ply`], [`glb`], [`drc`] and [`native`], and
//! [`bundle`] for one of these with an image. All of them take hostile bytes: no count is believed before it is compared with what is there.
//!
//! Texture coordinates have v pointing up, as in OBJ files; those of glTF files are turned over.
//! Images are looked at as far as their headers go.
//!
//! Positions are `f64` because text and PLY doubles hold that much; lengths are in
//! the mesh's own unit.

pub mod bundle;
mod check;
mod cursor;
pub mod drc;
mod error;
mod format;
pub mod glb;
mod image;
mod mesh;
pub mod native;
pub mod obj;
mod per_vertex;
pub mod ply;
mod sniff;

pub use error::ReadError;
pub use format::Format;
pub use image::{Image, ImageBytes, ImageFormat, ImageInfo, MAX_IMAGE_SIZE};
pub use mesh::{Attribute, Mesh};
pub use per_vertex::PointMesh;
pub use sniff::sniff;

/// How large a mesh may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Most vertices.
    pub max_vertices: usize,
    /// Most faces, after polygons are cut into triangles.
    pub max_faces: usize,
    /// Most bytes that a decoder may hold at once: Draco's, or the base64 of a glTF file.
    pub max_memory_bytes: usize,
}

impl Limits {
    /// For our own bytes: the limits are there to be given, not to be reached.
    pub const NONE: Self = Self {
        max_vertices: usize::MAX,
        max_faces: usize::MAX,
        max_memory_bytes: usize::MAX,
    };
}

/// Reads `bytes` as `format`.
///
/// # Errors
///
/// [`ReadError::LimitExceeded`] or [`ReadError::OutOfMemory`] if the mesh is too
/// large, any other [`ReadError`] if the bytes are not a usable mesh.
pub fn read(bytes: &[u8], format: Format, limits: &Limits) -> Result<Mesh, ReadError> {
    match format {
        Format::Obj => obj::read(bytes, limits),
        Format::Ply => ply::read(bytes, limits),
        Format::Glb => glb::read(bytes, limits),
        Format::Drc => drc::read(bytes, limits),
        Format::Native => native::read(bytes, limits),
        Format::Bundle => bundle::read(bytes, limits),
    }
}
