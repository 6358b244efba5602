//! OBJ files by hand.

#![allow(clippy::unwrap_used, reason = "this is test code")]

mod support;

use steadymesh_mesh_io::{Limits, Mesh, ReadError, obj};
use support::{LIMITS, tetrahedron};

fn read(text: &str) -> Result<Mesh, ReadError> {
    obj::read(text.as_bytes(), &LIMITS)
}

fn message(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

#[test]
fn positions_keep_all_digits_of_a_double() {
    let mesh = read("v 0.1 -1e-300 123456789.123456789\nv 1 0 0\nv 0 1. +.5\nf 1 2 3\n").unwrap();
    assert_eq!(mesh.positions[0], [0.1, -1e-300, 123_456_789.123_456_79]);
    assert_eq!(mesh.positions[2], [0.0, 1.0, 0.5]);
    assert_eq!(mesh.faces, [[0, 1, 2]]);
}

#[test]
fn polygons_become_fans() {
    let mesh = read("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 .5 0\nf 1 2 3 4 5\n").unwrap();
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
}

#[test]
fn negative_indices_count_back_from_where_they_stand() {
    let text = format!("{TRIANGLE}f -3 -2 -1\nv 0 0 1\nf -4 -2 -1\n");
    assert_eq!(read(&text).unwrap().faces, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn a_vertex_may_be_used_before_it_is_defined() {
    assert_eq!(
        read(&format!("f 1 2 3\n{TRIANGLE}")).unwrap().faces,
        [[0, 1, 2]]
    );
}

#[test]
fn seams_keep_their_own_indices() {
    let text = format!(
        "{TRIANGLE}vt 0 0\nvt 1 0\nvt 0 1\nvt .5\nvn 0 0 1\nf 1/1/1 2/2/1 3/3/1\nf 3/4/1 2/2/1 1/1/1\n"
    );
    let mesh = read(&text).unwrap();
    assert_eq!(mesh.positions.len(), 3);
    let uv = mesh.texture_coordinates.unwrap();
    assert_eq!(uv.values[3], [0.5, 0.0]);
    assert_eq!(uv.faces, Some(vec![[0, 1, 2], [3, 1, 0]]));
    assert_eq!(mesh.normals.unwrap().faces, Some(vec![[0; 3], [0; 3]]));
}

#[test]
fn an_attribute_that_a_corner_lacks_is_dropped() {
    let text = format!("{TRIANGLE}vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1//1 2//1 3//1\n");
    let mesh = read(&text).unwrap();
    assert_eq!(mesh.texture_coordinates, None);
    assert!(mesh.normals.is_some());
}

#[test]
fn vertex_colors_are_read_and_a_weight_is_not_a_color() {
    let mesh = read("v 0 0 0 1 0 0\nv 1 0 0 0 .5 0\nv 0 1 0 0 0 1\nf 1 2 3\n").unwrap();
    let colors = mesh.colors.unwrap().values;
    assert_eq!(
        colors,
        [[255, 0, 0, 255], [0, 128, 0, 255], [0, 0, 255, 255]]
    );
    assert_eq!(
        read("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n")
            .unwrap()
            .colors,
        None
    );
}

#[test]
fn line_endings_comments_continuations_and_other_records_are_no_obstacle() {
    let text = "\u{feff}# comment \\\r\nmtllib a b.mtl\r\no thing\r\n\tv 0 0 \\\r\n 0 # here\r\n\
                v 1 0 0\r\n\r\nv 0 1 0\r\nusemtl \u{fffd}\r\ns off\r\ng x\r\ncurv2 1 2\r\n\
                f 1 \\\r\n2 \\\r\n3\r\nl 1 2\r\n";
    let mesh = read(text).unwrap();
    assert_eq!((mesh.positions.len(), mesh.faces.len()), (3, 1));
}

#[test]
fn lines_may_end_as_on_old_macs_and_be_mixed() {
    let text = "# old\rv 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 \\\r2 3\r";
    for text in [
        text.to_owned(),
        text.replacen('\r', "\n", 2),
        text.replacen('\r', "\r\n", 3),
    ] {
        let mesh = read(&text).unwrap();
        assert_eq!((mesh.positions.len(), mesh.faces.len()), (3, 1), "{text:?}");
    }
    assert_eq!(
        message("v 0 0 0\rv 1 2 x3\r"),
        "line 2: `v` is followed by `x3`, which is not a number"
    );
}

#[test]
fn mistakes_name_the_line_and_the_token() {
    for (text, expected) in [
        (
            "v 0 0 0\nv 1 2 x3\n",
            "line 2: `v` is followed by `x3`, which is not a number",
        ),
        (
            "v 0 0\n",
            "line 1: `v` has 2 numbers, but at least 3 are needed",
        ),
        (
            "v 0,5 0 0\n",
            "line 1: `v` is followed by `0,5`, which is not a number",
        ),
        ("#\n\nv 0 NaN 0\n", "line 3: vertex 0 is not finite"),
        ("v 0 0 0\nv inf 0 0\n", "line 2: vertex 1 is not finite"),
        ("v 1e999 0 0\n", "line 1: vertex 0 is not finite"),
        (
            "v 1e300 0 0\n",
            "line 1: vertex 0 has the coordinate 1e300, which is beyond the range of 32-bit \
             floats; choose a larger unit",
        ),
        (
            "v 0 0 0\nf 1 2 x\n",
            "line 2: `x` is not a face corner; expected v, v/vt, v//vn or v/vt/vn with whole numbers",
        ),
        (
            "v 0 0 0\nf 1 1\n",
            "line 2: `f` has 2 corners, but at least 3 are needed",
        ),
        (
            "v 0 0 0\nf 1 0 1\n",
            "line 2: a vertex index is 0, but OBJ counts from 1",
        ),
        (
            "v 0 0 0\nf 1 1 -2\n",
            "line 2: face 0 refers to vertex -2, but there is 1 vertex",
        ),
        (
            "v 0 0 0\nvt nan 0\n",
            "line 2: texture coordinate 0 is not finite",
        ),
    ] {
        assert_eq!(message(text), expected);
    }
}

#[test]
fn an_index_out_of_range_names_face_line_and_count() {
    let text = format!("{TRIANGLE}f 1 2 3 1\n# \\\nf 1 2 \\\n 3\nf 1 2 4\n");
    assert_eq!(
        read(&text),
        Err(ReadError::IndexOutOfRange {
            face: 3,
            what: "vertex",
            index: 4,
            count: 3,
            line: Some(8)
        })
    );
    let message = message(&format!("{TRIANGLE}vt 0 0\nf 1/1 2/1 3/2\n"));
    assert_eq!(
        message,
        "line 5: face 0 refers to texture coordinate 2, but there is 1 texture coordinate"
    );
}

#[test]
fn nothing_to_work_with_is_told_apart() {
    assert_eq!(read(""), Err(ReadError::EmptyBody));
    assert_eq!(
        read("hello world\n"),
        Err(ReadError::NoVertices { format: "OBJ" })
    );
    assert_eq!(
        read(TRIANGLE),
        Err(ReadError::NoFaces {
            format: "OBJ",
            vertices: 3
        })
    );
}

#[test]
fn limits_count_everything() {
    let text = format!("{TRIANGLE}{TRIANGLE}f 1 2 3 4 5 6\nf 1 2 3\n");
    let read = |limits: Limits| obj::read(text.as_bytes(), &limits).unwrap_err();
    assert_eq!(
        read(Limits {
            max_vertices: 5,
            ..LIMITS
        }),
        ReadError::LimitExceeded {
            what: "vertices",
            found: 6,
            limit: 5
        }
    );
    assert_eq!(
        read(Limits {
            max_faces: 3,
            ..LIMITS
        }),
        ReadError::LimitExceeded {
            what: "faces",
            found: 5,
            limit: 3
        }
    );
}

#[test]
fn what_was_written_reads_back_exactly() {
    let mesh = tetrahedron();
    let back = obj::read(&obj::write(&mesh), &LIMITS).unwrap();
    assert_eq!(back.positions, mesh.positions);
    assert_eq!(back.faces, mesh.faces);
    assert_eq!(back.colors, mesh.colors);
    let uv = back.texture_coordinates.as_ref().unwrap();
    assert_eq!(uv.values, mesh.texture_coordinates.as_ref().unwrap().values);
    assert_eq!(uv.faces.as_ref(), Some(&mesh.faces));
    // Written again, it keeps its seams.
    assert_eq!(obj::read(&obj::write(&back), &LIMITS).unwrap(), back);
}
