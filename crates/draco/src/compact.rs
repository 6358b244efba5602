//! Leaves out what EdgeBreaker would leave out, for the sequential method, whose
//! decoder refuses files with more than three vertices a face.

use crate::{DecodedMesh, MeshView};

/// A copy without degenerate faces and without points that no face uses, each of the others with
/// its own position.
pub(crate) fn compacted(mesh: &MeshView<'_>) -> DecodedMesh {
    let is_usable = |&&[a, b, c]: &&[u32; 3]| a != b && b != c && c != a;
    let mut is_used = vec![false; mesh.point_count()];
    for &index in mesh.faces.iter().filter(is_usable).flatten() {
        is_used[index as usize] = true;
    }
    let mut next = 0_u32;
    let new_index: Vec<u32> = is_used
        .iter()
        .map(|&used| {
            let index = next;
            next += u32::from(used);
            index
        })
        .collect();
    let points = (0..mesh.point_count() as u32).zip(&is_used);
    let used_points = points.filter_map(|(point, &used)| used.then_some(point));
    DecodedMesh {
        positions: used_points
            .map(|point| mesh.positions[mesh.vertex_of(point) as usize])
            .collect(),
        faces: mesh
            .faces
            .iter()
            .filter(is_usable)
            .map(|face| face.map(|index| new_index[index as usize]))
            .collect(),
        normals: mesh.normals.map(|values| keep(values, &is_used)),
        colors: mesh.colors.map(|values| keep(values, &is_used)),
        texture_coordinates: mesh
            .texture_coordinates
            .map(|values| keep(values, &is_used)),
        materials: mesh.materials.map(|values| keep(values, &is_used)),
    }
}

fn keep<T: Copy>(values: &[T], is_used: &[bool]) -> Vec<T> {
    values
        .iter()
        .zip(is_used)
        .filter_map(|(&value, &used)| used.then_some(value))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unused_vertices_and_degenerate_faces_are_left_out_together() {
        let positions: Vec<[f32; 3]> = (0..5_u8).map(|x| [f32::from(x), 0.0, 0.0]).collect();
        let mesh = MeshView {
            positions: &positions,
            point_vertices: None,
            faces: &[[0, 0, 3], [4, 1, 2]],
            normals: None,
            colors: Some(&[[9; 4], [1; 4], [2; 4], [9; 4], [4; 4]]),
            texture_coordinates: None,
            materials: None,
        };
        let compact = compacted(&mesh);
        assert_eq!(
            compact.positions,
            [positions[1], positions[2], positions[4]]
        );
        assert_eq!(compact.faces, [[2, 0, 1]]);
        assert_eq!(compact.colors, Some(vec![[1; 4], [2; 4], [4; 4]]));
    }
}
