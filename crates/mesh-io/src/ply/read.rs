//! Goes through the elements of a file in order.

use super::ascii::AsciiBody;
use super::binary::BinaryBody;
use super::faces::Faces;
use super::header::{self, Element, Encoding, Header};
use super::layout::{self, VertexSlots};
use super::malformed;
use super::vertices::Vertices;
use crate::{Limits, Mesh, ReadError, check};

/// Reads a PLY file.
///
/// Positions may have any scalar type. Normals (`nx ny nz`), colors (`red green
/// blue`, `alpha`) and texture coordinates (`s t`, `u v` or `texture_u texture_v`)
/// are taken where the vertices have them. Polygons become fans of triangles around
/// their first corner. Other properties and elements are skipped.
///
/// # Errors
///
/// See [`ReadError`]; those about ASCII files name the line.
pub fn read(bytes: &[u8], limits: &Limits) -> Result<Mesh, ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::EmptyBody);
    }
    let header = header::parse(bytes)?;
    let plan = Plan::of(&header)?;
    layout::check_promises(&header)?;
    check::vertex_limit(to_usize(plan.vertex_count), limits)?;
    check::face_limit(to_usize(plan.face_count), limits)?;
    let mut sinks = Sinks {
        vertices: Vertices::new(plan.slots, to_usize(plan.vertex_count)),
        faces: Faces::new(limits, plan.vertex_count, to_usize(plan.face_count)),
        corner_list: plan.corner_list,
    };
    match header.encoding {
        Encoding::Ascii => {
            let mut body = AsciiBody::new(header.body, header.body_line);
            each(&header.elements, |role, element| {
                body.read(role, element, &mut sinks)
            })?;
        }
        Encoding::LittleEndian => {
            let mut body = BinaryBody::<false>::new(header.body);
            each(&header.elements, |role, element| {
                body.read(role, element, &mut sinks)
            })?;
        }
        Encoding::BigEndian => {
            let mut body = BinaryBody::<true>::new(header.body);
            each(&header.elements, |role, element| {
                body.read(role, element, &mut sinks)
            })?;
        }
    }
    Ok(sinks.vertices.into_mesh(sinks.faces.into_triangles()))
}

/// Where records go.
pub(super) struct Sinks<'a> {
    pub(super) vertices: Vertices,
    pub(super) faces: Faces<'a>,
    /// The property of a face that lists its corners.
    pub(super) corner_list: usize,
}

/// What an element is to the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Vertex,
    Face,
    Other,
}

/// Calls `read` for each element up to the last one that matters.
fn each(
    elements: &[Element],
    mut read: impl FnMut(Role, &Element) -> Result<(), ReadError>,
) -> Result<(), ReadError> {
    let (mut has_vertices, mut has_faces) = (false, false);
    for element in elements {
        // Only the first element of each name counts, as in `Plan::of`.
        let role = match element.name.as_str() {
            "vertex" if !has_vertices => Role::Vertex,
            "face" if !has_faces => Role::Face,
            _ => Role::Other,
        };
        has_vertices |= role == Role::Vertex;
        has_faces |= role == Role::Face;
        read(role, element)?;
        if has_vertices && has_faces {
            break;
        }
    }
    Ok(())
}

/// What the header says about the mesh.
struct Plan {
    vertex_count: u64,
    face_count: u64,
    slots: VertexSlots,
    corner_list: usize,
}

impl Plan {
    fn of(header: &Header<'_>) -> Result<Self, ReadError> {
        let find = |name: &str| {
            header
                .elements
                .iter()
                .find(|e| e.name == name && e.count > 0)
        };
        let first = |name: &str| header.elements.iter().find(|e| e.name == name);
        let vertices = first("vertex")
            .filter(|e| e.count > 0)
            .ok_or(ReadError::NoVertices { format: "PLY" })?;
        let Some(faces) = first("face").filter(|e| e.count > 0) else {
            if find("tristrips").is_some() {
                return Err(malformed(
                    "the faces are stored as triangle strips (`tristrips`), which are not \
                     supported; export them as `face` records",
                ));
            }
            let vertices = to_usize(vertices.count);
            return Err(ReadError::NoFaces {
                format: "PLY",
                vertices,
            });
        };
        Ok(Self {
            vertex_count: vertices.count,
            face_count: faces.count,
            slots: VertexSlots::of(vertices)?,
            corner_list: layout::corner_list(faces)?,
        })
    }
}

fn to_usize(count: u64) -> usize {
    usize::try_from(count).unwrap_or(usize::MAX)
}
