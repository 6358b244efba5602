//! `steadymesh evaluate` as a user meets it, its figures computed again by other means.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::Value;
use steadymesh_geometry::metrics::{
    DistanceStatistics, consistency, surface_distances, vertex_distances,
};
use steadymesh_geometry::registration::carry;
use steadymesh_geometry::spatial::{TriangleTree, VertexTree, closest_to_vertices};
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
            materials: None,
            texture_coordinates: None,
            image: None,
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

const MODES: [&str; 3] = ["off", "paper", "robust"];

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
    /// What was found for one of the numbers of faces.
    fn target(&self, index: usize) -> &Value {
        &self.json["sequences"][0]["targets"][index]
    }

    /// The result of frame `frame` in mode `mode`, to 500 faces, made by `simplify`.
    fn simplified(&self, mode: &str, frame: u64) -> TriangleMesh {
        static SIMPLIFIED: OnceLock<()> = OnceLock::new();
        SIMPLIFIED.get_or_init(|| {
            for mode in MODES {
                let simplify = "simplify in --target-faces 500 --format ply";
                succeed(
                    &format!("{simplify} --tracking {mode} --output {mode}"),
                    &self.folder,
                );
            }
        });
        mesh(&self.path(&format!("{mode}/frame{frame}.ply")))
    }

    /// The figures of that result.
    fn output(&self, mode: usize, frame: u64) -> &Value {
        &self.target(0)["runs"][mode]["outputs"][frame as usize - 1]
    }

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
    for (run, mode) in MODES.into_iter().enumerate() {
        assert_eq!(done.target(0)["runs"][run]["tracking"], mode);
        for frame in 1..FRAMES {
            let output = done.simplified(mode, frame);
            let found = done.output(run, frame);
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
            let largest = ["surface_distance", "sample_distance", "to_output"].map(|distance| {
                let statistics = &found["distances"][distance]["current"];
                statistics["max"].as_f64().unwrap()
            });
            close(&found["hausdorff"], largest.into_iter().fold(0.0, f64::max));
        }
    }
}

#[test]
fn the_decibels_are_those_of_the_written_meshes() {
    let done = done();
    for (run, mode) in MODES.into_iter().enumerate() {
        for frame in 1..FRAMES {
            let original = mesh(&done.path(&format!("in/frame{frame}.obj")));
            let output = done.simplified(mode, frame);
            let [there, back] = [(&original, &output), (&output, &original)].map(vertex_errors);
            let peak = original.bounding_box().diagonal();
            let found = &done.output(run, frame)["psnr"]["vertices"];
            for (error, index) in [("d1", 0), ("d2", 1)] {
                let (a, b) = (there[index], back[index]);
                close(&found[error]["worse"], decibels(peak, a.max(b)));
                close(&found[error]["better"], decibels(peak, a.min(b)));
            }
        }
    }
}

fn decibels(peak: f64, mean_square: f64) -> f64 {
    20.0 * (peak / mean_square.sqrt()).log10()
}

/// The mean squares of the distances to the nearest vertex, and of their part along its normal.
fn vertex_errors((from, to): (&TriangleMesh, &TriangleMesh)) -> [f64; 2] {
    let (tree, normals) = (
        VertexTree::new(to.positions()).unwrap(),
        to.vertex_normals(),
    );
    let mut sums = [0.0; 2];
    for vertex in from.positions() {
        let nearest = tree.nearest(vertex).0 as usize;
        let error = vertex - to.positions()[nearest];
        sums[0] += error.norm_squared();
        sums[1] += error.dot(&normals[nearest]).powi(2);
    }
    sums.map(|sum| sum / from.vertex_count() as f64)
}

#[test]
fn the_consistency_is_that_of_the_written_meshes() {
    let done = done();
    for (run, mode) in MODES.into_iter().enumerate() {
        for frame in 1..FRAMES {
            let source = mesh(&done.path(&format!("in/frame{}.obj", frame - 1)));
            let registered = mesh(&done.path(&format!("registered/frame{frame}.ply")));
            let before = done.simplified(mode, frame - 1);
            let surface = TriangleTree::new(&source).unwrap();
            let carried = carry(
                before.positions(),
                &closest_to_vertices(&before, &surface),
                (&source, &registered),
                &vec![0; source.vertex_count()],
            );
            let carried = carried.into_iter().map(|vertex| vertex.position).collect();
            let carried = before.with_positions(carried).unwrap();
            let expected = consistency(&carried, &done.simplified(mode, frame)).unwrap();
            let found = &done.output(run, frame)["consistency"];
            close(&found["vertex_persistence"], expected.vertex_persistence);
            close(&found["edge_persistence"], expected.edge_persistence);
            close(&found["flicker"], expected.flicker);
            assert!(done.output(run, frame)["known_motion_consistency"].is_null());
        }
    }
}

