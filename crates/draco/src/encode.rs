//! A mesh to Draco bytes.

use crate::{AttributeIds, MeshView, compact, status};
use std::ptr;
use steadymesh_draco_sys as sys;

/// How precisely and how fast to encode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EncodeOptions {
    /// Bits per coordinate of a position, over the largest extent of the bounding
    /// box: 1 to 30. Above 24 nothing is gained: a 32-bit float has no more, so the
    /// mesh is encoded with 24.
    pub position_bits: u8,
    /// Bits per coordinate of an octahedral normal: 2 to 30, of which 24 count.
    pub normal_bits: u8,
    /// Bits per color channel: 1 to 8. At 8, colors come back exactly.
    pub color_bits: u8,
    /// Bits per texture coordinate: 1 to 30, of which 24 count.
    pub texture_coordinate_bits: u8,
    /// 0 (smallest) to 10 (fastest). 10 does not compress connectivity and gives
    /// files several times larger.
    pub speed: u8,
}

impl Default for EncodeOptions {
    /// 12 bits keep the quantization step below the error of a 10:1 decimation, and half a texel of
    /// 2048.
    fn default() -> Self {
        Self {
            position_bits: 12,
            normal_bits: 8,
            color_bits: 8,
            texture_coordinate_bits: 12,
            speed: 5,
        }
    }
}

/// An encoded mesh with what a container such as glTF must say about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Encoded {
    /// The Draco file.
    pub bytes: Vec<u8>,
    /// Vertices that a decoder returns; see [`encode`] for why it can differ.
    pub point_count: usize,
    /// Faces that a decoder returns.
    pub face_count: usize,
    /// The unique id of each attribute.
    pub ids: AttributeIds,
}

