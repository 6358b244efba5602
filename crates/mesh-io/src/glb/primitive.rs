//! One primitive: its attributes and its triangles.

use super::accessor::{Component, Source};
use super::document::{Accessor, DracoExtension, Primitive};
use super::malformed;
use crate::error::are;
use crate::{Limits, ReadError, check, drc};
use steadymesh_draco::{AttributeIds, decode_with_ids};
use steadymesh_proto::wording::counted;

/// The vertices of a primitive in local coordinates, one value each.
pub(super) struct Vertices {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) normals: Option<Vec<[f32; 3]>>,
    pub(super) colors: Option<Vec<[u8; 4]>>,
    pub(super) coordinates: Option<Vec<[f32; 2]>>,
}

/// How many vertices and faces may still be added.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room<'a> {
    pub(super) limits: &'a Limits,
    pub(super) used_vertices: usize,
    /// Counts the degenerate triangles of strips as well.
    pub(super) used_faces: usize,
}

impl Room<'_> {
    pub(super) fn vertices(&self, more: usize) -> Result<(), ReadError> {
        check::vertex_limit(self.used_vertices.saturating_add(more), self.limits)
    }

    pub(super) fn faces(&self, more: usize) -> Result<(), ReadError> {
        check::face_limit(self.used_faces.saturating_add(more), self.limits)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Triangles,
    Strip,
    Fan,
}

impl Mode {
    /// `None` for points and lines.
    pub(super) fn of(primitive: &Primitive) -> Result<Option<Self>, ReadError> {
        match primitive.mode.unwrap_or(4) {
            0..=3 => Ok(None),
            4 => Ok(Some(Self::Triangles)),
            5 => Ok(Some(Self::Strip)),
            6 => Ok(Some(Self::Fan)),
            mode => Err(malformed(format!("the primitive mode {mode} is unknown"))),
        }
    }

    fn face_count(self, indices: usize) -> usize {
        match self {
            Self::Triangles => indices / 3,
            Self::Strip | Self::Fan => indices.saturating_sub(2),
        }
    }

    fn triangles(self, indices: &[u32]) -> Result<Vec<[u32; 3]>, ReadError> {
        match self {
            Self::Triangles => {
                let (triangles, rest) = indices.as_chunks::<3>();
                if !rest.is_empty() {
                    return Err(malformed(format!(
                        "a list of triangles has {}, which is not a multiple of 3",
                        counted(indices.len() as u64, "index")
                    )));
                }
                Ok(triangles.to_vec())
            }
            // Every second triangle of a strip is turned over; degenerate ones only
            // join strips.
            Self::Strip => Ok(indices
                .windows(3)
                .enumerate()
                .map(|(i, w)| {
                    if i % 2 == 0 {
                        [w[0], w[1], w[2]]
                    } else {
                        [w[0], w[2], w[1]]
                    }
                })
                .filter(|[a, b, c]| a != b && b != c && c != a)
                .collect()),
            Self::Fan => {
                let Some((&hub, rim)) = indices.split_first() else {
                    return Ok(Vec::new());
                };
                Ok(rim.windows(2).map(|pair| [hub, pair[0], pair[1]]).collect())
            }
        }
    }
}

const POSITION: &str = "POSITION";
const NORMAL: &str = "NORMAL";
const COLOR: &str = "COLOR_0";
const COORDINATE: &str = "TEXCOORD_0";

/// The accessors that make up the vertices; primitives that agree share them.
pub(super) fn vertex_key(primitive: &Primitive) -> [Option<usize>; 4] {
    [POSITION, NORMAL, COLOR, COORDINATE].map(|name| primitive.attributes.get(name).copied())
}

/// Reads the vertices of an uncompressed primitive.
pub(super) fn vertices(
    source: &Source<'_>,
    primitive: &Primitive,
    room: Room<'_>,
) -> Result<Vertices, ReadError> {
    let [position, normal, color, coordinate] = vertex_key(primitive);
    let position = position.ok_or_else(|| malformed("a primitive has no attribute POSITION"))?;
    let count = source.accessor(position)?.count;
    room.vertices(count)?;
    check_shape(source.accessor(position)?, POSITION, &["VEC3"], count)?;
    let optional = |index: Option<usize>, name: &str, shapes: &[&str]| match index {
        None => Ok::<_, ReadError>(None),
        Some(index) => {
            check_shape(source.accessor(index)?, name, shapes, count)?;
            Ok(Some(index))
        }
    };
    let normal = optional(normal, NORMAL, &["VEC3"])?;
    let color = optional(color, COLOR, &["VEC3", "VEC4"])?;
    let coordinate = optional(coordinate, COORDINATE, &["VEC2"])?;
    Ok(Vertices {
        positions: source.vectors::<3>(position)?,
        normals: normal
            .map(|i| narrow(source.vectors::<3>(i)?))
            .transpose()?,
        colors: color.map(|index| colors(source, index)).transpose()?,
        coordinates: coordinate
            .map(|i| narrow(source.vectors::<2>(i)?))
            .transpose()?,
    })
}

