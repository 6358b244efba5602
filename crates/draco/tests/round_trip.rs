//! What comes back after encoding: checked against the mesh that went in.

#![allow(clippy::unwrap_used, reason = "this is test code")]

use proptest::prelude::*;
use steadymesh_draco::{
    AttributeIds, DecodeError, DecodeLimits, DecodedMesh, EncodeError, EncodeOptions, decode,
    decode_with_ids, encode, encode_with_info,
};

const LIMITS: DecodeLimits = DecodeLimits {
    max_vertices: 1 << 20,
    max_faces: 1 << 20,
    max_memory_bytes: 256 << 20,
};

/// A bumpy sheet of `n` by `n` quads with all attributes.
fn sheet(n: u32) -> DecodedMesh {
    let points = || (0..=n).flat_map(move |y| (0..=n).map(move |x| (x as f32, y as f32)));
    let at = |x, y| y * (n + 1) + x;
    let cells = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
    let size = n as f32;
    DecodedMesh {
        positions: points()
            .map(|(x, y)| [x, y, (x * 0.7).sin() + (y * 0.3).cos()])
            .collect(),
        faces: cells
            .flat_map(|(x, y)| {
                [
                    [at(x, y), at(x + 1, y), at(x + 1, y + 1)],
                    [at(x, y), at(x + 1, y + 1), at(x, y + 1)],
                ]
            })
            .collect(),
        normals: Some(points().map(|_| [0.0, 0.0, 1.0]).collect()),
        colors: Some(points().map(|(x, y)| [x as u8, y as u8, 7, 200]).collect()),
        texture_coordinates: Some(points().map(|(x, y)| [x / size, y / size]).collect()),
        materials: Some(points().map(|(x, _)| 40_000 + (x as u16) / 4).collect()),
    }
}

fn nearest(positions: &[[f32; 3]], query: [f32; 3]) -> (usize, f32) {
    let distance = |p: &[f32; 3]| (0..3).map(|i| (p[i] - query[i]).abs()).fold(0.0, f32::max);
    let (index, point) = positions
        .iter()
        .enumerate()
        .min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)))
        .unwrap();
    (index, distance(point))
}

#[test]
fn every_attribute_comes_back_within_its_quantization_step() {
    let mesh = sheet(20);
    let options = EncodeOptions::default();
    let back = decode(&encode(&mesh.view(), &options).unwrap(), &LIMITS).unwrap();
    assert_eq!(
        (back.positions.len(), back.faces.len()),
        (mesh.positions.len(), mesh.faces.len())
    );
    // The extent is 20; half a step is the bound, with a little room for rounding.
    let half_step = 20.0 / 4095.0 / 2.0 * 1.01;
    for (i, &p) in back.positions.iter().enumerate() {
        let (source, distance) = nearest(&mesh.positions, p);
        assert!(distance <= half_step, "{distance}");
        assert_eq!(
            back.colors.as_ref().unwrap()[i],
            mesh.colors.as_ref().unwrap()[source]
        );
        let (uv, expected) = (
            back.texture_coordinates.as_ref().unwrap()[i],
            mesh.texture_coordinates.as_ref().unwrap()[source],
        );
        assert!((uv[0] - expected[0]).abs() < 1e-3 && (uv[1] - expected[1]).abs() < 1e-3);
        assert!(back.normals.as_ref().unwrap()[i][2] > 0.999);
        assert_eq!(
            back.materials.as_ref().unwrap()[i],
            mesh.materials.as_ref().unwrap()[source]
        );
    }
}

#[test]
fn the_winding_of_every_face_survives() {
    let mesh = sheet(8);
    let back = decode(
        &encode(&mesh.view(), &EncodeOptions::default()).unwrap(),
        &LIMITS,
    )
    .unwrap();
    for face in &back.faces {
        let [a, b, c] = face.map(|i| back.positions[i as usize]);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert!(area > 0.0);
    }
}

#[test]
fn equal_meshes_give_equal_bytes() {
    let mesh = sheet(12);
    let encode = || encode(&mesh.view(), &EncodeOptions::default()).unwrap();
    assert_eq!(encode(), encode());
}

#[test]
fn every_speed_and_extreme_precision_round_trips() {
    let mesh = sheet(6);
    for speed in 0..=10 {
        for position_bits in [1, 12, 30] {
            let options = EncodeOptions {
                speed,
                position_bits,
                ..EncodeOptions::default()
            };
            let encoded = encode_with_info(&mesh.view(), &options).unwrap();
            let back = decode(&encoded.bytes, &LIMITS).unwrap();
            assert_eq!(back.faces.len(), mesh.faces.len(), "speed {speed}");
            assert_eq!(encoded.point_count, back.positions.len());
            assert_eq!(encoded.face_count, back.faces.len());
        }
    }
}

#[test]
fn ids_tell_where_each_attribute_is() {
    let mesh = sheet(4);
    let encoded = encode_with_info(&mesh.view(), &EncodeOptions::default()).unwrap();
    let back = decode_with_ids(&encoded.bytes, &encoded.ids, &LIMITS).unwrap();
    assert_eq!(back, decode(&encoded.bytes, &LIMITS).unwrap());
    let swapped = AttributeIds {
        position: encoded.ids.normal.unwrap(),
        ..AttributeIds::default()
    };
    let normals = decode_with_ids(&encoded.bytes, &swapped, &LIMITS)
        .unwrap()
        .positions;
    assert_eq!(Some(normals), back.normals);
}

