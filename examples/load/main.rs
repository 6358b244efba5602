//! How many players one stream can have: a server of its own, one rig, and many players in this
//! process, some of which read slowly or not at all.
//!
//! ```sh
//! cargo run --release --example load -- --players 500 --stuck 20 --slow 20 --seconds 30
//! ```
//!
//! Prints what healthy players saw (frames lost, latency from capture to receipt), what the
//! others were told, the server's memory, and the rate of messages compared with a bare loop
//! that sends the same bytes over the same WebSocket library.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a tool for developers: it ends with a message where something is wrong"
)]

mod rate;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime};

use clap::Parser;
use futures_util::StreamExt;
use steadymesh::compute::ComputePool;
use steadymesh::config::Config;
use steadymesh::server::Server;
use steadymesh::streams::Registry;
use steadymesh::telemetry::Telemetry;
use steadymesh_proto::metrics::Tracking;
use steadymesh_proto::stream::MetricsMode;
use steadymesh_proto::{DeliveredFrame, NATIVE_CONTENT_TYPE, NativeFrame};
use steadymesh_synthetic_rig::{Options, Rig};
use tokio_tungstenite::tungstenite::Message;

#[derive(Debug, Clone, Parser)]
struct Arguments {
    /// Players in all.
    #[arg(long, default_value_t = 500)]
    players: usize,
    /// Those of them that connect and never read.
    #[arg(long, default_value_t = 20)]
    stuck: usize,
    /// Those of them that read at a tenth of the speed.
    #[arg(long, default_value_t = 20)]
    slow: usize,
    /// Frames per second.
    #[arg(long, default_value_t = 30.0)]
    fps: f64,
    /// How long, after all players are there.
    #[arg(long, default_value_t = 30)]
    seconds: u64,
    /// Frames for each of the two measurements of the rate, at most 280; 0 for none.
    #[arg(long, default_value_t = 200)]
    rate_frames: usize,
}

/// What one player saw.
#[derive(Debug, Default)]
struct Seen {
    frames: u64,
    /// Frames that did not come, as their numbers tell.
    lost: u64,
    /// Messages that said so.
    skipped: u64,
    latencies_us: Vec<u64>,
}

fn main() {
    steadymesh::tls::set_up();
    let arguments = Arguments::parse();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(run(&arguments));
}

