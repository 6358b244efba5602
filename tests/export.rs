//! `publish` with images beside the frame files, and `export` of what came of them.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/commands.rs"]
mod commands;

use std::path::{Path, PathBuf};

use commands::{Server, run};
use serde_json::{Value, json};
use steadymesh_mesh_io::{Format, Limits, Mesh, read};

const LIMITS: Limits = Limits {
    max_vertices: 1 << 20,
    max_faces: 1 << 20,
    max_memory_bytes: 1 << 28,
};

fn recording_to(folder: &Path) -> Server {
    let url = url::Url::from_directory_path(folder).unwrap();
    Server::start_with(&[
        ("STEADYMESH_RECORDINGS__URL", url.as_str()),
        ("STEADYMESH_STREAMS__DEFAULTS__RECORD", "output"),
    ])
}

fn succeeds(arguments: &str) {
    let output = run(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments}: {said}");
}

/// A closed box whose sides each lie on the whole image: every corner is on seams.
const BOX: &str = "mtllib box.mtl
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
f 1/1 4/4 3/3 2/2\nf 5/1 6/2 7/3 8/4\nf 1/1 2/2 6/3 5/4
f 2/1 3/2 7/3 6/4\nf 3/1 4/2 8/3 7/4\nf 4/1 1/2 5/3 8/4
";

fn png(width: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::from_pixel(width, 4, image::Rgb([9, 8, 7]));
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Publishes the box with an image three times, of which the second time is the same; gives the
/// recording's address.
fn record(server: &Server, folder: &Path) -> String {
    let stream = format!("http://{}/v1/streams/box", server.address);
    std::fs::write(folder.join("box.obj"), BOX).unwrap();
    let material = "newmtl skin\nmap_Kd -clamp on the skin.png\n";
    std::fs::write(folder.join("box.mtl"), material).unwrap();
    for width in [8, 8, 16] {
        std::fs::write(folder.join("the skin.png"), png(width)).unwrap();
        let file = folder.join("box.obj");
        succeeds(&format!("publish {stream} {} --fps 10", file.display()));
    }
    steadymesh::tls::set_up();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(async {
        let client = reqwest::Client::new();
        let get = async |url: &str| client.get(url).send().await.unwrap().json::<Value>().await;
        // The command has been told that its frames are accepted; the last one is out soon.
        while get(&stream).await.unwrap()["counters"]["published"] != 3 {
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
        let id = get(&stream).await.unwrap()["recording"]["id"].clone();
        let id = id.as_str().unwrap();
        client.delete(&stream).send().await.unwrap();
        let recording = format!("http://{}/v1/recordings/box/{id}", server.address);
        while get(&recording).await.unwrap()["state"] != "complete" {
            tokio::time::sleep(std::time::Duration::from_millis(50)).await;
        }
        recording
    })
}

/// The tests of this process share the loopback address and nothing else.
fn work_folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&folder).ok();
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn mesh(path: &Path, format: Format) -> Mesh {
    read(&std::fs::read(path).unwrap(), format, &LIMITS).unwrap()
}

#[test]
fn a_recording_is_exported_for_other_players_with_its_images() {
    let folder = work_folder("export");
    let server = recording_to(&work_folder("export-recordings"));
    let recording = record(&server, &folder);
    for format in ["uvol", "drc", "glb", "ply", "obj"] {
        let output = folder.join(format);
        let output = output.display();
        succeeds(&format!(
            "export {recording} --format {format} --output {output} --frame-rate 25"
        ));
    }
    // The second frame's image did not change and is there all the same.
    for (frame, image) in [png(8), png(8), png(16)].iter().enumerate() {
        let file = |format: &str, extension: &str| {
            folder.join(format).join(format!("{frame:06}.{extension}"))
        };
        for format in ["drc", "ply", "obj"] {
            assert_eq!(&std::fs::read(file(format, "png")).unwrap(), image);
        }
        assert_eq!(&std::fs::read(file("uvol/texture", "png")).unwrap(), image);
        let drc = std::fs::read(file("drc", "drc")).unwrap();
        assert_eq!(std::fs::read(file("uvol/geometry", "drc")).unwrap(), drc);
        let original = read(&drc, Format::Drc, &LIMITS).unwrap();
        for (format, kind) in [
            ("glb", Format::Glb),
            ("ply", Format::Ply),
            ("obj", Format::Obj),
        ] {
            let mesh = mesh(&file(format, format), kind);
            assert_eq!(mesh.faces.len(), original.faces.len(), "{format}");
            let coordinates = mesh.texture_coordinates.unwrap().values;
            let expected = &original.texture_coordinates.as_ref().unwrap().values;
            for (found, expected) in coordinates.iter().zip(expected) {
                let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
                assert!(off < 1e-5, "{format}: {found:?} {expected:?}");
            }
            assert_eq!(mesh.image.is_some(), format == "glb", "{format}");
        }
        let ply = std::fs::read(file("ply", "ply")).unwrap();
        let comment = format!("comment TextureFile {frame:06}.png\n");
        assert!(
            ply.windows(comment.len())
                .any(|part| part == comment.as_bytes())
        );
        let material = std::fs::read_to_string(file("obj", "mtl")).unwrap();
        assert!(material.contains(&format!("map_Kd {frame:06}.png")));
        let obj = std::fs::read_to_string(file("obj", "obj")).unwrap();
        assert!(obj.starts_with(&format!("mtllib {frame:06}.mtl\nusemtl frame\n")));
    }
    let manifest = std::fs::read(folder.join("uvol/manifest.json")).unwrap();
    let manifest: Value = serde_json::from_slice(&manifest).unwrap();
    assert_eq!(
        manifest,
        json!({
            "version": "v2",
            "duration": 0.12,
            "geometry": {
                "targets": { "draco": { "format": "draco", "frameRate": 25.0, "frameCount": 3 } },
                "path": "geometry/[######][ext]",
            },
            "texture": {
                "targets": { "png": {
                    "format": "png", "type": "baseColor", "resolution": [8, 4],
                    "frameRate": 25.0, "sequenceSize": 1, "sequenceCount": 3,
                } },
                "path": "texture/[######][ext]",
            },
        })
    );
}

#[test]
fn wrong_wishes_are_refused_before_anything_is_written() {
    let folder = work_folder("export-wrong");
    let output = folder.join("out");
    let stream = "http://127.0.0.1:1/v1/streams/box";
    for (more, said) in [
        ("--format stl", "invalid value 'stl'"),
        ("--format glb --frames 0", "at least 1"),
        ("--format uvol --frame-rate 0", "from 0.001 to 1000"),
        ("--format glb --from-seq 4", "is for recordings"),
    ] {
        let output = output.display();
        let refused = run(&format!("export {stream} --output {output} {more}"));
        assert_eq!(refused.status.code(), Some(2), "{more}");
        let stderr = String::from_utf8_lossy(&refused.stderr);
        assert!(stderr.contains(said), "{more}: {stderr}");
    }
    assert!(!output.exists());
}
