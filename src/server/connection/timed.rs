//! Streams that end when nothing happens on them for too long.
//!
//! The HTTP library has no time limit for a client that takes nothing of its answer, and one for
//! both a request's head and the time between requests. Here each has its own, above TLS and
//! below HTTP, so that all that is sent and received is seen.

use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use axum::body::{Body, HttpBody};
use axum::http::{Request, Response, StatusCode};
use axum_server::accept::Accept;
use bytes::Bytes;
use futures_util::future::BoxFuture;
use hyper::body::{Frame, Incoming, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Instant, Sleep, sleep_until};
use tower_service::Service;

use super::link::{Answering, Link, Patience};
use crate::server::App;

/// How an HTTP/2 connection begins. Nothing here needs HTTP/2: WebSocket does not run over it, and
/// what is not spoken cannot be attacked.
const HTTP2_PREFACE: &[u8] = b"PRI * HTTP/2.0";

/// Accepts connections that are timed.
#[derive(Debug, Clone)]
pub(in crate::server) struct Timed<A> {
    inner: A,
    app: Arc<App>,
}

impl<A> Timed<A> {
    pub fn new(inner: A, app: Arc<App>) -> Self {
        Self { inner, app }
    }
}

impl<A, S> Accept<TcpStream, S> for Timed<A>
where
    A: Accept<TcpStream, S>,
    A::Future: Send + 'static,
{
    type Stream = TimedStream<A::Stream>;
    type Service = Tracked<A::Service>;
    type Future = BoxFuture<'static, io::Result<(Self::Stream, Self::Service)>>;

    fn accept(&self, stream: TcpStream, service: S) -> Self::Future {
        let accepted = self.inner.accept(stream, service);
        let patience = self.app.options().patience();
        Box::pin(async move {
            let (stream, service) = accepted.await?;
            let link = Link::new();
            let stream = TimedStream::new(stream, link.clone(), patience);
            Ok((stream, Tracked { service, link }))
        })
    }
}

/// Tells the connection when a request is there, and requests which connection is theirs.
#[derive(Debug, Clone)]
pub(in crate::server) struct Tracked<S> {
    service: S,
    link: Link,
}

impl<S> Service<Request<Incoming>> for Tracked<S>
where
    S: Service<Request<Incoming>, Response = Response<Body>>,
    S::Future: Send + 'static,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = BoxFuture<'static, Result<Response<Body>, S::Error>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<Incoming>) -> Self::Future {
        let (link, answering) = (self.link.clone(), self.link.begin());
        request.extensions_mut().insert(link.clone());
        let response = self.service.call(request);
        Box::pin(async move {
            let response = response.await?;
            if response.status() == StatusCode::SWITCHING_PROTOCOLS {
                link.upgraded();
            }
            Ok(response.map(|body| {
                Body::new(Answer {
                    body,
                    _answering: answering,
                })
            }))
        })
    }
}

/// An answer's body.
struct Answer {
    body: Body,
    _answering: Answering,
}

impl HttpBody for Answer {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// A stream on which something must happen.
#[derive(Debug)]
pub(in crate::server) struct TimedStream<S> {
    stream: S,
    link: Link,
    patience: Patience,
    /// When something must have been received.
    receive: Alarm,
    /// When something that was written must have been taken.
    write: Stall,
    flush: Stall,
    /// How much of the first bytes is what an HTTP/2 connection begins with.
    preface: Option<usize>,
}

impl<S> TimedStream<S> {
    fn new(stream: S, link: Link, patience: Patience) -> Self {
        Self {
            stream,
            link,
            patience,
            receive: Alarm::default(),
            write: Stall::default(),
            flush: Stall::default(),
            preface: Some(0),
        }
    }

    /// Whether this is no connection of HTTP/1.1.
    fn is_http2(&mut self, received: &[u8]) -> bool {
        for byte in received {
            let Some(matched) = self.preface else {
                return false;
            };
            let goes_on = HTTP2_PREFACE.get(matched) == Some(byte);
            self.preface = goes_on.then_some(matched + 1);
            if self.preface == Some(HTTP2_PREFACE.len()) {
                return true;
            }
        }
        false
    }

    /// Notes what became of an attempt to write.
    fn written<T>(
        &mut self,
        context: &mut Context<'_>,
        polled: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if polled.is_ready() {
            self.write.end();
            self.flush.end();
            self.link.sent();
            return polled;
        }
        if self.link.is_upgraded() {
            return polled;
        }
        ready!(self.write.poll(context, &self.patience));
        Poll::Ready(Err(taken_nothing()))
    }

    /// The same for an attempt to flush, which may have nothing to do with what was written: a
    /// success says nothing about the client.
    fn flushed(
        &mut self,
        context: &mut Context<'_>,
        polled: Poll<io::Result<()>>,
    ) -> Poll<io::Result<()>> {
        if polled.is_ready() {
            self.flush.end();
            return polled;
        }
        if self.link.is_upgraded() {
            return polled;
        }
        ready!(self.flush.poll(context, &self.patience));
        Poll::Ready(Err(taken_nothing()))
    }
}

fn taken_nothing() -> io::Error {
    tracing::debug!("a client takes nothing of what is sent to it: the connection ends");
    io::Error::new(
        io::ErrorKind::TimedOut,
        "the client has taken nothing for limits.send_timeout_secs",
    )
}

impl<S: AsyncRead + Unpin> AsyncRead for TimedStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = &mut *self;
        ready!(this.link.poll_room(context));
        let before = buffer.filled().len();
        if let Poll::Ready(read) = Pin::new(&mut this.stream).poll_read(context, buffer) {
            let received = &buffer.filled()[before..];
            if !received.is_empty() {
                this.link.received(received.len());
                if this.is_http2(received) {
                    let reason = "HTTP/2 is not spoken here";
                    return Poll::Ready(Err(io::Error::new(io::ErrorKind::InvalidData, reason)));
                }
            }
            return Poll::Ready(read);
        }
        let Some(deadline) = this.link.deadline(&this.patience) else {
            return Poll::Pending;
        };
        ready!(this.receive.poll(context, deadline));
        tracing::debug!("nothing comes over a connection: it ends");
        // As if the client had closed it.
        Poll::Ready(Ok(()))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for TimedStream<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.written(context, polled)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let polled = Pin::new(&mut self.stream).poll_write_vectored(context, slices);
        self.written(context, polled)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let polled = Pin::new(&mut self.stream).poll_flush(context);
        self.flushed(context, polled)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let polled = Pin::new(&mut self.stream).poll_shutdown(context);
        self.flushed(context, polled)
    }
}

/// Wakes a task at a time that may change.
#[derive(Debug, Default)]
struct Alarm(Option<Pin<Box<Sleep>>>);

impl Alarm {
    fn poll(&mut self, context: &mut Context<'_>, deadline: Instant) -> Poll<()> {
        let sleep = self
            .0
            .get_or_insert_with(|| Box::pin(sleep_until(deadline)));
        if sleep.deadline() != deadline {
            sleep.as_mut().reset(deadline);
        }
        sleep.as_mut().poll(context)
    }
}

/// Bytes that are not taken.
#[derive(Debug, Default)]
struct Stall {
    until: Option<Instant>,
    alarm: Alarm,
}

impl Stall {
    /// Ready when it has lasted too long.
    fn poll(&mut self, context: &mut Context<'_>, patience: &Patience) -> Poll<()> {
        let until = *self
            .until
            .get_or_insert_with(|| Instant::now() + patience.send);
        self.alarm.poll(context, until)
    }

    fn end(&mut self) {
        self.until = None;
    }
}
