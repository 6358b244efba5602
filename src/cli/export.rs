//! `steadymesh export`: the frames of a stream or a recording as files that other players read.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde_json::json;
use steadymesh_mesh_io::ImageFormat;
use steadymesh_proto::wording::counted;
use steadymesh_proto::{DeliveredFrame, FrameMetrics};

use super::frame_writer::{OutputFormat, write_frame};
use super::output_files::{make_folder, write_file};
use super::progress::counter;
use super::receiver::{Next, frame_count, receive};
use super::remote::{Remote, TokenArgument};
use super::stream_url::StreamUrl;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The stream, such as `http://127.0.0.1:8080/v1/streams/demo`, or a recording of one, which is
    /// under /v1/recordings. A live stream is exported from now on.
    #[arg(value_parser = StreamUrl::parse_any)]
    url: StreamUrl,
    #[command(flatten)]
    token: TokenArgument,
    /// The folder for the files; made if it does not exist.
    #[arg(long, value_name = "DIR")]
    output: PathBuf,
    /// Which files.
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// Stop after so many frames.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = frame_count)]
    frames: Option<u64>,
    /// Begin with this frame of a recording.
    #[arg(long, value_name = "SEQ")]
    from_seq: Option<u64>,
    /// The frame rate that a UVOL manifest says. Without it, that of the capture times.
    #[arg(long, value_name = "FPS", allow_negative_numbers = true, value_parser = frame_rate)]
    frame_rate: Option<f64>,
}

/// What players of mesh sequences read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ExportFormat {
    /// A Universal Volumetric folder (version 2): a manifest, Draco meshes and images.
    Uvol,
    /// Draco meshes, numbered from 000000, with their images.
    Drc,
    /// glTF binaries with their images inside.
    Glb,
    /// PLY files, as Blender's sequence importers read them.
    Ply,
    /// OBJ files with materials and images.
    Obj,
}

/// What has been written so far.
struct Export<'a> {
    folder: &'a Path,
    format: ExportFormat,
    frames: u64,
    /// Of the first frame and the last that said when they were captured: number and time.
    first: Option<(u64, u64)>,
    last: Option<(u64, u64)>,
    /// Which image is the last that came, in which format.
    image: Option<(String, ImageFormat, Vec<u8>)>,
    texture: Option<Textures>,
}

/// What a manifest says of the images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Textures {
    format: ImageFormat,
    width: u32,
    height: u32,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let remote = Remote::new(&arguments.url, &arguments.token);
    let from_seq = arguments.from_seq.map(|seq| seq.to_string());
    let mut parameters = vec![("textures", "inline")];
    if remote.url.is_recording() {
        // As fast as it can be written.
        parameters.push(("speed", "0"));
        parameters.extend(from_seq.as_deref().map(|seq| ("from_seq", seq)));
    } else if from_seq.is_some() {
        super::wrong_usage("--from-seq is for recordings: a live stream is exported from now on");
    }
    make_folder(&arguments.output)?;
    let mut export = Export::new(&arguments.output, arguments.format);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let progress = counter();
    let outcome = runtime.block_on(async {
        let take = |message: &[u8]| export.write(message).map(|()| Next::Go);
        tokio::select! {
            outcome = receive(&remote, &parameters, arguments.frames, &progress, take) => outcome,
            signal = super::interrupted() => signal,
        }
    });
    progress.finish_and_clear();
    // What has come before a connection broke is a sequence, too.
    let finished = export.finish(arguments.frame_rate);
    let written = counted(export.frames, "frame");
    super::say(&format!(
        "{written} written to {}",
        arguments.output.display()
    ));
    outcome.and(finished)
}

impl<'a> Export<'a> {
    fn new(folder: &'a Path, format: ExportFormat) -> Self {
        Self {
            folder,
            format,
            frames: 0,
            first: None,
            last: None,
            image: None,
            texture: None,
        }
    }

