//! `steadymesh simplify`: a sequence of frame files, smaller.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail};
use clap::Args;
use steadymesh_mesh_io::ply;
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::stream::MetricsMode;
use steadymesh_proto::wording::counted;

use crate::pipeline::{
    AttributeWeight, Output, PreparedFrame, Previous, ProcessedFrame, Settings, TargetSize,
    TrackingStrength, process,
};
use crate::stopwatch::{Stopwatch, microseconds};
use crate::textures::SourceImage;

use super::frame_files::{expand, read_textured, to_file_mesh};
use super::frame_writer::{OutputFormat, write_frame};
use super::output_files::{
    create, is_same_folder, make_folder, output_names, refuse_to_overwrite, write_file,
};
use super::progress::progress_bar;
use super::target::{attribute_weight, target_faces, target_ratio, tracking_strength};
use super::tracking_mode::TrackingMode;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Frame files or folders of them: one sequence, folders in natural order.
    #[arg(required = true)]
    paths: Vec<PathBuf>,
    #[command(flatten)]
    target: TargetArguments,
    /// The folder for the simplified frames; made if it does not exist.
    #[arg(long, value_name = "DIR")]
    output: PathBuf,
    /// The format of the simplified frames.
    #[arg(long, value_enum, default_value_t = OutputFormat::Drc)]
    format: OutputFormat,
    /// Whether the previous frame takes part.
    #[arg(long, value_enum, default_value_t = TrackingMode::Robust)]
    tracking: TrackingMode,
    /// How strongly robust tracking holds a frame to the one before, 0 to 1.
    #[arg(long, value_name = "S", default_value = "0.5")]
    #[arg(allow_negative_numbers = true, value_parser = tracking_strength)]
    tracking_strength: TrackingStrength,
    /// How much colors, normals and texture coordinates count beside the shape, 0 to 1: a change by
    /// their whole range counts as this share of the frame's diagonal.
    #[arg(long, value_name = "W", default_value = "0")]
    #[arg(allow_negative_numbers = true, value_parser = attribute_weight)]
    attribute_weight: AttributeWeight,
    /// Write every frame's metrics to this file, one line of JSON a frame; for that the previous
    /// frame is registered even with tracking off.
    #[arg(long, value_name = "FILE.jsonl")]
    metrics: Option<PathBuf>,
    /// Write the registered previous frame of every frame after the first to this folder, as PLY;
    /// there is none where a frame was treated as a first one.
    #[arg(long, value_name = "DIR")]
    keep_registered: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct TargetArguments {
    /// How many faces each frame is to have.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = target_faces)]
    target_faces: Option<usize>,
    /// Which share of its faces each frame is to keep, above 0 and at most 1.
    #[arg(long, value_name = "R", allow_negative_numbers = true, value_parser = target_ratio)]
    target_ratio: Option<f64>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let settings = settings(arguments);
    let files = expand(&arguments.paths)?;
    let names = output_names(&files, arguments.format.extension())?;
    make_folder(&arguments.output)?;
    refuse_to_overwrite(&files, &arguments.output, &names)?;
    if let Some(folder) = &arguments.keep_registered {
        make_folder(folder)?;
        let registered = output_names(&files, "ply")?;
        refuse_to_overwrite(&files, folder, &registered)?;
        if arguments.format == OutputFormat::Ply && is_same_folder(folder, &arguments.output) {
            bail!(
                "simplified and registered frames would have the same names: give --keep-registered a folder of its own"
            );
        }
    }
    let mut metrics_file = arguments.metrics.as_deref().map(create).transpose()?;
    let progress = progress_bar(files.len() as u64);
    let mut previous: Option<(PreparedFrame, Output)> = None;
    for (seq, (file, name)) in files.iter().zip(&names).enumerate() {
        let seq = seq as u64;
        let before = previous.as_ref().map(|(frame, output)| Previous {
            frame,
            output: Some(output),
        });
        let Simplified {
            frame: current,
            out,
            image,
        } = simplify_one(file, before, seq, &settings)?;
        let (stem, _) = name.rsplit_once('.').unwrap_or((name, ""));
        let image = image.as_ref().map(SourceImage::file);
        let image = image.map(|(format, bytes)| (format, &bytes[..]));
        write_frame(
            &arguments.output,
            stem,
            arguments.format,
            (&out.draco, image),
        )?;
        if let (Some(folder), Some(registered)) = (&arguments.keep_registered, &out.registered) {
            let path = folder.join(Path::new(name).with_extension("ply"));
            write_file(&path, &ply::write(&to_file_mesh(registered)))?;
        }
        if let Some(metrics_file) = &mut metrics_file {
            serde_json::to_writer(&mut *metrics_file, &out.metrics)?;
            metrics_file
                .write_all(b"\n")
                .context("the metrics cannot be written")?;
        }
        warn_about(file, &out.metrics);
        previous = Some((current, out.output));
        progress.inc(1);
    }
    if let Some(mut metrics_file) = metrics_file {
        metrics_file
            .flush()
            .context("the metrics cannot be written")?;
    }
    progress.finish();
    Ok(())
}

struct Simplified {
    frame: PreparedFrame,
    out: ProcessedFrame,
    image: Option<SourceImage>,
}

fn simplify_one(
    file: &Path,
    previous: Option<Previous<'_>>,
    seq: u64,
    settings: &Settings,
) -> anyhow::Result<Simplified> {
    let started = Instant::now();
    let mut stopwatch = Stopwatch::start();
    let (raw, image) = read_textured(file)?;
    stopwatch.parsed();
    let current =
        PreparedFrame::new(raw, &mut stopwatch).with_context(|| file.display().to_string())?;
    let mut out = process(&current, previous, settings, &mut stopwatch)
        .with_context(|| file.display().to_string())?;
    out.metrics.seq = seq;
    out.metrics.reference_seq = out.registered.as_ref().map(|_| seq - 1);
    out.metrics.stage_us = stopwatch.times();
    out.metrics.latency_us = microseconds(started.elapsed());
    Ok(Simplified {
        frame: current,
        out,
        image,
    })
}

fn settings(arguments: &Arguments) -> Settings {
    let TargetArguments {
        target_faces,
        target_ratio,
    } = arguments.target;
    // Just one of them is there: the group is required and not multiple.
    let target = target_ratio.map_or_else(
        || TargetSize::Faces(target_faces.unwrap_or_default()),
        TargetSize::Ratio,
    );
    // Nothing is measured that nobody sees. What is to be kept must be registered, too.
    let metrics = match (&arguments.metrics, &arguments.keep_registered) {
        (None, None) => MetricsMode::Off,
        _ => MetricsMode::Full,
    };
    Settings {
        target,
        tracking: arguments.tracking.into(),
        tracking_strength: arguments.tracking_strength,
        attribute_weight: arguments.attribute_weight,
        metrics,
        ..Settings::default()
    }
}

/// Says what a user would want to know without having asked for metrics.
fn warn_about(file: &Path, metrics: &FrameMetrics) {
    let file = file.display();
    if let Some(reason) = metrics
        .registration_error
        .as_ref()
        .or(metrics.reset.as_ref())
    {
        super::say(&format!("{file}: treated as a first frame: {reason}"));
    }
    if !metrics.output.target_reached {
        let faces = counted(metrics.output.faces as u64, "face");
        super::say(&format!(
            "{file}: no edge can be collapsed any more, although the result has {faces}"
        ));
    }
}
