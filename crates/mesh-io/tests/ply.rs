//! PLY files by hand.

#![allow(clippy::unwrap_used, reason = "this is test code")]

mod support;

use steadymesh_mesh_io::{Limits, Mesh, ReadError, ply};
use support::{LIMITS, floats, tetrahedron};

fn read(bytes: &[u8]) -> Result<Mesh, ReadError> {
    ply::read(bytes, &LIMITS)
}

fn message(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

const ASCII: &str = "ply\nformat ascii 1.0\n";
const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";
const FACES: &str = "property list uchar int vertex_indices\n";

fn binary(format: &str, header: &str, body: &[u8]) -> Vec<u8> {
    let mut bytes = format!("ply\nformat {format} 1.0\n{header}end_header\n").into_bytes();
    bytes.extend(body);
    bytes
}

#[test]
fn an_ascii_file_with_everything_is_read() {
    let text = format!(
        "{ASCII}comment made by hand\nobj_info x\nelement material 1\nproperty int a\n\
         element vertex 4\nproperty list uchar int extra\n{XYZ}property float quality\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nproperty uchar alpha\nproperty float s\n\
         property float t\nelement face 1\nproperty uchar flags\n\
         property list uint8 uint32 vertex_index\nproperty list uchar float texcoord\n\
         element edge 1\nproperty int v\nend_header\n\
         99\n\
         2 7 7 0 0 0 .5 0 0 1 255 0 0 128 0 0\n\n\
         0 1 0 0 .5 0 0 1 0 255 0 128 1 0\n\
         0 1 1 0 .5 0 0 1 0 0 255 128 1 1\n\
         0 0 1 0.1 .5 0 0 nan 1 2 3 4 0 1\n\
         3 4 0 1 2 3 8 0 0 1 0 1 1 0 1\n5\n"
    );
    for text in [text.clone(), text.replace('\n', "\r\n")] {
        let mesh = read(text.as_bytes()).unwrap();
        assert_eq!(mesh.positions[3], [0.0, 1.0, 0.1]);
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.colors.unwrap().values[3], [1, 2, 3, 4]);
        assert_eq!(mesh.texture_coordinates.unwrap().values[2], [1.0, 1.0]);
        let normals = mesh.normals.unwrap().values;
        assert_eq!((normals[0], normals[3]), ([0.0, 0.0, 1.0], [0.0; 3]));
    }
}

/// A type's two names and how a small number is stored, little-endian.
type Type = (&'static str, &'static str, fn(u8) -> Vec<u8>);

const TYPES: [Type; 8] = [
    ("char", "int8", |v| vec![v]),
    ("uchar", "uint8", |v| vec![v]),
    ("short", "int16", |v| i16::from(v).to_le_bytes().to_vec()),
    ("ushort", "uint16", |v| u16::from(v).to_le_bytes().to_vec()),
    ("int", "int32", |v| i32::from(v).to_le_bytes().to_vec()),
    ("uint", "uint32", |v| u32::from(v).to_le_bytes().to_vec()),
    ("float", "float32", |v| f32::from(v).to_le_bytes().to_vec()),
    ("double", "float64", |v| f64::from(v).to_le_bytes().to_vec()),
];

