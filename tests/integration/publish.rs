//! Frames in by WebSocket.

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use reqwest::StatusCode;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{Error, Message};

use crate::support::{Player, TestServer, frames, problem, start, start_with};

/// A rig's connection, past its welcome.
struct RigConnection {
    connection: Player,
    welcome: Value,
}

async fn connect(server: &TestServer, query: &str) -> RigConnection {
    try_connect(server, query).await.unwrap()
}

async fn try_connect(server: &TestServer, query: &str) -> Result<RigConnection, StatusCode> {
    let url = server
        .url(&format!("/v1/streams/demo/publish{query}"))
        .replacen("http", "ws", 1);
    match tokio_tungstenite::connect_async(url).await {
        Ok((socket, _)) => {
            let mut connection = Player { socket };
            let welcome = connection.control().await;
            Ok(RigConnection {
                connection,
                welcome,
            })
        }
        Err(Error::Http(response)) => {
            Err(StatusCode::from_u16(response.status().as_u16()).unwrap())
        }
        Err(error) => panic!("{error}"),
    }
}

impl RigConnection {
    async fn send(&mut self, body: Vec<u8>) {
        self.connection
            .socket
            .send(Message::Binary(body.into()))
            .await
            .unwrap();
    }

    async fn say(&mut self, message: Value) {
        let text = message.to_string();
        self.connection
            .socket
            .send(Message::Text(text.into()))
            .await
            .unwrap();
    }

    /// The next acknowledgement; grants of credit are passed over.
    async fn ack(&mut self) -> Value {
        loop {
            let message = self.connection.control().await;
            if message["type"] == "ack" {
                return message;
            }
            assert_eq!(message["type"], "credit");
        }
    }

    async fn close_code(&mut self) -> CloseCode {
        loop {
            match self.connection.socket.next().await {
                Some(Ok(Message::Close(Some(close)))) => return close.code,
                Some(Ok(_)) => {}
                other => panic!("a close frame was expected, not {other:?}"),
            }
        }
    }
}

#[tokio::test]
async fn every_frame_is_acknowledged_when_it_is_in_and_when_it_is_out() {
    let server = start().await;
    let mut rig = connect(&server, "").await;
    assert_eq!(rig.welcome["type"], "welcome");
    assert_eq!(rig.welcome["protocol"], "steadymesh.v1");
    assert_eq!(rig.welcome["latest_seq"], json!(null));
    assert_eq!(rig.welcome["credit"], 4);
    for (message, body) in frames(3).into_iter().enumerate() {
        rig.send(body).await;
        let accepted =
            json!({"type": "ack", "message": message, "state": "accepted", "seq": message});
        assert_eq!(rig.ack().await, accepted);
        let published =
            json!({"type": "ack", "message": message, "state": "published", "seq": message});
        assert_eq!(rig.ack().await, published);
    }
    let latest = server.json("/v1/streams/demo/frames/latest/metrics").await;
    assert_eq!(
        (&latest["seq"], &latest["reference_seq"]),
        (&json!(2), &json!(1))
    );
}

#[tokio::test]
async fn a_rig_that_waits_for_credit_is_never_refused() {
    let server = start_with(|config| config.streams.queue_depth = 2).await;
    let mut rig = connect(&server, "").await;
    let mut credit = rig.welcome["credit"].as_u64().unwrap();
    let (mut sent, mut published) = (0, 0);
    let bodies = frames(12);
    while published < 12 {
        while sent < credit && sent < 12 {
            rig.send(bodies[sent as usize].clone()).await;
            sent += 1;
        }
        let message = rig.connection.control().await;
        if message["type"] == "credit" {
            assert!(credit < message["credit"].as_u64().unwrap());
            credit = message["credit"].as_u64().unwrap();
        } else {
            assert_ne!(message["state"], "rejected", "{message}");
            assert_ne!(message["state"], "dropped", "{message}");
            published += u64::from(message["state"] == "published");
        }
    }
}

#[tokio::test]
async fn a_rig_that_does_not_wait_for_credit_is_told_so_and_goes_on() {
    let server = start_with(|config| {
        config.streams.queue_depth = 1;
        config.compute.threads = 1;
    })
    .await;
    let mut rig = connect(&server, "").await;
    for body in crate::support::frames_of(8000, 6) {
        rig.send(body).await;
    }
    let mut refused = 0;
    let mut last = json!(null);
    for _ in 0..6 {
        let ack = rig.ack().await;
        if ack["state"] == "rejected" {
            assert_eq!(ack["problem"]["status"], 429);
            refused += 1;
        }
        last = ack;
    }
    assert!(0 < refused, "{last}");
    while last["state"] != "published" {
        last = rig.ack().await;
    }
}

