//! Draco bytes to a mesh.

use crate::{DecodedMesh, header, status};
use std::ptr;
use steadymesh_draco_sys as sys;

/// How much a file may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecodeLimits {
    /// Most vertices.
    pub max_vertices: usize,
    /// Most faces.
    pub max_faces: usize,
    /// Most bytes that libdraco may hold at once. The result's own copy, bounded
    /// by the other two, comes on top.
    pub max_memory_bytes: usize,
}

/// Which attribute of a Draco file is what, by Draco unique id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AttributeIds {
    /// The positions.
    pub position: u32,
    /// The normals.
    pub normal: Option<u32>,
    /// The colors.
    pub color: Option<u32>,
    /// The texture coordinates.
    pub texture_coordinate: Option<u32>,
}

/// Why bytes could not be decoded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The first five bytes are not `DRACO`.
    #[error("not a Draco file: it does not begin with \"DRACO\"")]
    NotDraco,
    /// There are no faces to work with.
    #[error("the Draco file holds a point cloud; a mesh with faces is needed")]
    PointCloud,
    /// A mesh without faces or vertices.
    #[error(
        "the Draco mesh has {vertices} vertices and {faces} faces; at least one face is needed"
    )]
    Empty {
        /// Number of vertices.
        vertices: usize,
        /// Number of faces.
        faces: usize,
    },
    /// More vertices or faces than allowed.
    #[error("the Draco mesh has {found} {what}; the limit is {limit}")]
    LimitExceeded {
        /// `vertices` or `faces`.
        what: &'static str,
        /// How many the file has.
        found: usize,
        /// How many it may have.
        limit: usize,
    },
    /// Decoding needs too much memory.
    #[error("decoding the Draco file needs more memory than the limit of {limit} bytes")]
    OutOfMemory {
        /// [`DecodeLimits::max_memory_bytes`].
        limit: usize,
    },
    /// No attribute has the id, or the file has no positions.
    #[error("the Draco mesh has no {what}{}", with_id(*.id))]
    MissingAttribute {
        /// The attribute.
        what: &'static str,
        /// The unique id that was asked for.
        id: Option<u32>,
    },
    /// An attribute has the wrong number of components.
    #[error("the {what} of the Draco mesh have {found} components; {expected} are needed")]
    ComponentCount {
        /// The attribute.
        what: &'static str,
        /// Numbers per value in the file.
        found: usize,
        /// What would do.
        expected: &'static str,
    },
    /// libdraco refused the bytes, or what it made of them contradicts itself.
    #[error("damaged or unsupported Draco file: {message}")]
    Malformed {
        /// libdraco's own words.
        message: String,
    },
}

/// Decodes a Draco mesh, taking the first attribute of each kind.
///
/// Any data type becomes `f32` (positions, normals, texture coordinates) or `u8`
/// (colors); integers that the file marks as normalized become fractions. Normals,
/// colors and texture coordinates with an unusual number of components are left
/// out. Vertices are in file order, which is not the encoder's.
///
/// # Errors
///
/// See [`DecodeError`].
pub fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<DecodedMesh, DecodeError> {
    let mesh = Mesh::decode(bytes, limits)?;
    let attributes = mesh.attributes()?;
    let first = |kind: Kind| {
        attributes
            .iter()
            .find(|a| a.info.semantic == kind.semantic())
    };
    let usable = |kind: Kind| first(kind).filter(|a| kind.accepts(a.info.component_count as usize));
    let position = first(Kind::Position).ok_or(DecodeError::MissingAttribute {
        what: Kind::Position.name(),
        id: None,
    })?;
    let scale = Scale::ByFlag;
    Ok(DecodedMesh {
        faces: mesh.faces()?,
        positions: mesh.vectors(position, Kind::Position, scale)?,
        normals: mesh.optional_vectors(usable(Kind::Normal), Kind::Normal, scale)?,
        colors: usable(Kind::Color).map(|a| mesh.colors(a)).transpose()?,
        texture_coordinates: mesh.optional_vectors(
            usable(Kind::TextureCoordinate),
            Kind::TextureCoordinate,
            scale,
        )?,
    })
}

