//! What every reader checks.

use crate::{Limits, ReadError};

/// Beyond this a difference of two coordinates, or the diagonal of their bounding
/// box, might not fit into a 32-bit float.
const MAX_COORDINATE: f64 = f32::MAX as f64 / 4.0;

/// Checks one position; `line` is `None` in binary formats.
pub(crate) fn position(
    position: [f64; 3],
    vertex: usize,
    line: Option<usize>,
) -> Result<(), ReadError> {
    // One comparison per axis accepts all good numbers; NaN fails it as well.
    if position.iter().all(|value| value.abs() <= MAX_COORDINATE) {
        return Ok(());
    }
    if position.iter().all(|value| value.is_finite()) {
        let value = position
            .into_iter()
            .find(|v| v.abs() > MAX_COORDINATE)
            .unwrap_or_default();
        return Err(ReadError::CoordinateTooLarge {
            vertex,
            value,
            line,
        });
    }
    Err(ReadError::NotFinite {
        what: "vertex",
        index: vertex,
        line,
    })
}

/// Checks all positions of a binary format.
pub(crate) fn positions(positions: &[[f64; 3]]) -> Result<(), ReadError> {
    positions
        .iter()
        .enumerate()
        .try_for_each(|(vertex, &p)| position(p, vertex, None))
}

/// Checks one texture coordinate; `line` is `None` in binary formats.
pub(crate) fn texture_coordinate(
    value: [f32; 2],
    index: usize,
    line: Option<usize>,
) -> Result<(), ReadError> {
    if value.iter().all(|number| number.is_finite()) {
        return Ok(());
    }
    Err(ReadError::NotFinite {
        what: "texture coordinate",
        index,
        line,
    })
}

/// Checks all texture coordinates of a binary format.
pub(crate) fn texture_coordinates(values: &[[f32; 2]]) -> Result<(), ReadError> {
    values
        .iter()
        .enumerate()
        .try_for_each(|(index, &value)| texture_coordinate(value, index, None))
}

/// Replaces normals that are not finite, as exporters write them for degenerate
/// faces, by zero vectors.
pub(crate) fn clean_normals(values: &mut [[f32; 3]]) {
    for value in values {
        if value.iter().any(|number| !number.is_finite()) {
            *value = [0.0; 3];
        }
    }
}

/// Checks that all faces refer to one of `vertices` positions.
pub(crate) fn faces(faces: &[[u32; 3]], vertices: usize) -> Result<(), ReadError> {
    for (face, corners) in faces.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&index| index as usize >= vertices) {
            return Err(ReadError::IndexOutOfRange {
                face,
                what: "vertex",
                index: i64::from(index),
                count: vertices,
                line: None,
            });
        }
    }
    Ok(())
}

/// Checks the number of vertices, counted or promised.
pub(crate) fn vertex_limit(found: usize, limits: &Limits) -> Result<(), ReadError> {
    // Indices are 32 bits wide whatever the limit says.
    limit(
        "vertices",
        found,
        limits.max_vertices.min(u32::MAX as usize),
    )
}

/// Checks the number of faces, counted or promised.
pub(crate) fn face_limit(found: usize, limits: &Limits) -> Result<(), ReadError> {
    limit("faces", found, limits.max_faces.min(u32::MAX as usize))
}

fn limit(what: &'static str, found: usize, limit: usize) -> Result<(), ReadError> {
    if found > limit {
        return Err(ReadError::LimitExceeded { what, found, limit });
    }
    Ok(())
}
