//! Services that are told what happens to streams.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde_json::{Value, json};
use steadymesh::config::Config;
use steadymesh::webhooks::{Bound, EndpointOptions, Figure, Options, Prepared, Secret};
use tokio::sync::mpsc;

use crate::process::Process;
use crate::support::{TestServer, frames, start_with};

const SECRET: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

/// A service that is told, and answers as it was asked to, then with 204.
struct Receiver {
    address: SocketAddr,
    requests: mpsc::UnboundedReceiver<(HeaderMap, Bytes)>,
    answers: Arc<Mutex<VecDeque<Response>>>,
}

#[derive(Clone)]
struct Shared {
    requests: mpsc::UnboundedSender<(HeaderMap, Bytes)>,
    answers: Arc<Mutex<VecDeque<Response>>>,
}

async fn take(State(shared): State<Shared>, headers: HeaderMap, body: Bytes) -> Response {
    shared.requests.send((headers, body)).ok();
    let answer = shared.answers.lock().unwrap().pop_front();
    answer.unwrap_or_else(|| StatusCode::NO_CONTENT.into_response())
}

impl Receiver {
    async fn start() -> Self {
        let (sender, requests) = mpsc::unbounded_channel();
        let answers = Arc::<Mutex<VecDeque<Response>>>::default();
        let shared = Shared {
            requests: sender,
            answers: Arc::clone(&answers),
        };
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let routes = Router::new().fallback(take).with_state(shared);
        tokio::spawn(async move { axum::serve(listener, routes).await });
        Self {
            address,
            requests,
            answers,
        }
    }

    fn answer(&self, answer: impl IntoResponse) {
        self.answers
            .lock()
            .unwrap()
            .push_back(answer.into_response());
    }

    async fn request(&mut self) -> (HeaderMap, Bytes) {
        let request = tokio::time::timeout(Duration::from_secs(20), self.requests.recv()).await;
        request.expect("a webhook is expected").unwrap()
    }

    /// The next message, whose signature is right.
    async fn message(&mut self) -> Value {
        let (headers, body) = self.request().await;
        let header = |name: &str| headers[name].to_str().unwrap();
        let signature = Secret::parse(SECRET).unwrap().sign(
            header("webhook-id"),
            header("webhook-timestamp").parse().unwrap(),
            &body,
        );
        assert_eq!(header("webhook-signature"), signature);
        assert_eq!(header("content-type"), "application/json");
        serde_json::from_slice(&body).unwrap()
    }

    async fn next_is(&mut self, kind: &str) -> Value {
        let message = self.message().await;
        assert_eq!(message["type"], kind, "{message}");
        message
    }
}

fn endpoint(name: &str, address: SocketAddr) -> EndpointOptions {
    EndpointOptions {
        name: name.to_owned(),
        url: format!("http://{address}/hook?key=k3y").try_into().unwrap(),
        secret: Some(Secret::parse(SECRET).unwrap()),
        secret_file: None,
        events: Vec::new(),
        streams: Vec::new(),
    }
}

/// A server that tells these endpoints.
async fn start(endpoints: Vec<EndpointOptions>, change: impl FnOnce(&mut Options)) -> TestServer {
    start_with(|config: &mut Config| {
        config.webhooks.endpoints = endpoints;
        config.webhooks.retry_ms = 10;
        change(&mut config.webhooks);
    })
    .await
}

async fn delete(server: &TestServer, stream: &str) {
    let url = server.url(&format!("/v1/streams/{stream}"));
    let answer = server.client.delete(url).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::NO_CONTENT);
}

