//! `steadymesh replay`: a recording's raw frames, sent to a stream again.

use std::time::Duration;

use clap::Args;
use indicatif::ProgressBar;
use steadymesh_proto::recording::Record;
use tokio::time::{Instant, sleep_until};

use super::frame_source::{Recorded, SourceFrame};
use super::publisher::{self, Publisher, Tally, Transport};
use super::recorded::{RecordedSource, RecordingPlace};
use super::remote::{Refusal, Remote, TokenArgument};
use super::stream_url::StreamUrl;

/// Where nothing was captured for longer, or the rig's clock was set, no longer is waited.
const MAX_PAUSE: Duration = Duration::from_secs(5);

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The recording: its address on a server (http://…/v1/recordings/STREAM/ID), its folder, or its
    /// address in an object store.
    #[arg(value_parser = RecordingPlace::parse)]
    recording: RecordingPlace,
    /// The stream that its raw frames are sent to, such as
    /// `http://127.0.0.1:8080/v1/streams/again`.
    #[arg(value_parser = StreamUrl::parse)]
    url: StreamUrl,
    #[command(flatten)]
    token: TokenArgument,
    /// The token of the server that has the recording, if it is another one.
    #[arg(long, env = "STEADYMESH_RECORDING_TOKEN", hide_env_values = true)]
    recording_token: Option<String>,
    /// How fast: 1 as it was captured, 0 as fast as the server takes it.
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true, value_parser = speed)]
    speed: f64,
    /// Begin with this frame.
    #[arg(long, value_name = "SEQ", default_value_t = 0)]
    from_seq: u64,
    /// Configure the stream as the recorded one was, which gives the same result again. Without it
    /// the stream has the settings that it was given, or the server's defaults.
    #[arg(long)]
    same_settings: bool,
    /// How frames are sent.
    #[arg(long, value_enum, default_value_t = Transport::Http)]
    transport: Transport,
    /// End the connection of another publisher by WebSocket, if there is one.
    #[arg(long)]
    takeover: bool,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let remote = Remote::new(&arguments.url, &arguments.token);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(replay(arguments, &remote))
}

async fn replay(arguments: &Arguments, remote: &Remote) -> anyhow::Result<()> {
    // The same token for the same server, and for no other.
    let token = match &arguments.recording {
        RecordingPlace::Server(url) if url.server() == arguments.url.server() => arguments
            .recording_token
            .as_deref()
            .or(arguments.token.get()),
        _ => arguments.recording_token.as_deref(),
    };
    let mut source = RecordedSource::open(&arguments.recording, token, arguments.from_seq).await?;
    if arguments.same_settings {
        configure(remote, &source).await?;
    }
    super::say(&format!(
        "replaying {} of {} to {}, to be watched at {}",
        source.summary.id,
        source.summary.stream,
        remote.url.name(),
        remote.url.page()
    ));
    publisher::work(async |tally, progress| {
        send_all(arguments, remote, &mut source, tally, progress).await
    })
    .await
}

async fn send_all(
    arguments: &Arguments,
    remote: &Remote,
    source: &mut RecordedSource,
    tally: &mut Tally,
    progress: &ProgressBar,
) -> anyhow::Result<()> {
    let transport = arguments.transport;
    let mut publisher = Publisher::connect(remote, transport, arguments.takeover).await?;
    let mut last: Option<(u64, Instant)> = None;
    while let Some((frame, body)) = source.next().await? {
        let now = Instant::now();
        let due = match last {
            Some((time_us, due)) if 0.0 < arguments.speed => {
                let between = Duration::from_micros(frame.time_us().saturating_sub(time_us));
                due + between.min(MAX_PAUSE).div_f64(arguments.speed)
            }
            _ => now,
        };
        sleep_until(due).await;
        // A frame that comes late is not made up for: the server would get a burst.
        last = Some((frame.time_us(), due.max(now)));
        let frame = SourceFrame {
            name: format!("frame {}", frame.seq),
            recorded: Some(Recorded {
                seq: frame.seq,
                capture_time_us: frame.capture_time_us,
            }),
            content_type: frame.content_type.into(),
            body,
        };
        publisher.send(frame, tally, progress).await?;
    }
    publisher.finish(tally, progress).await
}

/// Configures the stream as the recorded one was.
async fn configure(remote: &Remote, source: &RecordedSource) -> anyhow::Result<()> {
    let mut config = source.summary.config.clone();
    config.record = Some(Record::Off);
    let request = remote
        .http_client()?
        .put(remote.url.under(""))
        .json(&config);
    let answer = request.send().await;
    let answer = answer.map_err(|error| remote.unreachable(&error))?;
    if answer.status().is_success() {
        return Ok(());
    }
    let status = answer.status();
    let body = answer.bytes().await.unwrap_or_default();
    Err(Refusal::of(status, &body).into())
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(speed) if speed == 0.0 || (0.01..=100.0).contains(&speed) => Ok(speed),
        _ => Err("a number from 0.01 to 100, or 0, is expected".to_owned()),
    }
}
