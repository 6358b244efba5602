//! `steadymesh serve`: the server.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use clap::Args;
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;

use crate::bus::Bus;
use crate::compute::ComputePool;
use crate::config::{Config, Role};
use crate::otlp::Traces;
use crate::server::Server;
use crate::storage::{Recordings, UnusableStore};
use crate::streams::Registry;
use crate::telemetry::{Telemetry, log};
use crate::webhooks::{Prepared, Webhooks};
use crate::worker::Worker;

pub(super) const UNUSABLE_DEFAULTS: &str = "streams.defaults or streams.rules in the configuration";

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The configuration, a TOML file. Environment variables such as
    /// `STEADYMESH_STREAMS__HISTORY` come after it, the options of this command last.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Where the API and the player listen [default: 127.0.0.1:8080].
    #[arg(long, value_name = "ADDR")]
    listen: Option<SocketAddr>,
    /// Where operations listen: /metrics, /livez, /readyz [default: 127.0.0.1:9090].
    #[arg(long, value_name = "ADDR")]
    internal_listen: Option<SocketAddr>,
    /// What this node does [default: all]. Gateways and workers need bus.nats_url.
    #[arg(long)]
    role: Option<Role>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let config = load(arguments)?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()?;
    let (traces, complaint) = match Traces::from_environment(runtime.handle()) {
        Ok(traces) => (traces, None),
        Err(complaint) => (None, Some(complaint)),
    };
    log::set_up(&config.log, traces.as_ref().map(Traces::tracer))?;
    if let Some(complaint) = complaint {
        // As OpenTelemetry wants it: whoever runs without traces runs.
        tracing::warn!("{complaint}");
    }
    let outcome = runtime.block_on(serve(arguments, &config));
    if let Some(traces) = traces {
        traces.shut_down();
    }
    outcome
}

/// The file, then the environment, then the options.
fn load(arguments: &Arguments) -> anyhow::Result<Config> {
    let mut config = Config::load(arguments.config.as_deref())?;
    if let Some(address) = arguments.listen {
        config.listen = address;
    }
    if let Some(address) = arguments.internal_listen {
        config.internal_listen = address;
    }
    if let Some(role) = arguments.role {
        config.role = role;
    }
    config.check()?;
    Ok(config)
}

async fn serve(arguments: &Arguments, config: &Config) -> anyhow::Result<()> {
    // Before anything listens, so that a signal is never missed.
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut hangup = signal(SignalKind::hangup())?;
    super::open_files::allow(config.limits.connections);
    let node = Node::start(config).await?;
    let Node {
        registry,
        server,
        webhooks,
        ..
    } = &node;
    let internal = server.internal_address();
    let (role, threads) = (config.role, node.threads);
    match server.address() {
        Some(player) => tracing::info!(
            threads,
            "player and API on http://{player}, operations on http://{internal}"
        ),
        None => tracing::info!(threads, ?role, "operations on http://{internal}"),
    }
    let signal = loop {
        tokio::select! {
            _ = terminate.recv() => break "SIGTERM",
            _ = interrupt.recv() => break "SIGINT",
            _ = hangup.recv() => match reload(arguments, registry, server, webhooks).await {
                Ok(new) => tell_reloaded(config, &new),
                Err(error) => tracing::error!(
                    "the configuration cannot be used, the old one stays: {error:#}"
                ),
            },
        }
    };
    tracing::info!(signal, "asked to stop");
    let again = async {
        // Ctrl-C may come together with a SIGTERM from whoever started us: that is one request.
        tokio::time::sleep(Duration::from_secs(1)).await;
        super::interrupted().await
    };
    let stop = node.shut_down(Duration::from_secs(config.shutdown_grace_secs));
    tokio::select! {
        () = stop => tracing::info!("stopped"),
        _ = again => tracing::warn!("asked again: stopped at once"),
    }
    Ok(())
}

/// Everything that runs.
struct Node {
    registry: Registry,
    server: Server,
    webhooks: Webhooks,
    worker: Option<Worker>,
    /// What goes on beside, until this is dropped.
    background: CancellationToken,
    threads: usize,
}

impl Node {
    async fn start(config: &Config) -> anyhow::Result<Self> {
        let pool =
            Arc::new(ComputePool::new(config.compute()).context("the threads cannot be started")?);
        let telemetry = Arc::new(Telemetry::new().context("the metrics cannot be registered")?);
        let threads = pool.thread_count();
        let recordings = config.recordings().map(|options| {
            let opened = Recordings::open(options, Arc::clone(&telemetry))?;
            Ok::<_, UnusableStore>(Arc::new(opened))
        });
        let recordings = recordings.transpose()?;
        let bus = match config.bus() {
            Some(options) => Some(Bus::jet_stream(options).await.context("bus.nats_url")?),
            None => None,
        };
        let registry = Registry::new(
            config.streams(),
            Arc::clone(&pool),
            Arc::clone(&telemetry),
            recordings.clone(),
            bus.clone(),
        )
        .context(UNUSABLE_DEFAULTS)?;
        let background = CancellationToken::new();
        if let Some(recordings) = recordings {
            tokio::spawn(recordings.keep_tidy(background.clone()));
        }
        if config.role != Role::Worker {
            registry.follow_bus(background.clone()).await?;
        }
        let worker = match &bus {
            Some(bus) if config.role != Role::Gateway => {
                let (bus, pool) = (bus.clone(), Arc::clone(&pool));
                let telemetry = Arc::clone(&telemetry);
                Some(Worker::start(bus, pool, telemetry, config.worker()).await?)
            }
            Some(_) | None => None,
        };
        let listener = registry.listen();
        let webhooks = Webhooks::start(&config.webhooks, listener, Arc::clone(&telemetry))?;
        let server = Server::start(config.server(), registry.clone(), pool, telemetry, bus).await?;
        Ok(Self {
            registry,
            server,
            webhooks,
            worker,
            background,
            threads,
        })
    }

    /// Stops, in the order in which what is accepted comes out and is told.
    async fn shut_down(self, patience: Duration) {
        self.server.shut_down().await;
        if let Some(worker) = self.worker {
            worker.shut_down(patience).await;
        }
        // After the streams have ended, which is told too.
        self.webhooks.shut_down().await;
        self.background.cancel();
    }
}

/// Says that a new configuration has been taken, and what of it has not.
fn tell_reloaded(running: &Config, new: &Config) {
    let ignored = running.only_after_restart(new);
    if ignored.is_empty() {
        tracing::info!("the configuration has been read again (SIGHUP)");
    } else {
        tracing::warn!(
            "the configuration has been read again (SIGHUP), but these settings stay as they are \
             until a restart: {}",
            ignored.join(", ")
        );
    }
}

/// Takes what can be changed without dropping a connection, and gives the configuration that
/// was read.
async fn reload(
    arguments: &Arguments,
    registry: &Registry,
    server: &Server,
    webhooks: &Webhooks,
) -> anyhow::Result<Config> {
    let config = load(arguments)?;
    registry
        .check(&config.streams())
        .context(UNUSABLE_DEFAULTS)?;
    let prepared = Prepared::new(&config.webhooks)?;
    server.reload(config.server()).await?;
    registry.reload(config.streams());
    webhooks.reload(prepared).await;
    Ok(config)
}
