//! `steadymesh evaluate`: the paper's experiment on sequences of frames.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use indicatif::ProgressBar;
use steadymesh_geometry::TriangleMesh;
use steadymesh_mesh_io::ply;

use crate::evaluation::{
    Evaluation, Pair, Plan, Protocol, Sequence, file_words, pictured_frames, plots, report,
    terminal,
};
use crate::pipeline::{Settings, TargetSize, TrackingStrength};

use super::frame_files::to_file_mesh;
use super::output_files::{create, make_folder, write_file};
use super::progress::progress_bar;
use super::takes::{SyntheticOptions, Take, TakenFrame, takes};
use super::target::{target_faces, target_ratio, tracking_strength};
use super::tracking_mode::TrackingMode;

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("sequences").required(true).multiple(true))]
#[command(group = clap::ArgGroup::new("sizes").required(true).multiple(true))]
pub(super) struct Arguments {
    /// Folders of frame files, each a sequence in natural order; files are one sequence together.
    #[arg(group = "sequences")]
    paths: Vec<PathBuf>,
    /// The synthetic rig as a sequence, whose true motion is known; with several, one by one.
    /// Any of speed (1), noise (0.0003 m), vertices (20000), frames (30) and seed (1).
    #[arg(long, value_name = "speed=S,noise=M,…", group = "sequences")]
    #[arg(num_args = 0..=1, require_equals = true, default_missing_value = "")]
    synthetic: Vec<SyntheticOptions>,
    /// How many faces each frame is to have; several numbers are evaluated one by one.
    #[arg(long, value_name = "N", value_delimiter = ',', group = "sizes")]
    #[arg(allow_negative_numbers = true, value_parser = target_faces)]
    target_faces: Vec<usize>,
    /// Which share of its faces each frame is to keep; several are evaluated one by one.
    #[arg(long, value_name = "R", value_delimiter = ',', group = "sizes")]
    #[arg(allow_negative_numbers = true, value_parser = target_ratio)]
    target_ratio: Vec<f64>,
    /// The tracking modes to be compared with the original QEM, which is always there.
    #[arg(long, value_enum, value_name = "MODE", value_delimiter = ',')]
    #[arg(default_values = ["paper", "robust"])]
    tracking: Vec<TrackingMode>,
    /// How strongly robust tracking holds a frame to the one before, 0 to 1.
    #[arg(long, value_name = "S", default_value = "0.5")]
    #[arg(allow_negative_numbers = true, value_parser = tracking_strength)]
    tracking_strength: TrackingStrength,
    /// Write every figure to this file, as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a report (report.md), its plots and its pictures (SVG) to this folder, which is made
    /// if it does not exist. There are pictures at the first size, and of the first synthetic
    /// sequence only.
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Write the registered previous frame of every frame after the first to this folder, as PLY;
    /// to a folder in it for each sequence if there are several.
    #[arg(long, value_name = "DIR")]
    keep_registered: Option<PathBuf>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let takes = takes(&arguments.paths, &arguments.synthetic)?;
    let folders = registered_folders(&takes, arguments.keep_registered.as_deref())?;
    if let Some(folder) = &arguments.report {
        make_folder(folder)?;
    }
    // Made before the work, so that a name that cannot be written to is known at once.
    let json = arguments.json.as_deref().map(create).transpose()?;

    let plan = plan(arguments);
    let progress = progress_bar(takes.iter().map(Take::frame_count).sum());
    let mut sequences = Vec::with_capacity(takes.len());
    let mut rig_is_pictured = false;
    for (take, folder) in takes.iter().zip(&folders) {
        // It looks the same at any speed.
        let is_pictured = !(take.has_known_motion() && rig_is_pictured);
        rig_is_pictured |= take.has_known_motion();
        let pictured = match is_pictured {
            true => pictured_frames(take.frame_count()),
            false => 0..0,
        };
        let protocol = Protocol::new(plan.clone(), pictured);
        sequences.push(evaluate(take, protocol, folder.as_deref(), &progress)?);
    }
    progress.finish();

    let evaluation = Evaluation::new(command()?, sequences);
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

/// The folder for each sequence's registered frames, which is made now.
fn registered_folders(
    takes: &[Take],
    folder: Option<&Path>,
) -> anyhow::Result<Vec<Option<PathBuf>>> {
    let mut folders = Vec::with_capacity(takes.len());
    for take in takes {
        let folder = folder.map(|folder| match takes.len() {
            1 => folder.to_owned(),
            _ => folder.join(file_words(take.name())),
        });
        if let Some(folder) = &folder {
            make_folder(folder)?;
        }
        folders.push(folder);
    }
    Ok(folders)
}

/// Each size and each mode once, in the order in which they were typed.
fn plan(arguments: &Arguments) -> Plan {
    let faces = arguments.target_faces.iter().copied();
    let ratios = arguments.target_ratio.iter().copied();
    let mut targets = Vec::new();
    for target in faces
        .map(TargetSize::Faces)
        .chain(ratios.map(TargetSize::Ratio))
    {
        if !targets.contains(&target) {
            targets.push(target);
        }
    }
    Plan {
        targets,
        modes: arguments.tracking.iter().map(|&mode| mode.into()).collect(),
        settings: Settings {
            tracking_strength: arguments.tracking_strength,
            ..Settings::default()
        },
    }
}

/// Evaluates a sequence, two frames at a time, and writes each registered frame to
/// `registered_folder` if there is one.
fn evaluate(
    take: &Take,
    mut protocol: Protocol,
    registered_folder: Option<&Path>,
    progress: &ProgressBar,
) -> anyhow::Result<Sequence> {
    let names = take.registered_names()?;
    let mut previous: Option<TakenFrame> = None;
    for (seq, name) in (0..).zip(&names) {
        let current = take.frame(seq)?;
        if let Some(previous) = &previous {
            let carry = |output: &TriangleMesh| take.carry(previous, output, seq);
            let pair = Pair {
                seq,
                previous: &previous.prepared,
                current: &current.prepared,
                true_motion: take.has_known_motion().then_some(&carry),
            };
            let registered = protocol
                .add_pair(pair)
                .with_context(|| take.frame_name(seq))?;
            if let (Some(folder), Some(mesh)) = (registered_folder, &registered) {
                write_file(&folder.join(name), &ply::write(&to_file_mesh(mesh)))?;
            }
        }
        previous = Some(current);
        progress.inc(1);
    }
    let frames = (0..take.frame_count()).map(|seq| take.frame_name(seq));
    Ok(protocol.finish(take.name().to_owned(), frames.collect()))
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