/// Why a mesh could not be encoded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// An option is out of its range.
    #[error("{option} is {value}, but must be between {min} and {max}")]
    OptionOutOfRange {
        /// The name of the field of [`EncodeOptions`].
        option: &'static str,
        /// Its value.
        value: u8,
        /// The smallest value allowed.
        min: u8,
        /// The largest value allowed.
        max: u8,
    },
    /// The mesh has no vertices or no faces, or none that is not degenerate.
    #[error(
        "the mesh has {vertices} vertices and {faces} usable faces; at least one face is needed"
    )]
    Empty {
        /// Number of positions.
        vertices: usize,
        /// Faces with three different corners.
        faces: usize,
    },
    /// More than libdraco's 32-bit indices can address.
    #[error("{count} {what} are more than Draco can hold ({limit})")]
    TooLarge {
        /// `vertices` or `faces`.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
    /// An attribute must have one value per point.
    #[error("{points} points but {count} {what}")]
    CountMismatch {
        /// The attribute.
        what: &'static str,
        /// Its number of values.
        count: usize,
        /// Number of points.
        points: usize,
    },
    /// A point refers to a vertex that is not there.
    #[error("point {point} is of vertex {vertex}, but there are {vertices} vertices")]
    VertexOutOfRange {
        /// The index of the point, from 0.
        point: usize,
        /// The index of the vertex.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A coordinate is infinite or not a number.
    #[error("{what} of vertex {vertex} is not finite")]
    NotFinite {
        /// The attribute.
        what: &'static str,
        /// The index of the vertex, from 0.
        vertex: usize,
    },
    /// The values spread too far for 32-bit floats.
    #[error("the {what} spread further than a 32-bit float can hold; scale the mesh down")]
    ExtentOverflow {
        /// The attribute.
        what: &'static str,
    },
    /// A face refers to a point that is not there.
    #[error("face {face} refers to vertex {index}, but there are {points} vertices")]
    IndexOutOfRange {
        /// The index of the face, from 0.
        face: usize,
        /// The index of the point.
        index: u32,
        /// Number of points; that of vertices, if each is one.
        points: usize,
    },
    /// libdraco refused.
    #[error("libdraco could not encode the mesh: {message}")]
    Library {
        /// Its own words.
        message: String,
    },
}

/// Draco counts corners in 32-bit signed integers.
const MAX_FACES: usize = i32::MAX as usize / 3;
const MAX_VERTICES: usize = i32::MAX as usize;

/// The speed from which libdraco stores connectivity without EdgeBreaker.
const SEQUENTIAL_SPEED: u8 = 10;

/// EdgeBreaker compares all edges of a vertex with each other. Above this sum of
/// squared valences (a vertex with 22,000 faces; about 0.1 s) the connectivity is
/// stored as at [`SEQUENTIAL_SPEED`]. Ordinary meshes have 40 per vertex.
const MAX_VALENCE_WORK: u64 = 500_000_000;

/// A 32-bit float has no more significant bits. libdraco's entropy coder needs
/// memory in proportion to 2^bits (measured: 0.2 GB at 24, 3 GB at 28).
const MAX_EFFECTIVE_BITS: u8 = 24;

/// Compresses `mesh` to a Draco file. Equal inputs give equal bytes.
///
/// Positions that are equal are not merged: two vertices at one place stay two
/// vertices. The mesh that comes back may still differ from `mesh` in these ways,
/// which are EdgeBreaker's (the last does not happen at speed 10, nor where a
/// vertex has tens of thousands of faces, for which EdgeBreaker would take seconds):
///
/// - vertices and faces come back in another order, and the first corner of a
///   face may be another one (the winding stays);
/// - a face with two equal corners is left out;
/// - a vertex that no face uses is left out;
/// - a vertex where several fans of faces meet, and the ends of an edge that more
///   than two faces share, come back once per fan.
///
/// [`encode_with_info`] tells the counts that a decoder will see.
///
/// # Errors
///
/// See [`EncodeError`]; the mesh is checked completely before libdraco sees it.
pub fn encode(mesh: &MeshView<'_>, options: &EncodeOptions) -> Result<Vec<u8>, EncodeError> {
    encode_with_info(mesh, options).map(|encoded| encoded.bytes)
}

/// [`encode`], with the counts and attribute ids that a container needs.
///
/// # Errors
///
/// As [`encode`].
pub fn encode_with_info(
    mesh: &MeshView<'_>,
    options: &EncodeOptions,
) -> Result<Encoded, EncodeError> {
    check_options(options)?;
    check_mesh(mesh)?;
    if options.speed < SEQUENTIAL_SPEED && valence_work(mesh) <= MAX_VALENCE_WORK {
        encode_checked(mesh, options, false)
    } else {
        encode_checked(&compact::compacted(mesh).view(), options, true)
    }
}

/// The sum of the squares of all vertices' face counts.
fn valence_work(mesh: &MeshView<'_>) -> u64 {
    let mut valences = vec![0_u64; mesh.positions.len()];
    for &point in mesh.faces.as_flattened() {
        valences[mesh.vertex_of(point) as usize] += 1;
    }
    valences.iter().map(|valence| valence * valence).sum()
}

/// Encodes a mesh whose counts, indices and numbers are known to be good.
fn encode_checked(
    mesh: &MeshView<'_>,
    options: &EncodeOptions,
    is_sequential: bool,
) -> Result<Encoded, EncodeError> {
    let bits = |bits: u8| i32::from(bits.min(MAX_EFFECTIVE_BITS));
    let colors = mesh
        .colors
        .map(|colors| reduce_colors(colors, options.color_bits));
    let input = sys::Input {
        point_count: mesh.point_count(),
        vertex_count: mesh.positions.len(),
        face_count: mesh.faces.len(),
        positions: mesh.positions.as_flattened().as_ptr(),
        point_vertices: mesh.point_vertices.map_or(ptr::null(), <[u32]>::as_ptr),
        faces: mesh.faces.as_flattened().as_ptr(),
        normals: mesh
            .normals
            .map_or(ptr::null(), |v| v.as_flattened().as_ptr()),
        colors: colors
            .as_ref()
            .map_or(ptr::null(), |v| v.as_flattened().as_ptr()),
        texture_coordinates: mesh
            .texture_coordinates
            .map_or(ptr::null(), |v| v.as_flattened().as_ptr()),
        materials: mesh.materials.map_or(ptr::null(), <[u16]>::as_ptr),
        position_bits: bits(options.position_bits),
        normal_bits: bits(options.normal_bits),
        texture_coordinate_bits: bits(options.texture_coordinate_bits),
        speed: i32::from(options.speed),
        is_sequential: i32::from(is_sequential),
    };
    run(&input)
}

/// Owns the encoder's output on the C++ side.
struct Handle(ptr::NonNull<sys::Encoded>);

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the pointer came from `steadymesh_draco_encode`, is freed nowhere
        // else and is not used after this.
        unsafe { sys::steadymesh_draco_free_encoded(self.0.as_ptr()) }
    }
}

fn run(input: &sys::Input) -> Result<Encoded, EncodeError> {
    let mut raw = ptr::null_mut();
    let mut summary = sys::Summary::default();
    let mut status = status::unset();
    // SAFETY: `input` comes from `encode_with_info`, where every pointer is null or
    // leads to as many values as the counts say, borrowed until after this call;
    // indices were checked against the vertex count. The shim keeps no pointer,
    // writes a handle only on success, and is noexcept.
    unsafe { sys::steadymesh_draco_encode(input, &raw mut raw, &raw mut summary, &raw mut status) };
    let Some(handle) = ptr::NonNull::new(raw).map(Handle) else {
        return Err(EncodeError::Library {
            message: status::message(&status),
        });
    };
    // SAFETY: the handle is alive, and its buffer holds that many initialized bytes
    // which nothing changes while the slice lives.
    let bytes = unsafe {
        let start = sys::steadymesh_draco_encoded_bytes(handle.0.as_ptr());
        let length = sys::steadymesh_draco_encoded_length(handle.0.as_ptr());
        std::slice::from_raw_parts(start, length)
    };
    Ok(Encoded {
        bytes: bytes.to_vec(),
        point_count: summary.point_count,
        face_count: summary.face_count,
        ids: AttributeIds {
            position: u32::try_from(summary.position_id).unwrap_or_default(),
            normal: u32::try_from(summary.normal_id).ok(),
            color: u32::try_from(summary.color_id).ok(),
            texture_coordinate: u32::try_from(summary.texture_coordinate_id).ok(),
            material: u32::try_from(summary.material_id).ok(),
        },
    })
}

