//! Draco bytes to a mesh.

use crate::DecodedMesh;
use crate::decoded::{Kind, Mesh, Scale};
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
    /// The numbers of materials.
    pub material: Option<u32>,
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
    #[error(
        "the {what} of the Draco mesh have {found} component{}; {expected} are needed",
        if *.found == 1 { "" } else { "s" }
    )]
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
    decode_and_identify(bytes, limits).map(|(mesh, _)| mesh)
}

/// [`decode`], and the unique ids under which a container (glTF) would name the attributes that
/// it returns.
///
/// # Errors
///
/// As [`decode`].
pub fn decode_and_identify(
    bytes: &[u8],
    limits: &DecodeLimits,
) -> Result<(DecodedMesh, AttributeIds), DecodeError> {
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
    let (normal, color) = (usable(Kind::Normal), usable(Kind::Color));
    let (coordinate, material) = (usable(Kind::TextureCoordinate), usable(Kind::Material));
    let scale = Scale::ByFlag;
    let decoded = DecodedMesh {
        faces: mesh.faces()?,
        positions: mesh.vectors(position, Kind::Position, scale)?,
        normals: mesh.optional_vectors(normal, Kind::Normal, scale)?,
        colors: color.map(|a| mesh.colors(a)).transpose()?,
        texture_coordinates: mesh.optional_vectors(coordinate, Kind::TextureCoordinate, scale)?,
        materials: material.map(|a| mesh.materials(a)).transpose()?,
    };
    let ids = AttributeIds {
        position: position.info.unique_id,
        normal: normal.map(|a| a.info.unique_id),
        color: color.map(|a| a.info.unique_id),
        texture_coordinate: coordinate.map(|a| a.info.unique_id),
        material: material.map(|a| a.info.unique_id),
    };
    Ok((decoded, ids))
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
    let material = find_optional(Kind::Material, ids.material)?;
    let scale = Scale::AsStored;
    Ok(DecodedMesh {
        faces: mesh.faces()?,
        positions: mesh.vectors(position, Kind::Position, scale)?,
        normals: mesh.optional_vectors(normal, Kind::Normal, scale)?,
        colors: color.map(|a| mesh.colors(a)).transpose()?,
        texture_coordinates: mesh.optional_vectors(coordinate, Kind::TextureCoordinate, scale)?,
        materials: material.map(|a| mesh.materials(a)).transpose()?,
    })
}

/// The most bytes that the last decode on this thread held at once on the C++ heap.
#[must_use]
pub fn last_decode_peak_bytes() -> usize {
    // SAFETY: reads a thread-local number.
    unsafe { sys::steadymesh_draco_last_peak() }
}

fn with_id(id: Option<u32>) -> String {
    id.map(|id| format!(" with the unique id {id}"))
        .unwrap_or_default()
}
