//! `steadymesh evaluate` as a user meets it, its figures computed again by other means.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::Value;
use steadymesh_geometry::metrics::{DistanceStatistics, surface_distances, vertex_distances};
use steadymesh_geometry::spatial::{TriangleTree, VertexTree};
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_mesh_io::{Format, Limits, Mesh, obj, read};
use steadymesh_synthetic_rig as rig;

const FRAMES: u64 = 3;

fn steadymesh(arguments: &str, folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_steadymesh"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap()
}

fn succeed(arguments: &str, folder: &Path) -> String {
    let done = steadymesh(arguments, folder);
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{arguments}: {said}");
    assert!(said.is_empty(), "{arguments}: {said}");
    String::from_utf8(done.stdout).unwrap()
}

fn write_synthetic_frames(folder: &Path) {
    let options = rig::Options {
        vertex_count: 2000,
        // Fast enough for tracking to make a difference.
        speed: 2.0,
        ..rig::Options::default()
    };
    let rig = rig::Rig::new(&options).unwrap();
    std::fs::create_dir_all(folder).unwrap();
    for index in 0..FRAMES {
        let frame = rig.frame(index);
        let mesh = Mesh {
            positions: frame.positions.iter().map(|p| p.map(f64::from)).collect(),
            faces: frame.faces,
            normals: None,
            colors: None,
            texture_coordinates: None,
        };
        std::fs::write(folder.join(format!("frame{index}.obj")), obj::write(&mesh)).unwrap();
    }
}

/// One evaluation that several tests look at: everything it wrote, and what it printed.
struct Done {
    folder: PathBuf,
    printed: String,
    json: Value,
}

const ARGUMENTS: &str = "evaluate in --target-faces 500 --target-faces 300 --json figures.json \
                         --report report --keep-registered registered";

fn done() -> &'static Done {
    static DONE: OnceLock<Done> = OnceLock::new();
    DONE.get_or_init(|| {
        // Nothing drops a static: the folder stays until the next time.
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("evaluate");
        if folder.exists() {
            std::fs::remove_dir_all(&folder).unwrap();
        }
        write_synthetic_frames(&folder.join("in"));
        let printed = succeed(ARGUMENTS, &folder);
        let json = std::fs::read(folder.join("figures.json")).unwrap();
        let json = serde_json::from_slice(&json).unwrap();
        Done {
            folder,
            printed,
            json,
        }
    })
}

impl Done {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }
}

fn mesh(path: &Path) -> TriangleMesh {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let format = Format::from_extension(path.extension().unwrap().to_str().unwrap()).unwrap();
    let limits = Limits {
        max_vertices: 1 << 20,
        max_faces: 1 << 20,
        max_memory_bytes: 1 << 30,
    };
    let mesh = read(&bytes, format, &limits).unwrap();
    let positions = mesh.positions.into_iter().map(Point::from).collect();
    TriangleMesh::new(positions, mesh.faces).unwrap()
}

fn close(found: &Value, expected: f64) {
    let found = found.as_f64().unwrap();
    assert!(
        (found - expected).abs() <= 1e-12 * expected.abs(),
        "{found} instead of {expected}"
    );
}

fn close_statistics(found: &Value, distances: &[f64]) {
    let expected = DistanceStatistics::of(distances);
    assert_eq!(found["count"], expected.count);
    close(&found["mean"], expected.mean);
    close(&found["variance"], expected.variance);
    close(&found["std"], expected.std);
    close(&found["mse"], expected.mse);
    close(&found["rmse"], expected.rmse);
    close(&found["max"], expected.max);
}

#[test]
fn the_distances_are_those_of_the_written_meshes() {
    let done = done();
    for (run, mode) in [(0, "off"), (1, "paper")] {
        let simplify = format!("simplify in --target-faces 500 --tracking {mode} --output {mode}");
        succeed(&format!("{simplify} --format ply"), &done.folder);
        let run = &done.json["targets"][0]["runs"][run];
        assert_eq!(run["tracking"], mode);
        for frame in 1..FRAMES {
            let output = mesh(&done.path(&format!("{mode}/frame{frame}.ply")));
            let found = &run["outputs"][frame as usize - 1];
            assert_eq!(found["seq"], frame);
            assert_eq!(found["tracking"], mode);
            assert_eq!(found["faces"], output.face_count());
            let references = [
                ("previous", format!("registered/frame{frame}.ply")),
                ("current", format!("in/frame{frame}.obj")),
            ];
            for (name, path) in references {
                let reference = mesh(&done.path(&path));
                let surface = TriangleTree::new(&reference).unwrap();
                let vertices = VertexTree::new(reference.positions()).unwrap();
                let back = TriangleTree::new(&output).unwrap();
                let distances = &found["distances"];
                close_statistics(
                    &distances["surface_distance"][name],
                    &surface_distances(output.positions(), &surface),
                );
                close_statistics(
                    &distances["vertex_distance"][name],
                    &vertex_distances(output.positions(), &vertices),
                );
                close_statistics(
                    &distances["to_output"][name],
                    &surface_distances(reference.positions(), &back),
                );
                assert_eq!(distances["sample_distance"][name]["count"], 20_000);
            }
        }
    }
}

