//! OBJ text to a mesh.

use super::colors::Colors;
use super::face::{Corner, Indices, parse_corner};
use crate::cursor::{Lines, Tokens, number, shown};
use crate::mesh::materials_of_faces;
use crate::{Attribute, Limits, Mesh, ReadError, check};
use std::borrow::Cow;
use std::collections::BTreeMap;
use steadymesh_proto::wording::counted;

/// Reads an OBJ file.
///
/// Polygons become fans of triangles around their first corner. Texture coordinates
/// and normals are kept if every corner has them; vertex colors (three or four more
/// numbers on a `v` record, 0 to 1 or 0 to 255) if every vertex has them. A vertex
/// may be used before it is defined. Faces under different `usemtl` names have different materials,
/// numbered by their first use.
///
/// # Errors
///
/// See [`ReadError`]; each names the line.
pub fn read(bytes: &[u8], limits: &Limits) -> Result<Mesh, ReadError> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if text.is_empty() {
        return Err(ReadError::EmptyBody);
    }
    let mut reader = Reader::new(limits);
    for (line, record) in records(text) {
        reader.record(line, &record)?;
    }
    check::vertex_limit(reader.vertex_count, limits)?;
    check::face_limit(reader.face_count, limits)?;
    reader.finish(text)
}

/// The records of a file with the number of the line that each begins on; a
/// backslash at the end of a line joins the next one to it.
fn records(text: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, [u8]>)> {
    let mut lines = Lines::new(text, 1);
    std::iter::from_fn(move || {
        let (number, first) = lines.next()?;
        if first.last() != Some(&b'\\') || is_comment(first) {
            return Some((number, Cow::Borrowed(first)));
        }
        let mut joined = first.to_vec();
        while joined.last() == Some(&b'\\') {
            joined.pop();
            joined.push(b' ');
            let Some((_, next)) = lines.next() else { break };
            joined.extend_from_slice(next);
        }
        Some((number, Cow::Owned(joined)))
    })
}

fn is_comment(line: &[u8]) -> bool {
    line.trim_ascii_start().first() == Some(&b'#')
}

struct Reader<'a> {
    limits: &'a Limits,
    positions: Vec<[f64; 3]>,
    colors: Colors,
    coordinates: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    faces: Indices,
    /// These two go on counting beyond the limits, where nothing is kept any more.
    vertex_count: usize,
    face_count: usize,
    /// The corners of the current face.
    polygon: Vec<Corner>,
    /// Numbers of the materials' names, and that of the current one: 0 before the first.
    materials: BTreeMap<Vec<u8>, u32>,
    material: u32,
    /// By face.
    face_materials: Vec<u32>,
}

impl<'a> Reader<'a> {
    fn new(limits: &'a Limits) -> Self {
        Self {
            limits,
            positions: Vec::new(),
            colors: Colors::default(),
            coordinates: Vec::new(),
            normals: Vec::new(),
            faces: Indices::default(),
            vertex_count: 0,
            face_count: 0,
            polygon: Vec::new(),
            materials: BTreeMap::new(),
            material: 0,
            face_materials: Vec::new(),
        }
    }

