//! The mesh that readers give and writers take.

use crate::Image;

/// A triangle mesh as its file has it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Coordinates in the mesh's own unit.
    pub positions: Vec<[f64; 3]>,
    /// Indices into `positions`, counterclockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Normals of about unit length; a zero vector where the file has none.
    pub normals: Option<Attribute<[f32; 3]>>,
    /// Red, green, blue, alpha, 0 to 255.
    pub colors: Option<Attribute<[u8; 4]>>,
    /// Texture coordinates, usually 0 to 1, v upwards: (0, 0) is the lower left corner of the image.
    pub texture_coordinates: Option<Attribute<[f32; 2]>>,
    /// The image that lies on it. Writers other than [`glb`](crate::glb)'s leave it out.
    pub image: Option<Image>,
}

/// Values on the vertices or on the corners of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Attribute<T> {
    /// The values.
    pub values: Vec<T>,
    /// `None`: `values[i]` belongs to `positions[i]`. `Some`: for each face of the
    /// mesh, the indices into `values` of its three corners (OBJ).
    pub faces: Option<Vec<[u32; 3]>>,
}

impl<T> Attribute<T> {
    /// One value per position.
    #[must_use]
    pub fn per_vertex(values: Vec<T>) -> Self {
        Self {
            values,
            faces: None,
        }
    }
}
