//! `steadymesh publish`: a capture rig.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::bail;
use clap::{Args, ValueEnum};
use indicatif::ProgressBar;
use steadymesh_proto::wording::counted;
use steadymesh_synthetic_rig::{MAX_VERTEX_COUNT, MIN_VERTEX_COUNT, Options};
use tokio::time::{MissedTickBehavior, interval};

use super::frame_source::{FrameSource, SourceFrame};
use super::http_publisher::{HttpPublisher, Sent};
use super::progress::counter;
use super::remote::{Remote, RemoteArguments};
use super::websocket_publisher::WebSocketPublisher;

#[derive(Debug, Args)]
#[command(override_usage = "steadymesh publish [OPTIONS] <URL> <PATHS...|--synthetic>")]
pub(super) struct Arguments {
    #[command(flatten)]
    remote: RemoteArguments,
    #[command(flatten)]
    source: SourceArguments,
    /// Frames per second.
    #[arg(long, default_value_t = 30.0)]
    #[arg(allow_negative_numbers = true, value_parser = frames_per_second)]
    fps: f64,
    /// Begin anew after the last frame.
    #[arg(long = "loop")]
    repeat: bool,
    /// How frames are sent.
    #[arg(long, value_enum, default_value_t = Transport::Http)]
    transport: Transport,
    /// End the connection of another publisher by WebSocket, if there is one.
    #[arg(long)]
    takeover: bool,
    /// Vertices of a synthetic frame, about.
    #[arg(long, value_name = "N", default_value_t = Options::default().vertex_count)]
    #[arg(conflicts_with = "paths", allow_negative_numbers = true, value_parser = vertices)]
    vertices: usize,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct SourceArguments {
    /// Frame files or folders of them: one sequence, folders in natural order.
    paths: Vec<PathBuf>,
    /// An animated figure, remeshed in every frame.
    #[arg(long)]
    synthetic: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Transport {
    /// One request a frame.
    Http,
    /// One connection, with frames sent ahead as far as the server gives credit.
    Ws,
}

/// The publisher of the transport that was asked for.
enum Publisher {
    Http(Box<HttpPublisher>),
    WebSocket(Box<WebSocketPublisher>),
}

/// What has been done.
#[derive(Debug, Default)]
struct Tally {
    sent: u64,
    bytes: u64,
    refused: u64,
    waits: u64,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let remote = Remote::new(&arguments.remote);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let source = if arguments.source.synthetic {
        // Before a minute of computing.
        runtime.block_on(remote.reach())?;
        FrameSource::synthetic(&Options {
            vertex_count: arguments.vertices,
            frames_per_second: arguments.fps,
            ..Options::default()
        })?
    } else {
        FrameSource::files(&arguments.source.paths)?
    };
    runtime.block_on(publish(arguments, &remote, &source))
}

async fn publish(
    arguments: &Arguments,
    remote: &Remote,
    source: &FrameSource,
) -> anyhow::Result<()> {
    super::say(&format!(
        "publishing to {}, to be watched at {}",
        remote.url.name(),
        remote.url.page()
    ));
    let started = Instant::now();
    let mut tally = Tally::default();
    let progress = counter();
    let outcome = tokio::select! {
        outcome = send_all(arguments, remote, source, &mut tally, &progress) => outcome,
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

async fn send_all(
    arguments: &Arguments,
    remote: &Remote,
    source: &FrameSource,
    tally: &mut Tally,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let mut publisher = match arguments.transport {
        Transport::Http => {
            let publisher = HttpPublisher::new(remote, arguments.takeover)?;
            Publisher::Http(Box::new(publisher))
        }
        Transport::Ws => {
            let publisher = WebSocketPublisher::connect(remote, arguments.takeover).await?;
            Publisher::WebSocket(Box::new(publisher))
        }
    };
    let mut pace = interval(Duration::from_secs_f64(1.0 / arguments.fps));
    // A frame that comes late is not made up for: the server would get a burst.
    pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        for index in 0..source.len() {
            let frame = source.frame(index).await?;
            pace.tick().await;
            publisher.send(frame, tally, progress).await?;
        }
        if !arguments.repeat {
            return publisher.finish(tally, progress).await;
        }
    }
}

impl Publisher {
    async fn send(
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

    async fn finish(&mut self, tally: &mut Tally, progress: &ProgressBar) -> anyhow::Result<()> {
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

fn vertices(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if (MIN_VERTEX_COUNT..=MAX_VERTEX_COUNT).contains(&count) => Ok(count),
        _ => Err(format!(
            "a whole number from {MIN_VERTEX_COUNT} to {MAX_VERTEX_COUNT} is expected"
        )),
    }
}

fn frames_per_second(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(fps) if (0.01..=1000.0).contains(&fps) => Ok(fps),
        _ => Err("a number from 0.01 to 1000 is expected".to_owned()),
    }
}
