//! How fast messages leave: by a stream, and by a bare loop that sends the same bytes over the same
//! WebSocket library.
//!
//! All readers connect first and wait. Meanwhile the frames are published, so that no processing
//! takes part; then all of them read at once, and both senders send as fast as they can.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::ws::{Message as AxumMessage, WebSocketUpgrade};
use axum::routing::get;
use axum::serve::ListenerExt;
use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use steadymesh::config::Config;
use steadymesh_proto::NativeFrame;
use tokio::sync::watch;
use tokio_tungstenite::tungstenite::Message;

use super::start_server;

const READERS: usize = 400;

/// Prints both rates and their ratio.
pub async fn compare(frames: &[NativeFrame], count: usize) {
    let server = start_server(|config| {
        // All readers lie behind by all frames before they start.
        config.streams.subscriber_queue = count + 10;
        config.limits.send_timeout_secs = 600;
    })
    .await;
    let address = server.address().unwrap();
    let messages = publish(address, "first", frames, count).await;
    let length = messages.iter().map(Bytes::len).sum::<usize>() / count;
    println!("{READERS} readers, {count} messages of {length} bytes on average");

    let bare = serve_bare(messages).await;
    let readers = Readers::connect(&format!("ws://{bare}/"), count).await;
    let bare = readers.run().await;
    println!("a bare loop sends {bare:.0} messages a second");

    // One frame before the readers come: the one that a newcomer gets at once.
    publish(address, "second", &frames[..1], 1).await;
    let url = format!("ws://{address}/v1/streams/second/subscribe");
    let readers = Readers::connect(&url, count + 1).await;
    publish(address, "second", frames, count).await;
    let stream = readers.run().await;
    println!(
        "a stream sends {stream:.0} messages a second: {:.0} %",
        100.0 * stream / bare
    );
    server.shut_down().await;
}

/// Publishes frames, and gives the messages that players get.
async fn publish(
    address: SocketAddr,
    stream: &str,
    frames: &[NativeFrame],
    count: usize,
) -> Vec<Bytes> {
    let client = reqwest::Client::new();
    let subscribe = format!("ws://{address}/v1/streams/{stream}/subscribe");
    let url = format!("http://{address}/v1/streams/{stream}/frames");
    client
        .put(format!("http://{address}/v1/streams/{stream}"))
        .header("content-type", "application/json")
        .body("{}")
        .send()
        .await
        .unwrap();
    let (mut socket, _) = tokio_tungstenite::connect_async(&subscribe).await.unwrap();
    let mut messages = Vec::new();
    for frame in frames.iter().cycle().take(count) {
        let request = client.post(&url).header("prefer", "wait");
        let answer = request.body(frame.encode()).send().await.unwrap();
        assert_eq!(answer.status(), 200);
    }
    while messages.len() < count {
        if let Message::Binary(bytes) = socket.next().await.unwrap().unwrap() {
            messages.push(bytes);
        }
    }
    messages
}

/// Sends all messages to everybody who connects.
async fn serve_bare(messages: Vec<Bytes>) -> SocketAddr {
    let messages = Arc::new(messages);
    let handler = move |upgrade: WebSocketUpgrade| {
        let messages = Arc::clone(&messages);
        async move {
            upgrade.on_upgrade(move |socket| async move {
                let (mut sink, mut stream) = socket.split();
                for message in messages.iter() {
                    let message = AxumMessage::Binary(message.clone());
                    if sink.send(message).await.is_err() {
                        return;
                    }
                }
                while let Some(Ok(_)) = stream.next().await {}
            })
        }
    };
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    // As the server does: what lies in the system's buffers is not sent any more, only read.
    let buffer = Config::default().limits.send_buffer_bytes;
    let listener = listener.tap_io(move |stream| {
        socket2::SockRef::from(&*stream)
            .set_send_buffer_size(buffer)
            .unwrap();
        stream.set_nodelay(true).unwrap();
    });
    let router = Router::new().route("/", get(handler));
    tokio::spawn(async move { axum::serve(listener, router).await });
    address
}

/// Readers that wait for a sign.
struct Readers {
    go: watch::Sender<bool>,
    tasks: Vec<tokio::task::JoinHandle<usize>>,
}

impl Readers {
    /// Connects readers that will take `count` messages each.
    async fn connect(url: &str, count: usize) -> Self {
        let (go, _) = watch::channel(false);
        let mut tasks = Vec::new();
        for _ in 0..READERS {
            let (mut socket, _) = tokio_tungstenite::connect_async(url).await.unwrap();
            let mut sign = go.subscribe();
            tasks.push(tokio::spawn(async move {
                sign.wait_for(|go| *go).await.unwrap();
                let mut seen = 0;
                while seen < count {
                    let message = socket.next().await.unwrap().unwrap();
                    seen += usize::from(message.is_binary());
                }
                seen
            }));
        }
        // Until both kinds have filled the sockets' buffers.
        tokio::time::sleep(Duration::from_secs(2)).await;
        Self { go, tasks }
    }

    /// Messages a second, over all readers.
    async fn run(self) -> f64 {
        let begun = Instant::now();
        self.go.send(true).unwrap();
        let mut messages = 0;
        for task in self.tasks {
            messages += task.await.unwrap();
        }
        messages as f64 / begun.elapsed().as_secs_f64()
    }
}
