//! Gives every corner attribute one value per vertex, as PLY and glTF need it.

use crate::{Attribute, Mesh};
use std::borrow::Cow;

/// Position, normal, color, texture coordinate and material of a corner; 0 where absent.
type Key = [u32; 5];

/// A mesh with one value per position in every attribute.
#[derive(Debug, Clone, PartialEq)]
pub struct PointMesh {
    /// The mesh.
    pub mesh: Mesh,
    /// Positions that are repeated for another attribute, but for the first of each.
    pub repeated: usize,
    /// Positions that were left out because no face uses them.
    pub left_out: usize,
}

impl Mesh {
    /// The same mesh with one value per position in every attribute.
    ///
    /// Where the corners at one position differ in an attribute, the position is
    /// repeated; positions that no face uses are left out then. The order of the positions stays. A mesh whose
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
        let materials = usable(self.materials.as_ref(), self);
        let mut points = Points::new(self.positions.len());
        let corner_points: Vec<[u32; 3]> = (0..self.faces.len())
            .map(|face| {
                std::array::from_fn(|corner| {
                    points.number_of([
                        self.faces[face][corner],
                        index_at(normals, self, face, corner),
                        index_at(colors, self, face, corner),
                        index_at(coordinates, self, face, corner),
                        index_at(materials, self, face, corner),
                    ])
                })
            })
            .collect();
        let (keys, numbers) = points.by_position();
        let faces = corner_points
            .iter()
            .map(|corners| corners.map(|point| numbers[point as usize]))
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
            materials: materials.map(|a| gather(a, &keys, 4)),
            image: self.image.clone(),
        })
    }

    /// The same as [`with_attributes_per_vertex`](Self::with_attributes_per_vertex), and what that
    /// did to the vertices.
    #[must_use]
    pub fn into_points(self) -> PointMesh {
        let vertices = self.positions.len();
        if !self.has_corner_attributes() {
            return PointMesh {
                mesh: self,
                repeated: 0,
                left_out: 0,
            };
        }
        let mut is_used = vec![false; vertices];
        for &vertex in self.faces.iter().flatten() {
            is_used[vertex as usize] = true;
        }
        let used = is_used.iter().filter(|used| **used).count();
        let mesh = self.with_attributes_per_vertex().into_owned();
        PointMesh {
            repeated: mesh.positions.len() - used,
            left_out: vertices - used,
            mesh,
        }
    }

    fn has_corner_attributes(&self) -> bool {
        fn own<T>(attribute: Option<&Attribute<T>>) -> bool {
            attribute.is_some_and(|a| a.faces.is_some())
        }
        own(self.normals.as_ref())
            || own(self.colors.as_ref())
            || own(self.texture_coordinates.as_ref())
            || own(self.materials.as_ref())
    }
}

/// The different corners so far, those at one position in a chain.
struct Points {
    keys: Vec<Key>,
    /// By position, the last point there.
    last: Vec<u32>,
    /// By point, the one before it at the same position.
    before: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Points {
    fn new(position_count: usize) -> Self {
        Self {
            keys: Vec::with_capacity(position_count),
            last: vec![NONE; position_count],
            before: Vec::with_capacity(position_count),
        }
    }

    /// The number of the point with this key, a new one if there is none.
    fn number_of(&mut self, key: Key) -> u32 {
        let last = &mut self.last[key[0] as usize];
        let mut point = *last;
        while point != NONE {
            if self.keys[point as usize] == key {
                return point;
            }
            point = self.before[point as usize];
        }
        // At most three points a face, and faces fit into 32 bits.
        let new = u32::try_from(self.keys.len()).unwrap_or(NONE);
        self.keys.push(key);
        self.before.push(std::mem::replace(last, new));
        new
    }

    /// The keys in the order of their positions, and where each point has gone.
    fn by_position(&self) -> (Vec<Key>, Vec<u32>) {
        let mut keys = Vec::with_capacity(self.keys.len());
        let mut numbers = vec![0; self.keys.len()];
        for &last in &self.last {
            let start = keys.len();
            let mut point = last;
            while point != NONE {
                keys.push(self.keys[point as usize]);
                point = self.before[point as usize];
            }
            // Oldest first.
            keys[start..].reverse();
            let (mut number, mut point) = (keys.len(), last);
            while point != NONE {
                number -= 1;
                numbers[point as usize] = u32::try_from(number).unwrap_or(NONE);
                point = self.before[point as usize];
            }
        }
        (keys, numbers)
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
