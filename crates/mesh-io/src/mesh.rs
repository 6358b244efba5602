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
    /// Which material each face has, by number, if they have at least two: the values are numbers, and
    /// all corners of a face have the same.
    pub materials: Option<Attribute<u16>>,
    /// The image that lies on it. Writers other than [`glb`](crate::glb)'s leave it out.
    pub image: Option<Image>,
}

impl Mesh {
    /// The number of a face's material.
    #[must_use]
    pub fn material_of(&self, face: usize) -> Option<u16> {
        let materials = self.materials.as_ref()?;
        let [corner, ..] = match &materials.faces {
            Some(faces) => *faces.get(face)?,
            None => *self.faces.get(face)?,
        };
        materials.values.get(corner as usize).copied()
    }
}

/// Numbers materials by their first use, given which each face has; none if all have the same.
pub(crate) fn materials_of_faces<K: Ord + Copy>(faces: &[K]) -> Option<Attribute<u16>> {
    if faces.iter().all(|material| *material == faces[0]) {
        return None;
    }
    let mut numbers = std::collections::BTreeMap::new();
    let of_faces: Vec<[u32; 3]> = faces
        .iter()
        .map(|material| {
            // Beyond what can be counted they are all the last one.
            let next = numbers.len().min(usize::from(u16::MAX)) as u32;
            [*numbers.entry(*material).or_insert(next); 3]
        })
        .collect();
    Some(Attribute {
        values: (0..=u16::MAX).take(numbers.len()).collect(),
        faces: Some(of_faces),
    })
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
