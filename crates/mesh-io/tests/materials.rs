//! Which faces have the same material, through every format that can say so.
#![allow(clippy::unwrap_used, reason = "this is test code")]

mod support;

use std::collections::BTreeMap;

use steadymesh_draco::{EncodeOptions, MeshView, encode};
use steadymesh_mesh_io::{Attribute, ImageFormat, Mesh, drc, glb, obj};
use support::{LIMITS, tetrahedron};

/// Two faces of one material, then one of another, then one of the first again.
const TEXT: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl skin tone\nf 1 3 2\nf 1 2 4\n\
                    usemtl cloth\nf 1 4 3\nusemtl  skin  tone\nf 2 3 4\n";

/// How many faces each material has, and whether faces that touch the first vertex alone are told.
fn sizes(mesh: &Mesh) -> Vec<usize> {
    let mut sizes = BTreeMap::new();
    for face in 0..mesh.faces.len() {
        *sizes.entry(mesh.material_of(face).unwrap()).or_default() += 1;
    }
    sizes.into_values().collect()
}

#[test]
fn materials_are_numbered_by_their_first_use() {
    let mesh = obj::read(TEXT.as_bytes(), &LIMITS).unwrap();
    let of_faces: Vec<_> = (0..4).map(|face| mesh.material_of(face).unwrap()).collect();
    assert_eq!(of_faces, [0, 0, 1, 0]);
}

#[test]
fn one_material_is_none() {
    let one = TEXT.replace("usemtl cloth\n", "");
    assert_eq!(obj::read(one.as_bytes(), &LIMITS).unwrap().materials, None);
    // Faces before the first name have none of them.
    let late = TEXT.replace("usemtl skin tone\nf 1 3 2", "f 1 3 2");
    assert!(
        obj::read(late.as_bytes(), &LIMITS)
            .unwrap()
            .materials
            .is_some()
    );
}

#[test]
fn polygons_give_their_material_to_all_their_triangles() {
    let text =
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 2 0\nusemtl a\nf 1 2 3 4\nusemtl b\nf 4 3 5\n";
    let mesh = obj::read(text.as_bytes(), &LIMITS).unwrap();
    assert_eq!(sizes(&mesh), [2, 1]);
}

#[test]
fn what_was_written_has_the_same_materials() {
    let mesh = obj::read(TEXT.as_bytes(), &LIMITS).unwrap();
    let again = obj::read(&obj::write(&mesh), &LIMITS).unwrap();
    let of_faces: Vec<_> = (0..4)
        .map(|face| again.material_of(face).unwrap())
        .collect();
    assert_eq!(of_faces, [0, 0, 0, 1]);
    assert_eq!(again.faces[3], mesh.faces[2]);
    let as_glb = glb::read(&glb::write(&mesh, None), &LIMITS).unwrap();
    assert_eq!(sizes(&as_glb), [3, 1]);
}

#[test]
fn points_at_a_border_are_apart() {
    let mesh = obj::read(TEXT.as_bytes(), &LIMITS).unwrap();
    let points = mesh.into_points();
    assert_eq!(points.repeated, 3);
    let materials = points.mesh.materials.unwrap();
    for face in points.mesh.faces {
        let [a, b, c] = face.map(|point| materials.values[point as usize]);
        assert!(a == b && b == c);
    }
}

/// A tetrahedron whose first face has a material of its own, as a Draco file.
fn in_draco() -> Vec<u8> {
    let mesh = Mesh {
        materials: Some(Attribute {
            values: vec![7, 300],
            faces: Some(vec![[1; 3], [0; 3], [0; 3], [0; 3]]),
        }),
        ..tetrahedron()
    };
    let points = mesh.into_points().mesh;
    let positions: Vec<[f32; 3]> = points
        .positions
        .iter()
        .map(|p| p.map(|c| c as f32))
        .collect();
    let view = MeshView {
        positions: &positions,
        point_vertices: None,
        faces: &points.faces,
        normals: None,
        colors: None,
        texture_coordinates: points.texture_coordinates.as_ref().map(|a| &a.values[..]),
        materials: points.materials.as_ref().map(|a| &a.values[..]),
    };
    encode(&view, &EncodeOptions::default()).unwrap()
}

#[test]
fn a_draco_file_has_their_numbers() {
    let mesh = drc::read(&in_draco(), &LIMITS).unwrap();
    assert_eq!(sizes(&mesh), [3, 1]);
    assert!((0..4).any(|face| mesh.material_of(face) == Some(300)));
}

#[test]
fn in_gltf_each_is_a_primitive_of_its_own_with_the_image_on_it() {
    let bytes = in_draco();
    let parts = glb::DracoPart::split(&bytes, &LIMITS).unwrap();
    assert_eq!(parts.len(), 2);
    for image in [
        None,
        Some((ImageFormat::Jpeg, &b"\xff\xd8\xff\xe0 an image"[..])),
    ] {
        let file = glb::wrap_draco(&parts, image);
        let text = String::from_utf8_lossy(&file).into_owned();
        assert_eq!(text.contains("baseColorTexture"), image.is_some());
        assert!(text.contains("\"material0\"") && text.contains("\"material1\""));
        if image.is_none() {
            let back = glb::read(&file, &LIMITS).unwrap();
            assert_eq!(sizes(&back), [3, 1]);
            let corners = |mesh: &Mesh| {
                let positions = mesh.faces.iter().flatten();
                let mut all: Vec<[i32; 3]> = positions
                    .map(|&at| mesh.positions[at as usize].map(|c| (c * 1000.0).round() as i32))
                    .collect();
                all.sort_unstable();
                all
            };
            assert_eq!(corners(&back), corners(&tetrahedron()));
        }
    }
}
