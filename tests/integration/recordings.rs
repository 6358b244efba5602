//! Streams that are recorded, and recordings that are played.

use std::time::{Duration, Instant};

use futures_util::SinkExt;
use reqwest::StatusCode;
use serde_json::{Value, json};
use steadymesh::config::Config;
use tempfile::TempDir;
use tokio_tungstenite::tungstenite::Message;
use url::Url;

use crate::support::{TestServer, frames, problem, start, start_with};

/// A server that keeps recordings in a folder of its own.
async fn recording_server(folder: &TempDir, change: impl FnOnce(&mut Config)) -> TestServer {
    start_with(|config| {
        config.recordings.url = Some(Url::from_directory_path(folder.path()).unwrap());
        config.recordings.segment_secs = 0.1;
        change(config);
    })
    .await
}

async fn put(server: &TestServer, path: &str, body: Value) -> reqwest::Response {
    let request = server.client.put(server.url(path)).json(&body);
    request.send().await.unwrap()
}

async fn delete(server: &TestServer, path: &str) -> StatusCode {
    let request = server.client.delete(server.url(path));
    request.send().await.unwrap().status()
}

/// Begins to record a stream with a frame; gives the recording's address once it can be read.
async fn begin(server: &TestServer, body: Vec<u8>) -> String {
    put(server, "/v1/streams/rig", json!({"record": "output"})).await;
    server.publish("rig", body).await;
    let status = server.json("/v1/streams/rig").await;
    let id = status["recording"]["id"].as_str().unwrap();
    let path = format!("/v1/recordings/rig/{id}");
    while server.get(&path).await.status() != StatusCode::OK {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    path
}

/// Records so many frames, a tenth of a second apart by their capture time, and ends the stream.
/// Gives the recording's address and the Draco bytes that came out.
async fn record(server: &TestServer, count: u64) -> (String, Vec<Vec<u8>>) {
    put(server, "/v1/streams/rig", json!({"record": "both"})).await;
    let mut meshes = Vec::new();
    for (seq, frame) in frames(count).into_iter().enumerate() {
        let capture_time_us = 1_700_000_000_000_000 + seq as u64 * 100_000;
        let query = format!("seq={seq}&capture_time_us={capture_time_us}");
        let request = server
            .client
            .post(server.url(&format!("/v1/streams/rig/frames?{query}")))
            .header("prefer", "wait")
            .body(frame);
        assert_eq!(request.send().await.unwrap().status(), StatusCode::OK);
        let mesh = server
            .get(&format!("/v1/streams/rig/frames/{seq}.drc"))
            .await;
        meshes.push(mesh.bytes().await.unwrap().to_vec());
    }
    let status = server.json("/v1/streams/rig").await;
    let id = status["recording"]["id"].as_str().unwrap().to_owned();
    assert_eq!(
        delete(server, "/v1/streams/rig").await,
        StatusCode::NO_CONTENT
    );
    let path = format!("/v1/recordings/rig/{id}");
    for _ in 0..100 {
        let answer = server.get(&path).await;
        if answer.status() == StatusCode::OK {
            let recording: Value = answer.json().await.unwrap();
            if recording["state"] == "complete" {
                return (path, meshes);
            }
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("the recording does not end");
}

#[tokio::test]
async fn a_recorded_stream_can_be_listed_and_read_frame_by_frame() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |_| {}).await;
    let (path, meshes) = record(&server, 4).await;
    let list = server.json("/v1/recordings?stream=rig").await;
    let recording = &list["recordings"][0];
    assert_eq!(recording["config"]["record"], "both");
    for track in ["raw", "output"] {
        assert_eq!(recording[track]["frames"], 4, "{recording}");
        assert_eq!(recording[track]["last_time_us"], 1_700_000_000_300_000_u64);
        assert_eq!(recording[track]["gaps"], json!([]));
    }
    assert_eq!(
        server.json("/v1/recordings?stream=other").await["recordings"],
        json!([])
    );

    let listed = server
        .json(&format!("{path}/frames?from_seq=1&limit=2"))
        .await;
    assert_eq!(listed["frames"][0]["seq"], 1);
    assert_eq!(listed["more"], true);
    let by_time = format!("{path}/frames?from_us=1700000000300000");
    assert_eq!(server.json(&by_time).await["frames"][0]["seq"], 3);

    let frame = server.get(&format!("{path}/frames/2.drc")).await;
    assert!(
        frame.headers()["cache-control"]
            .to_str()
            .unwrap()
            .contains("immutable")
    );
    assert_eq!(frame.bytes().await.unwrap(), meshes[2]);
    let metrics = server.json(&format!("{path}/frames/2/metrics")).await;
    assert_eq!(
        (&metrics["seq"], &metrics["reference_seq"]),
        (&json!(2), &json!(1))
    );
    let glb = server.get(&format!("{path}/frames/2.glb")).await;
    assert_eq!(glb.headers()["content-type"], "model/gltf-binary");
    let raw = server.get(&format!("{path}/raw/2")).await;
    assert_eq!(
        raw.headers()["content-type"],
        "application/vnd.steadymesh.frame"
    );
    assert_eq!(raw.bytes().await.unwrap(), frames(3)[2]);

    let missing = server.get(&format!("{path}/frames/9.drc")).await;
    assert_eq!(missing.status(), StatusCode::NOT_FOUND);
    assert!(
        problem(missing).await["detail"]
            .as_str()
            .unwrap()
            .contains("no output frame 9")
    );

    assert_eq!(delete(&server, &path).await, StatusCode::NO_CONTENT);
    assert_eq!(server.get(&path).await.status(), StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn a_recording_is_played_as_a_stream_at_any_speed() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |_| {}).await;
    let (path, meshes) = record(&server, 6).await;
    for (speed, least, most) in [(1.0, 450, 2000), (5.0, 90, 450), (0.0, 0, 400)] {
        let began = Instant::now();
        let mut player = server.play(&format!("{path}/play?speed={speed}")).await;
        let hello = player.control().await;
        assert_eq!(
            (&hello["type"], &hello["latest_seq"]),
            (&json!("hello"), &json!(5))
        );
        for mesh in &meshes {
            assert_eq!(&player.frame().await.1, mesh);
        }
        let end = player.control().await;
        assert_eq!(end, json!({"type": "end", "reason": "finished"}));
        let took = began.elapsed().as_millis();
        assert!((least..most).contains(&took), "speed {speed}: {took} ms");
    }
}

#[tokio::test]
async fn a_player_pauses_seeks_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |_| {}).await;
    let (path, _) = record(&server, 6).await;
    let mut player = server.play(&format!("{path}/play?from_seq=2")).await;
    let say = async |player: &mut crate::support::Player, message: Value| {
        let text = Message::Text(message.to_string().into());
        player.socket.send(text).await.unwrap();
    };
    player.control().await;
    assert_eq!(player.frame().await.0.seq, 2);
    say(&mut player, json!({"type": "pause"})).await;
    say(
        &mut player,
        json!({"type": "seek", "time_us": 1_700_000_000_400_000_u64}),
    )
    .await;
    let shown = player.frame().await.0.seq;
    // Frame 3 may have been on its way already.
    let shown = if shown == 3 {
        player.frame().await.0.seq
    } else {
        shown
    };
    assert_eq!(shown, 4);
    let waited = tokio::time::timeout(Duration::from_millis(400), player.message()).await;
    assert!(waited.is_err(), "it is paused: {waited:?}");
    say(&mut player, json!({"type": "seek", "seq": 1})).await;
    assert_eq!(player.frame().await.0.seq, 1);
    say(&mut player, json!({"type": "speed", "speed": 0})).await;
    say(&mut player, json!({"type": "resume"})).await;
    for seq in 2..6 {
        assert_eq!(player.frame().await.0.seq, seq);
    }
    assert_eq!(player.control().await["reason"], "finished");
}

