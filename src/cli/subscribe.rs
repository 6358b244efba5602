//! `steadymesh subscribe`: a player without a screen.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use futures_util::StreamExt;
use indicatif::ProgressBar;
use steadymesh_proto::DeliveredFrame;
use steadymesh_proto::stream::ControlMessage;
use tokio_tungstenite::tungstenite::Message;

use super::progress::counter;
use super::remote::{Remote, RemoteArguments};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    remote: RemoteArguments,
    /// The folder for frames (`000041.drc`) and `metrics.jsonl`; made if it does not exist.
    /// Without it, the metrics go to standard output.
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Stop after so many frames.
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
}

/// Where frames go.
struct Output {
    folder: Option<PathBuf>,
    metrics: Box<dyn Write>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let remote = Remote::new(&arguments.remote)?;
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
    super::say(&format!("{} frames received", progress.position()));
    outcome.and(flushed)
}

async fn receive(
    remote: &Remote,
    limit: Option<u64>,
    output: &mut Output,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let mut socket = remote.connect("subscribe").await?;
    while limit.is_none_or(|limit| progress.position() < limit) {
        let Some(message) = socket.next().await else {
            bail!("the connection ended without a farewell");
        };
        match message.context("the connection broke")? {
            Message::Binary(bytes) => {
                output.write(&bytes)?;
                progress.inc(1);
            }
            // Messages of a newer server that are not known here are none of our business.
            Message::Text(text) => match serde_json::from_str(&text) {
                Ok(ControlMessage::Skipped { missed }) => progress.suspend(|| {
                    super::say(&format!(
                        "{missed} frames missed: they came faster than they were read"
                    ));
                }),
                Ok(ControlMessage::End { reason }) => {
                    super::say(&format!("the stream has ended ({reason:?})"));
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
            });
        };
        super::output_files::make_folder(folder)?;
        let metrics = super::output_files::create(&folder.join("metrics.jsonl"))?;
        Ok(Self {
            folder: Some(folder.to_owned()),
            metrics: Box::new(metrics),
        })
    }

    fn write(&mut self, message: &[u8]) -> anyhow::Result<()> {
        let frame = DeliveredFrame::decode(message).context("a message cannot be read")?;
        if let Some(folder) = &self.folder {
            let path = folder.join(format!("{:06}.drc", frame.metrics.seq));
            super::output_files::write_file(&path, frame.mesh)?;
        }
        serde_json::to_writer(&mut self.metrics, &frame.metrics)?;
        self.metrics
            .write_all(b"\n")
            .context("the metrics cannot be written")
    }
}