    /// Writes a frame. They are numbered from 0 without gaps, as players of sequences expect it.
    fn write(&mut self, message: &[u8]) -> anyhow::Result<()> {
        let frame = DeliveredFrame::decode(message).context("a message cannot be read")?;
        if let Some(time) = frame.metrics.capture_time_us {
            let stamp = (frame.metrics.seq, time);
            self.first = self.first.or(Some(stamp));
            self.last = Some(stamp);
        }
        self.take_image(&frame.metrics, frame.image)?;
        let image = self
            .image
            .as_ref()
            .map(|(_, format, bytes)| (*format, &bytes[..]));
        let stem = format!("{:06}", self.frames);
        let (geometry, texture) = (self.folder.join("geometry"), self.folder.join("texture"));
        match self.format {
            ExportFormat::Uvol => {
                if self.frames == 0 {
                    make_folder(&geometry)?;
                }
                write_frame(&geometry, &stem, OutputFormat::Drc, (frame.mesh, None))?;
                if let Some((format, bytes)) = image {
                    make_folder(&texture)?;
                    let name = format!("{stem}.{}", format.extension());
                    write_file(&texture.join(name), bytes)?;
                }
            }
            format => {
                let format = match format {
                    ExportFormat::Glb => OutputFormat::Glb,
                    ExportFormat::Ply => OutputFormat::Ply,
                    ExportFormat::Obj => OutputFormat::Obj,
                    ExportFormat::Drc | ExportFormat::Uvol => OutputFormat::Drc,
                };
                write_frame(self.folder, &stem, format, (frame.mesh, image))?;
            }
        }
        self.frames += 1;
        Ok(())
    }

    /// Keeps the frame's image, which comes only if it is another than the last.
    fn take_image(&mut self, metrics: &FrameMetrics, image: Option<&[u8]>) -> anyhow::Result<()> {
        let Some(texture) = &metrics.texture else {
            self.image = None;
            return Ok(());
        };
        if let Some(image) = image {
            let format = ImageFormat::from_media_type(&texture.media_type);
            let format = format.with_context(|| format!("an image is {}", texture.media_type))?;
            self.image = Some((texture.id.clone(), format, image.to_vec()));
            let of_manifest = Textures {
                format,
                width: texture.width,
                height: texture.height,
            };
            self.texture = self.texture.or(Some(of_manifest));
        }
        match &self.image {
            Some((id, ..)) if *id == texture.id => Ok(()),
            _ => bail!("the image of frame {} has not come", metrics.seq),
        }
    }

    /// Writes the manifest, if there is one.
    fn finish(&self, frame_rate: Option<f64>) -> anyhow::Result<()> {
        if self.format != ExportFormat::Uvol || self.frames == 0 {
            return Ok(());
        }
        let frame_rate = frame_rate.unwrap_or_else(|| self.captured_frame_rate());
        let mut manifest = json!({
            "version": "v2",
            "duration": self.frames as f64 / frame_rate,
            "geometry": {
                "targets": { "draco": {
                    "format": "draco", "frameRate": frame_rate, "frameCount": self.frames,
                } },
                "path": "geometry/[######][ext]",
            },
        });
        if let Some(Textures {
            format,
            width,
            height,
        }) = self.texture
        {
            let name = format.extension();
            manifest["texture"] = json!({
                "targets": { name: {
                    "format": name, "type": "baseColor", "resolution": [width, height],
                    "frameRate": frame_rate, "sequenceSize": 1, "sequenceCount": self.frames,
                } },
                "path": "texture/[######][ext]",
            });
        }
        let text = serde_json::to_vec_pretty(&manifest)?;
        write_file(&self.folder.join("manifest.json"), &text)
    }

    /// Frames a second, from the capture times; 30 if they do not say.
    fn captured_frame_rate(&self) -> f64 {
        let (Some((first, began)), Some((last, ended))) = (self.first, self.last) else {
            return 30.0;
        };
        let frames = last.saturating_sub(first) as f64;
        let seconds = ended.saturating_sub(began) as f64 / 1e6;
        if frames == 0.0 || seconds == 0.0 {
            return 30.0;
        }
        // A clock in microseconds gives no more.
        (frames / seconds * 1000.0).round() / 1000.0
    }
}

fn frame_rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(rate) if (0.001..=1000.0).contains(&rate) => Ok(rate),
        _ => Err("a number from 0.001 to 1000 is expected".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_rate_is_that_of_the_capture() {
        let mut export = Export::new(Path::new(""), ExportFormat::Uvol);
        assert_eq!(export.captured_frame_rate(), 30.0);
        (export.first, export.last) = (Some((4, 1_000_000)), Some((4, 1_000_000)));
        assert_eq!(export.captured_frame_rate(), 30.0);
        // One frame is missing between.
        export.last = Some((9, 1_200_000));
        assert_eq!(export.captured_frame_rate(), 25.0);
    }
}
