//! Connections on which nothing happens, and what a client has to say first.

use std::time::{Duration, Instant};

use reqwest::StatusCode;
use steadymesh::config::Config;
use steadymesh_proto::metrics::Tracking;
use steadymesh_proto::stream::MetricsMode;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio::time::timeout;

use crate::support::{TestServer, frames, frames_of, problem, start_with};

const GET_PLY: &str = "GET /v1/streams/demo/frames/latest.ply HTTP/1.1\r\nhost: localhost\r\n\r\n";

/// Frames come out as large as they went in.
fn with_large_frames(config: &mut Config) {
    config.streams.defaults.tracking = Some(Tracking::Off);
    config.streams.defaults.metrics = Some(MetricsMode::Off);
    config.streams.defaults.target_faces = Some(200_000);
}

/// Connects with a small buffer, so that what is not read stays with the server.
async fn connect(server: &TestServer) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.set_recv_buffer_size(8192).unwrap();
    socket
        .connect(server.server.address().unwrap())
        .await
        .unwrap()
}

async fn open_connections(server: &TestServer) -> u64 {
    let text = server.internal("/metrics").await.text().await.unwrap();
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("steadymesh_connections "));
    line.unwrap().parse().unwrap()
}

/// How long the connection lasts without anything coming over it.
async fn time_to_end(connection: &mut TcpStream) -> Duration {
    let begun = Instant::now();
    let mut buffer = [0; 1024];
    let read = timeout(Duration::from_secs(20), connection.read(&mut buffer)).await;
    let read = read.expect("the connection ends");
    assert!(matches!(read, Ok(0) | Err(_)), "{read:?}");
    begun.elapsed()
}

