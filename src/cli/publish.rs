//! `steadymesh publish`: a capture rig.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use indicatif::ProgressBar;
use steadymesh_synthetic_rig::{MAX_VERTEX_COUNT, MIN_VERTEX_COUNT, Options};
use tokio::time::{MissedTickBehavior, interval};

use super::frame_source::FrameSource;
use super::publisher::{self, Publisher, Tally, Transport};
use super::remote::{Remote, TokenArgument};
use super::stream_url::StreamUrl;

#[derive(Debug, Args)]
#[command(override_usage = "steadymesh publish [OPTIONS] <URL> <PATHS...|--synthetic>")]
pub(super) struct Arguments {
    /// The stream, such as `http://127.0.0.1:8080/v1/streams/demo`.
    #[arg(value_parser = StreamUrl::parse)]
    url: StreamUrl,
    #[command(flatten)]
    token: TokenArgument,
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

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let remote = Remote::new(&arguments.url, &arguments.token);
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
    publisher::work(async |tally, progress| {
        send_all(arguments, remote, source, tally, progress).await
    })
    .await
}

async fn send_all(
    arguments: &Arguments,
    remote: &Remote,
    source: &FrameSource,
    tally: &mut Tally,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let transport = arguments.transport;
    let mut publisher = Publisher::connect(remote, transport, arguments.takeover).await?;
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