#[test]
fn an_id_that_is_not_there_is_named() {
    let mesh = sheet(2);
    let bytes = encode(&mesh.view(), &EncodeOptions::default()).unwrap();
    let ids = AttributeIds {
        position: 77,
        ..AttributeIds::default()
    };
    let error = decode_with_ids(&bytes, &ids, &LIMITS).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the Draco mesh has no positions with the unique id 77"
    );
}

#[test]
fn vertices_at_one_place_are_not_merged() {
    let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].repeat(2);
    let mesh = DecodedMesh {
        positions,
        faces: vec![[0, 1, 2], [3, 4, 5]],
        ..DecodedMesh::default()
    };
    let back = decode(
        &encode(&mesh.view(), &EncodeOptions::default()).unwrap(),
        &LIMITS,
    )
    .unwrap();
    assert_eq!((back.positions.len(), back.faces.len()), (6, 2));
}

#[test]
fn a_mesh_that_cannot_be_encoded_is_refused_with_the_place() {
    let good = sheet(2);
    let fails = |change: &dyn Fn(&mut DecodedMesh)| {
        let mut mesh = good.clone();
        change(&mut mesh);
        encode(&mesh.view(), &EncodeOptions::default()).unwrap_err()
    };
    assert_eq!(
        fails(&|m| m.positions[4][1] = f32::NAN),
        EncodeError::NotFinite {
            what: "position",
            vertex: 4
        }
    );
    assert_eq!(
        fails(&|m| m.faces[3][2] = 9),
        EncodeError::IndexOutOfRange {
            face: 3,
            index: 9,
            points: 9
        }
    );
    assert_eq!(
        fails(&|m| m.colors.as_mut().unwrap().truncate(5)),
        EncodeError::CountMismatch {
            what: "colors",
            count: 5,
            points: 9
        }
    );
    assert_eq!(
        fails(&|m| m.faces.clear()),
        EncodeError::Empty {
            vertices: 9,
            faces: 0
        }
    );
    assert_eq!(
        fails(&|m| m.faces = vec![[1, 1, 2]]),
        EncodeError::Empty {
            vertices: 9,
            faces: 0
        }
    );
    assert_eq!(
        fails(&|m| {
            m.positions[0][0] = f32::MAX;
            m.positions[1][0] = f32::MIN;
        }),
        EncodeError::ExtentOverflow { what: "positions" }
    );
    let options = EncodeOptions {
        position_bits: 31,
        ..EncodeOptions::default()
    };
    assert_eq!(
        encode(&good.view(), &options).unwrap_err().to_string(),
        "position_bits is 31, but must be between 1 and 30"
    );
}

#[test]
fn limits_are_checked_against_the_counts_of_the_file() {
    let bytes = encode(&sheet(10).view(), &EncodeOptions::default()).unwrap();
    let few_vertices = DecodeLimits {
        max_vertices: 120,
        ..LIMITS
    };
    assert_eq!(
        decode(&bytes, &few_vertices),
        Err(DecodeError::LimitExceeded {
            what: "vertices",
            found: 121,
            limit: 120
        })
    );
    let few_faces = DecodeLimits {
        max_faces: 199,
        ..LIMITS
    };
    assert_eq!(
        decode(&bytes, &few_faces),
        Err(DecodeError::LimitExceeded {
            what: "faces",
            found: 200,
            limit: 199
        })
    );
}

#[test]
fn a_vertex_with_very_many_faces_is_encoded_without_edgebreaker() {
    let count = 30_000_u32;
    let angle = |i: u32| std::f32::consts::TAU * i as f32 / count as f32;
    let rim = (0..count).map(|i| [angle(i).cos(), angle(i).sin(), 0.0]);
    let mesh = DecodedMesh {
        positions: std::iter::once([0.0, 0.0, 1.0]).chain(rim).collect(),
        faces: (0..count)
            .map(|i| [0, 1 + i, 1 + (i + 1) % count])
            .collect(),
        ..DecodedMesh::default()
    };
    let encoded = encode_with_info(&mesh.view(), &EncodeOptions::default()).unwrap();
    // After five letters, two version numbers and the geometry comes the method.
    assert_eq!(encoded.bytes[8], 0);
    let back = decode(&encoded.bytes, &LIMITS).unwrap();
    assert_eq!((back.positions.len(), back.faces.len()), (30_001, 30_000));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whatever the topology (non-manifold, degenerate, isolated), a mesh with one
    /// usable face encodes, and the counts told are those that are decoded.
    #[test]
    fn any_valid_topology_encodes_and_its_counts_are_told(
        positions in prop::collection::vec(prop::array::uniform3(-9.0_f32..9.0), 3..12),
        corners in prop::collection::vec(prop::array::uniform3(0_u32..1000), 1..40),
        speed in 0_u8..=10,
        with_normals: bool,
    ) {
        let count = u32::try_from(positions.len()).unwrap();
        let mut faces: Vec<[u32; 3]> = corners.iter().map(|f| f.map(|i| i % count)).collect();
        faces.push([0, 1, 2]);
        let normals = with_normals.then(|| vec![[0.0, 1.0, 0.0]; positions.len()]);
        let mesh = DecodedMesh { positions, faces, normals, ..DecodedMesh::default() };
        let options = EncodeOptions { speed, ..EncodeOptions::default() };

        let encoded = encode_with_info(&mesh.view(), &options).unwrap();
        let back = decode(&encoded.bytes, &LIMITS).unwrap();

        prop_assert_eq!(encoded.point_count, back.positions.len());
        prop_assert_eq!(encoded.face_count, back.faces.len());
        let usable = mesh.faces.iter().filter(|[a, b, c]| a != b && b != c && c != a).count();
        prop_assert_eq!(back.faces.len(), usable);
    }
}
