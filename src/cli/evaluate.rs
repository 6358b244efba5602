//! `steadymesh evaluate`: the paper's experiment on a sequence of frame files.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use steadymesh_mesh_io::ply;

use crate::evaluation::{Evaluation, Plan, Protocol, plots, report, terminal};
use crate::pipeline::{PreparedFrame, Settings};

use super::frame_files::{expand, read_frame, to_file_mesh};
use super::output_files::{create, make_folder, output_names, write_file};
use super::progress::progress_bar;
use super::target::target_faces;
use super::tracking_mode::TrackingMode;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Frame files or folders of them: one sequence, folders in natural order.
    #[arg(required = true)]
    paths: Vec<PathBuf>,
    /// How many faces each frame is to have; several numbers are evaluated one by one.
    #[arg(long, value_name = "N", required = true, value_delimiter = ',')]
    #[arg(allow_negative_numbers = true, value_parser = target_faces)]
    target_faces: Vec<usize>,
    /// The tracking modes to be compared with the original QEM.
    #[arg(long, value_enum, value_name = "MODE", value_delimiter = ',')]
    #[arg(default_value = "paper")]
    tracking: Vec<TrackingMode>,
    /// Write every figure to this file, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report (report.md) and its plots (SVG) to this folder; made if it does not exist.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Write the registered previous frame of every frame after the first to this folder, as PLY.
    #[arg(long, value_name = "DIR")]
    keep_registered: Option<PathBuf>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let files = expand(&arguments.paths)?;
    if files.len() < 2 {
        let count = files.len();
        bail!("consecutive frames are compared, which takes at least two frames; found {count}");
    }
    let registered_files = match &arguments.keep_registered {
        Some(folder) => {
            let names = output_names(&files, "ply")?;
            make_folder(folder)?;
            names.iter().map(|name| Some(folder.join(name))).collect()
        }
        None => vec![None; files.len()],
    };
    if let Some(folder) = &arguments.report {
        make_folder(folder)?;
    }
    // Made before the work, so that a name that cannot be written to is known at once.
    let json = arguments.json.as_deref().map(create).transpose()?;

    let evaluation = evaluate(&files, &registered_files, plan(arguments))?;
    if let Some(mut json) = json {
        serde_json::to_writer_pretty(&mut json, &evaluation)?;
        json.write_all(b"\n")
            .and_then(|()| json.flush())
            .context("the JSON file cannot be written")?;
    }
    if let Some(folder) = &arguments.report {
        for plot in plots(&evaluation)? {
            write_file(&folder.join(plot.file_name), plot.svg.as_bytes())?;
        }
        write_file(&folder.join("report.md"), report(&evaluation).as_bytes())?;
    }
    super::print(&terminal(&evaluation))
}

/// Each number of faces and each mode once, in the order in which they were typed.
fn plan(arguments: &Arguments) -> Plan {
    let mut targets = Vec::new();
    for &target in &arguments.target_faces {
        if !targets.contains(&target) {
            targets.push(target);
        }
    }
    Plan {
        target_faces: targets,
        modes: arguments.tracking.iter().map(|&mode| mode.into()).collect(),
        settings: Settings::default(),
    }
}

/// Evaluates the frames in `files`, two at a time, and writes each registered frame to the file
/// that is meant for it.
fn evaluate(
    files: &[PathBuf],
    registered_files: &[Option<PathBuf>],
    plan: Plan,
) -> anyhow::Result<Evaluation> {
    let mut protocol = Protocol::new(plan);
    let progress = progress_bar(files.len() as u64);
    let mut previous: Option<PreparedFrame> = None;
    for (seq, (file, registered_file)) in files.iter().zip(registered_files).enumerate() {
        let current = read(file)?;
        if let Some(previous) = previous {
            let registered = protocol
                .add_pair(seq as u64, &previous, &current)
                .with_context(|| file.display().to_string())?;
            if let (Some(path), Some(mesh)) = (registered_file, &registered) {
                write_file(path, &ply::write(&to_file_mesh(mesh)))?;
            }
        }
        previous = Some(current);
        progress.inc(1);
    }
    progress.finish();
    let names = files.iter().filter_map(|file| file.file_name());
    let names = names.map(|name| name.to_string_lossy().into_owned());
    Ok(protocol.finish(command()?, names.collect()))
}

fn read(file: &Path) -> anyhow::Result<PreparedFrame> {
    PreparedFrame::new(read_frame(file)?, &mut ()).with_context(|| file.display().to_string())
}

/// What was typed, so that it can be typed again.
fn command() -> anyhow::Result<String> {
    let arguments = std::env::args_os().skip(1);
    let arguments: Vec<String> = arguments
        .map(|argument| argument.to_string_lossy().into_owned())
        .collect();
    let words = std::iter::once("steadymesh").chain(arguments.iter().map(String::as_str));
    shlex::try_join(words).context("the arguments cannot be quoted")
}
