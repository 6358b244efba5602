//! The house rules that a compiler does not check: who may use whom, what the pure parts do
//! without, and how long a file may be.

#![allow(clippy::unwrap_used, reason = "this is test code")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Which modules of the server may use which others. What is not here may use none.
const MAY_USE: [(&str, &[&str]); 12] = [
    (
        "cli",
        &[
            "bus",
            "compute",
            "config",
            "evaluation",
            "otlp",
            "pipeline",
            "server",
            "stopwatch",
            "storage",
            "streams",
            "telemetry",
            "textures",
            "tls",
            "webhooks",
            "worker",
        ],
    ),
    (
        "config",
        &[
            "bus",
            "compute",
            "server",
            "storage",
            "streams",
            "telemetry",
            "webhooks",
            "worker",
        ],
    ),
    (
        "server",
        &[
            "bus",
            "compute",
            "processing",
            "stopwatch",
            "storage",
            "streams",
            "telemetry",
        ],
    ),
    (
        "streams",
        &[
            "bus",
            "compute",
            "pipeline",
            "processing",
            "stopwatch",
            "storage",
            "telemetry",
            "textures",
        ],
    ),
    (
        "worker",
        &[
            "bus",
            "compute",
            "pipeline",
            "processing",
            "stopwatch",
            "streams",
            "telemetry",
            "textures",
        ],
    ),
    (
        "processing",
        &["compute", "pipeline", "stopwatch", "textures"],
    ),
    ("textures", &["compute"]),
    ("storage", &["telemetry"]),
    ("webhooks", &["streams", "telemetry"]),
    ("evaluation", &["pipeline"]),
    ("stopwatch", &["pipeline", "telemetry"]),
    ("main", &["cli"]),
];

/// Code without IO, clock, log, threads or chance.
const PURE: [&str; 5] = [
    "crates/geometry/src",
    "crates/mesh-io/src",
    "crates/synthetic-rig/src",
    "proto/src",
    "src/pipeline",
];

const IMPURE: [&str; 12] = [
    "std::fs",
    "std::net",
    "std::io",
    "std::env",
    "std::process",
    "std::thread",
    "Instant",
    "SystemTime",
    "tokio",
    "tracing",
    "rayon",
    "println!",
];

const MAX_LINES: usize = 500;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// All Rust files under `folder`, with their code before the tests.
fn sources(folder: &str) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                // Tests in a file of their own.
                if path.ends_with("tests.rs") {
                    continue;
                }
                let text = std::fs::read_to_string(&path).unwrap();
                let code = text
                    .split("#[cfg(test)]\nmod tests {")
                    .next()
                    .unwrap()
                    .to_owned();
                files.push((path, code));
            }
        }
    }
    assert!(
        !files.is_empty(),
        "{folder} has no Rust files: the rule looks in the wrong place"
    );
    files
}

fn relative(path: &Path) -> String {
    path.strip_prefix(root()).unwrap().display().to_string()
}

/// Lines that are code rather than comment.
fn code_lines(code: &str) -> impl Iterator<Item = &str> {
    code.lines()
        .map(str::trim)
        .filter(|line| !line.starts_with("//"))
}

#[test]
fn modules_use_only_what_is_below_them() {
    let mut wrong = Vec::new();
    for (path, code) in sources("src") {
        let inside = path.strip_prefix(root().join("src")).unwrap();
        let module = inside
            .iter()
            .next()
            .unwrap()
            .to_str()
            .unwrap()
            .trim_end_matches(".rs");
        if module == "lib" {
            continue;
        }
        let allowed = MAY_USE
            .iter()
            .find(|row| row.0 == module)
            .map_or(&[][..], |row| row.1);
        for used in used_modules(&code) {
            if used != module && !allowed.contains(&used.as_str()) {
                wrong.push(format!("{} uses {used}", relative(&path)));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The modules that `crate::…` and `steadymesh::…` paths begin with.
fn used_modules(code: &str) -> BTreeSet<String> {
    let mut used = BTreeSet::new();
    for line in code_lines(code) {
        for (at, prefix) in line.match_indices("crate::") {
            let rest = &line[at + prefix.len()..];
            if let Some(list) = rest.strip_prefix('{') {
                let names = list.split(['}', ';']).next().unwrap();
                used.extend(names.split(',').filter_map(first_name));
            } else {
                used.extend(first_name(rest));
            }
        }
    }
    used
}

fn first_name(path: &str) -> Option<String> {
    let name: String = path
        .trim()
        .chars()
        .take_while(|c| c.is_ascii_alphanumeric() || *c == '_')
        .collect();
    (!name.is_empty()).then_some(name)
}

#[test]
fn the_core_does_no_io_reads_no_clock_and_starts_no_thread() {
    let mut wrong = Vec::new();
    for folder in PURE {
        for (path, code) in sources(folder) {
            for line in code_lines(&code) {
                for word in IMPURE {
                    if line.contains(word) {
                        wrong.push(format!("{}: {line}", relative(&path)));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn only_the_server_knows_http() {
    let mut wrong = Vec::new();
    for folder in [
        "src/streams",
        "src/pipeline",
        "src/telemetry",
        "src/evaluation",
    ] {
        for (path, code) in sources(folder) {
            let knows = |line: &str| {
                ["axum", "hyper", "tower", "reqwest"]
                    .iter()
                    .any(|w| line.contains(w))
            };
            if code_lines(&code).any(knows) {
                wrong.push(relative(&path));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn unsafe_code_is_in_the_draco_crates_and_the_heaps_only() {
    let mut wrong = Vec::new();
    for folder in [
        "src",
        "proto/src",
        "crates/geometry/src",
        "crates/mesh-io/src",
        "crates/synthetic-rig/src",
    ] {
        for (path, code) in sources(folder) {
            if code_lines(&code).any(|line| line.contains("unsafe ")) {
                wrong.push(relative(&path));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn every_file_says_its_job_and_is_short() {
    let mut wrong = Vec::new();
    for folder in ["src", "proto/src", "crates"] {
        for (path, code) in sources(folder) {
            if !code.starts_with("//!") {
                wrong.push(format!(
                    "{} does not begin with its job (//!)",
                    relative(&path)
                ));
            }
            let lines = code.lines().count();
            if MAX_LINES < lines {
                wrong.push(format!("{} has {lines} lines", relative(&path)));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