fn check_options(options: &EncodeOptions) -> Result<(), EncodeError> {
    let ranges = [
        ("position_bits", options.position_bits, 1, 30),
        // The octahedral transform needs two bits at least.
        ("normal_bits", options.normal_bits, 2, 30),
        ("color_bits", options.color_bits, 1, 8),
        (
            "texture_coordinate_bits",
            options.texture_coordinate_bits,
            1,
            30,
        ),
        ("speed", options.speed, 0, 10),
    ];
    for (option, value, min, max) in ranges {
        if !(min..=max).contains(&value) {
            return Err(EncodeError::OptionOutOfRange {
                option,
                value,
                min,
                max,
            });
        }
    }
    Ok(())
}

fn check_mesh(mesh: &MeshView<'_>) -> Result<(), EncodeError> {
    let (points, vertices) = (mesh.point_count(), mesh.positions.len());
    for (what, count, limit) in [
        ("vertices", points.max(vertices), MAX_VERTICES),
        ("faces", mesh.faces.len(), MAX_FACES),
    ] {
        if count > limit {
            return Err(EncodeError::TooLarge { what, count, limit });
        }
    }
    check_point_vertices(mesh)?;
    check_values("position", "positions", mesh.positions, vertices)?;
    if let Some(normals) = mesh.normals {
        check_values("normal", "normals", normals, points)?;
    }
    if let Some(coordinates) = mesh.texture_coordinates {
        check_values(
            "texture coordinate",
            "texture coordinates",
            coordinates,
            points,
        )?;
    }
    let counts = [
        ("colors", mesh.colors.map(<[_]>::len)),
        ("materials", mesh.materials.map(<[_]>::len)),
    ];
    for (what, count) in counts {
        if let Some(count) = count.filter(|count| *count != points) {
            return Err(EncodeError::CountMismatch {
                what,
                count,
                points,
            });
        }
    }
    check_faces(mesh, points)
}

fn check_point_vertices(mesh: &MeshView<'_>) -> Result<(), EncodeError> {
    let vertices = mesh.positions.len();
    let of_points = mesh.point_vertices.unwrap_or_default().iter().enumerate();
    for (point, &vertex) in of_points {
        if vertices <= vertex as usize {
            return Err(EncodeError::VertexOutOfRange {
                point,
                vertex,
                vertices,
            });
        }
    }
    Ok(())
}

fn check_faces(mesh: &MeshView<'_>, points: usize) -> Result<(), EncodeError> {
    let mut usable = 0;
    for (face, corners) in mesh.faces.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&index| index as usize >= points) {
            return Err(EncodeError::IndexOutOfRange {
                face,
                index,
                points,
            });
        }
        let [a, b, c] = corners.map(|point| mesh.vertex_of(point));
        usable += usize::from(a != b && b != c && c != a);
    }
    if usable == 0 {
        let vertices = mesh.positions.len();
        return Err(EncodeError::Empty { vertices, faces: 0 });
    }
    Ok(())
}

fn check_values<const N: usize>(
    singular: &'static str,
    plural: &'static str,
    values: &[[f32; N]],
    points: usize,
) -> Result<(), EncodeError> {
    if values.len() != points {
        let count = values.len();
        return Err(EncodeError::CountMismatch {
            what: plural,
            count,
            points,
        });
    }
    let mut low = [f32::INFINITY; N];
    let mut high = [f32::NEG_INFINITY; N];
    for (vertex, value) in values.iter().enumerate() {
        for axis in 0..N {
            if !value[axis].is_finite() {
                return Err(EncodeError::NotFinite {
                    what: singular,
                    vertex,
                });
            }
            low[axis] = low[axis].min(value[axis]);
            high[axis] = high[axis].max(value[axis]);
        }
    }
    // libdraco scales by the extent in `f32`.
    if (0..N).any(|axis| (high[axis] - low[axis]) == f32::INFINITY) {
        return Err(EncodeError::ExtentOverflow { what: plural });
    }
    Ok(())
}

/// Rounds every channel to one of 2^`bits` levels. libdraco stores 8-bit integers
/// without loss, so fewer levels are what makes them smaller.
fn reduce_colors(colors: &[[u8; 4]], bits: u8) -> Vec<[u8; 4]> {
    let top = (1_u32 << bits) - 1;
    let reduce = |channel: u8| {
        let level = (u32::from(channel) * top + 127) / 255;
        let value = (level * 255 + top / 2) / top;
        u8::try_from(value).unwrap_or(u8::MAX)
    };
    colors.iter().map(|color| color.map(reduce)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bits_keep_every_color_and_one_bit_keeps_black_and_white() {
        let ramp: Vec<[u8; 4]> = (0..=255).map(|v| [v; 4]).collect();
        assert_eq!(reduce_colors(&ramp, 8), ramp);
        assert_eq!(reduce_colors(&[[0, 100, 200, 255]], 1), [[0, 0, 255, 255]]);
    }
}