#[test]
fn every_type_in_both_spellings_and_byte_orders_is_read() {
    for (short, long, store) in TYPES {
        for (name, big) in [(short, false), (long, true)] {
            let put = |v: u8| {
                let mut bytes = store(v);
                if big {
                    bytes.reverse();
                }
                bytes
            };
            let mut header = format!(
                "element vertex 3\nproperty {name} x\nproperty {name} y\nproperty {name} z\n"
            );
            let body: Vec<u8> = [1, 2, 3, 4, 5, 6, 7, 8, 9]
                .into_iter()
                .flat_map(put)
                .collect();
            let is_integer = store(1) != store(1) || !matches!(short, "float" | "double");
            header += "element face 1\n";
            let mut body = body;
            if is_integer {
                header += &format!("property list {name} {name} vertex_indices\n");
                body.extend([3, 0, 1, 2].into_iter().flat_map(put));
            } else {
                header += FACES;
                body.push(3);
                let index = |v: i32| {
                    if big {
                        v.to_be_bytes()
                    } else {
                        v.to_le_bytes()
                    }
                };
                body.extend([0, 1, 2].into_iter().flat_map(index));
            }
            let format = if big {
                "binary_big_endian"
            } else {
                "binary_little_endian"
            };
            let mesh = read(&binary(format, &header, &body)).unwrap();
            assert_eq!(mesh.positions[2], [7.0, 8.0, 9.0], "{name}");
            assert_eq!(mesh.faces, [[0, 1, 2]], "{name}");
        }
    }
}

#[test]
fn mixed_polygons_and_extra_elements_in_binary_are_read() {
    let header = format!(
        "element extra 2\nproperty list uchar short a\nproperty uchar b\n\
         element vertex 4\n{XYZ}element face 3\n{FACES}element rest 9\nproperty double q\n"
    );
    let mut body = vec![2, 1, 0, 2, 0, 9, 0, 9];
    body.extend(floats(&[
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0,
    ]));
    for polygon in [&[0, 1, 2][..], &[0, 1, 2, 3], &[3, 2, 1]] {
        body.push(polygon.len() as u8);
        body.extend(polygon.iter().flat_map(|v: &i32| v.to_le_bytes()));
    }
    body.extend([0; 72]);
    let mesh = read(&binary("binary_little_endian", &header, &body)).unwrap();
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 1, 2], [0, 2, 3], [3, 2, 1]]);
}

#[test]
fn faces_may_come_before_vertices() {
    let text = format!(
        "{ASCII}element face 1\n{FACES}element vertex 3\n{XYZ}end_header\n3 0 1 2\n0 0 0\n1 0 0\n0 1 0"
    );
    assert_eq!(read(text.as_bytes()).unwrap().faces, [[0, 1, 2]]);
}

#[test]
fn float_colors_are_fractions() {
    let text = format!(
        "{ASCII}element vertex 3\n{XYZ}property float red\nproperty float green\n\
         property float blue\nelement face 1\n{FACES}end_header\n\
         0 0 0 1 .5 0\n1 0 0 2 -1 nan\n0 1 0 0 0 0\n3 0 1 2\n"
    );
    let colors = read(text.as_bytes()).unwrap().colors.unwrap().values;
    assert_eq!(
        colors,
        [[255, 128, 0, 255], [255, 0, 0, 255], [0, 0, 0, 255]]
    );
}

#[test]
fn a_promise_that_the_body_cannot_keep_is_refused_with_its_figures() {
    let header = format!("element vertex 4294967296\n{XYZ}element face 1\n{FACES}");
    assert_eq!(
        message(&binary("binary_little_endian", &header, &[0; 30])),
        "PLY: the header promises 4294967296 vertices, which need 51539607552 bytes; the body has \
         30, so it ends inside vertex 2"
    );
    let header = format!("element vertex 1\n{XYZ}element face 18446744073709551615\n{FACES}");
    let error = message(&binary("binary_little_endian", &header, &[0; 30]));
    assert!(
        error.contains("promises 18446744073709551615 faces"),
        "{error}"
    );
    let text =
        format!("{ASCII}element vertex 99999999999\n{XYZ}element face 1\n{FACES}end_header\n0");
    let error = message(text.as_bytes());
    assert!(
        error.contains("which need at least 599999999994 bytes; the body has 1"),
        "{error}"
    );
}