#[test]
fn averages_and_changes_follow_from_the_pairs() {
    for target in done().json["targets"].as_array().unwrap() {
        assert_eq!(target["compared_pairs"], FRAMES - 1);
        let mut means = vec![];
        for run in target["runs"].as_array().unwrap() {
            let outputs = run["outputs"].as_array().unwrap();
            let mean_of = |key: &str| {
                let figures = outputs.iter().map(|o| {
                    o["distances"]["surface_distance"]["previous"][key]
                        .as_f64()
                        .unwrap()
                });
                figures.sum::<f64>() / outputs.len() as f64
            };
            let average = &run["average"]["surface_distance"]["previous"]["own_unit"];
            close(&average["mean"], mean_of("mean"));
            close(&average["std"], mean_of("variance").sqrt());
            close(&average["rmse"], mean_of("mse").sqrt());
            means.push(mean_of("mean"));
        }
        let change = &target["runs"][1]["average_change_percent"]["surface_distance"]["previous"];
        let expected = 100.0 * (means[1] / means[0] - 1.0);
        let found = change["mean"].as_f64().unwrap();
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        assert!(found < 0.0, "tracking comes no closer: {found} %");
        assert!(target["runs"][0]["average_change_percent"].is_null());
    }
}

#[test]
fn bit_rates_are_those_of_thirty_frames_a_second() {
    let done = done();
    for run in done.json["targets"][1]["runs"].as_array().unwrap() {
        for output in run["outputs"].as_array().unwrap() {
            assert_eq!(output["faces"], 300);
            assert_eq!(output["target_reached"], true);
            assert_eq!(output["non_manifold_edges"], 0);
            let bits = 240.0 * output["bytes"].as_f64().unwrap();
            let rate = output["mbit_per_second"].as_f64().unwrap();
            assert!((rate - bits / 1e6).abs() < 1e-9);
        }
    }
}

#[test]
fn the_terminal_shows_the_papers_four_tables_for_every_number_of_faces() {
    let printed = &done().printed;
    for label in [
        "To 500 faces",
        "To 300 faces",
        "3 frames, 2 pairs, failed registrations: 0",
    ] {
        assert_eq!(printed.matches(label).count(), 1, "{label}:\n{printed}");
    }
    for label in [
        "Table 1: best",
        "Table 2: best",
        "Table 3: average",
        "Table 4: average",
    ] {
        assert_eq!(printed.matches(label).count(), 2, "{label}:\n{printed}");
    }
    let average = &done().json["targets"][0]["runs"][1]["average_change_percent"];
    let change = average["surface_distance"]["previous"]["mean"]
        .as_f64()
        .unwrap();
    assert!(
        printed.contains(&format!("{change:+.1} %")),
        "{change}:\n{printed}"
    );
}

#[test]
fn the_report_names_its_command_and_has_every_plot_it_refers_to() {
    let done = done();
    let report = done.text("report/report.md");
    let command: Vec<&str> = ARGUMENTS.split_whitespace().collect();
    assert!(report.contains(&format!("steadymesh {}\n", command.join(" "))));
    assert!(report.contains(concat!("Steadymesh ", env!("CARGO_PKG_VERSION"))));
    assert!(report.contains("the paper's change") && report.contains("-36.6 %"));
    let plots: Vec<&str> = report
        .split("](")
        .skip(1)
        .map(|rest| rest.split(')').next().unwrap())
        .collect();
    assert_eq!(plots.len(), 12);
    for plot in plots {
        let svg = done.text(&format!("report/{plot}"));
        assert!(
            svg.contains("original, k-1") && svg.contains("tracked (paper), k"),
            "{plot}"
        );
    }
    let written = std::fs::read_dir(done.path("report")).unwrap().count();
    assert_eq!(written, 12 + 1);
}

#[test]
fn an_argument_with_a_space_is_quoted_in_the_report() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    write_synthetic_frames(&folder.path().join("in"));
    let done = Command::new(env!("CARGO_BIN_EXE_steadymesh"))
        .args([
            "evaluate",
            "in",
            "--target-faces",
            "500,300",
            "--report",
            "my report",
        ])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(done.status.success());
    let report = std::fs::read_to_string(folder.path().join("my report/report.md")).unwrap();
    assert!(
        report.contains("--target-faces '500,300' --report 'my report'"),
        "{}",
        &report[..300]
    );
    assert!(report.contains("## To 500 faces") && report.contains("## To 300 faces"));
}

#[test]
fn equal_inputs_give_equal_files() {
    let done = done();
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    write_synthetic_frames(&folder.path().join("in"));
    assert_eq!(succeed(ARGUMENTS, folder.path()), done.printed);
    let mut compared = 0;
    for part in ["report", "registered", ""] {
        for entry in std::fs::read_dir(folder.path().join(part)).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                let name = path.strip_prefix(folder.path()).unwrap();
                let expected = std::fs::read(done.folder.join(name)).unwrap();
                assert!(
                    std::fs::read(&path).unwrap() == expected,
                    "{}",
                    name.display()
                );
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 13 + 2 + 1);
}

#[test]
fn one_frame_and_a_bad_frame_are_failures_that_say_what_is_wrong() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    write_synthetic_frames(folder.path());
    std::fs::write(folder.path().join("text.obj"), "this is not a mesh\n").unwrap();
    let one = steadymesh("evaluate frame0.obj --target-faces 100", folder.path());
    assert_eq!(one.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&one.stderr).contains("at least two frames"));
    let bad = steadymesh(
        "evaluate frame0.obj text.obj --target-faces 100",
        folder.path(),
    );
    assert_eq!(bad.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&bad.stderr).contains("text.obj"));
}

#[test]
fn wrong_usage_is_exit_code_two() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    for arguments in [
        "evaluate a.obj b.obj",
        "evaluate --target-faces 100",
        "evaluate a.obj b.obj --target-faces 3",
        "evaluate a.obj b.obj --target-faces 100,many",
        "evaluate a.obj b.obj --target-faces 100 --tracking no-such-mode",
    ] {
        let done = steadymesh(arguments, folder.path());
        assert_eq!(done.status.code(), Some(2), "{arguments}");
        assert!(!done.stderr.is_empty());
    }
}
