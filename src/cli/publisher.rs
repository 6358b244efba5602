//! Sends frames to a stream by either transport, and counts what becomes of them.

use std::time::Instant;

use anyhow::bail;
use clap::ValueEnum;
use indicatif::ProgressBar;
use steadymesh_proto::wording::counted;

use super::frame_source::SourceFrame;
use super::http_publisher::{HttpPublisher, Sent};
use super::progress::counter;
use super::remote::Remote;
use super::websocket_publisher::WebSocketPublisher;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Transport {
    /// One request a frame.
    Http,
    /// One connection, with frames sent ahead as far as the server gives credit.
    Ws,
}

/// The publisher of the transport that was asked for.
pub(super) enum Publisher {
    Http(Box<HttpPublisher>),
    WebSocket(Box<WebSocketPublisher>),
}

/// What has been done.
#[derive(Debug, Default)]
pub(super) struct Tally {
    sent: u64,
    bytes: u64,
    refused: u64,
    waits: u64,
}

/// Has `send` send frames until it is through or the process is asked to end, and says what has been
/// done.
///
/// # Errors
///
/// What `send` fails with, and frames that were refused.
pub(super) async fn work(
    send: impl AsyncFnOnce(&mut Tally, &ProgressBar) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let started = Instant::now();
    let mut tally = Tally::default();
    let progress = counter();
    let outcome = tokio::select! {
        outcome = send(&mut tally, &progress) => outcome,
        // Asked to stop, which is the usual end of a rig that loops.
        signal = super::interrupted() => signal,
    };
    progress.finish_and_clear();
    if outcome.is_err() && tally.sent + tally.refused == 0 {
        return outcome;
    }
    let Tally {
        sent,
        bytes,
        refused,
        waits,
    } = tally;
    let seconds = started.elapsed().as_secs_f64();
    super::say(&format!(
        "{} sent in {seconds:.1} s ({:.1} fps, {:.1} Mbit/s), {refused} refused, {} for the server",
        counted(sent, "frame"),
        sent as f64 / seconds,
        bytes as f64 * 8e-6 / seconds,
        counted(waits, "wait")
    ));
    outcome?;
    if 0 < refused {
        let was = if refused == 1 { "was" } else { "were" };
        bail!("{} {was} refused", counted(refused, "frame"));
    }
    Ok(())
}

impl Publisher {
    /// Readies a publisher of a stream; `takeover` ends the connection of another.
    ///
    /// # Errors
    ///
    /// If the server cannot be reached or refuses.
    pub async fn connect(
        remote: &Remote,
        transport: Transport,
        takeover: bool,
    ) -> anyhow::Result<Self> {
        Ok(match transport {
            Transport::Http => Self::Http(Box::new(HttpPublisher::new(remote, takeover)?)),
            Transport::Ws => {
                let publisher = WebSocketPublisher::connect(remote, takeover).await?;
                Self::WebSocket(Box::new(publisher))
            }
        })
    }

    /// Sends a frame, waiting where the server asks for it.
    ///
    /// # Errors
    ///
    /// If the server stays away, or would refuse all other frames too.
    pub async fn send(
        &mut self,
        frame: SourceFrame,
        tally: &mut Tally,
        progress: &ProgressBar,
    ) -> anyhow::Result<()> {
        let bytes = frame.body.len() as u64;
        match self {
            Self::Http(publisher) => match publisher.send(&frame, &mut tally.waits).await? {
                Sent::Accepted => tally.count(1, progress),
                Sent::Refused(reason) => tally.refuse(&frame.name, &reason, progress),
            },
            Self::WebSocket(publisher) => {
                publisher.send(frame).await?;
                tally.take(publisher, progress);
            }
        }
        tally.bytes += bytes;
        Ok(())
    }

    /// Waits until all frames have been answered.
    ///
    /// # Errors
    ///
    /// As [`Publisher::send`].
    pub async fn finish(
        &mut self,
        tally: &mut Tally,
        progress: &ProgressBar,
    ) -> anyhow::Result<()> {
        if let Self::WebSocket(publisher) = self {
            let finished = publisher.finish().await;
            tally.take(publisher, progress);
            finished?;
        }
        Ok(())
    }
}

impl Tally {
    fn take(&mut self, publisher: &mut WebSocketPublisher, progress: &ProgressBar) {
        let news = publisher.progress();
        self.count(news.accepted, progress);
        self.waits += news.waits;
        for (name, reason) in news.refused {
            self.refuse(&name, &reason, progress);
        }
    }

    fn count(&mut self, accepted: u64, progress: &ProgressBar) {
        self.sent += accepted;
        progress.inc(accepted);
    }

    fn refuse(&mut self, name: &str, reason: &str, progress: &ProgressBar) {
        self.refused += 1;
        progress.suspend(|| super::say(&format!("{name}: {reason}")));
    }
}
