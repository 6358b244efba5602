//! The configuration: a TOML file, then the environment, then each module's own options.

mod load;
mod options;

pub use load::{ConfigError, default_file};

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use steadymesh_proto::stream::StreamConfig;
use url::Url;

use crate::server::{TlsOptions, auth};
use crate::streams::StreamRule;
use crate::telemetry::log;
use crate::webhooks;

/// Everything that can be set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// What this node does.
    pub role: Role,
    /// Where the API and the player listen.
    pub listen: SocketAddr,
    /// Where operations listen: `/metrics`, `/livez`, `/readyz`.
    pub internal_listen: SocketAddr,
    /// Whether `listen` may be an address that others reach although there are no tokens.
    pub allow_public_without_tokens: bool,
    /// How long accepted frames may take to come out once the server is asked to stop, in
    /// seconds.
    pub shutdown_grace_secs: u64,
    /// The certificate, if the public listener is to speak TLS.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tls: Option<TlsOptions>,
    /// The log.
    pub log: log::Options,
    /// Who may do what.
    pub auth: auth::Options,
    /// Who may use the server through a browser.
    pub http: Http,
    /// The threads that compute.
    pub compute: Compute,
    /// How large and how slow a request may be.
    pub limits: RequestLimits,
    /// How streams are kept.
    pub streams: Streams,
    /// Where they are recorded.
    pub recordings: Recordings,
    /// How nodes work together.
    pub bus: Bus,
    /// Who is told what happens to them.
    pub webhooks: webhooks::Options,
}

/// What a node does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Everything.
    All,
    /// It talks to rigs and players; workers process what it takes.
    Gateway,
    /// It processes what gateways take.
    Worker,
}

/// How nodes work together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Bus {
    /// NATS servers, `nats://host:port`, with commas between them; without it there is one node.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nats_url: Option<String>,
    /// Credentials (`.creds`), if they want some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub credentials_file: Option<PathBuf>,
    /// What the names of streams and subjects there begin with.
    pub prefix: String,
    /// Servers that keep each log.
    pub replicas: usize,
    /// Seconds after which a frame is given to another worker if one has not answered for it.
    pub ack_wait_secs: f64,
    /// Bytes of frames that may wait.
    pub max_bytes: u64,
    /// Seconds that a frame is kept which nobody processes.
    pub max_age_secs: u64,
    /// Frames of a stream that may be accepted and not be out.
    pub frames: usize,
    /// Milliseconds after which a frame of a `live` stream gives way to newer ones.
    pub live_max_age_ms: u64,
}

/// Where streams are recorded, and how much of them is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Recordings {
    /// A folder (`file:///…`) or an object store (`s3://…`, `gs://…`, `az://…`); without it nothing
    /// is recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub url: Option<Url>,
    /// Seconds of a segment: what a crash may lose.
    pub segment_secs: f64,
    /// Bytes at which a segment ends before its time.
    pub segment_bytes: u64,
    /// Bytes of frames that may wait to be written, over all streams.
    pub queue_bytes: usize,
    /// Seconds after which what was recorded is taken away.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_age_secs: Option<u64>,
    /// Bytes over which the oldest is taken away.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_bytes: Option<u64>,
    /// Seconds between two looks at what is to be taken away.
    pub sweep_interval_secs: u64,
    /// Seconds that the last frames of a recording may take to be written.
    pub farewell_secs: u64,
}

/// The threads that compute.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Compute {
    /// Threads; 0 for one per core.
    pub threads: usize,
    /// Jobs of either kind, short and long, that may wait for a thread.
    pub queue: usize,
}

/// Who may use the server through a browser.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Http {
    /// Origins such as `https://studio.example` whose pages may use the server, or `*`.
    pub allowed_origins: Vec<String>,
    /// Names such as `rig.studio.example` by which requests may address the server, or `*`.
    pub allowed_hosts: Vec<String>,
}

