//! Native frames, as `proto` defines them.

use crate::{Attribute, Limits, Mesh, ReadError, check};
use steadymesh_proto::NativeFrame;

/// Reads a native frame. Vertices and faces are those of the frame, in its order.
///
/// # Errors
///
/// See [`ReadError`].
pub fn read(bytes: &[u8], limits: &Limits) -> Result<Mesh, ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::EmptyBody);
    }
    // Its arrays are checked against the length of `bytes`: they take no more than that.
    let frame = NativeFrame::decode(bytes)?;
    let (vertices, faces) = (frame.positions.len(), frame.faces.len());
    check::vertex_limit(vertices, limits)?;
    check::face_limit(faces, limits)?;
    let format = "native";
    if vertices == 0 {
        return Err(ReadError::NoVertices { format });
    }
    if faces == 0 {
        return Err(ReadError::NoFaces { format, vertices });
    }
    check::faces(&frame.faces, vertices)?;
    let positions: Vec<[f64; 3]> = frame.positions.iter().map(|p| p.map(f64::from)).collect();
    check::positions(&positions)?;
    let mut normals = frame.normals;
    if let Some(normals) = &mut normals {
        check::clean_normals(normals);
    }
    if let Some(values) = &frame.texture_coordinates {
        check::texture_coordinates(values)?;
    }
    Ok(Mesh {
        positions,
        faces: frame.faces,
        normals: normals.map(Attribute::per_vertex),
        colors: frame.colors.map(Attribute::per_vertex),
        texture_coordinates: frame.texture_coordinates.map(Attribute::per_vertex),
        materials: None,
        image: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits {
        max_vertices: 100,
        max_faces: 100,
        max_memory_bytes: 1 << 20,
    };

    fn triangle() -> NativeFrame {
        NativeFrame {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            faces: vec![[0, 1, 2]],
            colors: Some(vec![[1, 2, 3, 4]; 3]),
            ..NativeFrame::default()
        }
    }

    fn error_of(frame: &NativeFrame) -> ReadError {
        read(&frame.encode(), &LIMITS).unwrap_err()
    }

    #[test]
    fn a_native_frame_is_read_with_its_attributes() {
        let mesh = read(&triangle().encode(), &LIMITS).unwrap();
        assert_eq!(mesh.positions[1], [1.0, 0.0, 0.0]);
        assert_eq!(mesh.faces, [[0, 1, 2]]);
        assert_eq!(mesh.colors.unwrap().values, [[1, 2, 3, 4]; 3]);
    }

    #[test]
    fn what_is_wrong_with_a_native_frame_is_named_with_its_place() {
        let mut frame = triangle();
        frame.positions[2][1] = f32::NAN;
        assert_eq!(error_of(&frame).to_string(), "vertex 2 is not finite");

        let mut frame = triangle();
        frame.faces[0][2] = 3;
        let message = "face 0 refers to vertex 3, but there are 3 vertices";
        assert_eq!(error_of(&frame).to_string(), message);

        let mut frame = triangle();
        frame.faces.clear();
        assert!(matches!(error_of(&frame), ReadError::NoFaces { .. }));
        assert!(matches!(
            error_of(&NativeFrame::default()),
            ReadError::NoVertices { .. }
        ));
        assert_eq!(read(b"", &LIMITS), Err(ReadError::EmptyBody));
    }

    #[test]
    fn more_than_the_limits_allow_is_refused() {
        let limits = Limits {
            max_faces: 0,
            ..LIMITS
        };
        let error = read(&triangle().encode(), &limits).unwrap_err();
        assert!(matches!(
            error,
            ReadError::LimitExceeded {
                what: "faces",
                found: 1,
                limit: 0
            }
        ));
    }
}