    fn record(&mut self, line: usize, record: &[u8]) -> Result<(), ReadError> {
        let without_comment = match record.iter().position(|&byte| byte == b'#') {
            Some(start) => &record[..start],
            None => record,
        };
        let mut tokens = Tokens::new(without_comment);
        match tokens.next() {
            Some(b"v") => self.vertex(line, tokens),
            Some(b"vt") => self.coordinate(line, tokens),
            Some(b"vn") => self.normal(line, tokens),
            // `fo` is what the specification calls outdated and readers still accept.
            Some(b"f" | b"fo") => self.face(line, tokens),
            Some(b"usemtl") => {
                self.use_material(tokens);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn vertex(&mut self, line: usize, tokens: Tokens<'_>) -> Result<(), ReadError> {
        self.vertex_count += 1;
        if self.vertex_count > self.limits.max_vertices {
            return Ok(());
        }
        let mut numbers = [0.0_f64; 7];
        let count = parse_numbers(line, "v", tokens, &mut numbers)?;
        if count < 3 {
            return Err(too_few(line, "v", count, 3));
        }
        let [x, y, z, ..] = numbers;
        check::position([x, y, z], self.positions.len(), Some(line))?;
        self.positions.push([x, y, z]);
        self.colors.push(match count {
            6 => Some([numbers[3], numbers[4], numbers[5], f64::NAN]),
            7 => Some([numbers[3], numbers[4], numbers[5], numbers[6]]),
            _ => None,
        });
        Ok(())
    }

    fn coordinate(&mut self, line: usize, tokens: Tokens<'_>) -> Result<(), ReadError> {
        let mut numbers = [0.0_f64; 3];
        let count = parse_numbers(line, "vt", tokens, &mut numbers)?;
        if count < 1 {
            return Err(too_few(line, "vt", count, 1));
        }
        let coordinate = [numbers[0] as f32, numbers[1] as f32];
        check::texture_coordinate(coordinate, self.coordinates.len(), Some(line))?;
        self.coordinates.push(coordinate);
        Ok(())
    }

    fn normal(&mut self, line: usize, tokens: Tokens<'_>) -> Result<(), ReadError> {
        let mut numbers = [0.0_f64; 3];
        let count = parse_numbers(line, "vn", tokens, &mut numbers)?;
        if count < 3 {
            return Err(too_few(line, "vn", count, 3));
        }
        self.normals.push(numbers.map(|value| value as f32));
        Ok(())
    }

    fn face(&mut self, line: usize, tokens: Tokens<'_>) -> Result<(), ReadError> {
        let counts = [
            self.vertex_count,
            self.coordinates.len(),
            self.normals.len(),
        ];
        self.polygon.clear();
        for token in tokens {
            self.polygon
                .push(parse_corner(token, counts, self.face_count, line)?);
        }
        if self.polygon.len() < 3 {
            return Err(too_few(line, "f", self.polygon.len(), 3));
        }
        self.face_count += self.polygon.len() - 2;
        if self.face_count <= self.limits.max_faces {
            self.faces.push_fan(&self.polygon);
            self.face_materials.resize(self.face_count, self.material);
        }
        Ok(())
    }

    fn use_material(&mut self, tokens: Tokens<'_>) {
        let name: Vec<&[u8]> = tokens.collect();
        let next = self.materials.len() as u32 + 1;
        self.material = *self.materials.entry(name.join(&b' ')).or_insert(next);
    }

    fn finish(mut self, text: &[u8]) -> Result<Mesh, ReadError> {
        if self.positions.is_empty() {
            return Err(ReadError::NoVertices { format: "OBJ" });
        }
        let vertices = self.positions.len();
        if self.faces.len() == 0 {
            return Err(ReadError::NoFaces {
                format: "OBJ",
                vertices,
            });
        }
        let counts = [vertices, self.coordinates.len(), self.normals.len()];
        self.faces
            .check(counts)
            .map_err(|out| out.with_line(line_of_face(text, out.face())))?;
        check::clean_normals(&mut self.normals);
        let (faces, coordinate_faces, normal_faces) = self.faces.into_parts();
        Ok(Mesh {
            positions: self.positions,
            faces,
            normals: attribute(self.normals, normal_faces),
            colors: self.colors.finish().map(Attribute::per_vertex),
            texture_coordinates: attribute(self.coordinates, coordinate_faces),
            materials: materials_of_faces(&self.face_materials),
            image: None,
        })
    }
}

fn attribute<T>(values: Vec<T>, faces: Option<Vec<[u32; 3]>>) -> Option<Attribute<T>> {
    faces.map(|faces| Attribute {
        values,
        faces: Some(faces),
    })
}

/// Parses as many tokens as there is room for; returns how many there were.
fn parse_numbers(
    line: usize,
    record: &str,
    tokens: Tokens<'_>,
    numbers: &mut [f64],
) -> Result<usize, ReadError> {
    let mut count = 0;
    for (slot, token) in numbers.iter_mut().zip(tokens) {
        *slot = number(token).ok_or_else(|| ReadError::Obj {
            line,
            message: format!(
                "`{record}` is followed by {}, which is not a number",
                shown(token)
            ),
        })?;
        count += 1;
    }
    Ok(count)
}

fn too_few(line: usize, record: &str, found: usize, needed: usize) -> ReadError {
    let what = if record == "f" { "corner" } else { "number" };
    let found = counted(found as u64, what);
    let verb = if needed == 1 { "is" } else { "are" };
    let message = format!("`{record}` has {found}, but at least {needed} {verb} needed");
    ReadError::Obj { line, message }
}

/// The line that triangle `face` came from. Only called on the way to an error, so
/// that no line number has to be kept for every face.
fn line_of_face(text: &[u8], face: usize) -> Option<usize> {
    let mut count = 0;
    for (line, record) in records(text) {
        let without_comment = record
            .split(|&byte| byte == b'#')
            .next()
            .unwrap_or_default();
        let mut tokens = Tokens::new(without_comment);
        if matches!(tokens.next(), Some(b"f" | b"fo")) {
            count += tokens.count().saturating_sub(2);
            if count > face {
                return Some(line);
            }
        }
    }
    None
}