/// How large and how slow a request may be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RequestLimits {
    /// Bytes of a frame's body.
    pub body_bytes: usize,
    /// Vertices of a frame.
    pub vertices: usize,
    /// Faces of a frame, polygons cut into triangles.
    pub faces: usize,
    /// Bytes that decoding Draco data or base64 in a frame may take.
    pub decode_memory_bytes: usize,
    /// Bytes of frames that are being received at a time, over all streams.
    pub memory_bytes: usize,
    /// Connections to the public listener.
    pub connections: usize,
    /// Connections to it from one address.
    pub connections_per_address: usize,
    /// Players of one stream.
    pub subscribers_per_stream: usize,
    /// Recordings that are played at a time.
    pub playbacks: usize,
    /// Seconds until a request's head must be complete.
    pub header_timeout_secs: u64,
    /// Seconds until a request's body must be complete.
    pub body_timeout_secs: u64,
    /// Seconds that a connection may stay without a request.
    pub idle_timeout_secs: u64,
    /// Bytes that the operating system may hold for a connection that does not read.
    pub send_buffer_bytes: usize,
    /// Seconds that a player may take to receive one message, and anybody else to take some of
    /// an answer, before they are disconnected.
    pub send_timeout_secs: u64,
}

/// How streams are kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Streams {
    /// Most streams at a time.
    pub max: usize,
    /// Frames of a stream that may wait to be processed.
    pub queue_depth: usize,
    /// Frames of a stream that may be in work at a time; each takes tens of megabytes.
    pub parallel_frames: usize,
    /// Frames that a stream remembers.
    pub history: usize,
    /// Bytes that they may take; the newest frame is remembered in any case.
    pub history_bytes: usize,
    /// How many frames a player may fall behind before it is taken to the newest.
    pub subscriber_queue: usize,
    /// Seconds for which the place of a publisher that vanished is kept.
    pub linger_secs: u64,
    /// Seconds after which a stream without frames ends.
    pub idle_timeout_secs: u64,
    /// What a stream's configuration leaves out.
    pub defaults: StreamConfig,
    /// Defaults of their own for some streams; the first rule that matches counts.
    pub rules: Vec<StreamRule>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            role: Role::All,
            listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8080),
            internal_listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 9090),
            allow_public_without_tokens: false,
            shutdown_grace_secs: 10,
            tls: None,
            log: log::Options::default(),
            auth: auth::Options::default(),
            http: Http::default(),
            compute: Compute::default(),
            limits: RequestLimits::default(),
            streams: Streams::default(),
            recordings: Recordings::default(),
            bus: Bus::default(),
            webhooks: webhooks::Options::default(),
        }
    }
}

impl Default for Bus {
    /// A gigabyte is half a minute of a rig whose frames nobody processes.
    fn default() -> Self {
        Self {
            nats_url: None,
            credentials_file: None,
            prefix: "steadymesh".to_owned(),
            replicas: 1,
            ack_wait_secs: 2.0,
            max_bytes: 1 << 30,
            max_age_secs: 600,
            frames: 16,
            live_max_age_ms: 500,
        }
    }
}

impl Default for Recordings {
    /// Less than a second is lost in a crash, the time of writing included.
    fn default() -> Self {
        Self {
            url: None,
            segment_secs: 0.8,
            segment_bytes: 32 << 20,
            queue_bytes: 128 << 20,
            max_age_secs: None,
            max_bytes: None,
            sweep_interval_secs: 60,
            farewell_secs: 5,
        }
    }
}

impl Default for Compute {
    fn default() -> Self {
        Self {
            threads: 0,
            queue: 64,
        }
    }
}

impl Default for RequestLimits {
    /// A million vertices, far above any rig of today, and what their files take.
    fn default() -> Self {
        Self {
            body_bytes: 64 << 20,
            vertices: 1_000_000,
            faces: 2_000_000,
            decode_memory_bytes: 256 << 20,
            memory_bytes: 512 << 20,
            connections: 1000,
            connections_per_address: 1000,
            subscribers_per_stream: 1000,
            playbacks: 100,
            header_timeout_secs: 10,
            body_timeout_secs: 30,
            idle_timeout_secs: 75,
            send_buffer_bytes: 256 << 10,
            send_timeout_secs: 10,
        }
    }
}

impl Default for Streams {
    /// Ten seconds of frames at 30 per second are remembered.
    fn default() -> Self {
        Self {
            max: 64,
            queue_depth: 4,
            parallel_frames: 4,
            history: 300,
            history_bytes: 256 << 20,
            subscriber_queue: 30,
            linger_secs: 5,
            idle_timeout_secs: 3600,
            defaults: StreamConfig::default(),
            rules: Vec::new(),
        }
    }
}
