//! The mesh types of both directions.

/// A borrowed triangle mesh to encode. Every attribute holds one value per position.
#[derive(Debug, Clone, Copy)]
pub struct MeshView<'a> {
    /// Finite coordinates.
    pub positions: &'a [[f32; 3]],
    /// Indices into `positions`, counterclockwise seen from outside.
    pub faces: &'a [[u32; 3]],
    /// Unit normals; the length of each is lost.
    pub normals: Option<&'a [[f32; 3]]>,
    /// Red, green, blue, alpha, 0 to 255.
    pub colors: Option<&'a [[u8; 4]]>,
    /// Texture coordinates, usually 0 to 1.
    pub texture_coordinates: Option<&'a [[f32; 2]]>,
}

/// A decoded triangle mesh. Every attribute holds one value per position.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DecodedMesh {
    /// Coordinates. Not checked to be finite: that is up to the reader.
    pub positions: Vec<[f32; 3]>,
    /// Indices into `positions`, each checked to be in range.
    pub faces: Vec<[u32; 3]>,
    /// Normals, about unit length.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Red, green, blue, alpha, 0 to 255; alpha is 255 where the file has none.
    pub colors: Option<Vec<[u8; 4]>>,
    /// Texture coordinates, usually 0 to 1.
    pub texture_coordinates: Option<Vec<[f32; 2]>>,
}

impl DecodedMesh {
    /// Borrows the mesh, for example to encode it again.
    #[must_use]
    pub fn view(&self) -> MeshView<'_> {
        MeshView {
            positions: &self.positions,
            faces: &self.faces,
            normals: self.normals.as_deref(),
            colors: self.colors.as_deref(),
            texture_coordinates: self.texture_coordinates.as_deref(),
        }
    }
}
