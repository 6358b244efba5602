//! The HTTP and WebSocket edge, the only place that knows HTTP.
//!
//! `router` has the public routes on one screen, `internal` those of operations, which have a
//! listener of their own.

mod access;
pub mod auth;
mod body;
mod connection;
mod control;
mod description;
mod error;
mod extract;
mod frames;
mod host;
mod ingest;
mod internal;
mod multipart;
mod origin;
mod playback;
mod player;
mod prefer;
mod publish;
mod recordings;
mod request_log;
mod router;
mod socket;
mod subscribe;
mod textures;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use arc_swap::ArcSwap;
use axum::Router;
use axum::http::Request;
use axum_server::Handle;
use axum_server::accept::{Accept, DefaultAcceptor};
use axum_server::service::SendService;
use axum_server::tls_rustls::{RustlsAcceptor, RustlsConfig};
use hyper::body::Incoming;
use serde::{Deserialize, Serialize};
use socket2::{Domain, Socket, Type};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::sync::Semaphore;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::bus::Bus;
use crate::compute::ComputePool;
use crate::streams::Registry;
use crate::telemetry::Telemetry;

use auth::{Auth, Tickets};
use connection::{ConnectionCap, Memory, Patience, Timed};

/// Connections that may wait to be accepted; the system may allow fewer.
const BACKLOG: i32 = 4096;
/// Connections may take so long to end after the last stream has.
const FAREWELL: Duration = Duration::from_secs(2);

/// Where the server listens, what it lets in, and how long it waits.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The public listener; none for a node that talks to operators alone.
    pub listen: Option<SocketAddr>,
    /// The listener of operations.
    pub internal_listen: SocketAddr,
    /// The certificate of the public listener, if it speaks TLS.
    pub tls: Option<TlsOptions>,
    /// Who may do what.
    pub auth: auth::Options,
    /// Origins whose pages may use the server, or `*`.
    pub allowed_origins: Vec<String>,
    /// Names by which the server may be asked, or `*`.
    pub allowed_hosts: Vec<String>,
    /// How long accepted frames may take to come out once the server is asked to stop.
    pub shutdown_grace: Duration,
    /// Most bytes of a frame's body.
    pub max_body_bytes: usize,
    /// Most bytes of frames that are being received at a time.
    pub max_memory_bytes: usize,
    /// Most connections, in all.
    pub max_connections: usize,
    /// Most connections from one address.
    pub max_connections_per_address: usize,
    /// Most players of a stream.
    pub max_subscribers: usize,
    /// Most recordings that are played at a time.
    pub max_playbacks: usize,
    /// How long a request's head may take.
    pub header_timeout: Duration,
    /// How long a request's body may take.
    pub body_timeout: Duration,
    /// How long a connection may stay without a request.
    pub idle_timeout: Duration,
    /// Bytes that the operating system may hold for a connection that does not read.
    pub send_buffer_bytes: usize,
    /// How long a player may take to receive one message, and anybody else to take some of an
    /// answer.
    pub send_timeout: Duration,
}

impl Options {
    fn patience(&self) -> Patience {
        Patience {
            head: self.header_timeout,
            idle: self.idle_timeout,
            send: self.send_timeout,
        }
    }
}

/// A certificate chain and its key, in PEM.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TlsOptions {
    /// The chain, the server's own certificate first.
    pub certificate_file: PathBuf,
    /// Its private key.
    pub key_file: PathBuf,
}

/// What all handlers share.
#[derive(Debug)]
struct App {
    registry: Registry,
    telemetry: Arc<Telemetry>,
    pool: Arc<ComputePool>,
    options: ArcSwap<Options>,
    auth: ArcSwap<Auth>,
    tickets: Tickets,
    stopping: AtomicBool,
    /// Cancelled when connections that do not end with a stream are to end.
    stop: CancellationToken,
    /// WebSocket connections, which end after the request that began them.
    sockets: TaskTracker,
    /// Bytes of frames that are being received.
    memory: Memory,
    /// Recordings that may be played beside those that are.
    playbacks: Arc<Semaphore>,
    /// Where the public listener listens, whatever a later configuration says.
    listens_on: Option<SocketAddr>,
    /// What this node cannot work without.
    bus: Option<Bus>,
}

impl App {
    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    fn options(&self) -> Arc<Options> {
        self.options.load_full()
    }
}

/// Why a server could not start, or not take a new configuration.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NotStarted {
    /// An address cannot be had.
    #[error("cannot listen on {address}: {reason}")]
    CannotListen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        reason: io::Error,
    },
    /// The certificate or its key cannot be used.
    #[error("tls: {certificate} with {key}: {reason}")]
    Tls {
        /// The certificate's file.
        certificate: String,
        /// The key's file.
        key: String,
        /// What is wrong.
        reason: io::Error,
    },
    /// The key of signed tokens cannot be used.
    #[error(transparent)]
    Jwt(#[from] auth::UnusableKey),
}

