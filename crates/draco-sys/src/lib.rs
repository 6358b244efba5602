//! Raw declarations of the C++ shim over libdraco. Use `steadymesh-draco`
//! instead: it checks what these functions take for granted.
//!
//! No function throws or unwinds. Handles are owned by the caller and freed by
//! the matching `free` function; pointers into slices are not kept. While
//! [`steadymesh_draco_decode`] runs, the C++ heap of its thread is limited to
//! `memory_limit` bytes: the shim replaces the global `operator new`, and
//! libdraco is linked statically so that its calls end there.
#![allow(unsafe_code)]

use std::ffi::c_char;

/// The call succeeded.
pub const OK: i32 = 0;
/// libdraco refused the input; the message is its own.
pub const REJECTED: i32 = 1;
/// The decoder asked for more memory than the budget allows.
pub const OVER_BUDGET: i32 = 2;
/// The bytes hold a point cloud, not a mesh.
pub const NOT_A_MESH: i32 = 3;
/// libdraco decoded something that contradicts itself.
pub const INCONSISTENT: i32 = 4;
/// Any other exception, or a broken precondition.
pub const INTERNAL: i32 = 5;

/// How a call went: one of the constants above and a zero-terminated message.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Status {
    /// [`OK`] or the kind of failure.
    pub code: i32,
    /// Zero-terminated text, empty on success.
    pub message: [c_char; 252],
}

/// What one decoded attribute holds.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct Attribute {
    /// 0 position, 1 normal, 2 color, 3 texture coordinate, 4 generic, 5 material.
    pub semantic: i32,
    /// 1 i8, 2 u8, 3 i16, 4 u16, 5 i32, 6 u32, 7 i64, 8 u64, 9 f32, 10 f64, 11 bool.
    pub data_type: i32,
    /// Numbers per value.
    pub component_count: u32,
    /// The id that `KHR_draco_mesh_compression` refers to.
    pub unique_id: u32,
    /// 1 if integers stand for fractions of their type's largest value.
    pub normalized: u32,
}

/// A mesh to encode: one value per point for every attribute but the positions, null where absent.
#[repr(C)]
#[derive(Debug)]
pub struct Input {
    /// Number of points.
    pub point_count: usize,
    /// Number of vertices, which have the positions.
    pub vertex_count: usize,
    /// Number of triangles.
    pub face_count: usize,
    /// `3 * vertex_count` finite numbers.
    pub positions: *const f32,
    /// `point_count` indices below the vertex count, or null if point i is vertex i.
    pub point_vertices: *const u32,
    /// `3 * face_count` indices below `point_count`.
    pub faces: *const u32,
    /// `3 * point_count` finite numbers, or null.
    pub normals: *const f32,
    /// `4 * point_count` numbers, or null.
    pub colors: *const u8,
    /// `2 * point_count` finite numbers, or null.
    pub texture_coordinates: *const f32,
    /// `point_count` numbers, or null.
    pub materials: *const u16,
    /// 1 to 30.
    pub position_bits: i32,
    /// 2 to 30.
    pub normal_bits: i32,
    /// 1 to 30.
    pub texture_coordinate_bits: i32,
    /// 0 (smallest) to 10 (fastest).
    pub speed: i32,
    /// 1 stores connectivity as it is, 0 compresses it with EdgeBreaker.
    pub is_sequential: i32,
}

/// What the encoder wrote; an id is -1 where the attribute is absent.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub struct Summary {
    /// Points that a decoder will return.
    pub point_count: usize,
    /// Faces that a decoder will return.
    pub face_count: usize,
    /// Unique id of the positions.
    pub position_id: i32,
    /// Unique id of the normals.
    pub normal_id: i32,
    /// Unique id of the colors.
    pub color_id: i32,
    /// Unique id of the texture coordinates.
    pub texture_coordinate_id: i32,
    /// Unique id of the materials.
    pub material_id: i32,
}

/// A decoded mesh on the C++ side.
#[repr(C)]
#[derive(Debug)]
pub struct Mesh {
    _opaque: [u8; 0],
}

/// Encoded bytes on the C++ side.
#[repr(C)]
#[derive(Debug)]
pub struct Encoded {
    _opaque: [u8; 0],
}

unsafe extern "C" {
    /// Decodes; writes a handle to `out`, or null and the reason to `status`.
    pub fn steadymesh_draco_decode(
        bytes: *const u8,
        length: usize,
        memory_limit: usize,
        out: *mut *mut Mesh,
        status: *mut Status,
    );
    /// Number of points, at most `u32::MAX`.
    pub fn steadymesh_draco_point_count(mesh: *const Mesh) -> usize;
    /// Number of triangles, at most `u32::MAX`.
    pub fn steadymesh_draco_face_count(mesh: *const Mesh) -> usize;
    /// Number of attributes.
    pub fn steadymesh_draco_attribute_count(mesh: *const Mesh) -> usize;
    /// Describes attribute `index`, counted from 0 in file order.
    pub fn steadymesh_draco_attribute(
        mesh: *const Mesh,
        index: usize,
        out: *mut Attribute,
        status: *mut Status,
    );
    /// Writes `3 * face_count` indices below the point count; `capacity` in `u32`s.
    pub fn steadymesh_draco_read_faces(
        mesh: *const Mesh,
        out: *mut u32,
        capacity: usize,
        status: *mut Status,
    );
    /// Writes `component_count * point_count` numbers as stored; `capacity` in `f32`s.
    pub fn steadymesh_draco_read_attribute(
        mesh: *const Mesh,
        index: usize,
        out: *mut f32,
        capacity: usize,
        status: *mut Status,
    );
    /// Frees a decoded mesh; null is allowed.
    pub fn steadymesh_draco_free_mesh(mesh: *mut Mesh);
    /// Encodes; writes a handle and a summary, or null and the reason to `status`.
    pub fn steadymesh_draco_encode(
        input: *const Input,
        out: *mut *mut Encoded,
        summary: *mut Summary,
        status: *mut Status,
    );
    /// The first encoded byte; valid until the handle is freed.
    pub fn steadymesh_draco_encoded_bytes(encoded: *const Encoded) -> *const u8;
    /// Number of encoded bytes.
    pub fn steadymesh_draco_encoded_length(encoded: *const Encoded) -> usize;
    /// Frees encoded bytes; null is allowed.
    pub fn steadymesh_draco_free_encoded(encoded: *mut Encoded);
    /// Most bytes that this thread's last decode held at once on the C++ heap.
    pub fn steadymesh_draco_last_peak() -> usize;
    /// Size of the allocation that this thread's last decode was refused, or 0.
    pub fn steadymesh_draco_last_refused() -> usize;
}
