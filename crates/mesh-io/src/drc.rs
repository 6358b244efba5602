//! Draco files.

use crate::{Attribute, Limits, Mesh, ReadError, check};
use steadymesh_draco::{DecodeLimits, DecodedMesh, decode};

/// Reads a Draco mesh. Vertices are those of the file, in its order.
///
/// # Errors
///
/// See [`ReadError`].
pub fn read(bytes: &[u8], limits: &Limits) -> Result<Mesh, ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::EmptyBody);
    }
    let decoded = decode(bytes, &decode_limits(limits))?;
    let mesh = into_mesh(decoded)?;
    check::positions(&mesh.positions)?;
    Ok(mesh)
}

pub(crate) fn decode_limits(limits: &Limits) -> DecodeLimits {
    DecodeLimits {
        max_vertices: limits.max_vertices,
        max_faces: limits.max_faces,
        max_memory_bytes: limits.max_memory_bytes,
    }
}

/// Converts what the decoder checked; positions are left to the caller.
fn into_mesh(decoded: DecodedMesh) -> Result<Mesh, ReadError> {
    let mut normals = decoded.normals;
    if let Some(normals) = &mut normals {
        check::clean_normals(normals);
    }
    if let Some(values) = &decoded.texture_coordinates {
        check::texture_coordinates(values)?;
    }
    Ok(Mesh {
        positions: decoded.positions.iter().map(|p| p.map(f64::from)).collect(),
        faces: decoded.faces,
        normals: normals.map(Attribute::per_vertex),
        colors: decoded.colors.map(Attribute::per_vertex),
        texture_coordinates: decoded.texture_coordinates.map(Attribute::per_vertex),
        materials: decoded.materials.map(Attribute::per_vertex),
        image: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use steadymesh_draco::{EncodeOptions, MeshView, encode};

    const LIMITS: Limits = Limits {
        max_vertices: 100,
        max_faces: 100,
        max_memory_bytes: 16 << 20,
    };

    fn triangle() -> Vec<u8> {
        let mesh = MeshView {
            positions: &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            point_vertices: None,
            faces: &[[0, 1, 2]],
            normals: None,
            colors: None,
            texture_coordinates: Some(&[[0.0; 2], [1.0, 0.0], [0.0, 1.0]]),
            materials: None,
        };
        encode(&mesh, &EncodeOptions::default()).unwrap()
    }

    #[test]
    fn a_draco_file_is_read_with_its_attributes() {
        let mesh = read(&triangle(), &LIMITS).unwrap();
        assert_eq!((mesh.positions.len(), mesh.faces.len()), (3, 1));
        assert_eq!(mesh.texture_coordinates.unwrap().values.len(), 3);
    }

    #[test]
    fn each_limit_has_its_own_error() {
        let error = |limits| read(&triangle(), &limits).unwrap_err();
        assert_eq!(
            error(Limits {
                max_vertices: 2,
                ..LIMITS
            }),
            ReadError::LimitExceeded {
                what: "vertices",
                found: 3,
                limit: 2
            }
        );
        assert_eq!(
            error(Limits {
                max_memory_bytes: 100,
                ..LIMITS
            }),
            ReadError::OutOfMemory { limit: 100 }
        );
    }

    #[test]
    fn an_empty_body_and_noise_are_told_apart() {
        assert_eq!(read(b"", &LIMITS), Err(ReadError::EmptyBody));
        let error = read(b"hello", &LIMITS).unwrap_err();
        assert_eq!(
            error.to_string(),
            "not a Draco file: it does not begin with \"DRACO\""
        );
    }
}