/// Decodes a Draco mesh whose container (glTF) names the attributes by unique id.
///
/// Integers are handed out as they are stored, since the container says what they
/// stand for; only colors are always brought to 0 to 255.
///
/// # Errors
///
/// As [`decode`], and [`DecodeError::MissingAttribute`] or
/// [`DecodeError::ComponentCount`] for any attribute that is asked for.
pub fn decode_with_ids(
    bytes: &[u8],
    ids: &AttributeIds,
    limits: &DecodeLimits,
) -> Result<DecodedMesh, DecodeError> {
    let mesh = Mesh::decode(bytes, limits)?;
    let attributes = mesh.attributes()?;
    let find = |kind: Kind, id: u32| {
        attributes
            .iter()
            .find(|a| a.info.unique_id == id)
            .ok_or(DecodeError::MissingAttribute {
                what: kind.name(),
                id: Some(id),
            })
    };
    let find_optional = |kind: Kind, id: Option<u32>| id.map(|id| find(kind, id)).transpose();
    let position = find(Kind::Position, ids.position)?;
    let normal = find_optional(Kind::Normal, ids.normal)?;
    let color = find_optional(Kind::Color, ids.color)?;
    let coordinate = find_optional(Kind::TextureCoordinate, ids.texture_coordinate)?;
    let scale = Scale::AsStored;
    Ok(DecodedMesh {
        faces: mesh.faces()?,
        positions: mesh.vectors(position, Kind::Position, scale)?,
        normals: mesh.optional_vectors(normal, Kind::Normal, scale)?,
        colors: color.map(|a| mesh.colors(a)).transpose()?,
        texture_coordinates: mesh.optional_vectors(coordinate, Kind::TextureCoordinate, scale)?,
    })
}

/// The most bytes that the last decode on this thread held at once on the C++ heap.
#[must_use]
pub fn last_decode_peak_bytes() -> usize {
    // SAFETY: reads a thread-local number.
    unsafe { sys::steadymesh_draco_last_peak() }
}

#[derive(Clone, Copy)]
enum Scale {
    /// As the file's `normalized` flag says.
    ByFlag,
    AsStored,
}

#[derive(Clone, Copy)]
enum Kind {
    Position,
    Normal,
    Color,
    TextureCoordinate,
}

impl Kind {
    fn semantic(self) -> i32 {
        match self {
            Self::Position => 0,
            Self::Normal => 1,
            Self::Color => 2,
            Self::TextureCoordinate => 3,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Position => "positions",
            Self::Normal => "normals",
            Self::Color => "colors",
            Self::TextureCoordinate => "texture coordinates",
        }
    }

