//! Meshes whose vertices have several points: what comes back at every speed.

#![allow(clippy::unwrap_used, reason = "this is test code")]

use std::collections::BTreeMap;

use steadymesh_draco::{DecodeLimits, EncodeOptions, MeshView, decode, encode};

const LIMITS: DecodeLimits = DecodeLimits {
    max_vertices: 1 << 20,
    max_faces: 1 << 20,
    max_memory_bytes: 256 << 20,
};

const AROUND: u32 = 24;
const ROWS: u32 = 10;

/// A tube: vertices, the vertex of each point, faces over points, and what the points look like.
/// Where it closes, vertices have two points.
type Tube = (Vec<[f32; 3]>, Vec<u32>, Vec<[u32; 3]>, Vec<[f32; 2]>);

fn tube() -> Tube {
    let mut vertices = Vec::new();
    let (mut points, mut looks) = (Vec::new(), Vec::new());
    for row in 0..=ROWS {
        for column in 0..=AROUND {
            let angle = column as f32 / AROUND as f32 * std::f32::consts::TAU;
            if column < AROUND {
                vertices.push([angle.cos(), angle.sin(), row as f32 * 0.3]);
            }
            points.push(row * AROUND + column % AROUND);
            looks.push([column as f32 / AROUND as f32, row as f32 / ROWS as f32]);
        }
    }
    let mut faces = Vec::new();
    for row in 0..ROWS {
        for column in 0..AROUND {
            let a = row * (AROUND + 1) + column;
            let above = a + AROUND + 1;
            faces.push([a, a + 1, above + 1]);
            faces.push([a, above + 1, above]);
        }
    }
    (vertices, points, faces, looks)
}

#[test]
fn a_seam_comes_back_closed_at_every_speed() {
    let (vertices, points, faces, looks) = tube();
    let colors: Vec<[u8; 4]> = looks
        .iter()
        .map(|[u, _]| [(u * 240.0) as u8, 1, 2, 255])
        .collect();
    let mesh = MeshView {
        positions: &vertices,
        point_vertices: Some(&points),
        faces: &faces,
        normals: None,
        colors: Some(&colors),
        materials: None,
        texture_coordinates: Some(&looks),
    };
    for speed in 0..=10 {
        let options = EncodeOptions {
            speed,
            ..EncodeOptions::default()
        };
        let back = decode(&encode(&mesh, &options).unwrap(), &LIMITS).unwrap();
        assert_eq!(back.faces.len(), faces.len(), "speed {speed}");
        assert_eq!(back.positions.len(), points.len(), "speed {speed}");
        let coordinates = back.texture_coordinates.unwrap();
        let colors = back.colors.unwrap();
        // The points of a vertex are at exactly the same place.
        let mut places: BTreeMap<[u32; 3], u32> = BTreeMap::new();
        for (position, ([u, v], color)) in back.positions.iter().zip(coordinates.iter().zip(colors))
        {
            *places.entry(position.map(f32::to_bits)).or_default() += 1;
            let angle = u * std::f32::consts::TAU;
            let expected = [angle.cos(), angle.sin(), v * ROWS as f32 * 0.3];
            let off = (0..3)
                .map(|i| (position[i] - expected[i]).abs())
                .fold(0.0, f32::max);
            assert!(off < 0.01, "speed {speed}: {position:?} looks like {u} {v}");
            assert!(
                (f32::from(color[0]) - u * 240.0).abs() < 2.0,
                "speed {speed}"
            );
        }
        assert_eq!(places.len(), vertices.len(), "speed {speed}");
        let doubled = places.values().filter(|count| **count == 2).count();
        assert_eq!(doubled, ROWS as usize + 1, "speed {speed}");
    }
}
