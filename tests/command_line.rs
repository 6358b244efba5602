//! The command line as a user meets it: files in, files out, exit codes.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it measured"
)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use steadymesh_mesh_io::{Mesh, obj};
use steadymesh_synthetic_rig as rig;

/// A folder of its own for a test, removed with it.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        if path.exists() {
            std::fs::remove_dir_all(&path).unwrap();
        }
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

fn steadymesh(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_steadymesh"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn write_synthetic_frames(folder: &Path, count: u64) {
    let options = rig::Options {
        vertex_count: 2000,
        ..rig::Options::default()
    };
    let rig = rig::Rig::new(&options).unwrap();
    for index in 0..count {
        let frame = rig.frame(index);
        let mesh = Mesh {
            positions: frame.positions.iter().map(|p| p.map(f64::from)).collect(),
            faces: frame.faces,
            normals: None,
            colors: None,
            materials: None,
            texture_coordinates: None,
            image: None,
        };
        std::fs::write(folder.join(format!("frame{index}.obj")), obj::write(&mesh)).unwrap();
    }
}

#[test]
fn simplify_writes_frames_metrics_and_registered_frames() {
    let folder = Folder::new("simplify_writes");
    std::fs::create_dir(folder.0.join("in")).unwrap();
    write_synthetic_frames(&folder.0.join("in"), 3);
    let arguments = "simplify in --target-faces 500 --output out --metrics metrics.jsonl \
                     --keep-registered registered";
    let arguments: Vec<&str> = arguments.split_whitespace().collect();
    let done = steadymesh(&arguments, &folder.0);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    assert!(done.stdout.is_empty());
    let metrics = std::fs::read_to_string(folder.0.join("metrics.jsonl")).unwrap();
    for (seq, line) in metrics.lines().enumerate() {
        let frame: serde_json::Value = serde_json::from_str(line).unwrap();
        assert_eq!(frame["seq"], seq);
        assert_eq!(frame["output"]["faces"], 500);
        let drc = std::fs::read(folder.0.join(format!("out/frame{seq}.drc"))).unwrap();
        assert_eq!(frame["output"]["bytes"], drc.len());
        assert_eq!(
            folder.0.join(format!("registered/frame{seq}.ply")).exists(),
            seq != 0
        );
    }
    assert_eq!(metrics.lines().count(), 3);
}

#[test]
fn simplify_says_what_comes_back_without_tracking_and_tracks_robustly_by_default() {
    let folder = Folder::new("simplify_modes");
    std::fs::create_dir(folder.0.join("in")).unwrap();
    write_synthetic_frames(&folder.0.join("in"), 2);
    let simplify = |name: &str, options: &str| {
        let arguments = format!(
            "simplify in --target-faces 500 --output {name} --metrics {name}.jsonl {options}"
        );
        let arguments: Vec<&str> = arguments.split_whitespace().collect();
        assert!(steadymesh(&arguments, &folder.0).status.success());
        let metrics = std::fs::read_to_string(folder.0.join(format!("{name}.jsonl"))).unwrap();
        let last: serde_json::Value =
            serde_json::from_str(metrics.lines().last().unwrap()).unwrap();
        last
    };
    let off = simplify("off", "--tracking off");
    assert_eq!(off["tracking"], "off");
    assert_eq!(off["reference_seq"], 0);
    assert!(off["consistency"].is_object());
    assert!(off["vertex_distance"]["previous"].is_object());

    let default = simplify("default", "");
    assert_eq!(default["tracking"], "robust");
    let persistence = |metrics: &serde_json::Value| {
        metrics["consistency"]["vertex_persistence"]
            .as_f64()
            .unwrap()
    };
    let strong = simplify("strong", "--tracking-strength 1");
    assert!(persistence(&off) < persistence(&default));
    assert!(persistence(&default) < persistence(&strong));
}

#[test]
fn wrong_usage_is_exit_code_two_and_a_bad_file_is_one() {
    let folder = Folder::new("exit_codes");
    std::fs::write(folder.0.join("text.obj"), "this is not a mesh\n").unwrap();
    let code = |arguments: &str| {
        let arguments: Vec<&str> = arguments.split_whitespace().collect();
        let output = steadymesh(&arguments, &folder.0);
        assert!(!output.stderr.is_empty(), "{arguments:?} says nothing");
        output.status.code()
    };
    assert_eq!(code("simplify text.obj --output out"), Some(2));
    assert_eq!(
        code("simplify text.obj --target-faces 0 --output out"),
        Some(2)
    );
    assert_eq!(
        code("simplify text.obj --target-ratio 2 --output out"),
        Some(2)
    );
    assert_eq!(
        code("simplify text.obj --target-faces 100 --output out"),
        Some(1)
    );
    assert_eq!(
        code("simplify missing.obj --target-faces 100 --output new"),
        Some(1)
    );
    assert!(!folder.0.join("new").exists());
    for wrong in [
        "simplify text.obj --target-faces -4 --output out",
        "simplify text.obj --target-faces 100 --output out --tracking-strength 1.5",
        "simplify text.obj --target-faces 100 --output out --tracking-strength nan",
        "evaluate text.obj --target-faces 100 --tracking-strength -1",
        "evaluate text.obj --target-faces 3",
        "publish demo --synthetic",
        "publish localhost:8080/demo --synthetic",
        "publish http://localhost:8080/demo --synthetic --vertices 0",
        "publish http://localhost:8080/demo --synthetic --vertices -1",
        "publish http://localhost:8080/demo --synthetic --fps 0",
        "subscribe http://localhost:8080",
        "subscribe http://localhost:8080/demo --frames 0",
        "health localhost",
    ] {
        assert_eq!(code(wrong), Some(2), "{wrong}");
    }
}

#[test]
fn simplify_does_not_overwrite_its_input_or_one_output_by_another() {
    let folder = Folder::new("simplify_refuses");
    std::fs::create_dir(folder.0.join("in")).unwrap();
    write_synthetic_frames(&folder.0.join("in"), 2);
    let before = std::fs::read(folder.0.join("in/frame0.obj")).unwrap();
    for arguments in [
        "simplify in --target-faces 500 --format obj --output in",
        "simplify in --target-faces 500 --format ply --output out --keep-registered out",
    ] {
        let arguments: Vec<&str> = arguments.split_whitespace().collect();
        let refused = steadymesh(&arguments, &folder.0);
        assert_eq!(refused.status.code(), Some(1), "{arguments:?}");
    }
    assert_eq!(
        std::fs::read(folder.0.join("in/frame0.obj")).unwrap(),
        before
    );
}