/// Waits until a series of an endpoint has this value.
async fn has_series(server: &TestServer, series: &str) {
    let line = format!("steadymesh_webhooks_{series}\n");
    let mut text = String::new();
    for _ in 0..500 {
        text = server.internal("/metrics").await.text().await.unwrap();
        if text.contains(&line) {
            return;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("{line} is not in\n{text}");
}

#[tokio::test]
async fn the_start_and_the_end_of_a_stream_are_told_signed_and_in_order() {
    let mut receiver = Receiver::start().await;
    let server = start(vec![endpoint("ops", receiver.address)], |_| {}).await;
    for body in frames(2) {
        server.publish("demo", body).await;
    }
    let started = receiver.next_is("stream.started").await;
    assert_eq!(started["data"], json!({"stream": "demo", "seq": 0}));
    assert!(started["timestamp"].as_str().unwrap().ends_with('Z'));
    delete(&server, "demo").await;
    let ended = receiver.next_is("stream.ended").await;
    let data = json!({
        "stream": "demo", "reason": "deleted", "published": 2, "dropped": 0, "latest_seq": 1
    });
    assert_eq!(ended["data"], data);
    has_series(&server, "delivered_total{endpoint=\"ops\"} 2").await;
    let text = server.internal("/metrics").await.text().await.unwrap();
    assert!(!text.contains("k3y"), "a metric shows the address");
}

#[tokio::test]
async fn a_stall_and_its_end_are_told() {
    let mut receiver = Receiver::start().await;
    let server = start(vec![endpoint("ops", receiver.address)], |webhooks| {
        webhooks.stall_secs = 1;
    })
    .await;
    let mut bodies = frames(2).into_iter();
    server.publish("demo", bodies.next().unwrap()).await;
    receiver.next_is("stream.started").await;
    let stalled = receiver.next_is("stream.stalled").await;
    assert_eq!(
        (&stalled["data"]["stream"], &stalled["data"]["seq"]),
        (&json!("demo"), &json!(0))
    );
    assert!(1.0 <= stalled["data"]["silent_secs"].as_f64().unwrap());
    server.publish("demo", bodies.next().unwrap()).await;
    let resumed = receiver.next_is("stream.resumed").await;
    assert_eq!(resumed["data"]["seq"], 1);
}

#[tokio::test]
async fn a_figure_out_of_its_bound_is_told_after_enough_frames_and_so_is_its_return() {
    let mut receiver = Receiver::start().await;
    let server = start(vec![endpoint("ops", receiver.address)], |webhooks| {
        webhooks.exceeded_after_frames = 2;
        webhooks.restored_after_frames = 3;
        webhooks.bounds = vec![Bound {
            figure: Figure::SurfaceDistanceCurrent,
            min: None,
            max: Some(0.001),
            streams: Vec::new(),
        }];
    })
    .await;
    let url = server.url("/v1/streams/demo");
    // So few faces are far from the surface; as many as there are lie on it.
    let coarse = json!({"target_faces": 20}).to_string();
    server.client.put(&url).body(coarse).send().await.unwrap();
    let bodies = frames(6);
    for body in &bodies[..2] {
        server.publish("demo", body.clone()).await;
    }
    receiver.next_is("stream.started").await;
    let exceeded = receiver.next_is("consistency.exceeded").await;
    let data = &exceeded["data"];
    assert_eq!(data["figure"], "surface_distance_current");
    assert_eq!(data["bound"], json!({"max": 0.001}));
    assert_eq!((&data["seq"], &data["frames"]), (&json!(1), &json!(2)));
    assert!(0.001 < data["value"].as_f64().unwrap());
    let fine = json!({"target_ratio": 1.0}).to_string();
    server.client.put(&url).body(fine).send().await.unwrap();
    for body in &bodies[2..5] {
        server.publish("demo", body.clone()).await;
    }
    let restored = receiver.next_is("consistency.restored").await;
    assert_eq!(restored["data"]["seq"], 4);
}

#[tokio::test]
async fn a_message_is_sent_again_while_that_may_help_with_the_same_id() {
    let mut receiver = Receiver::start().await;
    receiver.answer(StatusCode::SERVICE_UNAVAILABLE);
    receiver.answer(StatusCode::TOO_MANY_REQUESTS);
    let server = start(vec![endpoint("ops", receiver.address)], |_| {}).await;
    server.publish("demo", frames(1).remove(0)).await;
    let mut ids = Vec::new();
    for _ in 0..3 {
        let (headers, _) = receiver.request().await;
        ids.push(headers["webhook-id"].clone());
    }
    assert!(ids.iter().all(|id| *id == ids[0]), "{ids:?}");
    has_series(&server, "delivered_total{endpoint=\"ops\"} 1").await;
    // A refusal is final, and a redirect is one.
    receiver.answer((StatusCode::FOUND, [("location", "/elsewhere")]));
    delete(&server, "demo").await;
    receiver.next_is("stream.ended").await;
    has_series(&server, "failed_total{endpoint=\"ops\"} 1").await;
    assert!(receiver.requests.try_recv().is_err());
}

#[tokio::test]
async fn an_endpoint_is_told_only_of_its_events_and_streams() {
    let mut receiver = Receiver::start().await;
    let mut picky = endpoint("ops", receiver.address);
    picky.events = vec![steadymesh::webhooks::Kind::Ended];
    picky.streams = vec!["rig-*".parse().unwrap()];
    let server = start(vec![picky], |_| {}).await;
    let body = frames(1).remove(0);
    for stream in ["demo", "rig-1"] {
        server.publish(stream, body.clone()).await;
        delete(&server, stream).await;
    }
    let ended = receiver.next_is("stream.ended").await;
    assert_eq!(ended["data"]["stream"], "rig-1");
}

#[tokio::test]
async fn an_endpoint_that_never_answers_holds_up_neither_streams_nor_other_endpoints() {
    // It accepts connections, as far as the system does that for it, and says nothing.
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let mut receiver = Receiver::start().await;
    let endpoints = vec![
        endpoint("silent", silent.local_addr().unwrap()),
        endpoint("ops", receiver.address),
    ];
    let server = start(endpoints, |webhooks| {
        webhooks.queue = 1;
        webhooks.shutdown_secs = 1;
    })
    .await;
    let body = frames(1).remove(0);
    for round in 0..3 {
        server.publish("demo", body.clone()).await;
        receiver.next_is("stream.started").await;
        if round < 2 {
            delete(&server, "demo").await;
            receiver.next_is("stream.ended").await;
        }
    }
    // Of five messages one is on its way and one waits.
    has_series(&server, "dropped_total{endpoint=\"silent\"} 3").await;
    let before = std::time::Instant::now();
    let TestServer {
        server, webhooks, ..
    } = server;
    server.shut_down().await;
    webhooks.shut_down().await;
    assert!(before.elapsed() < Duration::from_secs(4));
    let ended = receiver.next_is("stream.ended").await;
    assert_eq!(ended["data"]["reason"], "shutdown");
}

#[tokio::test]
async fn a_new_configuration_sends_what_waits_to_the_new_address() {
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = silent.local_addr().unwrap();
    let server = start(vec![endpoint("ops", address)], |_| {}).await;
    server.publish("demo", frames(1).remove(0)).await;
    has_series(&server, "queued{endpoint=\"ops\"} 1").await;
    let mut receiver = Receiver::start().await;
    let options = Options {
        endpoints: vec![endpoint("ops", receiver.address)],
        ..Options::default()
    };
    server
        .webhooks
        .reload(Prepared::new(&options).unwrap())
        .await;
    receiver.next_is("stream.started").await;
    // Without endpoints their series are gone.
    let none = Prepared::new(&Options::default()).unwrap();
    server.webhooks.reload(none).await;
    for _ in 0..500 {
        let text = server.internal("/metrics").await.text().await.unwrap();
        if !text.contains("endpoint=\"ops\"") {
            return;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("the series of an endpoint that is gone are still there");
}

#[tokio::test]
async fn endpoints_come_with_sighup_and_hear_of_the_end_and_the_log_shows_none_of_their_secrets() {
    let folder = tempfile::tempdir().unwrap();
    let secret_file = folder.path().join("ops.secret");
    std::fs::write(&secret_file, format!("{SECRET}\n")).unwrap();
    let mut receiver = Receiver::start().await;
    let endpoint = |secret_file: &std::path::Path| {
        format!(
            "[[webhooks.endpoints]]\nname = 'ops'\nurl = 'http://{}/hook?key=k3y'\n\
             secret_file = '{}'\n",
            receiver.address,
            secret_file.display()
        )
    };
    let (good, bad) = (endpoint(&secret_file), endpoint(folder.path()));
    let mut process = Process::start("trace", "", &[]);
    process.reload(&good);
    process.wait_for("has been read again");
    process.reload(&bad);
    let line = process.wait_for("the old one stays");
    assert!(line.contains("secret_file of ops"), "{line}");
    let frame = reqwest::Client::new()
        .post(process.url("/v1/streams/demo/frames"))
        .header("prefer", "wait")
        .body(frames(1).remove(0));
    assert_eq!(frame.send().await.unwrap().status(), StatusCode::OK);
    receiver.next_is("stream.started").await;
    let log = tokio::task::spawn_blocking(|| process.stop())
        .await
        .unwrap();
    let ended = receiver.next_is("stream.ended").await;
    assert_eq!(ended["data"]["reason"], "shutdown");
    for line in log {
        assert!(!line.contains("MfKQ") && !line.contains("k3y"), "{line}");
    }
}
