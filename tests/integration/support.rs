//! A server of a test's own, and what it takes to talk to it.

use std::net::SocketAddr;
use std::sync::Arc;

use futures_util::StreamExt;
use reqwest::{Client, RequestBuilder, Response, StatusCode};
use serde_json::Value;
use steadymesh::bus::Bus;
use steadymesh::compute::ComputePool;
use steadymesh::config::Config;
use steadymesh::server::Server;
use steadymesh::storage::Recordings;
use steadymesh::streams::Registry;
use steadymesh::telemetry::Telemetry;
use steadymesh::webhooks::Webhooks;
use steadymesh_proto::{DeliveredFrame, FrameMetrics, NATIVE_CONTENT_TYPE, NativeFrame};
use steadymesh_synthetic_rig::{Options, Rig};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};
use tokio_util::sync::CancellationToken;

/// A running server on ports of its own.
pub struct TestServer {
    pub server: Server,
    pub client: Client,
    pub webhooks: Webhooks,
}

pub async fn start() -> TestServer {
    start_with(|_| {}).await
}

/// Starts a server whose configuration differs from the default.
pub async fn start_with(change: impl FnOnce(&mut Config)) -> TestServer {
    start_on(None, change).await
}

/// Starts one whose frames go over a bus, where there is one.
pub async fn start_on(bus: Option<Bus>, change: impl FnOnce(&mut Config)) -> TestServer {
    let anywhere: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let mut config = Config {
        listen: anywhere,
        internal_listen: anywhere,
        ..Config::default()
    };
    steadymesh::tls::set_up();
    config.streams.defaults.target_faces = Some(400);
    change(&mut config);
    config.check().unwrap();
    let pool = Arc::new(ComputePool::new(config.compute()).unwrap());
    let telemetry = Arc::new(Telemetry::new().unwrap());
    let recordings = config
        .recordings()
        .map(|options| Arc::new(Recordings::open(options, Arc::clone(&telemetry)).unwrap()));
    let registry = Registry::new(
        config.streams(),
        Arc::clone(&pool),
        Arc::clone(&telemetry),
        recordings,
        bus.clone(),
    )
    .unwrap();
    registry.follow_bus(CancellationToken::new()).await.unwrap();
    let webhooks =
        Webhooks::start(&config.webhooks, registry.listen(), Arc::clone(&telemetry)).unwrap();
    let server = Server::start(config.server(), registry, pool, telemetry, bus)
        .await
        .unwrap();
    TestServer {
        server,
        client: Client::new(),
        webhooks,
    }
}

impl TestServer {
    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.server.address().unwrap())
    }

    pub async fn get(&self, path: &str) -> Response {
        self.client.get(self.url(path)).send().await.unwrap()
    }

    pub async fn json(&self, path: &str) -> Value {
        self.get(path).await.json().await.unwrap()
    }

    pub async fn internal(&self, path: &str) -> Response {
        let url = format!("http://{}{path}", self.server.internal_address());
        self.client.get(url).send().await.unwrap()
    }

    /// A request that posts a native frame.
    pub fn post(&self, stream: &str, body: Vec<u8>) -> RequestBuilder {
        self.client
            .post(self.url(&format!("/v1/streams/{stream}/frames")))
            .header("content-type", NATIVE_CONTENT_TYPE)
            .body(body)
    }

    /// Posts a frame and waits until it is out.
    pub async fn publish(&self, stream: &str, body: Vec<u8>) -> FrameMetrics {
        let response = self
            .post(stream, body)
            .header("prefer", "wait")
            .send()
            .await
            .unwrap();
        assert_eq!(response.status(), StatusCode::OK);
        response.json().await.unwrap()
    }

    pub async fn subscribe(&self, stream: &str) -> Player {
        let url = self
            .url(&format!("/v1/streams/{stream}/subscribe"))
            .replacen("http", "ws", 1);
        let (socket, _) = tokio_tungstenite::connect_async(url).await.unwrap();
        Player { socket }
    }

    /// Plays a recording that is at `path`.
    pub async fn play(&self, path: &str) -> Player {
        let url = self.url(path).replacen("http", "ws", 1);
        let (socket, _) = tokio_tungstenite::connect_async(url).await.unwrap();
        Player { socket }
    }
}

/// A player that reads message by message.
pub struct Player {
    pub socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
}

impl Player {
    pub async fn message(&mut self) -> Message {
        loop {
            match self.socket.next().await.unwrap().unwrap() {
                Message::Ping(_) | Message::Pong(_) => {}
                message => return message,
            }
        }
    }

    pub async fn control(&mut self) -> Value {
        match self.message().await {
            Message::Text(text) => serde_json::from_str(&text).unwrap(),
            other => panic!("a text message was expected, not {other:?}"),
        }
    }

    /// The next frame's metrics and Draco bytes.
    pub async fn frame(&mut self) -> (FrameMetrics, Vec<u8>) {
        match self.message().await {
            Message::Binary(bytes) => {
                let frame = DeliveredFrame::decode(&bytes).unwrap();
                (frame.metrics, frame.mesh.to_vec())
            }
            other => panic!("a frame was expected, not {other:?}"),
        }
    }
}

/// Native frames of a small figure in motion.
pub fn frames(count: u64) -> Vec<Vec<u8>> {
    frames_of(1000, count)
}

/// Native frames of a figure with about so many vertices.
pub fn frames_of(vertex_count: usize, count: u64) -> Vec<Vec<u8>> {
    let rig = Rig::new(&Options {
        vertex_count,
        ..Options::default()
    })
    .unwrap();
    let encode = |index| {
        let frame = rig.frame(index);
        let native = NativeFrame {
            positions: frame.positions,
            faces: frame.faces,
            ..NativeFrame::default()
        };
        native.encode()
    };
    (0..count).map(encode).collect()
}

/// The problem document of an answer.
pub async fn problem(response: Response) -> Value {
    let content_type = response.headers()["content-type"]
        .to_str()
        .unwrap()
        .to_owned();
    assert_eq!(content_type, "application/problem+json");
    let status = response.status().as_u16();
    let problem: Value = response.json().await.unwrap();
    assert_eq!(problem["status"], status);
    problem
}
