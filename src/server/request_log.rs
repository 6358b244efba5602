//! A request's id, its spans, and its line in the log.
//!
//! An operator who looks for errors finds defects only: refusals, which are a client's business
//! or overload, are counted and told at the level `debug`, as is everything that went well.

use std::time::Instant;

use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::Response;
use tracing::field::Empty;
use tracing::{Instrument, Span};

use crate::stopwatch::microseconds;
use crate::telemetry::traces;

pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
const MAX_ID_BYTES: usize = 64;

/// The span under which a request is logged, for what goes on after its answer.
#[derive(Debug, Clone)]
pub(super) struct LogSpan(pub Span);

/// What a problem's answer says to the log.
#[derive(Debug, Clone)]
pub(super) struct Report {
    pub kind: &'static str,
    /// Set for defects that nobody has logged.
    pub defect: Option<String>,
}

/// Runs a request under its id.
pub(super) async fn log(mut request: Request, next: Next) -> Response {
    let started = Instant::now();
    let id = request_id(request.headers());
    let span = log_span(&request, &id);
    let trace = span.in_scope(|| trace_span(&request));
    request.extensions_mut().insert(LogSpan(span.clone()));
    let answering = next.run(request).instrument(trace.clone());
    let mut response = answering.instrument(span.clone()).await;
    let status = response.status();
    trace.record("http.response.status_code", status.as_u16());
    if status.is_server_error() {
        trace.record("otel.status_code", "ERROR");
    }
    // Within the trace, so that an error is seen there too.
    span.in_scope(|| trace.in_scope(|| write(&response, started)));
    response.headers_mut().insert(REQUEST_ID, id);
    response
}

/// The path without the query, which may hold a ticket.
fn log_span(request: &Request, id: &HeaderValue) -> Span {
    // An id has been checked to be text.
    let request_id = id.to_str().unwrap_or_default();
    let (method, path) = (request.method(), request.uri().path());
    tracing::info_span!("request", request_id, %method, path)
}

/// In the terms of OpenTelemetry's conventions for HTTP servers.
fn trace_span(request: &Request) -> Span {
    let route = request.extensions().get::<MatchedPath>();
    let route = route.map_or("", MatchedPath::as_str);
    let (method, path) = (request.method().as_str(), request.uri().path());
    let span = tracing::info_span!(
        target: traces::TARGET,
        "request",
        otel.name = %format_args!("{method} {route}"),
        otel.kind = "server",
        otel.status_code = Empty,
        http.request.method = method,
        http.route = route,
        url.path = path,
        http.response.status_code = Empty,
    );
    traces::join(&span, |name| {
        let value = request.headers().get(name)?;
        value.to_str().ok().map(str::to_owned)
    });
    span
}

fn write(response: &Response, started: Instant) {
    let status = response.status();
    let (code, latency_us) = (status.as_u16(), microseconds(started.elapsed()));
    let report = response.extensions().get::<Report>();
    let kind = report.map_or("", |report| report.kind);
    match report {
        Some(Report {
            defect: Some(detail),
            ..
        }) => {
            tracing::error!(status = code, latency_us, detail, "request failed");
        }
        // What no problem document was made for is a defect as well, unless it is a refusal.
        None if status.is_server_error() && status != StatusCode::SERVICE_UNAVAILABLE => {
            tracing::error!(status = code, latency_us, "request failed");
        }
        _ => tracing::debug!(status = code, latency_us, kind, "request answered"),
    }
}

/// The client's id if it can be shown as it is, else one of our own.
fn request_id(headers: &HeaderMap) -> HeaderValue {
    let is_sane = |id: &&HeaderValue| {
        let bytes = id.as_bytes();
        let is_plain = |byte: &u8| byte.is_ascii_alphanumeric() || b"-_.".contains(byte);
        (1..=MAX_ID_BYTES).contains(&bytes.len()) && bytes.iter().all(is_plain)
    };
    headers
        .get(REQUEST_ID)
        .filter(is_sane)
        .cloned()
        .unwrap_or_else(|| {
            // Without random numbers requests cannot be told apart, and go on nevertheless.
            let random = getrandom::u64().unwrap_or_default();
            let id = HeaderValue::try_from(format!("{random:016x}"));
            id.unwrap_or_else(|_| HeaderValue::from_static("none"))
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::error::Problem;
    use axum::response::IntoResponse;
    use std::sync::{Arc, Mutex};

    fn id_for(sent: &str) -> String {
        let mut headers = HeaderMap::new();
        headers.insert(
            REQUEST_ID,
            HeaderValue::from_bytes(sent.as_bytes()).unwrap(),
        );
        request_id(&headers).to_str().unwrap().to_owned()
    }

    #[test]
    fn a_clients_id_is_taken_if_it_is_plain_and_short() {
        assert_eq!(id_for("rig-2.take_7"), "rig-2.take_7");
        for strange in ["", "a b", "{\"a\":1}", "é", &"x".repeat(65)] {
            assert_eq!(id_for(strange).len(), 16, "{strange}");
        }
        assert_ne!(id_for(""), id_for(""));
    }

    /// The level at which an answer is logged.
    fn level_of(response: &Response) -> String {
        let log = Arc::new(Mutex::new(Vec::new()));
        let writer = Arc::clone(&log);
        let subscriber = tracing_subscriber::fmt()
            .without_time()
            .with_max_level(tracing::Level::TRACE)
            .with_ansi(false)
            .with_writer(move || Writer(Arc::clone(&writer)))
            .finish();
        tracing::subscriber::with_default(subscriber, || write(response, Instant::now()));
        let text = String::from_utf8(log.lock().unwrap().clone()).unwrap();
        text.split_whitespace()
            .next()
            .unwrap_or_default()
            .to_owned()
    }

    struct Writer(Arc<Mutex<Vec<u8>>>);

    impl std::io::Write for Writer {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn only_defects_that_nobody_has_logged_are_errors() {
        let defect = || Problem::defect("it broke");
        let plain = |status: StatusCode| status.into_response();
        for (response, level) in [
            (defect().into_response(), "ERROR"),
            (defect().already_logged().into_response(), "DEBUG"),
            (plain(StatusCode::INTERNAL_SERVER_ERROR), "ERROR"),
            (Problem::stopping().into_response(), "DEBUG"),
            (Problem::unauthorized("no").into_response(), "DEBUG"),
            (plain(StatusCode::SERVICE_UNAVAILABLE), "DEBUG"),
            (plain(StatusCode::OK), "DEBUG"),
        ] {
            assert_eq!(level_of(&response), level, "{response:?}");
        }
    }
}
