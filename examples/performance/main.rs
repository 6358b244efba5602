//! Writes docs/PERFORMANCE.md to standard output, from what Criterion left behind. `make bench`
//! calls it.
//!
//! ```sh
//! cargo run --release --example performance -- target/criterion > docs/PERFORMANCE.md
//! ```

#![allow(
    clippy::print_stdout,
    reason = "a tool for developers, whose output is the document"
)]

mod estimates;
mod machine;

use std::path::PathBuf;

use anyhow::Context;
use estimates::{Estimate, Estimates, exponent};

/// In the order of a frame's way, with what each does.
const STAGES: [(&str, &str); 14] = [
    ("parse PLY", "binary PLY to arrays"),
    ("parse OBJ", "OBJ text to arrays"),
    ("parse GLB", "binary glTF to arrays"),
    ("parse DRC", "Draco (default settings) to arrays"),
    ("repair", "welding, bad faces, non-manifold edges"),
    ("register", "the frame before onto this one"),
    ("simplify off", "original QEM, to a tenth of the faces"),
    ("simplify robust", "the same with `tracking=robust`"),
    ("simplify paper", "the same with `tracking=paper`"),
    ("encode", "the simplified mesh to Draco and back"),
    ("measure full", "`metrics=full`"),
    ("measure sampled", "`metrics=sampled`"),
    ("process", "a parsed frame to a delivered one, by default"),
    (
        "meshopt",
        "`meshopt::simplify` to a tenth of the faces, for comparison",
    ),
];

/// Tables go over these sizes.
const FACE_COUNTS: [usize; 7] = [5_000, 10_000, 20_000, 50_000, 100_000, 500_000, 1_000_000];

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os().nth(1);
    let folder = PathBuf::from(folder.context("name Criterion's folder, target/criterion")?);
    let estimates = Estimates::read(&folder)?;
    println!(
        "# Performance\n\nMade by `make bench`: `cargo bench --bench stages`, one thread, medians \
         of ten samples. {}\n\nThe frames are those of the synthetic rig (0.3 mm of noise). \
         Empty places were left out to keep a run below ten minutes: stages that need two \
         registered frames end at 100,000 faces.\n",
        machine::described()
    );
    println!("## Milliseconds by the number of faces\n");
    let sizes = FACE_COUNTS.map(|count| count.to_string());
    times(&estimates, &sizes);
    scaling(&estimates);
    ratios(&estimates, &sizes);
    let captures = estimates.captures();
    if !captures.is_empty() {
        println!("\n## Milliseconds on captures\n");
        times(&estimates, &captures);
    }
    Ok(())
}

fn times(estimates: &Estimates, names: &[String]) {
    let heads: Vec<String> = names.iter().map(|name| estimates.head(name)).collect();
    println!("| stage | {} |", heads.join(" | "));
    println!("|---|{}", "---:|".repeat(names.len()));
    for (stage, _) in STAGES {
        let cells = names.iter().map(|name| {
            let found = estimates.of(stage, name);
            found.map_or(String::new(), |found| milliseconds(found.seconds))
        });
        println!("| {stage} | {} |", cells.collect::<Vec<_>>().join(" | "));
    }
}

fn milliseconds(seconds: f64) -> String {
    let value = seconds * 1e3;
    match value {
        _ if value < 1.0 => format!("{value:.3}"),
        _ if value < 10.0 => format!("{value:.2}"),
        _ if value < 100.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

fn scaling(estimates: &Estimates) {
    println!(
        "\n## How times grow\n\nTime is proportional to the number of faces to the power of \
         *exponent*, fitted by least squares to the logarithms of the times above.\n\n\
         | stage | what it does | exponent |\n|---|---|---:|"
    );
    for (stage, what) in STAGES {
        let found: Vec<Estimate> = FACE_COUNTS
            .iter()
            .filter_map(|count| estimates.of(stage, &count.to_string()))
            .collect();
        let exponent = exponent(&found).map_or(String::new(), |found| format!("{found:.2}"));
        println!("| {stage} | {what} | {exponent} |");
    }
}

fn ratios(estimates: &Estimates, sizes: &[String]) {
    println!(
        "\n## Beside meshopt\n\nHow many times as long simplification takes as \
         `meshopt::simplify` in the same run, to the same number of faces. meshopt keeps vertices \
         where they are and works in `f32`; the modes here place them anew, in `f64`.\n"
    );
    println!("| mode | {} |", sizes.join(" | "));
    println!("|---|{}", "---:|".repeat(sizes.len()));
    for mode in ["off", "robust", "paper"] {
        let cells = sizes.iter().map(|size| {
            let ours = estimates.of(&format!("simplify {mode}"), size)?;
            let theirs = estimates.of("meshopt", size)?;
            Some(format!("{:.1}", ours.seconds / theirs.seconds))
        });
        let cells: Vec<String> = cells.map(Option::unwrap_or_default).collect();
        println!("| {mode} | {} |", cells.join(" | "));
    }
}
