//! `steadymesh subscribe`: a player without a screen.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use steadymesh_mesh_io::ImageFormat;
use steadymesh_proto::DeliveredFrame;
use steadymesh_proto::wording::counted;

use super::frame_writer::{OutputFormat, write_frame};
use super::progress::counter;
use super::receiver::{Next, frame_count, receive};
use super::remote::{Remote, TokenArgument};
use super::stream_url::StreamUrl;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The stream, such as `http://127.0.0.1:8080/v1/streams/demo`, or a recording of one, which is
    /// under /v1/recordings.
    #[arg(value_parser = StreamUrl::parse_any)]
    url: StreamUrl,
    #[command(flatten)]
    token: TokenArgument,
    /// The folder for frames (`000041.drc`), their images where they change (`000041.jpg`), and
    /// `metrics.jsonl`; made if it does not exist.
    /// Without it, the metrics go to standard output.
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Stop after so many frames.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = frame_count)]
    frames: Option<u64>,
}

/// Where frames go.
struct Output {
    folder: Option<PathBuf>,
    metrics: Box<dyn Write>,
    /// Whether the reader of standard output has left.
    is_unread: bool,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let remote = Remote::new(&arguments.url, &arguments.token);
    let mut output = Output::open(arguments.output.as_deref())?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let progress = counter();
    // Images are of use in a folder only.
    let wishes = arguments.output.as_ref().map(|_| ("textures", "inline"));
    let wishes = Vec::from_iter(wishes);
    let outcome = runtime.block_on(async {
        let take = |message: &[u8]| output.write(message);
        tokio::select! {
            outcome = receive(&remote, &wishes, arguments.frames, &progress, take) => outcome,
            signal = super::interrupted() => signal,
        }
    });
    progress.finish_and_clear();
    let flushed = output
        .metrics
        .flush()
        .context("the metrics cannot be written");
    if output.is_unread {
        // Whoever closes the pipe, as `head` does, has read enough.
        return Ok(());
    }
    if outcome.is_ok() || 0 < progress.position() {
        let received = counted(progress.position(), "frame");
        super::say(&format!("{received} received"));
    }
    outcome.and(flushed)
}

impl Output {
    fn open(folder: Option<&Path>) -> anyhow::Result<Self> {
        let Some(folder) = folder else {
            return Ok(Self {
                folder: None,
                metrics: Box::new(std::io::stdout()),
                is_unread: false,
            });
        };
        super::output_files::make_folder(folder)?;
        let metrics = super::output_files::create(&folder.join("metrics.jsonl"))?;
        Ok(Self {
            folder: Some(folder.to_owned()),
            metrics: Box::new(metrics),
            is_unread: false,
        })
    }

    fn write(&mut self, message: &[u8]) -> anyhow::Result<Next> {
        let frame = DeliveredFrame::decode(message).context("a message cannot be read")?;
        if let Some(folder) = &self.folder {
            let stem = format!("{:06}", frame.metrics.seq);
            let texture = frame.metrics.texture.as_ref();
            let format = texture.and_then(|t| ImageFormat::from_media_type(&t.media_type));
            // One that has not changed has its file beside an earlier frame.
            let image = format.zip(frame.image);
            write_frame(folder, &stem, OutputFormat::Drc, (frame.mesh, image))?;
        }
        let mut line = serde_json::to_vec(&frame.metrics)?;
        line.push(b'\n');
        match self.metrics.write_all(&line) {
            Err(error) if error.kind() == ErrorKind::BrokenPipe && self.folder.is_none() => {
                self.is_unread = true;
                Ok(Next::Stop)
            }
            written => written
                .map(|()| Next::Go)
                .context("the metrics cannot be written"),
        }
    }
}
