//! `steadymesh subscribe`: a player without a screen.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use futures_util::StreamExt;
use indicatif::ProgressBar;
use steadymesh_proto::DeliveredFrame;
use steadymesh_proto::stream::{ControlMessage, EndReason};
use steadymesh_proto::wording::counted;
use tokio_tungstenite::tungstenite::Message;

use super::progress::counter;
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
    /// The folder for frames (`000041.drc`) and `metrics.jsonl`; made if it does not exist.
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
    let outcome = runtime.block_on(async {
        tokio::select! {
            outcome = receive(&remote, arguments.frames, &mut output, &progress) => outcome,
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

async fn receive(
    remote: &Remote,
    limit: Option<u64>,
    output: &mut Output,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let part = if remote.url.is_recording() {
        "play"
    } else {
        "subscribe"
    };
    let mut socket = remote.connect(part, &[]).await?;
    while limit.is_none_or(|limit| progress.position() < limit) {
        let Some(message) = socket.next().await else {
            bail!("the connection ended without a farewell");
        };
        match message.context("the connection broke")? {
            Message::Binary(bytes) => {
                output.write(&bytes)?;
                if output.is_unread {
                    break;
                }
                progress.inc(1);
            }
            // Messages of a newer server that are not known here are none of our business.
            Message::Text(text) => match serde_json::from_str(&text) {
                Ok(ControlMessage::Skipped { missed }) => progress.suspend(|| {
                    super::say(&format!(
                        "{} missed, because they came faster than they were read",
                        counted(missed, "frame")
                    ));
                }),
                Ok(ControlMessage::End { reason }) => {
                    super::say(&format!("the stream has ended: {}", why(reason)));
                    return Ok(());
                }
                Ok(ControlMessage::Hello { .. }) | Err(_) => {}
            },
            Message::Close(_) => return Ok(()),
            Message::Ping(_) | Message::Pong(_) | Message::Frame(_) => {}
        }
    }
    // Said so that the server need not find out.
    socket.close(None).await.ok();
    Ok(())
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

    fn write(&mut self, message: &[u8]) -> anyhow::Result<()> {
        let frame = DeliveredFrame::decode(message).context("a message cannot be read")?;
        if let Some(folder) = &self.folder {
            let path = folder.join(format!("{:06}.drc", frame.metrics.seq));
            super::output_files::write_file(&path, frame.mesh)?;
        }
        let mut line = serde_json::to_vec(&frame.metrics)?;
        line.push(b'\n');
        match self.metrics.write_all(&line) {
            Err(error) if error.kind() == ErrorKind::BrokenPipe && self.folder.is_none() => {
                self.is_unread = true;
                Ok(())
            }
            written => written.context("the metrics cannot be written"),
        }
    }
}

fn why(reason: EndReason) -> &'static str {
    match reason {
        EndReason::Deleted => "it was deleted",
        EndReason::Idle => "no frame had come for a long time",
        EndReason::Shutdown => "the server stops",
        EndReason::Finished => "the recording is over",
    }
}

fn frame_count(text: &str) -> Result<u64, String> {
    match text.parse() {
        Ok(count) if 0 < count => Ok(count),
        _ => Err("a whole number of at least 1 is expected".to_owned()),
    }
}