#[test]
fn truncation_names_the_record() {
    let whole = ply::write(&tetrahedron());
    let error = message(&whole[..whole.len() - 20]);
    assert_eq!(error, "PLY: the file ends inside face 2 of 4");
    let text = format!(
        "{ASCII}element vertex 3\n{XYZ}element face 1\n{FACES}end_header\n0 0 0\n1 0 0\n          "
    );
    assert_eq!(
        message(text.as_bytes()),
        "PLY: the file ends before vertex 2 of 3"
    );
}

#[test]
fn mistakes_in_ascii_name_the_line() {
    let file = |body: &str| {
        format!("{ASCII}element vertex 3\n{XYZ}element face 1\n{FACES}end_header\n{body}")
    };
    let start = "0 0 0\n1 0 0\n0 1 0\n";
    for (body, expected) in [
        (
            "0 0 x\n1 0 0\n0 1 0\n3 0 1 2\n".to_owned(),
            "PLY: line 10: `x` is not a number",
        ),
        (
            "0 0\n1 0 0\n0 1 0\n3 0 1 2\n".to_owned(),
            "PLY: line 10: vertex 0 has too few numbers",
        ),
        (
            "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n".to_owned(),
            "line 11: vertex 1 is not finite",
        ),
        (
            format!("{start}3 0 1 3\n"),
            "line 13: face 0 refers to vertex 3, but there are 3 vertices",
        ),
        (
            format!("{start}3 0 1 -1\n"),
            "line 13: face 0 refers to vertex -1, but there are 3 vertices",
        ),
        (
            format!("{start}3 0 1 1.5\n"),
            "PLY: line 13: face 0 refers to vertex 1.5, which is not a whole number",
        ),
        (
            format!("{start}2 0 1\n"),
            "PLY: line 13: face 0 has 2 corners, but at least 3 are needed",
        ),
        (
            format!("{start}3 0 1 2 2\n"),
            "PLY: line 13: face 0 has more numbers than the header says, from `2` on",
        ),
        (
            format!("{start}4000000000 0 1 2\n"),
            "PLY: line 13: face 0 has too few numbers",
        ),
    ] {
        assert_eq!(message(file(&body).as_bytes()), expected);
    }
}

#[test]
fn lines_may_end_as_on_old_macs_and_be_mixed() {
    let text = format!(
        "{ASCII}element vertex 3\n{XYZ}element face 1\n{FACES}end_header\n\
         0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    );
    for text in [
        text.replace('\n', "\r"),
        text.replacen('\n', "\r", 4),
        text.replacen('\n', "\r\n", 6).replacen("\r\n", "\r", 3),
    ] {
        assert_eq!(
            read(text.as_bytes()).unwrap().faces,
            [[0, 1, 2]],
            "{text:?}"
        );
    }
    let wrong = text.replace("0 1 0", "0 1 y").replace('\n', "\r");
    assert_eq!(
        message(wrong.as_bytes()),
        "PLY: line 12: `y` is not a number"
    );
    let whole = ply::write(&tetrahedron());
    let header = whole
        .windows(11)
        .position(|w| w == b"end_header\n")
        .unwrap()
        + 11;
    let mut old = whole.clone();
    old[..header]
        .iter_mut()
        .filter(|b| **b == b'\n')
        .for_each(|b| *b = b'\r');
    // A body that begins with the byte of a line feed.
    (old[header], old[header + 1]) = (b'\n', 0);
    let mut new = whole;
    (new[header], new[header + 1]) = (b'\n', 0);
    assert_eq!(read(&old).unwrap(), read(&new).unwrap());
}

#[test]
fn numbers_of_an_ascii_file_may_stand_anywhere() {
    let header = format!(
        "{ASCII}element extra 1\nproperty int a\nelement vertex 4\n{XYZ}element face 2\n{FACES}\
         element edge 2\nproperty int v\nend_header\n"
    );
    for body in [
        "7\n0 0 0 1 0 0\n1 1 0 0 1 0\n3 0 1 2 3 0 2 3\n5 6\n",
        "7 0 0 0 1 0 0 1 1 0 0 1 0 3 0 1 2 3 0 2 3 5 6",
        "7\n\n0\n0\n0\n1\n0\n0\n1 1\n0\n0 1 0\n3\n0 1 2\n3 0\n\n2 3\n5\n6\n\n",
    ] {
        for text in [body.to_owned(), body.replace('\n', "\r")] {
            let mesh = read(format!("{header}{text}").as_bytes()).unwrap();
            assert_eq!(mesh.positions[2], [1.0, 1.0, 0.0]);
            assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]]);
        }
    }
}