async fn run(arguments: &Arguments) {
    let server = start_server(|_| {}).await;
    let bodies = Arc::new(frames());
    let stop = Arc::new(AtomicBool::new(false));
    let published = Arc::new(AtomicU64::new(0));
    let rig = tokio::spawn(publish(
        server.address().unwrap(),
        Arc::clone(&bodies),
        arguments.fps,
        (Arc::clone(&stop), Arc::clone(&published)),
    ));
    while published.load(Relaxed) < 5 {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let measuring = Arc::new(AtomicBool::new(false));
    let players = connect_players(arguments, server.address().unwrap(), &stop, &measuring).await;
    println!("{} players connected", players.len());
    tokio::time::sleep(Duration::from_secs(2)).await;
    measuring.store(true, Relaxed);
    let (before, begun) = (published.load(Relaxed), Instant::now());
    for _ in 0..arguments.seconds {
        tokio::time::sleep(Duration::from_secs(1)).await;
        peak_memory(&server).await;
    }
    let sent = published.load(Relaxed) - before;
    let fps = sent as f64 / begun.elapsed().as_secs_f64();
    println!("{sent} frames published, {fps:.1} a second");
    println!(
        "memory of this process at the end, players included: {}",
        peak_memory(&server).await
    );
    stop.store(true, Relaxed);
    rig.await.unwrap();
    report(players).await;
    if 0 < arguments.rate_frames {
        rate::compare(&bodies, arguments.rate_frames).await;
    }
    server.shut_down().await;
}

/// A server whose frames have 4,000 faces already: what is measured is the way out.
async fn start_server(change: impl FnOnce(&mut Config)) -> Server {
    let anywhere: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let mut config = Config {
        listen: anywhere,
        internal_listen: anywhere,
        ..Config::default()
    };
    config.streams.defaults.target_faces = Some(4000);
    config.streams.defaults.tracking = Some(Tracking::Off);
    config.streams.defaults.metrics = Some(MetricsMode::Off);
    change(&mut config);
    let pool = Arc::new(ComputePool::new(config.compute()).unwrap());
    let telemetry = Arc::new(Telemetry::new().unwrap());
    let registry = Registry::new(
        config.streams(),
        Arc::clone(&pool),
        Arc::clone(&telemetry),
        None,
        None,
    )
    .unwrap();
    Server::start(config.server(), registry, pool, telemetry, None)
        .await
        .unwrap()
}

/// Frames of about 4,000 faces.
fn frames() -> Vec<NativeFrame> {
    let options = Options {
        vertex_count: 2000,
        ..Options::default()
    };
    let rig = Rig::new(&options).unwrap();
    let native = |index| {
        let frame = rig.frame(index);
        NativeFrame {
            positions: frame.positions,
            faces: frame.faces,
            ..NativeFrame::default()
        }
    };
    (0..30).map(native).collect()
}

fn now_us() -> u64 {
    let since = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap();
    u64::try_from(since.as_micros()).unwrap()
}

async fn publish(
    address: SocketAddr,
    frames: Arc<Vec<NativeFrame>>,
    fps: f64,
    (stop, published): (Arc<AtomicBool>, Arc<AtomicU64>),
) {
    let client = reqwest::Client::new();
    let url = format!("http://{address}/v1/streams/load/frames");
    let mut pace = tokio::time::interval(Duration::from_secs_f64(1.0 / fps));
    for frame in frames.iter().cycle() {
        if stop.load(Relaxed) {
            return;
        }
        pace.tick().await;
        let frame = NativeFrame {
            capture_time_us: Some(now_us()),
            ..frame.clone()
        };
        let request = client
            .post(&url)
            .header("content-type", NATIVE_CONTENT_TYPE);
        let response = request.body(frame.encode()).send().await.unwrap();
        if response.status() == 202 {
            published.fetch_add(1, Relaxed);
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Healthy,
    Slow,
    Stuck,
}

type Players = Vec<(Kind, tokio::task::JoinHandle<Seen>)>;

async fn connect_players(
    arguments: &Arguments,
    address: SocketAddr,
    stop: &Arc<AtomicBool>,
    measuring: &Arc<AtomicBool>,
) -> Players {
    let url = format!("ws://{address}/v1/streams/load/subscribe");
    let mut players = Vec::new();
    for index in 0..arguments.players {
        let kind = match index {
            i if i < arguments.stuck => Kind::Stuck,
            i if i < arguments.stuck + arguments.slow => Kind::Slow,
            _ => Kind::Healthy,
        };
        let (socket, _) = tokio_tungstenite::connect_async(&url).await.unwrap();
        let (stop, measuring) = (Arc::clone(stop), Arc::clone(measuring));
        let pause = Duration::from_secs_f64(10.0 / arguments.fps);
        players.push((
            kind,
            tokio::spawn(play(socket, kind, pause, (stop, measuring))),
        ));
    }
    players
}

type Socket =
    tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<tokio::net::TcpStream>>;

async fn play(
    mut socket: Socket,
    kind: Kind,
    pause: Duration,
    (stop, measuring): (Arc<AtomicBool>, Arc<AtomicBool>),
) -> Seen {
    let mut seen = Seen::default();
    let mut last = None;
    while !stop.load(Relaxed) {
        if kind == Kind::Stuck {
            tokio::time::sleep(Duration::from_millis(200)).await;
            continue;
        }
        let Ok(Some(Ok(message))) =
            tokio::time::timeout(Duration::from_secs(1), socket.next()).await
        else {
            continue;
        };
        match message {
            Message::Binary(bytes) => {
                let frame = DeliveredFrame::decode(&bytes).unwrap();
                let seq = frame.metrics.seq;
                if measuring.load(Relaxed) {
                    seen.frames += 1;
                    seen.lost += last.map_or(0, |last| seq - last - 1);
                    let latency = now_us() - frame.metrics.capture_time_us.unwrap();
                    seen.latencies_us.push(latency);
                }
                last = Some(seq);
            }
            Message::Text(text) if text.contains("skipped") => seen.skipped += 1,
            Message::Close(_) => return seen,
            _ => {}
        }
        if kind == Kind::Slow {
            tokio::time::sleep(pause).await;
        }
    }
    seen
}

async fn peak_memory(server: &Server) -> String {
    let url = format!("http://{}/metrics", server.internal_address());
    let text = reqwest::get(url).await.unwrap().text().await.unwrap();
    let line = text
        .lines()
        .find_map(|l| l.strip_prefix("process_resident_memory_bytes "));
    let bytes: f64 = line.unwrap().parse().unwrap();
    format!("{:.0} MB", bytes / 1e6)
}

async fn report(players: Players) {
    let mut latencies = Vec::new();
    let (mut healthy, mut lost, mut least) = (0, 0, u64::MAX);
    let mut others = Vec::new();
    for (kind, player) in players {
        let seen = player.await.unwrap();
        match kind {
            Kind::Healthy => {
                healthy += 1;
                lost += seen.lost;
                least = least.min(seen.frames);
                latencies.extend(seen.latencies_us);
            }
            Kind::Slow | Kind::Stuck => others.push((kind, seen)),
        }
    }
    for kind in [Kind::Slow, Kind::Stuck] {
        let of_kind: Vec<_> = others.iter().filter(|other| other.0 == kind).collect();
        let sum =
            |value: fn(&Seen) -> u64| of_kind.iter().map(|(_, seen)| value(seen)).sum::<u64>();
        println!(
            "{} {kind:?} players: {} frames received, {} lost, {} times told so",
            of_kind.len(),
            sum(|seen| seen.frames),
            sum(|seen| seen.lost),
            sum(|seen| seen.skipped)
        );
    }
    latencies.sort_unstable();
    let quantile = |q: f64| {
        let index = ((latencies.len() - 1) as f64 * q) as usize;
        latencies[index] as f64 / 1000.0
    };
    println!(
        "{healthy} healthy players: {lost} frames lost, at least {least} each; latency p50 \
         {:.1} ms, p99 {:.1} ms, max {:.1} ms",
        quantile(0.5),
        quantile(0.99),
        quantile(1.0)
    );
}