#[test]
fn averages_and_changes_follow_from_the_pairs() {
    for target in [0, 1].map(|index| done().target(index)) {
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
        let robust = &target["runs"][2]["average"]["consistency"];
        let original = &target["runs"][0]["average"]["consistency"];
        let back = ["vertex_persistence", "edge_persistence"];
        for share in back.map(|share| [original, robust].map(|c| c[share].as_f64().unwrap())) {
            assert!(share[0] < share[1], "{share:?}");
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
    for run in done.target(1)["runs"].as_array().unwrap() {
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
    let average = &done().target(0)["runs"][1]["average_change_percent"];
    let change = average["surface_distance"]["previous"]["mean"]
        .as_f64()
        .unwrap();
    assert!(
        printed.contains(&format!("{change:+.1} %")),
        "{change}:\n{printed}"
    );
}

/// Seven plots a size, and two pictures at the first one.
const IMAGES: usize = 7 + 2 + 7;

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
    assert_eq!(plots.len(), IMAGES);
    for plot in plots {
        let svg = done.text(&format!("report/{plot}"));
        let labels = match plot {
            _ if plot.contains("persistence") => ["original, vertices", "tracked (paper), edges"],
            _ if plot.contains("contact-sheet") => ["tracked (robust)", "frame 2: "],
            _ if plot.contains("heat-map") => ["to frame k-1: ", "tracked (paper)"],
            _ => ["original, k-1", "tracked (robust), k"],
        };
        for label in labels {
            assert!(svg.contains(label), "{plot}: {label}");
        }
        assert!(svg.len() < 300_000, "{plot}: {} bytes", svg.len());
    }
    let written = std::fs::read_dir(done.path("report")).unwrap().count();
    assert_eq!(written, IMAGES + 1);
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
    assert!(report.contains("### in: to 500 faces") && report.contains("### in: to 300 faces"));
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
    assert_eq!(compared, IMAGES + 1 + 2 + 1);
}

#[test]
fn every_folder_is_a_sequence_and_the_rig_one_whose_motion_is_known() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    for name in ["first", "second"] {
        write_synthetic_frames(&folder.path().join(name));
    }
    std::fs::remove_file(folder.path().join("second/frame0.obj")).unwrap();
    let printed = succeed(
        "evaluate first second --synthetic=vertices=2000,speed=2,frames=3 --target-ratio 0.125 \
         --target-faces 300 --tracking robust --json a.json --report report --keep-registered out",
        folder.path(),
    );
    let json = std::fs::read(folder.path().join("a.json")).unwrap();
    let json: Value = serde_json::from_slice(&json).unwrap();
    let sequences = json["sequences"].as_array().unwrap();
    let names: Vec<&str> = sequences
        .iter()
        .map(|s| s["name"].as_str().unwrap())
        .collect();
    let rig = "rig, speed 2, noise 0.3 mm, 2000 vertices";
    assert_eq!(names, ["first", "second", rig]);
    assert_eq!(sequences[1]["pairs"].as_array().unwrap().len(), 1);
    let sizes = sequences[0]["targets"].as_array().unwrap();
    assert_eq!(sizes[0]["target_faces"], 300);
    assert_eq!(sizes[1]["target_ratio"], 0.125);
    for name in ["first/frame2.ply", "second/frame2.ply"] {
        assert!(folder.path().join("out").join(name).exists(), "{name}");
    }
    for label in [
        "first, 300 faces",
        "second, 12.5 % of the faces",
        "Along the true motion",
    ] {
        assert!(printed.contains(label), "{label}:\n{printed}");
    }

    // The same frames, once from files and once from the rig.
    let outputs = |sequence: usize| &sequences[sequence]["targets"][1]["runs"][1]["outputs"];
    for frame in 0..2 {
        let (file, known) = (&outputs(0)[frame], &outputs(2)[frame]);
        assert_eq!(file["distances"], known["distances"]);
        assert_eq!(file["consistency"], known["consistency"]);
        assert!(file["known_motion_consistency"].is_null());
        let flicker = |of: &Value| of["flicker"].as_f64().unwrap();
        let ratio = flicker(&known["known_motion_consistency"]) / flicker(&known["consistency"]);
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
    }
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
        "evaluate a.obj b.obj --target-ratio 1.5",
        "evaluate --synthetic=colour=1 --target-faces 100",
        "evaluate --synthetic",
    ] {
        let done = steadymesh(arguments, folder.path());
        assert_eq!(done.status.code(), Some(2), "{arguments}");
        assert!(!done.stderr.is_empty());
    }
}

#[test]
fn a_pair_across_a_scene_cut_is_not_compared_and_the_report_says_why() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let frames = folder.path().join("in");
    write_synthetic_frames(&frames);
    let last = frames.join(format!("frame{}.obj", FRAMES - 1));
    let figure = mesh(&last);
    let lines = figure.positions().iter();
    let mut another: String = lines
        .map(|p| format!("v {} {} {}\n", p.z * p.z, 0.1 * p.x, p.y * p.x))
        .collect();
    for [a, b, c] in figure.faces() {
        another.push_str(&format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    }
    std::fs::write(&last, another).unwrap();
    let evaluate = "evaluate in --target-faces 300 --json a.json --report report";
    let printed = succeed(evaluate, folder.path());
    let report = std::fs::read_to_string(folder.path().join("report/report.md")).unwrap();
    for text in [printed, report] {
        assert!(text.contains("scene cut: "), "{text}");
    }
    let json = std::fs::read(folder.path().join("a.json")).unwrap();
    let json: Value = serde_json::from_slice(&json).unwrap();
    let sequence = &json["sequences"][0];
    let (pairs, target) = (&sequence["pairs"], &sequence["targets"][0]);
    let cut = FRAMES as usize - 2;
    assert!(pairs[cut]["reset"].is_string() && pairs[cut - 1]["reset"].is_null());
    assert_eq!(target["compared_pairs"], cut);
    for run in target["runs"].as_array().unwrap() {
        let output = &run["outputs"][cut];
        assert_eq!(output["tracking"], "off");
        assert!(output["consistency"].is_null());
        assert!(output["distances"]["surface_distance"]["previous"].is_null());
    }
}
