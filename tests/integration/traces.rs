//! Traces, as a collector receives them.

use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, Uri};
use bytes::Bytes;
use reqwest::Client;
use steadymesh_proto::NATIVE_CONTENT_TYPE;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use crate::process::Process;
use crate::support::frames;

const TRACE_ID: [u8; 16] = *b"\x4b\xf9\x2f\x35\x77\xb3\x4d\xa6\xa3\xce\x92\x9d\x0e\x0e\x47\x36";
const TRACEPARENT: &str = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

type Export = (Uri, HeaderMap, Bytes);

/// Receives exports on a port of its own.
async fn collector() -> (String, UnboundedReceiver<Export>) {
    let (sender, exports) = unbounded_channel();
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let routes = Router::new().fallback(export).with_state(sender);
    tokio::spawn(async move { axum::serve(listener, routes).await });
    (address, exports)
}

async fn export(
    State(sender): State<UnboundedSender<Export>>,
    uri: Uri,
    headers: HeaderMap,
    body: Bytes,
) -> StatusCode {
    sender.send((uri, headers, body)).ok();
    StatusCode::OK
}

async fn post(process: &Process, body: Vec<u8>) {
    let request = Client::new()
        .post(process.url("/v1/streams/demo/frames"))
        .header("content-type", NATIVE_CONTENT_TYPE)
        .header("prefer", "wait")
        .header("traceparent", TRACEPARENT)
        .body(body);
    assert!(request.send().await.unwrap().status().is_success());
}

/// A span of this name: field 5 of `opentelemetry.proto.trace.v1.Span`.
fn span(name: &str) -> Vec<u8> {
    let mut field = vec![5 << 3 | 2, u8::try_from(name.len()).unwrap()];
    field.extend(name.as_bytes());
    field
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

#[tokio::test]
async fn requests_frames_and_stages_are_exported_within_the_publishers_trace() {
    let (address, mut exports) = collector().await;
    let process = Process::start(
        "info",
        "",
        &[
            ("OTEL_EXPORTER_OTLP_ENDPOINT", &address),
            ("OTEL_EXPORTER_OTLP_HEADERS", "x-tenant=studio-2"),
            ("OTEL_SERVICE_NAME", "left-stage"),
            (
                "OTEL_RESOURCE_ATTRIBUTES",
                "deployment.environment.name=rehearsal",
            ),
        ],
    );
    for body in frames(2) {
        post(&process, body).await;
    }
    let url = process.url("/v1/streams?ticket=t1cket");
    Client::new().get(url).send().await.unwrap();
    // Everything is delivered before the end, however long the exporter's interval.
    let log = tokio::task::spawn_blocking(|| process.stop())
        .await
        .unwrap();
    let mut all = Vec::new();
    while let Ok((uri, headers, body)) = exports.try_recv() {
        assert_eq!(uri.path(), "/v1/traces");
        assert_eq!(headers["content-type"], "application/x-protobuf");
        assert_eq!(headers["x-tenant"], "studio-2");
        all.extend(body);
    }
    for text in ["left-stage", "rehearsal", "demo", "/v1/streams/demo/frames"] {
        assert!(
            contains(&all, text.as_bytes()),
            "{text} is not in what was exported"
        );
    }
    for name in [
        "POST /v1/streams/{stream}/frames",
        "frame",
        "parse",
        "repair",
        "register",
        "simplify",
        "encode",
        "measure",
    ] {
        assert!(contains(&all, &span(name)), "no span {name}");
    }
    assert!(contains(&all, &TRACE_ID));
    assert!(!contains(&all, b"t1cket"), "a trace shows a ticket");
    assert!(
        !log.iter().any(|line| line.contains("\"name\":\"frame\"")),
        "{log:#?}"
    );
}

#[tokio::test]
async fn a_collector_that_never_answers_holds_up_neither_frames_nor_the_end() {
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/v1/traces", silent.local_addr().unwrap());
    let environment = [
        ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", address.as_str()),
        ("OTEL_BSP_SCHEDULE_DELAY", "50"),
        ("OTEL_BSP_MAX_QUEUE_SIZE", "8"),
    ];
    let process = Process::start("info", "", &environment);
    for body in frames(4) {
        post(&process, body).await;
    }
    let before = Instant::now();
    tokio::task::spawn_blocking(|| process.stop())
        .await
        .unwrap();
    assert!(
        before.elapsed() < Duration::from_secs(8),
        "{:?}",
        before.elapsed()
    );
}

#[tokio::test]
async fn a_protocol_that_is_not_spoken_is_a_warning() {
    let environment = [
        ("OTEL_EXPORTER_OTLP_ENDPOINT", "http://127.0.0.1:4317"),
        ("OTEL_EXPORTER_OTLP_PROTOCOL", "grpc"),
    ];
    let process = Process::start("info", "", &environment);
    post(&process, frames(1).remove(0)).await;
    let log = process.stop();
    let is_warning = |line: &String| line.contains("\"WARN\"") && line.contains("http/protobuf");
    assert!(log.iter().any(is_warning), "{log:#?}");
}