/// The triangles of an uncompressed primitive of `vertex_count` vertices, and how
/// many there were before degenerate ones were dropped.
pub(super) fn faces(
    source: &Source<'_>,
    primitive: &Primitive,
    (mode, vertex_count): (Mode, usize),
    room: Room<'_>,
) -> Result<(Vec<[u32; 3]>, usize), ReadError> {
    let index_count = match primitive.indices {
        Some(index) => source.accessor(index)?.count,
        None => vertex_count,
    };
    let face_count = mode.face_count(index_count);
    room.faces(face_count)?;
    let indices = match primitive.indices {
        Some(index) => source.indices(index)?,
        // The vertex count passed the limit, which is within 32 bits.
        None => (0..u32::try_from(vertex_count).unwrap_or(u32::MAX)).collect(),
    };
    let faces = mode.triangles(&indices)?;
    check::faces(&faces, vertex_count).map_err(|error| at_face(error, room.used_faces))?;
    Ok((faces, face_count))
}

/// Counts the face of an index error from the first face of the file on.
fn at_face(error: ReadError, first: usize) -> ReadError {
    match error {
        ReadError::IndexOutOfRange {
            face,
            what,
            index,
            count,
            line,
        } => ReadError::IndexOutOfRange {
            face: first + face,
            what,
            index,
            count,
            line,
        },
        other => other,
    }
}

/// Decodes a primitive that Draco compressed.
pub(super) fn decompress(
    source: &Source<'_>,
    primitive: &Primitive,
    draco: &DracoExtension,
    room: Room<'_>,
) -> Result<(Vertices, Vec<[u32; 3]>), ReadError> {
    let (bytes, _) = source.view(draco.buffer_view)?;
    let id = |name: &str| draco.attributes.get(name).copied();
    let ids = AttributeIds {
        position: id(POSITION)
            .ok_or_else(|| malformed("a Draco primitive names no attribute POSITION"))?,
        normal: id(NORMAL),
        color: id(COLOR),
        texture_coordinate: id(COORDINATE),
        // A primitive has one.
        material: None,
    };
    let decoded = decode_with_ids(bytes, &ids, &drc::decode_limits(room.limits))?;
    room.vertices(decoded.positions.len())?;
    room.faces(decoded.faces.len())?;
    // The accessors say what integers stand for.
    let divisor = |name: &str| match primitive.attributes.get(name) {
        Some(&index) => divisor(source.accessor(index)?),
        None => Ok(1.0),
    };
    let (position, normal, coordinate) =
        (divisor(POSITION)?, divisor(NORMAL)?, divisor(COORDINATE)?);
    let widen =
        |value: f32, by: f64| (f64::from(value) / by).max(if by > 1.0 { -1.0 } else { f64::MIN });
    let scale = |value: f32, by: f64| widen(value, by) as f32;
    let vertices = Vertices {
        positions: decoded
            .positions
            .iter()
            .map(|p| p.map(|v| widen(v, position)))
            .collect(),
        normals: decoded.normals.map(|all| {
            all.into_iter()
                .map(|n| n.map(|v| scale(v, normal)))
                .collect()
        }),
        colors: decoded.colors,
        coordinates: decoded.texture_coordinates.map(|all| {
            all.into_iter()
                .map(|c| c.map(|v| scale(v, coordinate)))
                .collect()
        }),
    };
    Ok((vertices, decoded.faces))
}

fn divisor(accessor: &Accessor) -> Result<f64, ReadError> {
    let component = Component::of(accessor.component_type)?;
    Ok(if accessor.normalized {
        component.divisor()
    } else {
        1.0
    })
}

fn check_shape(
    accessor: &Accessor,
    name: &str,
    shapes: &[&str],
    count: usize,
) -> Result<(), ReadError> {
    if !shapes.contains(&accessor.shape.as_str()) {
        return Err(malformed(format!(
            "the accessor of {name} is not of type {}",
            shapes.join(" or ")
        )));
    }
    if accessor.count != count {
        return Err(malformed(format!(
            "{name} has {}, but there {}",
            counted(accessor.count as u64, "value"),
            are(count, "vertex")
        )));
    }
    Ok(())
}

fn colors(source: &Source<'_>, index: usize) -> Result<Vec<[u8; 4]>, ReadError> {
    let accessor = source.accessor(index)?;
    // Integer colors are always fractions, though some files forget to say so.
    let scale = match (accessor.normalized, Component::of(accessor.component_type)?) {
        (true, _) | (_, Component::F32) => 255.0,
        (false, component) => 255.0 / component.divisor(),
    };
    // `as` clamps, and sends NaN to 0.
    let channel = |value: f64| (value * scale).round() as u8;
    if accessor.shape == "VEC4" {
        return Ok(source
            .vectors::<4>(index)?
            .into_iter()
            .map(|c| c.map(channel))
            .collect());
    }
    let opaque = |[r, g, b]: [f64; 3]| [channel(r), channel(g), channel(b), u8::MAX];
    Ok(source
        .vectors::<3>(index)?
        .into_iter()
        .map(opaque)
        .collect())
}

fn narrow<const N: usize>(values: Vec<[f64; N]>) -> Result<Vec<[f32; N]>, ReadError> {
    Ok(values
        .into_iter()
        .map(|value| value.map(|number| number as f32))
        .collect())
}
