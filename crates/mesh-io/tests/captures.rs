//! Real captures, where they are present.

#![allow(clippy::unwrap_used, reason = "this is test code")]

mod support;

use std::time::Instant;
use steadymesh_mesh_io::{Format, Mesh, obj, ply, read, sniff};
use support::{LIMITS, captures};

fn read_file(path: &std::path::Path) -> Mesh {
    let bytes = std::fs::read(path).unwrap();
    let format = Format::from_extension(path.extension().unwrap().to_str().unwrap()).unwrap();
    assert_eq!(sniff(&bytes), Some(format));
    read(&bytes, format, &LIMITS).unwrap()
}

#[test]
fn every_obj_capture_has_as_many_vertices_and_triangles_as_records() {
    for folder in ["basketball_player", "thomas", "textured"] {
        for path in captures(folder).unwrap_or_default() {
            if path.extension().is_none_or(|extension| extension != "obj") {
                continue;
            }
            let text = String::from_utf8(std::fs::read(&path).unwrap()).unwrap();
            let count = |keyword: &str| text.lines().filter(|l| l.starts_with(keyword)).count();
            let mesh = read_file(&path);
            assert_eq!(mesh.positions.len(), count("v "), "{}", path.display());
            assert_eq!(mesh.faces.len(), count("f "), "{}", path.display());
            assert_eq!(mesh.texture_coordinates.is_some(), count("vt ") > 0);
            // The compact formats keep it, to the precision of 32-bit floats.
            let back = ply::read(&ply::write(&mesh), &LIMITS).unwrap();
            assert_eq!(back.faces.len(), mesh.faces.len());
        }
    }
}

#[test]
fn every_draco_capture_is_read_with_texture_coordinates() {
    for path in captures("liam").unwrap_or_default() {
        let mesh = read_file(&path);
        assert!(
            (31_000..36_000).contains(&mesh.positions.len()),
            "{}",
            mesh.positions.len()
        );
        assert!(
            (50_000..58_000).contains(&mesh.faces.len()),
            "{}",
            mesh.faces.len()
        );
        assert_eq!(
            mesh.texture_coordinates.unwrap().values.len(),
            mesh.positions.len()
        );
    }
}

/// Prints parse times; run it on a release build with `--ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn parse_times() {
    let time = |name: &str, bytes: &[u8], format: Format| {
        let best = (0..20).map(|_| {
            let start = Instant::now();
            let mesh = read(bytes, format, &LIMITS).unwrap();
            (start.elapsed(), mesh.faces.len())
        });
        let (elapsed, faces) = best.min().unwrap();
        println!("{name}: {faces} faces, {} bytes, {elapsed:?}", bytes.len());
    };
    for folder in ["basketball_player", "textured", "liam"] {
        let Some(path) = captures(folder).and_then(|paths| paths.into_iter().next()) else {
            continue;
        };
        let mesh = read_file(&path);
        let format = Format::from_extension(path.extension().unwrap().to_str().unwrap()).unwrap();
        time(folder, &std::fs::read(&path).unwrap(), format);
        time("  as OBJ", &obj::write(&mesh), Format::Obj);
        time("  as PLY", &ply::write(&mesh), Format::Ply);
        time(
            "  as GLB",
            &steadymesh_mesh_io::glb::write(&mesh, None),
            Format::Glb,
        );
    }
}
