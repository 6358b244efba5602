//! `steadymesh subscribe`: a player without a screen.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use futures_util::StreamExt;
use indicatif::ProgressBar;
use steadymesh_proto::stream::{ControlMessage, Problem};
use steadymesh_proto::{DeliveredFrame, SUBPROTOCOL};
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::{Error, Message};

use super::progress::counter;
use super::stream_url::StreamUrl;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The stream, such as `http://127.0.0.1:8080/v1/streams/demo`.
    url: String,
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
    let url = StreamUrl::parse(&arguments.url)?;
    let mut output = Output::open(arguments.output.as_deref())?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let progress = counter();
    let outcome = runtime.block_on(async {
        tokio::select! {
            outcome = receive(&url, arguments.frames, &mut output, &progress) => outcome,
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
    url: &StreamUrl,
    limit: Option<u64>,
    output: &mut Output,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let address = url.websocket_under("subscribe");
    let mut request = address.as_str().into_client_request()?;
    let protocol = HeaderValue::from_static(SUBPROTOCOL);
    request
        .headers_mut()
        .insert("Sec-WebSocket-Protocol", protocol);
    let connected = tokio_tungstenite::connect_async(request).await;
    let (mut socket, _) = connected.map_err(|error| explain(error, &address))?;
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

/// The server's own words where it has some.
pub(super) fn explain(error: Error, address: &str) -> anyhow::Error {
    if let Error::Http(response) = &error {
        let body = response.body().as_deref().unwrap_or_default();
        let detail = serde_json::from_slice::<Problem>(body).map(|problem| problem.detail);
        let status = response.status();
        return anyhow::anyhow!(
            "the server answers {status}: {}",
            detail.unwrap_or_default()
        );
    }
    anyhow::Error::new(error).context(format!("{address} cannot be reached"))
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