#[tokio::test]
async fn a_frame_that_is_no_mesh_is_rejected_and_the_next_one_works() {
    let server = start().await;
    let mut rig = connect(&server, "").await;
    rig.send(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n".to_vec())
        .await;
    let ack = rig.ack().await;
    assert_eq!(ack["state"], "rejected");
    assert_eq!(ack["problem"]["status"], 422);
    rig.send(frames(1).remove(0)).await;
    assert_eq!(rig.ack().await["state"], "accepted");
    assert_eq!(
        server.json("/v1/streams/demo").await["counters"]["rejected"],
        1
    );
}

#[tokio::test]
async fn a_text_message_numbers_the_frame_after_it() {
    let server = start().await;
    let mut rig = connect(&server, "").await;
    rig.say(json!({"type": "frame", "seq": 40, "capture_time_us": 123}))
        .await;
    rig.send(frames(2).remove(0)).await;
    assert_eq!(rig.ack().await["seq"], 40);
    rig.send(frames(2).remove(1)).await;
    let mut states = Vec::new();
    for _ in 0..3 {
        let ack = rig.ack().await;
        states.push((ack["state"].clone(), ack["seq"].clone()));
    }
    assert!(
        states.contains(&(json!("accepted"), json!(41))),
        "{states:?}"
    );
    let metrics = server.json("/v1/streams/demo/frames/40/metrics").await;
    assert_eq!(metrics["capture_time_us"], 123);
    rig.say(json!({"type": "frame", "seqq": 40})).await;
    let ack = rig.ack().await;
    assert_eq!(ack["message"], 2);
    assert!(
        ack["problem"]["detail"].as_str().unwrap().contains("seqq"),
        "{ack}"
    );
    // The frame that it was about is not taken, and not answered twice; the next one is.
    rig.send(frames(1).remove(0)).await;
    rig.send(frames(1).remove(0)).await;
    let ack = rig.ack().await;
    assert_eq!(
        (&ack["message"], &ack["state"]),
        (&json!(3), &json!("accepted"))
    );
}

#[tokio::test]
async fn a_second_publisher_is_refused_until_it_takes_over() {
    let server = start().await;
    let mut first = connect(&server, "").await;
    assert_eq!(
        try_connect(&server, "").await.err(),
        Some(StatusCode::CONFLICT)
    );
    let body = frames(1).remove(0);
    let post = server.post("demo", body.clone()).send().await.unwrap();
    assert_eq!(post.status(), StatusCode::CONFLICT);
    assert!(
        problem(post).await["detail"]
            .to_string()
            .contains("takeover")
    );

    let mut second = connect(&server, "?takeover=true").await;
    assert_eq!(first.close_code().await, CloseCode::from(4409));
    second.send(body.clone()).await;
    assert_eq!(second.ack().await["state"], "accepted");

    let url = server.url("/v1/streams/demo/frames?takeover=true");
    let post = server.client.post(url).body(body).send().await.unwrap();
    assert_eq!(post.status(), StatusCode::ACCEPTED);
    assert_eq!(second.close_code().await, CloseCode::from(4409));
}

#[tokio::test]
async fn a_publisher_that_vanished_comes_back_to_its_place_and_players_see_a_gap_only() {
    let server = start().await;
    let bodies = frames(2);
    let mut rig = connect(&server, "").await;
    rig.send(bodies[0].clone()).await;
    rig.ack().await;
    rig.ack().await;
    let mut player = server.subscribe("demo").await;
    player.control().await;
    assert_eq!(player.frame().await.0.seq, 0);
    let session = rig.welcome["session"].as_str().unwrap().to_owned();
    // Without a farewell.
    drop(rig);
    assert_eq!(
        try_connect(&server, "").await.err(),
        Some(StatusCode::CONFLICT)
    );
    let mut rig = connect(&server, &format!("?session={session}")).await;
    assert_eq!(rig.welcome["latest_seq"], 0);
    rig.send(bodies[1].clone()).await;
    let (metrics, _) = player.frame().await;
    assert_eq!((metrics.seq, metrics.reference_seq), (1, Some(0)));
}

#[tokio::test]
async fn a_place_that_is_not_wanted_back_is_free_after_a_while_or_at_once() {
    let server = start_with(|config| config.streams.linger_secs = 0).await;
    drop(connect(&server, "").await);
    let mut tries = 0;
    let mut rig = loop {
        match try_connect(&server, "").await {
            Ok(rig) => break rig,
            // The server may not have noticed yet.
            Err(status) => assert_eq!(status, StatusCode::CONFLICT),
        }
        tries += 1;
        assert!(tries < 200, "the place is never given up");
        tokio::time::sleep(Duration::from_millis(10)).await;
    };
    rig.connection.socket.close(None).await.unwrap();
    while rig.connection.socket.next().await.is_some() {}
    connect(&server, "").await;
}

#[tokio::test]
async fn a_message_over_the_limit_ends_the_connection_with_its_code() {
    let server = start_with(|config| config.limits.body_bytes = 10_000).await;
    let mut rig = connect(&server, "").await;
    rig.connection
        .socket
        .send(Message::Binary(vec![0; 20_000].into()))
        .await
        .ok();
    assert_eq!(rig.close_code().await, CloseCode::Size);
}

/// A request that takes all the memory there is for frames, for as long as it stays half.
async fn take_all_memory(server: &TestServer, bytes: usize) -> tokio::net::TcpStream {
    use tokio::io::AsyncWriteExt;
    let mut half = tokio::net::TcpStream::connect(server.server.address().unwrap())
        .await
        .unwrap();
    let head = format!(
        "POST /v1/streams/other/frames HTTP/1.1\r\nhost: localhost\r\ncontent-length: {bytes}\r\n\r\n"
    );
    half.write_all(head.as_bytes()).await.unwrap();
    // Once a second such request is refused, the first one has the memory.
    while server
        .post("other", vec![0; 2000])
        .send()
        .await
        .unwrap()
        .status()
        != StatusCode::SERVICE_UNAVAILABLE
    {}
    half
}

fn with_little_memory(config: &mut steadymesh::config::Config) {
    config.limits.memory_bytes = 1 << 20;
    config.limits.body_timeout_secs = 2;
}

#[tokio::test]
async fn a_small_frame_for_which_there_is_no_memory_is_rejected_with_the_limits_name() {
    let server = start_with(with_little_memory).await;
    let mut rig = connect(&server, "").await;
    let _half = take_all_memory(&server, 1 << 20).await;
    rig.send(vec![0; 1000]).await;
    let ack = rig.ack().await;
    assert_eq!(ack["problem"]["status"], 503, "{ack}");
    let detail = ack["problem"]["detail"].as_str().unwrap();
    assert!(detail.contains("limits.memory_bytes"), "{ack}");
}

#[tokio::test]
async fn a_large_frame_waits_for_memory_while_it_comes_in() {
    let server = start_with(with_little_memory).await;
    let body = crate::support::frames_of(16_000, 1).remove(0);
    assert!(400_000 < body.len() && body.len() < 1 << 20);
    let mut rig = connect(&server, "").await;
    let half = take_all_memory(&server, 1 << 20).await;
    let sending = async {
        rig.send(body).await;
        rig.ack().await
    };
    tokio::pin!(sending);
    let waiting = tokio::time::timeout(Duration::from_millis(500), &mut sending).await;
    assert!(waiting.is_err(), "{waiting:?}");
    drop(half);
    assert_eq!(sending.await["state"], "accepted");
}

/// A publisher that has sent most of a frame, and goes on holding memory for it.
async fn hold_most_of_a_frame(server: &TestServer) -> tokio::net::TcpStream {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    let mut holder = tokio::net::TcpStream::connect(server.server.address().unwrap())
        .await
        .unwrap();
    let handshake = "GET /v1/streams/other/publish HTTP/1.1\r\nhost: localhost\r\n\
                     upgrade: websocket\r\nconnection: upgrade\r\nsec-websocket-version: 13\r\n\
                     sec-websocket-key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n";
    holder.write_all(handshake.as_bytes()).await.unwrap();
    // What comes before the answer is read as HTTP still, and not counted.
    holder.read_exact(&mut [0; 64]).await.unwrap();
    let mut message = vec![0x82, 0xff];
    message.extend(1_040_000_u64.to_be_bytes());
    // The mask, and the frame but for its end.
    message.resize(message.len() + 4 + 1_000_000, 0);
    holder.write_all(&message).await.unwrap();
    for _ in 0..500 {
        let refused = server.post("third", vec![0; 60_000]).send().await.unwrap();
        if refused.status() == StatusCode::SERVICE_UNAVAILABLE {
            return holder;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("half a frame takes no memory");
}

#[tokio::test]
async fn a_frame_that_finds_no_memory_in_time_or_never_could_ends_the_connection() {
    let server = start_with(with_little_memory).await;
    let mut rig = connect(&server, "").await;
    let _holder = hold_most_of_a_frame(&server).await;
    let body = Message::Binary(vec![0; 900_000].into());
    rig.connection.socket.send(body).await.ok();
    let Some(Ok(Message::Close(Some(close)))) = rig.connection.socket.next().await else {
        panic!("a close frame was expected");
    };
    assert_eq!(close.code, CloseCode::Again);
    assert!(close.reason.contains("limits.memory_bytes"), "{close:?}");

    let server = start_with(|config| {
        config.limits.memory_bytes = 100_000;
        config.limits.body_timeout_secs = 3600;
    })
    .await;
    let mut rig = connect(&server, "").await;
    let body = Message::Binary(vec![0; 2_000_000].into());
    rig.connection.socket.send(body).await.ok();
    assert_eq!(rig.close_code().await, CloseCode::Again);
}

#[tokio::test]
async fn a_publisher_is_told_when_its_stream_is_deleted_and_when_the_server_stops() {
    let server = start().await;
    let mut rig = connect(&server, "").await;
    server
        .client
        .delete(server.url("/v1/streams/demo"))
        .send()
        .await
        .unwrap();
    assert_eq!(rig.close_code().await, CloseCode::Normal);
    let mut rig = connect(&server, "").await;
    let stop = tokio::spawn(server.server.shut_down());
    assert_eq!(rig.close_code().await, CloseCode::Away);
    stop.await.unwrap();
}

#[tokio::test]
async fn a_publisher_that_says_goodbye_is_answered() {
    let server = start().await;
    let mut rig = connect(&server, "").await;
    let goodbye = tokio_tungstenite::tungstenite::protocol::CloseFrame {
        code: CloseCode::Normal,
        reason: "done".into(),
    };
    rig.connection.socket.close(Some(goodbye)).await.unwrap();
    assert_eq!(rig.close_code().await, CloseCode::Normal);
}

#[tokio::test]
async fn a_publisher_that_floods_with_pings_is_sent_away() {
    let server = start().await;
    let mut rig = connect(&server, "").await;
    for _ in 0..500 {
        let ping = Message::Ping(vec![0; 125].into());
        if rig.connection.socket.send(ping).await.is_err() {
            break;
        }
    }
    loop {
        match rig.connection.socket.next().await {
            Some(Ok(Message::Close(Some(close)))) => {
                assert_eq!(close.code, CloseCode::from(4420));
                break;
            }
            Some(Ok(_)) => {}
            // Whoever still sends when the connection ends may see it reset.
            Some(Err(_)) | None => break,
        }
    }
    let post = server
        .post("other", frames(1).remove(0))
        .send()
        .await
        .unwrap();
    assert_eq!(post.status(), StatusCode::ACCEPTED);
}

#[tokio::test]
async fn a_deleted_stream_says_what_became_of_its_frames() {
    let server = start_with(|config| config.compute.threads = 1).await;
    let mut rig = connect(&server, "").await;
    for body in crate::support::frames_of(8000, 3) {
        rig.send(body).await;
    }
    let mut accepted = std::collections::BTreeSet::new();
    while accepted.len() < 3 {
        let ack = rig.ack().await;
        if ack["state"] == "accepted" {
            accepted.insert(ack["message"].as_u64().unwrap());
        }
    }
    server
        .client
        .delete(server.url("/v1/streams/demo"))
        .send()
        .await
        .unwrap();
    let mut open = accepted;
    loop {
        match rig.connection.message().await {
            Message::Text(text) => {
                let message: Value = serde_json::from_str(&text).unwrap();
                if message["state"] == "published" || message["state"] == "dropped" {
                    open.remove(&message["message"].as_u64().unwrap());
                }
            }
            Message::Close(_) => break,
            other => panic!("{other:?} was not expected"),
        }
    }
    assert!(open.len() < 3, "of {open:?} nothing was said");
}
