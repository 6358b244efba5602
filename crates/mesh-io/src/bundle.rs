//! Bundles, as `proto` defines them: a mesh in any other format, and its image.

use steadymesh_proto::Bundle;

use crate::{Format, Image, Limits, Mesh, ReadError, read as read_as, sniff};

/// Reads a bundle: the mesh as its own format has it, with the bundle's image in place of any that
/// the mesh's file has.
///
/// # Errors
///
/// See [`ReadError`].
pub fn read(bytes: &[u8], limits: &Limits) -> Result<Mesh, ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::EmptyBody);
    }
    let bundle = Bundle::decode(bytes)?;
    let start = bytes.len() - bundle.image.len();
    let image = Image::within(bytes, start..bytes.len())?;
    let mut mesh = match sniff(bundle.mesh) {
        // It would have two images.
        Some(Format::Bundle) => return Err(ReadError::BundleInBundle),
        Some(format) => read_as(bundle.mesh, format, limits)?,
        None => return Err(ReadError::BundledMesh),
    };
    mesh.image = Some(image);
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::tests::png_header;
    use crate::{ImageBytes, ImageFormat};

    const LIMITS: Limits = Limits {
        max_vertices: 100,
        max_faces: 100,
        max_memory_bytes: 1 << 20,
    };
    const OBJ: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    fn bundle(mesh: &[u8], image: &[u8]) -> Vec<u8> {
        let (seq, capture_time_us) = (None, None);
        Bundle {
            seq,
            capture_time_us,
            mesh,
            image,
        }
        .encode()
    }

    #[test]
    fn a_bundle_is_its_mesh_with_its_image() {
        let png = png_header(8, 4);
        let bytes = bundle(OBJ, &png);
        assert_eq!(sniff(&bytes), Some(Format::Bundle));
        let mesh = read(&bytes, &LIMITS).unwrap();
        assert_eq!((mesh.positions.len(), mesh.faces.len()), (3, 1));
        let image = mesh.image.unwrap();
        assert_eq!((image.info.format, image.info.width), (ImageFormat::Png, 8));
        let range = bytes.len() - png.len()..bytes.len();
        assert_eq!(image.bytes, ImageBytes::Within(range));
    }

    #[test]
    fn what_is_wrong_with_a_bundle_is_named() {
        let png = png_header(8, 4);
        let message = |bytes: &[u8]| read(bytes, &LIMITS).unwrap_err().to_string();
        assert!(message(&bundle(b"hello", &png)).contains("bundle's mesh"));
        assert!(message(&bundle(OBJ, b"hello")).starts_with("the image:"));
        let inner = bundle(OBJ, &png);
        assert!(message(&bundle(&inner, &png)).contains("inside of a bundle"));
        assert!(message(b"SMB1").starts_with("bundle: "));
    }
}
