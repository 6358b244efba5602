//! Goes through the elements of a file in order.

use super::ascii::{AsciiBody, RecordEnd};
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
/// their first corner. Other properties and elements are skipped. ASCII files have one
/// element a line; if they do not, the numbers are taken in order wherever they stand, as long
/// as there are neither more nor fewer than the header says.
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
    match header.encoding {
        Encoding::Ascii => match read_ascii(&header, &plan, limits, RecordEnd::Line) {
            // Tells what is wrong with a file that cannot be read either way.
            Err(error @ ReadError::Ply { .. }) => {
                read_ascii(&header, &plan, limits, RecordEnd::LastNumber).map_err(|_| error)
            }
            outcome => outcome,
        },
        Encoding::LittleEndian => read_binary::<false>(&header, &plan, limits),
        Encoding::BigEndian => read_binary::<true>(&header, &plan, limits),
    }
}

fn read_ascii(
    header: &Header<'_>,
    plan: &Plan,
    limits: &Limits,
    record_end: RecordEnd,
) -> Result<Mesh, ReadError> {
    let mut sinks = Sinks::new(plan, limits);
    let mut body = AsciiBody::new(header.body, header.body_line, record_end);
    let mut read = |role, element: &Element| body.read(role, element, &mut sinks);
    match record_end {
        RecordEnd::Line => each(up_to_mesh(&header.elements), &mut read)?,
        RecordEnd::LastNumber => {
            each(&header.elements, &mut read)?;
            // One number too many or too few moves all that follow it: only where they come
            // out even is every one of them known to be in its place.
            if !body.is_at_end() {
                return Err(malformed("there are more numbers than the header says"));
            }
        }
    }
    Ok(sinks.into_mesh())
}

fn read_binary<const BIG: bool>(
    header: &Header<'_>,
    plan: &Plan,
    limits: &Limits,
) -> Result<Mesh, ReadError> {
    let mut sinks = Sinks::new(plan, limits);
    let mut body = BinaryBody::<BIG>::new(header.body);
    each(up_to_mesh(&header.elements), |role, element| {
        body.read(role, element, &mut sinks)
    })?;
    Ok(sinks.into_mesh())
}

/// Where records go.
pub(super) struct Sinks<'a> {
    pub(super) vertices: Vertices,
    pub(super) faces: Faces<'a>,
    /// The property of a face that lists its corners.
    pub(super) corner_list: usize,
}

impl<'a> Sinks<'a> {
    fn new(plan: &Plan, limits: &'a Limits) -> Self {
        let (vertices, faces) = (to_usize(plan.vertex_count), to_usize(plan.face_count));
        Self {
            vertices: Vertices::new(plan.slots.clone(), vertices),
            faces: Faces::new(limits, plan.vertex_count, faces),
            corner_list: plan.corner_list,
        }
    }

    /// Takes a record; `line` is known in ASCII files.
    #[inline]
    pub(super) fn push(
        &mut self,
        role: Role,
        record: &Record,
        line: Option<usize>,
    ) -> Result<(), ReadError> {
        match role {
            Role::Vertex => self.vertices.push(|index| record.scalars[index], line),
            Role::Face => self.faces.push(&record.corners, line),
            Role::Other => Ok(()),
        }
    }

    fn into_mesh(self) -> Mesh {
        self.vertices.into_mesh(self.faces.into_triangles())
    }
}

/// The numbers of one record, whatever encoding they come from.
#[derive(Default)]
pub(super) struct Record {
    /// One for each property, 0 for lists.
    pub(super) scalars: Vec<f64>,
    /// The list of corners, if it has one.
    pub(super) corners: Vec<f64>,
}

/// What an element is to the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Vertex,
    Face,
    Other,
}

/// The elements up to the last one that matters.
fn up_to_mesh(elements: &[Element]) -> &[Element] {
    let first = |name: &str| elements.iter().position(|e| e.name == name);
    let last = first("vertex").max(first("face"));
    &elements[..last.map_or(0, |last| last + 1)]
}

/// Calls `read` for each element.
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
