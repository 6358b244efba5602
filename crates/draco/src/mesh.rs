//! The mesh types of both directions.

/// A borrowed triangle mesh to encode. Every attribute holds one value per point.
#[derive(Debug, Clone, Copy)]
pub struct MeshView<'a> {
    /// Finite coordinates, one per vertex.
    pub positions: &'a [[f32; 3]],
    /// The vertex of each point; none if they are the same. Where a texture has a seam, a vertex
    /// has several points, and the surface stays in one piece.
    pub point_vertices: Option<&'a [u32]>,
    /// Indices of points, counterclockwise seen from outside.
    pub faces: &'a [[u32; 3]],
    /// Unit normals; the length of each is lost.
    pub normals: Option<&'a [[f32; 3]]>,
    /// Red, green, blue, alpha, 0 to 255.
    pub colors: Option<&'a [[u8; 4]]>,
    /// Texture coordinates, usually 0 to 1.
    pub texture_coordinates: Option<&'a [[f32; 2]]>,
    /// Numbers of materials; all points of a face have the same.
    pub materials: Option<&'a [u16]>,
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
    /// Numbers of materials.
    pub materials: Option<Vec<u16>>,
}

impl MeshView<'_> {
    /// How many points there are.
    #[must_use]
    pub fn point_count(&self) -> usize {
        self.point_vertices
            .map_or(self.positions.len(), <[u32]>::len)
    }

    /// The vertex of a point that there is.
    pub(crate) fn vertex_of(&self, point: u32) -> u32 {
        self.point_vertices
            .map_or(point, |vertices| vertices[point as usize])
    }
}

impl DecodedMesh {
    /// Borrows the mesh, for example to encode it again.
    #[must_use]
    pub fn view(&self) -> MeshView<'_> {
        MeshView {
            positions: &self.positions,
            point_vertices: None,
            faces: &self.faces,
            normals: self.normals.as_deref(),
            colors: self.colors.as_deref(),
            texture_coordinates: self.texture_coordinates.as_deref(),
            materials: self.materials.as_deref(),
        }
    }
}
