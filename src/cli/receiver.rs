//! Receives the frames of a stream or a recording, for the commands that do something with them.

use anyhow::{Context, bail};
use futures_util::StreamExt;
use indicatif::ProgressBar;
use steadymesh_proto::stream::{ControlMessage, EndReason};
use steadymesh_proto::wording::counted;
use tokio_tungstenite::tungstenite::Message;

use super::remote::Remote;

/// Whether another frame is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    Go,
    Stop,
}

/// Gives every delivered frame, as its message, to `take`, until there are no more, `limit` of them
/// have come, or it says stop.
///
/// # Errors
///
/// A connection that cannot be made or that breaks, and what `take` gives.
pub(super) async fn receive(
    remote: &Remote,
    parameters: &[(&str, &str)],
    limit: Option<u64>,
    progress: &ProgressBar,
    mut take: impl FnMut(&[u8]) -> anyhow::Result<Next>,
) -> anyhow::Result<()> {
    let part = if remote.url.is_recording() {
        "play"
    } else {
        "subscribe"
    };
    let mut socket = remote.connect(part, parameters).await?;
    while limit.is_none_or(|limit| progress.position() < limit) {
        let Some(message) = socket.next().await else {
            bail!("the connection ended without a farewell");
        };
        match message.context("the connection broke")? {
            Message::Binary(bytes) => {
                if take(&bytes)? == Next::Stop {
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

fn why(reason: EndReason) -> &'static str {
    match reason {
        EndReason::Deleted => "it was deleted",
        EndReason::Idle => "no frame had come for a long time",
        EndReason::Shutdown => "the server stops",
        EndReason::Finished => "the recording is over",
    }
}

/// A number of frames on the command line.
pub(super) fn frame_count(text: &str) -> Result<u64, String> {
    match text.parse() {
        Ok(count) if 0 < count => Ok(count),
        _ => Err("a whole number of at least 1 is expected".to_owned()),
    }
}
