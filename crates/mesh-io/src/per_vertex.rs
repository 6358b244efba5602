//! Gives every corner attribute one value per vertex, as PLY and glTF need it.

use crate::{Attribute, Mesh};
use std::borrow::Cow;
use std::collections::HashMap;

/// Position, normal, color and texture coordinate of a corner; 0 where absent.
type Key = [u32; 4];

impl Mesh {
    /// The same mesh with one value per position in every attribute.
    ///
    /// Where the corners at one position differ in an attribute, the position is
    /// repeated; positions that no face uses are left out then. A mesh whose
    /// attributes are all per vertex comes back as it is. Attributes whose faces do
    /// not match those of the mesh are left out.
    #[must_use]
    pub fn with_attributes_per_vertex(&self) -> Cow<'_, Self> {
        if !self.has_corner_attributes() {
            return Cow::Borrowed(self);
        }
        let normals = usable(self.normals.as_ref(), self);
        let colors = usable(self.colors.as_ref(), self);
        let coordinates = usable(self.texture_coordinates.as_ref(), self);
        let mut vertex_of_key = HashMap::new();
        let mut keys: Vec<Key> = Vec::new();
        let faces = (0..self.faces.len())
            .map(|face| {
                std::array::from_fn(|corner| {
                    let key = [
                        self.faces[face][corner],
                        index_at(normals, self, face, corner),
                        index_at(colors, self, face, corner),
                        index_at(coordinates, self, face, corner),
                    ];
                    *vertex_of_key.entry(key).or_insert_with(|| {
                        keys.push(key);
                        // At most three vertices a face, and faces fit into 32 bits.
                        u32::try_from(keys.len() - 1).unwrap_or(u32::MAX)
                    })
                })
            })
            .collect();
        Cow::Owned(Self {
            positions: keys
                .iter()
                .map(|key| self.positions[key[0] as usize])
                .collect(),
            faces,
            normals: normals.map(|a| gather(a, &keys, 1)),
            colors: colors.map(|a| gather(a, &keys, 2)),
            texture_coordinates: coordinates.map(|a| gather(a, &keys, 3)),
        })
    }

    fn has_corner_attributes(&self) -> bool {
        fn own<T>(attribute: Option<&Attribute<T>>) -> bool {
            attribute.is_some_and(|a| a.faces.is_some())
        }
        own(self.normals.as_ref())
            || own(self.colors.as_ref())
            || own(self.texture_coordinates.as_ref())
    }
}

fn usable<'a, T>(attribute: Option<&'a Attribute<T>>, mesh: &Mesh) -> Option<&'a Attribute<T>> {
    attribute.filter(|a| match &a.faces {
        None => a.values.len() == mesh.positions.len(),
        Some(faces) => {
            faces.len() == mesh.faces.len()
                && faces
                    .iter()
                    .flatten()
                    .all(|&index| (index as usize) < a.values.len())
        }
    })
}

fn index_at<T>(attribute: Option<&Attribute<T>>, mesh: &Mesh, face: usize, corner: usize) -> u32 {
    match attribute {
        None => 0,
        Some(Attribute { faces: None, .. }) => mesh.faces[face][corner],
        Some(Attribute {
            faces: Some(faces), ..
        }) => faces[face][corner],
    }
}

fn gather<T: Copy>(attribute: &Attribute<T>, keys: &[Key], slot: usize) -> Attribute<T> {
    let value = |key: &Key| attribute.values[key[slot] as usize];
    Attribute::per_vertex(keys.iter().map(value).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seam_repeats_its_positions_and_nothing_else() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0; 3], [2.0; 3], [3.0; 3]],
            faces: vec![[0, 1, 2], [2, 1, 3]],
            texture_coordinates: Some(Attribute {
                values: vec![[0.0; 2], [0.1; 2], [0.2; 2], [0.3; 2], [0.9; 2]],
                faces: Some(vec![[0, 1, 2], [4, 1, 3]]),
            }),
            ..Mesh::default()
        };
        let split = mesh.with_attributes_per_vertex();
        assert_eq!(
            split.positions,
            [[0.0; 3], [1.0; 3], [2.0; 3], [2.0; 3], [3.0; 3]]
        );
        assert_eq!(split.faces, [[0, 1, 2], [3, 1, 4]]);
        let values = &split.texture_coordinates.as_ref().unwrap().values;
        assert_eq!(values, &[[0.0; 2], [0.1; 2], [0.2; 2], [0.9; 2], [0.3; 2]]);
    }
}
