//! How many connections there may be, in all and from one address.

use std::collections::HashMap;
use std::io::{self, IoSlice};
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum_server::accept::Accept;
use futures_util::future::BoxFuture;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::Semaphore;
use tokio::time::timeout;

use crate::server::App;

/// How long a client that is sent away may take to read why.
const FAREWELL: Duration = Duration::from_millis(500);
/// Clients that are told why at a time. More are sent away without a word, so that a flood of
/// connections over the limit takes no more files than these.
const MAX_FAREWELLS: usize = 64;

/// Lets connections in while there is room for them.
#[derive(Debug, Clone)]
pub(in crate::server) struct ConnectionCap {
    app: Arc<App>,
    counts: Arc<Mutex<Counts>>,
    farewells: Arc<Semaphore>,
    /// Whether an answer can be sent as it is, which it cannot before a TLS handshake.
    is_plain: bool,
}

#[derive(Debug, Default)]
struct Counts {
    total: usize,
    by_address: HashMap<IpAddr, usize>,
}

/// A connection that is counted for as long as it lasts.
#[derive(Debug)]
pub(in crate::server) struct Counted {
    stream: TcpStream,
    _guard: Guard,
}

#[derive(Debug)]
struct Guard {
    cap: ConnectionCap,
    address: IpAddr,
}

impl ConnectionCap {
    pub fn new(app: Arc<App>, is_plain: bool) -> Self {
        Self {
            app,
            counts: Arc::default(),
            farewells: Arc::new(Semaphore::new(MAX_FAREWELLS)),
            is_plain,
        }
    }

    fn enter(&self, address: IpAddr) -> Result<Guard, String> {
        let options = self.app.options();
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        let limit = options.max_connections;
        if limit <= counts.total {
            return Err(format!(
                "{limit} connections are open, which is limits.connections"
            ));
        }
        let limit = options.max_connections_per_address;
        let from_there = counts.by_address.get(&address).copied().unwrap_or_default();
        if limit <= from_there {
            return Err(format!(
                "{limit} connections from {address} are open, which is \
                 limits.connections_per_address"
            ));
        }
        counts.total += 1;
        counts.by_address.insert(address, from_there + 1);
        self.app.telemetry.open_connections.set(counts.total as i64);
        drop(counts);
        let cap = self.clone();
        Ok(Guard { cap, address })
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        let mut counts = self
            .cap
            .counts
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        counts.total -= 1;
        match counts.by_address.get_mut(&self.address) {
            Some(count) if 1 < *count => *count -= 1,
            _ => {
                counts.by_address.remove(&self.address);
            }
        }
        self.cap
            .app
            .telemetry
            .open_connections
            .set(counts.total as i64);
    }
}

impl<S: Send + 'static> Accept<TcpStream, S> for ConnectionCap {
    type Stream = Counted;
    type Service = S;
    type Future = BoxFuture<'static, io::Result<(Counted, S)>>;

    fn accept(&self, stream: TcpStream, service: S) -> Self::Future {
        let cap = self.clone();
        Box::pin(async move {
            let address = stream.peer_addr()?.ip();
            match cap.enter(address) {
                Ok(guard) => {
                    // Frames are whole messages: waiting for more would only delay them.
                    stream.set_nodelay(true)?;
                    // The default grows to megabytes, in which a slow player would fall behind
                    // by minutes before anybody notices.
                    let buffer = cap.app.options().send_buffer_bytes;
                    socket2::SockRef::from(&stream).set_send_buffer_size(buffer)?;
                    let counted = Counted {
                        stream,
                        _guard: guard,
                    };
                    Ok((counted, service))
                }
                Err(reason) => {
                    cap.app.telemetry.refused_connections.inc();
                    if cap.is_plain
                        && let Ok(_turn) = cap.farewells.try_acquire()
                    {
                        timeout(FAREWELL, send_away(stream, &reason)).await.ok();
                    }
                    Err(io::Error::other(reason))
                }
            }
        })
    }
}

/// Says why, and waits until the client has closed, so that it can read it.
async fn send_away(mut stream: TcpStream, reason: &str) -> io::Result<()> {
    let body = format!(
        "{{\"type\":\"urn:steadymesh:problem:over-limit\",\"title\":\"Over a limit\",\
         \"status\":503,\"detail\":\"{reason}\"}}"
    );
    let answer = format!(
        "HTTP/1.1 503 Service Unavailable\r\ncontent-type: application/problem+json\r\n\
         retry-after: 1\r\nconnection: close\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(answer.as_bytes()).await?;
    stream.shutdown().await?;
    let mut rest = [0; 4096];
    while 0 < stream.read(&mut rest).await? {}
    Ok(())
}

impl AsyncRead for Counted {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Counted {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}