#[tokio::test]
async fn a_client_that_takes_nothing_of_its_answer_is_disconnected() {
    let server = start_with(|config| {
        with_large_frames(config);
        config.limits.send_timeout_secs = 1;
        config.limits.send_buffer_bytes = 8192;
    })
    .await;
    server.publish("demo", frames_of(40_000, 1).remove(0)).await;
    let before = open_connections(&server).await;
    let mut stuck = connect(&server).await;
    stuck.write_all(GET_PLY.as_bytes()).await.unwrap();
    let begun = Instant::now();
    while open_connections(&server).await == before {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    while before < open_connections(&server).await {
        assert!(begun.elapsed() < Duration::from_secs(10), "it is kept");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    assert!(Duration::from_millis(900) < begun.elapsed());
    let mut rest = Vec::new();
    // Whatever was under way, and then the end, or a reset.
    stuck.read_to_end(&mut rest).await.ok();
    assert!(rest.len() < 500_000, "{} bytes", rest.len());
}

#[tokio::test]
async fn a_client_that_reads_slowly_and_steadily_gets_all_of_its_answer() {
    let server = start_with(|config| {
        with_large_frames(config);
        config.limits.send_timeout_secs = 1;
        config.limits.idle_timeout_secs = 1;
        config.limits.send_buffer_bytes = 8192;
    })
    .await;
    server.publish("demo", frames_of(40_000, 1).remove(0)).await;
    let mut slow = connect(&server).await;
    let request = GET_PLY.replace("host:", "connection: close\r\nhost:");
    slow.write_all(request.as_bytes()).await.unwrap();
    let (begun, mut received) = (Instant::now(), Vec::new());
    let mut buffer = vec![0; 1 << 16];
    loop {
        let read = slow.read(&mut buffer).await.unwrap();
        if read == 0 {
            break;
        }
        received.extend_from_slice(&buffer[..read]);
        tokio::time::sleep(Duration::from_secs_f64(read as f64 / 5e5)).await;
    }
    assert!(Duration::from_secs(2) < begun.elapsed(), "it is not slow");
    let head = received.windows(4).position(|w| w == b"\r\n\r\n").unwrap() + 4;
    let text = String::from_utf8_lossy(&received[..head]).into_owned();
    let length = text
        .lines()
        .find_map(|line| line.strip_prefix("content-length: "))
        .unwrap();
    assert_eq!(received.len() - head, length.parse::<usize>().unwrap());
}

#[tokio::test]
async fn a_connection_ends_when_it_is_idle_and_sooner_when_a_head_stays_half() {
    let server = start_with(|config| {
        config.limits.header_timeout_secs = 1;
        config.limits.idle_timeout_secs = 3;
    })
    .await;
    let (one, three) = (Duration::from_millis(900), Duration::from_millis(2900));
    let mut silent = connect(&server).await;
    let mut half = connect(&server).await;
    half.write_all(b"GET / HT").await.unwrap();
    let mut used = connect(&server).await;
    let request = b"GET /v1/streams HTTP/1.1\r\nhost: localhost\r\n\r\n";
    used.write_all(request).await.unwrap();
    let mut answer = [0; 4096];
    assert!(0 < used.read(&mut answer).await.unwrap());
    let (silent, half, used) = tokio::join!(
        time_to_end(&mut silent),
        time_to_end(&mut half),
        time_to_end(&mut used)
    );
    assert!(one < silent && silent < three, "{silent:?}");
    assert!(one < half && half < three, "{half:?}");
    assert!(three < used, "{used:?}");
}

#[tokio::test]
async fn a_request_that_is_on_its_way_is_not_idle_and_neither_is_a_player() {
    let server = start_with(|config| config.limits.idle_timeout_secs = 1).await;
    let body = frames(1).remove(0);
    server.publish("demo", body.clone()).await;
    let mut player = server.subscribe("demo").await;
    player.control().await;
    player.frame().await;
    let mut rig = connect(&server).await;
    let head = format!(
        "POST /v1/streams/demo/frames HTTP/1.1\r\nhost: localhost\r\ncontent-length: {}\r\n\r\n",
        body.len()
    );
    rig.write_all(head.as_bytes()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(2500)).await;
    rig.write_all(&body).await.unwrap();
    let mut status = [0; 12];
    rig.read_exact(&mut status).await.unwrap();
    assert_eq!(&status, b"HTTP/1.1 202");
    assert_eq!(player.frame().await.0.seq, 1);
}

#[tokio::test]
async fn http_2_is_not_spoken() {
    let server = start_with(|_| {}).await;
    let mut client = connect(&server).await;
    for part in [&b"PRI"[..], b" * HTTP/2.0\r\n\r\nSM\r\n\r\n"] {
        client.write_all(part).await.unwrap();
    }
    let ended = time_to_end(&mut client).await;
    assert!(ended < Duration::from_secs(5), "{ended:?}");
}

async fn asked_as(server: &TestServer, host: &str) -> StatusCode {
    let request = server.client.get(server.url("/v1/streams"));
    let response = request.header("host", host).send().await.unwrap();
    if response.status() == StatusCode::MISDIRECTED_REQUEST {
        let detail = problem(response).await["detail"].to_string();
        assert!(
            detail.contains(host) && detail.contains("http.allowed_hosts"),
            "{detail}"
        );
        return StatusCode::MISDIRECTED_REQUEST;
    }
    response.status()
}

#[tokio::test]
async fn an_open_server_on_this_machine_answers_to_its_own_names_only() {
    let server = start_with(|_| {}).await;
    let refused = StatusCode::MISDIRECTED_REQUEST;
    assert_eq!(asked_as(&server, "evil.example").await, refused);
    assert_eq!(asked_as(&server, "192.168.1.9:8080").await, refused);
    assert_eq!(asked_as(&server, "localhost:8080").await, StatusCode::OK);
    let url = server.url("/v1/streams/demo/publish");
    let upgrade = server.client.get(url).header("host", "evil.example");
    assert_eq!(upgrade.send().await.unwrap().status(), refused);
}

#[tokio::test]
async fn a_server_answers_to_the_names_that_are_configured() {
    let listed = vec!["rig.example".to_owned()];
    let server = start_with(|config| config.http.allowed_hosts = listed).await;
    assert_eq!(asked_as(&server, "rig.example").await, StatusCode::OK);
    let refused = StatusCode::MISDIRECTED_REQUEST;
    assert_eq!(asked_as(&server, "evil.example").await, refused);
    let server = start_with(|config| {
        config.listen = "0.0.0.0:0".parse().unwrap();
        config.allow_public_without_tokens = true;
    })
    .await;
    assert_eq!(asked_as(&server, "any.example").await, StatusCode::OK);
}