    fn accepts(self, component_count: usize) -> bool {
        match self {
            Self::Position | Self::Normal => component_count == 3,
            Self::Color => component_count == 3 || component_count == 4,
            Self::TextureCoordinate => component_count == 2,
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Self::Position | Self::Normal => "3",
            Self::Color => "3 or 4",
            Self::TextureCoordinate => "2",
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Attribute {
    index: usize,
    info: sys::Attribute,
}

impl Attribute {
    /// The largest value of an integer type; `None` for floats.
    fn integer_max(&self) -> Option<f32> {
        Some(match self.info.data_type {
            1 => f32::from(i8::MAX),
            2 => f32::from(u8::MAX),
            3 => f32::from(i16::MAX),
            4 => f32::from(u16::MAX),
            5 => i32::MAX as f32,
            6 => u32::MAX as f32,
            7 => i64::MAX as f32,
            8 => u64::MAX as f32,
            11 => 1.0,
            _ => return None,
        })
    }
}

/// A decoded mesh that lives on the C++ side.
struct Mesh {
    raw: ptr::NonNull<sys::Mesh>,
    vertex_count: usize,
    face_count: usize,
}

impl Drop for Mesh {
    fn drop(&mut self) {
        // SAFETY: the pointer came from `steadymesh_draco_decode`, is freed nowhere
        // else and is not used after this.
        unsafe { sys::steadymesh_draco_free_mesh(self.raw.as_ptr()) }
    }
}

impl Mesh {
    fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<Self, DecodeError> {
        if !header::has_magic(bytes) {
            return Err(DecodeError::NotDraco);
        }
        if let Some(counts) = header::counts(bytes) {
            check_limits(counts.vertices as usize, counts.faces as usize, limits)?;
        }
        let limit = limits.max_memory_bytes;
        let mut raw = ptr::null_mut();
        let mut status = status::unset();
        // SAFETY: `bytes` is readable for `bytes.len()` bytes during the call and the
        // shim keeps no pointer into it; it writes a handle only on success. It is
        // noexcept, so no C++ exception unwinds into Rust.
        unsafe {
            sys::steadymesh_draco_decode(
                bytes.as_ptr(),
                bytes.len(),
                limit,
                &raw mut raw,
                &raw mut status,
            );
        }
        let raw = ptr::NonNull::new(raw).ok_or_else(|| failure(&status, limit))?;
        // SAFETY: the handle was just made and is not null.
        let (vertex_count, face_count) = unsafe {
            (
                sys::steadymesh_draco_point_count(raw.as_ptr()),
                sys::steadymesh_draco_face_count(raw.as_ptr()),
            )
        };
        let mesh = Self {
            raw,
            vertex_count,
            face_count,
        };
        if vertex_count == 0 || face_count == 0 {
            return Err(DecodeError::Empty {
                vertices: vertex_count,
                faces: face_count,
            });
        }
        check_limits(vertex_count, face_count, limits)?;
        Ok(mesh)
    }

    fn attributes(&self) -> Result<Vec<Attribute>, DecodeError> {
        // SAFETY: the handle is alive.
        let count = unsafe { sys::steadymesh_draco_attribute_count(self.raw.as_ptr()) };
        (0..count)
            .map(|index| {
                let mut info = sys::Attribute::default();
                let mut status = status::unset();
                // SAFETY: the handle is alive; the shim checks the index and writes
                // only to the two references, which outlive the call.
                unsafe {
                    sys::steadymesh_draco_attribute(
                        self.raw.as_ptr(),
                        index,
                        &raw mut info,
                        &raw mut status,
                    );
                }
                accept(&status)?;
                Ok(Attribute { index, info })
            })
            .collect()
    }

    fn faces(&self) -> Result<Vec<[u32; 3]>, DecodeError> {
        let mut faces = vec![[0_u32; 3]; self.face_count];
        let flat = faces.as_flattened_mut();
        let mut status = status::unset();
        // SAFETY: the handle is alive and `flat` is writable for `flat.len()` values,
        // which the shim compares with what it writes.
        unsafe {
            sys::steadymesh_draco_read_faces(
                self.raw.as_ptr(),
                flat.as_mut_ptr(),
                flat.len(),
                &raw mut status,
            );
        }
        accept(&status)?;
        Ok(faces)
    }

    /// All components of all vertices, as stored.
    fn numbers(&self, attribute: &Attribute, kind: Kind) -> Result<Vec<f32>, DecodeError> {
        let components = attribute.info.component_count as usize;
        if !kind.accepts(components) {
            return Err(DecodeError::ComponentCount {
                what: kind.name(),
                found: components,
                expected: kind.expected(),
            });
        }
        let mut numbers = vec![0.0_f32; self.vertex_count * components];
        let mut status = status::unset();
        // SAFETY: the handle is alive and `numbers` is writable for its length, which
        // the shim compares with what it writes; it checks the index as well.
        unsafe {
            sys::steadymesh_draco_read_attribute(
                self.raw.as_ptr(),
                attribute.index,
                numbers.as_mut_ptr(),
                numbers.len(),
                &raw mut status,
            );
        }
        accept(&status)?;
        Ok(numbers)
    }

    fn vectors<const N: usize>(
        &self,
        attribute: &Attribute,
        kind: Kind,
        scale: Scale,
    ) -> Result<Vec<[f32; N]>, DecodeError> {
        let mut numbers = self.numbers(attribute, kind)?;
        let is_fraction = attribute.info.normalized != 0 && matches!(scale, Scale::ByFlag);
        if let (true, Some(max)) = (is_fraction, attribute.integer_max()) {
            for number in &mut numbers {
                *number = (*number / max).max(-1.0);
            }
        }
        Ok(numbers.as_chunks::<N>().0.to_vec())
    }

    fn optional_vectors<const N: usize>(
        &self,
        attribute: Option<&Attribute>,
        kind: Kind,
        scale: Scale,
    ) -> Result<Option<Vec<[f32; N]>>, DecodeError> {
        attribute.map(|a| self.vectors(a, kind, scale)).transpose()
    }

    fn colors(&self, attribute: &Attribute) -> Result<Vec<[u8; 4]>, DecodeError> {
        let numbers = self.numbers(attribute, Kind::Color)?;
        let scale = 255.0 / attribute.integer_max().unwrap_or(1.0);
        // `as` sends NaN to 0 and clamps the rest.
        let channel = |number: f32| (number * scale).round() as u8;
        let components = attribute.info.component_count as usize;
        Ok(numbers
            .chunks_exact(components)
            .map(|c| {
                let alpha = c.get(3).map_or(u8::MAX, |&alpha| channel(alpha));
                [channel(c[0]), channel(c[1]), channel(c[2]), alpha]
            })
            .collect())
    }
}

fn check_limits(vertices: usize, faces: usize, limits: &DecodeLimits) -> Result<(), DecodeError> {
    let checks = [
        ("vertices", vertices, limits.max_vertices),
        ("faces", faces, limits.max_faces),
    ];
    for (what, found, limit) in checks {
        if found > limit {
            return Err(DecodeError::LimitExceeded { what, found, limit });
        }
    }
    Ok(())
}

fn accept(status: &sys::Status) -> Result<(), DecodeError> {
    match status.code {
        sys::OK => Ok(()),
        _ => Err(DecodeError::Malformed {
            message: status::message(status),
        }),
    }
}

fn failure(status: &sys::Status, limit: usize) -> DecodeError {
    match status.code {
        sys::OVER_BUDGET => DecodeError::OutOfMemory { limit },
        sys::NOT_A_MESH => DecodeError::PointCloud,
        _ => DecodeError::Malformed {
            message: status::message(status),
        },
    }
}

fn with_id(id: Option<u32>) -> String {
    id.map(|id| format!(" with the unique id {id}"))
        .unwrap_or_default()
}