#[tokio::test]
async fn a_recording_that_goes_on_is_played_as_it_grows() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |_| {}).await;
    let mut bodies = frames(3).into_iter();
    let path = begin(&server, bodies.next().unwrap()).await;
    let mut player = server.play(&format!("{path}/play?speed=0")).await;
    player.control().await;
    assert_eq!(player.frame().await.0.seq, 0);
    for body in bodies {
        server.publish("rig", body).await;
    }
    assert_eq!(player.frame().await.0.seq, 1);
    assert_eq!(player.frame().await.0.seq, 2);
    let refused = server
        .client
        .delete(server.url(&path))
        .send()
        .await
        .unwrap();
    assert_eq!(refused.status(), StatusCode::CONFLICT);
    assert_eq!(
        delete(&server, "/v1/streams/rig/recording").await,
        StatusCode::NO_CONTENT
    );
    assert_eq!(player.control().await["reason"], "finished");
    // The stream itself goes on.
    assert_eq!(
        server.json("/v1/streams/rig").await["config"]["record"],
        "off"
    );
}

#[tokio::test]
async fn frames_that_the_stream_has_forgotten_come_from_its_recording() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |config| config.streams.history = 2).await;
    put(&server, "/v1/streams/rig", json!({"record": "output"})).await;
    for body in frames(5) {
        server.publish("rig", body).await;
    }
    tokio::time::sleep(Duration::from_millis(500)).await;
    for seq in 0..5 {
        let frame = server
            .get(&format!("/v1/streams/rig/frames/{seq}.drc"))
            .await;
        assert_eq!(frame.status(), StatusCode::OK, "frame {seq}");
    }
    let metrics = server.json("/v1/streams/rig/frames/0/metrics").await;
    assert_eq!(metrics["seq"], 0);
    let missing = server.get("/v1/streams/rig/frames/9.drc").await;
    assert_eq!(missing.status(), StatusCode::NOT_FOUND);
    let text = server.internal("/metrics").await.text().await.unwrap();
    let expected = "steadymesh_recording_frames_total{stream=\"rig\",track=\"output\"} 5";
    assert!(text.contains(expected), "{text}");
}

