//! A frame in parts (`multipart/form-data`, RFC 7578): its mesh and its texture image.

use std::convert::Infallible;

use bytes::Bytes;
use futures_util::stream;
use multer::Multipart;
use steadymesh_mesh_io::{ImageInfo, sniff};
use steadymesh_proto::Bundle;

use super::error::Problem;

/// The boundary of a body of this content type; none if it is not one of parts.
///
/// # Errors
///
/// 400 if it is one and names no boundary.
pub(super) fn boundary(content_type: &str) -> Result<Option<String>, Problem> {
    const TYPE: &str = "multipart/form-data";
    let essence = content_type.split(';').next().unwrap_or_default().trim();
    if !essence.eq_ignore_ascii_case(TYPE) {
        return Ok(None);
    }
    multer::parse_boundary(content_type).map(Some).map_err(|_| {
        Problem::bad_request("the Content-Type is multipart/form-data and names no boundary")
    })
}

/// The same frame in one piece: a bundle, or the mesh alone if there is no image.
///
/// # Errors
///
/// 400 says what is wrong with the parts.
pub(super) async fn join(body: Bytes, boundary: String) -> Result<Bytes, Problem> {
    let chunks = stream::iter([Ok::<_, Infallible>(body)]);
    let mut parts = Multipart::new(chunks, boundary);
    let (mut mesh, mut image) = (None, None);
    while let Some(part) = parts.next_field().await.map_err(|error| refused(&error))? {
        let name = part.name().unwrap_or_default().to_owned();
        let bytes = part.bytes().await.map_err(|error| refused(&error))?;
        let kind = kind_of(&name, &bytes)?;
        let place = match kind {
            "mesh" => &mut mesh,
            _ => &mut image,
        };
        if place.replace(bytes).is_some() {
            return Err(Problem::bad_request(format!(
                "there are two parts that are the {kind}"
            )));
        }
    }
    let mesh = mesh.ok_or_else(|| Problem::bad_request("there is no part named \"mesh\""))?;
    // An empty file field of a form.
    let Some(image) = image.filter(|image| !image.is_empty()) else {
        return Ok(mesh);
    };
    if u32::try_from(mesh.len()).is_err() {
        return Err(Problem::bad_request("the mesh has 4 GiB or more"));
    }
    let bundle = Bundle {
        seq: None,
        capture_time_us: None,
        mesh: &mesh,
        image: &image,
    };
    Ok(bundle.encode().into())
}

/// Whether a part is the mesh or the texture: by its name, or else by its first bytes.
fn kind_of(name: &str, bytes: &[u8]) -> Result<&'static str, Problem> {
    match name {
        "mesh" => Ok("mesh"),
        "texture" => Ok("texture"),
        _ if sniff(bytes).is_some() => Ok("mesh"),
        _ if ImageInfo::read(bytes).is_ok() => Ok("texture"),
        _ => {
            let name: String = name.chars().filter(|c| !c.is_control()).take(64).collect();
            Err(Problem::bad_request(format!(
                "there is a part named \"{name}\" that is neither a mesh nor an image: a frame has the \
                 parts \"mesh\" and, if it has an image, \"texture\""
            )))
        }
    }
}

fn refused(error: &multer::Error) -> Problem {
    Problem::bad_request(format!("the parts of the body cannot be read: {error}"))
}
