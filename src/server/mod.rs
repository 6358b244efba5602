//! The HTTP and WebSocket edge, the only place that knows HTTP.
//!
//! `router` has the public routes on one screen, `internal` those of operations, which have a
//! listener of their own.

mod body;
mod control;
mod error;
mod extract;
mod frames;
mod ingest;
mod internal;
mod player;
mod prefer;
mod publish;
mod router;
mod socket;
mod subscribe;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::Router;
use axum_server::Handle;
use tokio::task::JoinHandle;
use tokio_util::task::TaskTracker;

use crate::compute::ComputePool;
use crate::streams::Registry;
use crate::telemetry::Telemetry;

/// Connections may take so long to end after the last stream has.
const FAREWELL: Duration = Duration::from_secs(2);

/// Where the server listens, and how long it waits.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The public listener.
    pub listen: SocketAddr,
    /// The listener of operations.
    pub internal_listen: SocketAddr,
    /// How long accepted frames may take to come out once the server is asked to stop.
    pub shutdown_grace: Duration,
    /// Most bytes of a frame's body.
    pub max_body_bytes: usize,
    /// How long a request's head may take.
    pub header_timeout: Duration,
    /// How long a request's body may take.
    pub body_timeout: Duration,
    /// How long a player may take to receive one message.
    pub send_timeout: Duration,
}

/// What all handlers share.
#[derive(Debug)]
struct App {
    registry: Registry,
    telemetry: Arc<Telemetry>,
    pool: Arc<ComputePool>,
    options: Options,
    stopping: AtomicBool,
    /// WebSocket connections, which end after the request that began them.
    sockets: TaskTracker,
}

impl App {
    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }
}

/// Why a server could not start.
#[derive(Debug, thiserror::Error)]
#[error("cannot listen on {address}: {reason}")]
pub struct CannotListen {
    /// The address.
    pub address: SocketAddr,
    /// What the system says.
    pub reason: io::Error,
}

/// A running server. It stops when [`Server::shut_down`] is called.
#[derive(Debug)]
pub struct Server {
    app: Arc<App>,
    public: Listener,
    internal: Listener,
}

#[derive(Debug)]
struct Listener {
    address: SocketAddr,
    handle: Handle<SocketAddr>,
    task: JoinHandle<io::Result<()>>,
}

impl Server {
    /// Starts listening; must be called within a Tokio runtime.
    ///
    /// # Errors
    ///
    /// [`CannotListen`] if an address cannot be had.
    pub fn start(
        options: Options,
        registry: Registry,
        pool: Arc<ComputePool>,
        telemetry: Arc<Telemetry>,
    ) -> Result<Self, CannotListen> {
        let (listen, internal_listen) = (options.listen, options.internal_listen);
        let header_timeout = options.header_timeout;
        let app = Arc::new(App {
            registry,
            telemetry,
            pool,
            options,
            stopping: AtomicBool::new(false),
            sockets: TaskTracker::new(),
        });
        // Both before either is served, so that a failure leaves nothing running.
        let (public, internal) = (bind(listen)?, bind(internal_listen)?);
        Ok(Self {
            public: serve(public, router::router(Arc::clone(&app)), header_timeout)?,
            internal: serve(internal, internal::router(Arc::clone(&app)), header_timeout)?,
            app,
        })
    }

    /// The public listener's address.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.public.address
    }

    /// The address of operations.
    #[must_use]
    pub fn internal_address(&self) -> SocketAddr {
        self.internal.address
    }

    /// Stops: takes no new connections and frames, lets accepted frames come out, tells
    /// players that it is over, and ends.
    pub async fn shut_down(self) {
        let grace = self.app.options.shutdown_grace;
        self.app.stopping.store(true, Ordering::Relaxed);
        self.public.handle.graceful_shutdown(Some(grace + FAREWELL));
        self.app.registry.shut_down(grace).await;
        self.app.sockets.close();
        if tokio::time::timeout(FAREWELL, self.app.sockets.wait())
            .await
            .is_err()
        {
            tracing::warn!("some players did not take leave in time");
        }
        self.public.ended("public").await;
        self.internal.handle.graceful_shutdown(Some(FAREWELL));
        self.internal.ended("internal").await;
    }
}

impl Listener {
    async fn ended(self, name: &str) {
        match self.task.await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::error!(%error, "the {name} listener ended badly"),
            Err(error) => tracing::error!(%error, "the {name} listener panicked"),
        }
    }
}

fn bind(address: SocketAddr) -> Result<(TcpListener, SocketAddr), CannotListen> {
    let cannot = |reason| CannotListen { address, reason };
    let listener = TcpListener::bind(address).map_err(cannot)?;
    let bound = listener.local_addr().map_err(cannot)?;
    Ok((listener, bound))
}

fn serve(
    (listener, address): (TcpListener, SocketAddr),
    router: Router,
    header_timeout: Duration,
) -> Result<Listener, CannotListen> {
    let handle = Handle::new();
    let mut server = axum_server::from_tcp(listener)
        .map_err(|reason| CannotListen { address, reason })?
        .handle(handle.clone())
        .first_request_timeout(header_timeout);
    // The libraries' defaults have no timeout: half a head would hold a connection for ever.
    server
        .http_builder()
        .http1()
        .header_read_timeout(header_timeout);
    let task = tokio::spawn(server.serve(router.into_make_service()));
    Ok(Listener {
        address,
        handle,
        task,
    })
}