#[tokio::test]
async fn a_server_without_a_place_for_recordings_says_so() {
    let server = start().await;
    let refused = put(&server, "/v1/streams/rig", json!({"record": "raw"})).await;
    assert_eq!(refused.status(), StatusCode::BAD_REQUEST);
    let detail = problem(refused).await["detail"].to_string();
    assert!(
        detail.contains("record is raw") && detail.contains("recordings.url"),
        "{detail}"
    );
    let refused = server.get("/v1/recordings").await;
    assert_eq!(refused.status(), StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn wrong_wishes_of_players_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |config| config.limits.playbacks = 1).await;
    let (path, _) = record(&server, 2).await;
    for (query, word) in [
        ("speed=-1", "speed is -1"),
        ("speed=NaN", "speed is NaN"),
        ("speed=1e-300", "from 0.01 to 100"),
        ("from_seq=1&from_us=2", "from_seq and from_us"),
        ("from=1", "from"),
        ("", "WebSocket"),
    ] {
        let refused = server.get(&format!("{path}/play?{query}")).await;
        assert_eq!(refused.status(), StatusCode::BAD_REQUEST, "{query}");
        let detail = problem(refused).await["detail"].to_string();
        assert!(detail.contains(word), "{query}: {detail}");
    }
    for id in ["latest", "20261129T215703Z-3f9a", "..%2f..%2fetc"] {
        let missing = server.get(&format!("/v1/recordings/rig/{id}/play")).await;
        assert_eq!(missing.status(), StatusCode::NOT_FOUND, "{id}");
    }
    let mut first = server.play(&format!("{path}/play?speed=0.01")).await;
    first.control().await;
    let url = server
        .url(&format!("{path}/play"))
        .replacen("http", "ws", 1);
    assert!(tokio_tungstenite::connect_async(url).await.is_err());
    let nonsense = Message::Text("{\"type\":\"rewind\"}".into());
    first.socket.send(nonsense).await.unwrap();
    loop {
        if let Message::Close(Some(close)) = first.message().await {
            assert_eq!(u16::from(close.code), 1008);
            break;
        }
    }
}

#[tokio::test]
async fn a_player_at_the_end_that_is_paused_can_still_go_back() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |_| {}).await;
    let (path, _) = record(&server, 3).await;
    let mut player = server
        .play(&format!("{path}/play?from_seq=1&speed=0.01"))
        .await;
    player.control().await;
    assert_eq!(player.frame().await.0.seq, 1);
    let say = async |player: &mut crate::support::Player, message: Value| {
        let text = Message::Text(message.to_string().into());
        player.socket.send(text).await.unwrap();
    };
    say(&mut player, json!({"type": "pause"})).await;
    for seq in [2, 9, 0] {
        say(&mut player, json!({"type": "seek", "seq": seq})).await;
        if seq < 3 {
            assert_eq!(player.frame().await.0.seq, seq);
        }
    }
    say(&mut player, json!({"type": "seek", "seq": 9})).await;
    say(&mut player, json!({"type": "resume"})).await;
    assert_eq!(player.control().await["reason"], "finished");
}

#[tokio::test]
async fn a_player_that_waits_for_a_frame_gets_that_one_and_the_servers_farewell() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |_| {}).await;
    let mut bodies = frames(3).into_iter();
    let path = begin(&server, bodies.next().unwrap()).await;
    let mut player = server
        .play(&format!("{path}/play?from_seq=2&speed=0"))
        .await;
    player.control().await;
    for body in bodies {
        server.publish("rig", body).await;
    }
    assert_eq!(player.frame().await.0.seq, 2);
    let stop = tokio::spawn(server.server.shut_down());
    assert_eq!(player.control().await["reason"], "shutdown");
    match player.message().await {
        Message::Close(Some(close)) => assert_eq!(u16::from(close.code), 1001),
        other => panic!("a farewell was expected, not {other:?}"),
    }
    drop(player);
    stop.await.unwrap();
}

#[tokio::test]
async fn other_settings_begin_another_recording() {
    let folder = tempfile::tempdir().unwrap();
    let server = recording_server(&folder, |_| {}).await;
    let mut bodies = frames(2).into_iter();
    for target_faces in [100, 200] {
        let config = json!({"record": "output", "target_faces": target_faces});
        put(&server, "/v1/streams/rig", config.clone()).await;
        // The same settings again change nothing.
        put(&server, "/v1/streams/rig", config).await;
        server.publish("rig", bodies.next().unwrap()).await;
    }
    assert_eq!(
        delete(&server, "/v1/streams/rig/recording").await,
        StatusCode::NO_CONTENT
    );
    let mut recordings = Vec::new();
    for _ in 0..100 {
        let list = server.json("/v1/recordings").await;
        recordings = list["recordings"].as_array().unwrap().clone();
        if recordings
            .iter()
            .filter(|r| r["state"] == "complete")
            .count()
            == 2
        {
            break;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let faces: std::collections::BTreeSet<_> = recordings
        .iter()
        .map(|r| {
            (
                r["config"]["target_faces"].as_u64(),
                r["output"]["frames"].as_u64(),
            )
        })
        .collect();
    assert_eq!(faces, [(Some(100), Some(1)), (Some(200), Some(1))].into());
}
