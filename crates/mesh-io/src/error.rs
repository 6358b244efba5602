//! Why bytes are not a usable mesh.

use steadymesh_draco::DecodeError;
use steadymesh_proto::wording::counted;

/// Why bytes are not a usable mesh. Vertices and faces are counted from 0, lines from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// There is nothing to read.
    #[error("the body is empty; send a mesh file")]
    EmptyBody,
    /// More vertices or faces than allowed.
    #[error("the mesh has {found} {what}; the limit is {limit}")]
    LimitExceeded {
        /// `vertices` or `faces`.
        what: &'static str,
        /// How many there are, as far as was counted.
        found: usize,
        /// How many there may be.
        limit: usize,
    },
    /// A decoder needs more memory than allowed.
    #[error("decoding the mesh needs more memory than the limit of {limit} bytes")]
    OutOfMemory {
        /// [`Limits::max_memory_bytes`](crate::Limits::max_memory_bytes).
        limit: usize,
    },
    /// No vertices at all.
    #[error("the {format} file has no vertices; a mesh needs at least three")]
    NoVertices {
        /// The format's usual name.
        format: &'static str,
    },
    /// Vertices, but no faces.
    #[error(
        "the {format} file has {} but no faces; point clouds and line sets cannot be used, send \
         triangles or polygons",
        counted(*.vertices as u64, "vertex")
    )]
    NoFaces {
        /// The format's usual name.
        format: &'static str,
        /// How many vertices there are.
        vertices: usize,
    },
    /// An infinite or undefined number.
    #[error("{}{what} {index} is not finite", on_line(*.line))]
    NotFinite {
        /// `vertex` for positions, or `texture coordinate`.
        what: &'static str,
        /// Its index.
        index: usize,
        /// The line in a text format.
        line: Option<usize>,
    },
    /// A coordinate so large that a 32-bit float cannot hold the mesh's extent.
    #[error(
        "{}vertex {vertex} has the coordinate {value:e}, which is beyond the range of 32-bit \
         floats; choose a larger unit",
        on_line(*.line)
    )]
    CoordinateTooLarge {
        /// The index of the vertex.
        vertex: usize,
        /// The coordinate.
        value: f64,
        /// The line in a text format.
        line: Option<usize>,
    },
    /// A face refers to something that is not there.
    #[error(
        "{}face {face} refers to {what} {index}, but there {}",
        on_line(*.line),
        are(*.count, .what)
    )]
    IndexOutOfRange {
        /// The index of the face.
        face: usize,
        /// `vertex`, `texture coordinate` or `normal`.
        what: &'static str,
        /// The index as the file gives it: from 1 in OBJ, from 0 elsewhere.
        index: i64,
        /// How many there are.
        count: usize,
        /// The line in a text format.
        line: Option<usize>,
    },
    /// A line of an OBJ file does not make sense.
    #[error("line {line}: {message}")]
    Obj {
        /// The line.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A PLY file does not make sense.
    #[error("PLY: {message}")]
    Ply {
        /// What is wrong and where.
        message: String,
    },
    /// A glTF file does not make sense or needs what is not supported.
    #[error("glTF: {message}")]
    Glb {
        /// What is wrong and where.
        message: String,
    },
    /// A native frame does not make sense.
    #[error("native frame: {0}")]
    Native(#[from] steadymesh_proto::InvalidNativeFrame),
    /// A bundle does not make sense.
    #[error("bundle: {0}")]
    Bundle(#[from] steadymesh_proto::InvalidBundle),
    /// A bundle whose mesh is a bundle.
    #[error(
        "bundle: there is a bundle inside of a bundle; its mesh must be a mesh file or a native frame"
    )]
    BundleInBundle,
    /// A bundle's mesh is none.
    #[error(
        "bundle: the bundle's mesh begins like none of OBJ, PLY, glTF, Draco and native frames"
    )]
    BundledMesh,
    /// An image cannot be used.
    #[error("the image: {message}")]
    Image {
        /// What is wrong.
        message: String,
    },
    /// Draco data cannot be decoded.
    #[error(transparent)]
    Draco(DecodeError),
}

impl From<DecodeError> for ReadError {
    fn from(error: DecodeError) -> Self {
        match error {
            DecodeError::LimitExceeded { what, found, limit } => {
                Self::LimitExceeded { what, found, limit }
            }
            DecodeError::OutOfMemory { limit } => Self::OutOfMemory { limit },
            DecodeError::Empty { vertices: 0, .. } => Self::NoVertices { format: "Draco" },
            DecodeError::Empty { vertices, .. } => Self::NoFaces {
                format: "Draco",
                vertices,
            },
            other => Self::Draco(other),
        }
    }
}

fn on_line(line: Option<usize>) -> String {
    line.map(|line| format!("line {line}: "))
        .unwrap_or_default()
}

/// How many there are: `are 3 vertices`, `is 1 vertex`.
pub(crate) fn are(count: usize, one: &str) -> String {
    let verb = if count == 1 { "is" } else { "are" };
    format!("{verb} {}", counted(count as u64, one))
}