/// A running server. It stops when [`Server::shut_down`] is called.
#[derive(Debug)]
pub struct Server {
    app: Arc<App>,
    public: Option<Listener>,
    internal: Listener,
    tls: Option<RustlsConfig>,
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
    /// [`NotStarted`].
    pub async fn start(
        options: Options,
        registry: Registry,
        pool: Arc<ComputePool>,
        telemetry: Arc<Telemetry>,
        bus: Option<Bus>,
    ) -> Result<Self, NotStarted> {
        let auth = Auth::new(&options.auth)?;
        let tls = match &options.tls {
            Some(files) => Some(load_tls(files).await?),
            None => None,
        };
        // Both before either is served, so that a failure leaves nothing running.
        let public = options.listen.map(bind).transpose()?;
        let internal = bind(options.internal_listen)?;
        let app = Arc::new(App {
            registry,
            telemetry,
            pool,
            memory: Memory::new(options.max_memory_bytes),
            playbacks: Arc::new(Semaphore::new(
                options.max_playbacks.min(Semaphore::MAX_PERMITS),
            )),
            listens_on: public.as_ref().map(|public| public.1),
            bus,
            options: ArcSwap::from_pointee(options),
            auth: ArcSwap::from_pointee(auth),
            tickets: Tickets::default(),
            stopping: AtomicBool::new(false),
            stop: CancellationToken::new(),
            sockets: TaskTracker::new(),
        });
        let cap = ConnectionCap::new(Arc::clone(&app), tls.is_none());
        let routes = router::router(Arc::clone(&app));
        let public = match (public, &tls) {
            (None, _) => None,
            (Some(public), Some(tls)) => {
                let acceptor = RustlsAcceptor::new(tls.clone())
                    .handshake_timeout(app.options().header_timeout)
                    .acceptor(cap);
                let acceptor = Timed::new(acceptor, Arc::clone(&app));
                Some(serve(public, acceptor, routes)?)
            }
            (Some(public), None) => Some(serve(public, Timed::new(cap, Arc::clone(&app)), routes)?),
        };
        let routes = internal::router(Arc::clone(&app));
        let acceptor = Timed::new(DefaultAcceptor::new(), Arc::clone(&app));
        Ok(Self {
            public,
            internal: serve(internal, acceptor, routes)?,
            app,
            tls,
        })
    }

    /// Finds out whether the files that `options` name can be used.
    ///
    /// # Errors
    ///
    /// [`NotStarted`] names the one that cannot.
    pub async fn check(options: &Options) -> Result<(), NotStarted> {
        Auth::new(&options.auth)?;
        if let Some(files) = &options.tls {
            load_tls(files).await?;
        }
        Ok(())
    }

    /// Takes a new configuration, all of it or nothing. Connections stay. Addresses stay what
    /// they were, and so does whether TLS is spoken.
    ///
    /// # Errors
    ///
    /// [`NotStarted`] if a file that it names cannot be used.
    pub async fn reload(&self, options: Options) -> Result<(), NotStarted> {
        let auth = Auth::new(&options.auth)?;
        if let (Some(tls), Some(files)) = (&self.tls, &options.tls) {
            tls.reload_from_config(load_tls(files).await?.get_inner());
        }
        self.app.auth.store(Arc::new(auth));
        self.app.options.store(Arc::new(options));
        Ok(())
    }

    /// The public listener's address, if there is one.
    #[must_use]
    pub fn address(&self) -> Option<SocketAddr> {
        self.public.as_ref().map(|public| public.address)
    }

    /// The address of operations.
    #[must_use]
    pub fn internal_address(&self) -> SocketAddr {
        self.internal.address
    }

    /// Stops: takes no new connections and frames, lets accepted frames come out, tells
    /// players that it is over, and ends.
    pub async fn shut_down(self) {
        let grace = self.app.options().shutdown_grace;
        self.app.stopping.store(true, Ordering::Relaxed);
        if let Some(public) = &self.public {
            public.handle.graceful_shutdown(Some(grace + FAREWELL));
        }
        self.app.registry.shut_down(grace).await;
        self.app.stop.cancel();
        self.app.sockets.close();
        if tokio::time::timeout(FAREWELL, self.app.sockets.wait())
            .await
            .is_err()
        {
            tracing::warn!("some players did not take leave in time");
        }
        if let Some(public) = self.public {
            public.ended("public").await;
        }
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

async fn load_tls(files: &TlsOptions) -> Result<RustlsConfig, NotStarted> {
    let loaded = RustlsConfig::from_pem_file(&files.certificate_file, &files.key_file).await;
    let loaded = loaded.map_err(|reason| cannot_use(files, reason))?;
    // The library offers HTTP/2 too, which connections here do not speak.
    let mut config = (*loaded.get_inner()).clone();
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(RustlsConfig::from_config(Arc::new(config)))
}

fn cannot_use(files: &TlsOptions, reason: io::Error) -> NotStarted {
    NotStarted::Tls {
        certificate: files.certificate_file.display().to_string(),
        key: files.key_file.display().to_string(),
        reason,
    }
}

fn bind(address: SocketAddr) -> Result<(TcpListener, SocketAddr), NotStarted> {
    let cannot = |reason| NotStarted::CannotListen { address, reason };
    let listener = listen(address).map_err(cannot)?;
    let bound = listener.local_addr().map_err(cannot)?;
    Ok((listener, bound))
}

/// The standard library's listener lets few connections wait to be accepted: a flood of them
/// would cost others seconds.
fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = Socket::new(Domain::for_address(address), Type::STREAM, None)?;
    // As the standard library does, so that a server can be started again at once.
    socket.set_reuse_address(true)?;
    socket.bind(&address.into())?;
    socket.listen(BACKLOG)?;
    Ok(socket.into())
}

fn serve<A>(
    (listener, address): (TcpListener, SocketAddr),
    acceptor: A,
    router: Router,
) -> Result<Listener, NotStarted>
where
    A: Accept<TcpStream, Router> + Clone + Send + Sync + 'static,
    A::Stream: AsyncRead + AsyncWrite + Unpin + Send,
    A::Service: SendService<Request<Incoming>> + Send,
    A::Future: Send,
{
    let handle = Handle::new();
    let server = axum_server::from_tcp(listener)
        .map_err(|reason| NotStarted::CannotListen { address, reason })?
        .acceptor(acceptor)
        .handle(handle.clone());
    let task = tokio::spawn(server.serve(router.into_make_service()));
    Ok(Listener {
        address,
        handle,
        task,
    })
}