#[test]
fn numbers_that_do_not_come_out_even_are_not_guessed_at() {
    let file = |body: &str| {
        let header = format!("element vertex 3\n{XYZ}element face 1\n{FACES}end_header\n");
        message(format!("{ASCII}{header}{body}").as_bytes())
    };
    // A fourth number on every vertex, which the header does not know.
    assert_eq!(
        file("0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n"),
        "PLY: line 10: vertex 0 has more numbers than the header says, from `1` on"
    );
    // Everything could be read but for what is left over.
    assert_eq!(
        file("0 0 0 1 0 0\n0 1 0\n3 0 1 2\n9\n"),
        "PLY: line 10: vertex 0 has more numbers than the header says, from `1` on"
    );
}

#[test]
fn bad_numbers_in_binary_name_vertex_and_face() {
    let mut mesh = tetrahedron();
    mesh.positions[2][1] = f64::NAN;
    assert_eq!(message(&ply::write(&mesh)), "vertex 2 is not finite");
    let mut mesh = tetrahedron();
    mesh.faces[3][0] = 4;
    assert_eq!(
        message(&ply::write(&mesh)),
        "face 3 refers to vertex 4, but there are 4 vertices"
    );
    mesh.faces[3][0] = u32::MAX;
    assert_eq!(
        message(&ply::write(&mesh)),
        "face 3 refers to vertex -1, but there are 4 vertices"
    );
}

#[test]
fn what_is_missing_is_named() {
    let file = |header: &str, body: &str| format!("{ASCII}{header}end_header\n{body}");
    let vertices = format!("element vertex 1\n{XYZ}");
    for (header, expected) in [
        (
            String::new(),
            "the PLY file has no vertices; a mesh needs at least three",
        ),
        (
            vertices.clone(),
            "the PLY file has 1 vertex but no faces; point clouds and line sets cannot be \
             used, send triangles or polygons",
        ),
        (
            format!("{vertices}element tristrips 1\n{FACES}"),
            "PLY: the faces are stored as triangle strips (`tristrips`), which are not \
             supported; export them as `face` records",
        ),
        (
            format!("element vertex 1\nproperty float x\nelement face 1\n{FACES}"),
            "PLY: the vertices have no property `y`",
        ),
        (
            format!("{vertices}element face 1\nproperty int a\n"),
            "PLY: the faces have no list property `vertex_indices` or `vertex_index`",
        ),
    ] {
        assert_eq!(
            message(file(&header, "0 0 0\n3 0 0 0\n").as_bytes()),
            expected
        );
    }
    assert_eq!(read(b""), Err(ReadError::EmptyBody));
}

#[test]
fn limits_are_told_before_anything_is_parsed() {
    let bytes = ply::write(&tetrahedron());
    let read = |limits: Limits| ply::read(&bytes, &limits).unwrap_err();
    assert_eq!(
        read(Limits {
            max_vertices: 3,
            ..LIMITS
        }),
        ReadError::LimitExceeded {
            what: "vertices",
            found: 4,
            limit: 3
        }
    );
    assert_eq!(
        read(Limits {
            max_faces: 3,
            ..LIMITS
        }),
        ReadError::LimitExceeded {
            what: "faces",
            found: 4,
            limit: 3
        }
    );
}

#[test]
fn what_was_written_reads_back_exactly() {
    assert_eq!(read(&ply::write(&tetrahedron())).unwrap(), tetrahedron());
}
