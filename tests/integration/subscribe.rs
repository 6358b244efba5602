//! Frames out.

use std::time::Duration;

use futures_util::SinkExt;
use serde_json::json;
use steadymesh_proto::SUBPROTOCOL;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{Error, Message};

use crate::support::{frames, problem, start, start_with};

#[tokio::test]
async fn a_late_player_gets_a_hello_the_latest_frame_and_then_every_frame() {
    let server = start().await;
    let bodies = frames(4);
    server.publish("demo", bodies[0].clone()).await;
    server.publish("demo", bodies[1].clone()).await;
    let mut player = server.subscribe("demo").await;
    let hello = player.control().await;
    assert_eq!(hello["type"], "hello");
    assert_eq!(hello["protocol"], SUBPROTOCOL);
    assert_eq!(hello["latest_seq"], 1);
    assert_eq!(hello["config"]["target_faces"], 400);
    let (metrics, mesh) = player.frame().await;
    assert_eq!(metrics.seq, 1);
    assert_eq!(metrics.output.bytes, mesh.len());
    let latest = server
        .get("/v1/streams/demo/frames/1.drc")
        .await
        .bytes()
        .await
        .unwrap();
    assert_eq!(mesh, latest);
    for seq in [2, 3] {
        server.publish("demo", bodies[seq].clone()).await;
        assert_eq!(player.frame().await.0.seq, seq as u64);
    }
}

#[tokio::test]
async fn a_player_that_is_there_before_the_first_frame_gets_that_one_too() {
    let server = start().await;
    server
        .client
        .put(server.url("/v1/streams/demo"))
        .body("{}")
        .send()
        .await
        .unwrap();
    let mut player = server.subscribe("demo").await;
    assert_eq!(player.control().await["latest_seq"], json!(null));
    for body in frames(3) {
        server.post("demo", body).send().await.unwrap();
    }
    for seq in 0..3 {
        assert_eq!(player.frame().await.0.seq, seq);
    }
}

#[tokio::test]
async fn a_player_that_is_too_slow_is_taken_to_the_newest_frame_and_told() {
    let server = start_with(|config| {
        config.streams.subscriber_queue = 2;
        config.streams.history = 600;
        config.streams.queue_depth = 700;
        config.streams.defaults.tracking = Some(steadymesh_proto::metrics::Tracking::Off);
        // The operating system buffers megabytes: frames must be many and large to fill them.
        config.streams.defaults.target_faces = Some(200_000);
        config.streams.defaults.metrics = Some(steadymesh_proto::stream::MetricsMode::Off);
        config.streams.defaults.draco.speed = Some(10);
        config.streams.defaults.draco.position_bits = Some(20);
    })
    .await;
    let body = crate::support::frames_of(20_000, 1).remove(0);
    server.publish("demo", body.clone()).await;
    let mut slow = server.subscribe("demo").await;
    slow.control().await;
    slow.frame().await;
    let mut total = 1;
    // Other players and the stream do not feel it.
    let skipped = loop {
        for _ in 0..20 {
            server.publish("demo", body.clone()).await;
            total += 1;
        }
        let text = server.internal("/metrics").await.text().await.unwrap();
        let series = "steadymesh_subscriber_skipped_frames_total{stream=\"demo\"} ";
        let line = text
            .lines()
            .find_map(|line| line.strip_prefix(series))
            .unwrap();
        if 0 < line.parse::<u64>().unwrap() || 400 < total {
            break line.parse::<u64>().unwrap();
        }
        // Read a little, so that the connection is slow rather than stuck.
        slow.message().await;
    };
    assert!(0 < skipped, "{total} frames and nothing was skipped");
    loop {
        if let Message::Text(text) = slow.message().await {
            assert!(text.contains(r#""type":"skipped""#), "{text}");
            break;
        }
    }
}

#[tokio::test]
async fn a_deleted_stream_takes_leave_of_its_players() {
    let server = start().await;
    server.publish("demo", frames(1).remove(0)).await;
    let mut player = server.subscribe("demo").await;
    player.control().await;
    player.frame().await;
    server
        .client
        .delete(server.url("/v1/streams/demo"))
        .send()
        .await
        .unwrap();
    assert_eq!(
        player.control().await,
        json!({"type": "end", "reason": "deleted"})
    );
    let Message::Close(Some(close)) = player.message().await else {
        panic!("a close frame was expected");
    };
    assert_eq!(close.code, CloseCode::Normal);
}

#[tokio::test]
async fn a_stopping_server_lets_accepted_frames_out_and_takes_leave() {
    let server = start().await;
    let bodies = frames(3);
    server.publish("demo", bodies[0].clone()).await;
    let mut player = server.subscribe("demo").await;
    player.control().await;
    player.frame().await;
    for body in &bodies[1..] {
        server.post("demo", body.clone()).send().await.unwrap();
    }
    let stop = tokio::spawn(server.server.shut_down());
    assert_eq!(player.frame().await.0.seq, 1);
    assert_eq!(player.frame().await.0.seq, 2);
    assert_eq!(
        player.control().await,
        json!({"type": "end", "reason": "shutdown"})
    );
    let Message::Close(Some(close)) = player.message().await else {
        panic!("a close frame was expected");
    };
    assert_eq!(close.code, CloseCode::Away);
    tokio::time::timeout(Duration::from_secs(20), stop)
        .await
        .unwrap()
        .unwrap();
}

#[tokio::test]
async fn a_player_may_name_the_subprotocol_and_no_other() {
    let server = start().await;
    server.publish("demo", frames(1).remove(0)).await;
    let url = server
        .url("/v1/streams/demo/subscribe")
        .replacen("http", "ws", 1);
    let connect = |protocol: &'static str| {
        let mut request = url.as_str().into_client_request().unwrap();
        request
            .headers_mut()
            .insert("sec-websocket-protocol", protocol.parse().unwrap());
        tokio_tungstenite::connect_async(request)
    };
    let (_, response) = connect("other, steadymesh.v1").await.unwrap();
    assert_eq!(response.headers()["sec-websocket-protocol"], SUBPROTOCOL);
    let Err(Error::Http(refused)) = connect("steadymesh.v9").await else {
        panic!("another subprotocol must be refused");
    };
    assert_eq!(refused.status(), 400);
}

#[tokio::test]
async fn a_stream_that_is_not_there_is_a_404_before_the_handshake() {
    let server = start().await;
    let response = server.get("/v1/streams/none/subscribe").await;
    assert_eq!(response.status(), 404);
    problem(response).await;
    server.publish("demo", frames(1).remove(0)).await;
    let plain = server.get("/v1/streams/demo/subscribe").await;
    assert_eq!(plain.status(), 400);
    assert!(
        problem(plain).await["detail"]
            .to_string()
            .contains("WebSocket")
    );
}

#[tokio::test]
async fn a_player_that_leaves_is_no_longer_counted() {
    let server = start().await;
    server.publish("demo", frames(1).remove(0)).await;
    let mut player = server.subscribe("demo").await;
    player.control().await;
    assert_eq!(server.json("/v1/streams/demo").await["subscribers"], 1);
    player.socket.send(Message::Close(None)).await.unwrap();
    for _ in 0..200 {
        if server.json("/v1/streams/demo").await["subscribers"] == 0 {
            return;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("the player is still counted");
}
