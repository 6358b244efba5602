//! Frames in.

use reqwest::StatusCode;
use serde_json::json;
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::{Quality, Tracking};
use steadymesh_proto::stream::Accepted;

use crate::support::{frames, frames_of, problem, start, start_with};

#[tokio::test]
async fn a_frame_that_is_waited_for_comes_back_as_its_metrics() {
    let server = start().await;
    let frames = frames(2);
    let first = server.publish("demo", frames[0].clone()).await;
    assert_eq!(
        (first.seq, first.tracking, first.reference_seq),
        (0, Tracking::Off, None)
    );
    let second = server.publish("demo", frames[1].clone()).await;
    assert_eq!(
        (second.seq, second.tracking, second.reference_seq),
        (1, Tracking::Robust, Some(0))
    );
    assert_eq!(second.output.faces, 400);
    assert!(second.surface_distance.unwrap().previous.is_some());
    assert!(0 < second.latency_us);
}

#[tokio::test]
async fn frames_that_are_not_waited_for_come_out_in_order() {
    let server = start_with(|config| config.streams.queue_depth = 20).await;
    let mut player = None;
    for (index, body) in frames(12).into_iter().enumerate() {
        let response = server.post("demo", body).send().await.unwrap();
        assert_eq!(response.status(), StatusCode::ACCEPTED);
        let accepted: Accepted = response.json().await.unwrap();
        assert_eq!(accepted.seq, index as u64);
        assert!(0 < accepted.queued);
        if player.is_none() {
            player = Some(server.subscribe("demo").await);
        }
    }
    let mut player = player.unwrap();
    player.control().await;
    let mut next = player.frame().await.0.seq;
    while next < 11 {
        let seq = player.frame().await.0.seq;
        assert_eq!(seq, next + 1);
        next = seq;
    }
}

#[tokio::test]
async fn every_format_is_known_by_its_type_and_by_its_first_bytes() {
    let server = start().await;
    let rig = frames(1).remove(0);
    let mesh = steadymesh_mesh_io::native::read(
        &rig,
        &steadymesh_mesh_io::Limits {
            max_vertices: 10_000,
            max_faces: 10_000,
            max_memory_bytes: 1 << 24,
        },
    )
    .unwrap();
    for (content_type, body) in [
        ("model/obj", steadymesh_mesh_io::obj::write(&mesh)),
        ("application/x-ply", steadymesh_mesh_io::ply::write(&mesh)),
        (
            "model/gltf-binary",
            steadymesh_mesh_io::glb::write(&mesh, None),
        ),
        ("application/vnd.steadymesh.frame", rig),
    ] {
        for named in [content_type, "application/octet-stream"] {
            let response = server
                .client
                .post(server.url("/v1/streams/formats/frames"))
                .header("content-type", named)
                .header("prefer", "wait")
                .body(body.clone())
                .send()
                .await
                .unwrap();
            assert_eq!(
                response.status(),
                StatusCode::OK,
                "{content_type} as {named}"
            );
        }
    }
}

#[tokio::test]
async fn a_rig_numbers_its_frames_by_query_or_envelope() {
    let server = start().await;
    let mut bodies = frames(3);
    let url = server.url("/v1/streams/demo/frames?seq=40&capture_time_us=123");
    let response = server
        .client
        .post(&url)
        .body(bodies.remove(0))
        .send()
        .await
        .unwrap();
    assert_eq!(response.json::<Accepted>().await.unwrap().seq, 40);
    let frame = steadymesh_proto::NativeFrame {
        seq: Some(44),
        capture_time_us: Some(456),
        ..steadymesh_proto::NativeFrame::decode(&bodies.remove(0)).unwrap()
    };
    let metrics = server.publish("demo", frame.encode()).await;
    assert_eq!((metrics.seq, metrics.capture_time_us), (44, Some(456)));
    assert_eq!(metrics.reference_seq, Some(40));
    let metrics = server.publish("demo", bodies.remove(0)).await;
    assert_eq!((metrics.seq, metrics.capture_time_us), (45, None));
}

#[tokio::test]
async fn a_number_that_comes_again_does_nothing_and_one_that_goes_back_is_refused() {
    let server = start().await;
    let body = frames(1).remove(0);
    let url = |seq| server.url(&format!("/v1/streams/demo/frames?seq={seq}"));
    let post = |seq| server.client.post(url(seq)).body(body.clone()).send();
    post(7).await.unwrap();
    let again = post(7).await.unwrap();
    assert_eq!(again.status(), StatusCode::ACCEPTED);
    assert!(again.json::<Accepted>().await.unwrap().duplicate);
    let back = post(6).await.unwrap();
    assert_eq!(back.status(), StatusCode::CONFLICT);
    let detail = problem(back).await["detail"].to_string();
    assert!(detail.contains("frame 7"), "{detail}");
    let stream = server.json("/v1/streams/demo").await;
    assert_eq!(stream["counters"]["received"], 1);
}

#[tokio::test]
async fn a_number_that_not_every_player_can_count_to_is_refused() {
    let server = start().await;
    let body = frames(1).remove(0);
    let url = server.url("/v1/streams/demo/frames?seq=18446744073709551615");
    let response = server
        .client
        .post(url)
        .body(body.clone())
        .send()
        .await
        .unwrap();
    assert_eq!(response.status(), StatusCode::BAD_REQUEST);
    let url = server.url("/v1/streams/demo/frames?seq=9007199254740991");
    let last = server
        .client
        .post(url)
        .body(body.clone())
        .send()
        .await
        .unwrap();
    assert_eq!(last.status(), StatusCode::ACCEPTED);
    // There is nowhere to go from there, and nothing breaks.
    let response = server.post("demo", body).send().await.unwrap();
    assert!(response.status().is_client_error() || response.status().is_success());
}

#[tokio::test]
async fn a_full_queue_answers_429_and_loses_nothing() {
    let server = start_with(|config| {
        config.streams.queue_depth = 1;
        config.compute.threads = 1;
    })
    .await;
    let bodies = frames_of(8000, 10);
    let mut accepted = 0;
    let mut refused = None;
    for body in bodies {
        let response = server.post("demo", body).send().await.unwrap();
        match response.status() {
            StatusCode::ACCEPTED => accepted += 1,
            _ => refused = Some(response),
        }
    }
    let refused = refused.expect("ten frames at once are more than a queue of one takes");
    assert_eq!(refused.status(), StatusCode::TOO_MANY_REQUESTS);
    assert_eq!(refused.headers()["retry-after"], "1");
    problem(refused).await;
    let last = loop {
        let stream = server.json("/v1/streams/demo").await;
        if stream["queued"] == 0 {
            break stream;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    };
    assert_eq!(last["counters"]["published"], json!(accepted));
    assert_eq!(last["counters"]["dropped"], 0);
}

#[tokio::test]
async fn a_live_stream_drops_the_oldest_waiting_frame_and_counts_it() {
    let server = start_with(|config| {
        config.streams.queue_depth = 1;
        config.compute.threads = 1;
        config.streams.defaults.overload = Some(steadymesh_proto::stream::Overload::Live);
    })
    .await;
    for (seq, body) in frames_of(20_000, 8).into_iter().enumerate() {
        // The answer comes when the frame has been read, so that the queue is what drops.
        let url = server.url(&format!("/v1/streams/demo/frames?seq={seq}"));
        let response = server.client.post(url).body(body).send().await.unwrap();
        assert_eq!(response.status(), StatusCode::ACCEPTED);
    }
    let last = server
        .client
        .post(server.url("/v1/streams/demo/frames?seq=7"));
    let last = last
        .header("prefer", "wait")
        .body(frames(1).remove(0))
        .send()
        .await
        .unwrap();
    assert_eq!(last.status(), StatusCode::OK, "the newest frame comes out");
    let stream = server.json("/v1/streams/demo").await;
    let dropped = stream["counters"]["dropped"].as_u64().unwrap();
    let published = stream["counters"]["published"].as_u64().unwrap();
    assert!(0 < dropped, "{stream}");
    assert_eq!(dropped + published, 8);
    let text = server.internal("/metrics").await.text().await.unwrap();
    let series =
        format!("steadymesh_frames_dropped_total{{reason=\"overload\",stream=\"demo\"}} {dropped}");
    assert!(text.contains(&series), "{text}");
}

#[tokio::test]
async fn a_live_stream_does_less_for_each_frame_before_it_drops_one() {
    let server = start_with(|config| {
        config.streams.queue_depth = 4;
        config.compute.threads = 1;
        let defaults = &mut config.streams.defaults;
        defaults.overload = Some(steadymesh_proto::stream::Overload::Live);
        defaults.tracking = Some(Tracking::Paper);
    })
    .await;
    for (seq, body) in frames_of(8000, 12).into_iter().enumerate() {
        let url = server.url(&format!("/v1/streams/demo/frames?seq={seq}"));
        let wait = if seq == 11 { "wait" } else { "handling=strict" };
        let request = server.client.post(url).header("prefer", wait).body(body);
        assert!(request.send().await.unwrap().status().is_success());
    }
    let out = server.json("/v1/streams/demo/metrics?last=12").await;
    let out: Vec<FrameMetrics> = serde_json::from_value(out["frames"].clone()).unwrap();
    for metrics in out.iter().filter(|m| m.quality == Quality::Untracked) {
        assert_eq!(metrics.tracking, Tracking::Off);
        assert!(metrics.registration.is_none());
    }
    let qualities: Vec<Quality> = out.iter().map(|metrics| metrics.quality).collect();
    assert_eq!(qualities[0], Quality::Full);
    let in_order = qualities.is_sorted();
    assert!(
        in_order && qualities.ends_with(&[Quality::Untracked]),
        "{qualities:?}"
    );
    let text = server.internal("/metrics").await.text().await.unwrap();
    let count = qualities
        .iter()
        .filter(|&&q| q == Quality::Untracked)
        .count();
    let series = format!(
        "steadymesh_frames_by_quality_total{{quality=\"untracked\",stream=\"demo\"}} {count}"
    );
    assert!(text.contains(&series), "{text}");
}

#[tokio::test]
async fn equal_frames_give_equal_bytes_whatever_the_number_of_threads() {
    let bodies = frames(4);
    let mut results = Vec::new();
    for threads in [1, 4] {
        let server = start_with(|config| config.compute.threads = threads).await;
        for body in &bodies {
            server.post("demo", body.clone()).send().await.unwrap();
        }
        let mut draco = Vec::new();
        for seq in 0..4 {
            let url = server.url(&format!("/v1/streams/demo/frames?seq={seq}"));
            // A frame that is in already is waited for like any other.
            if seq == 3 {
                let wait = server.client.post(url).header("prefer", "wait");
                wait.body(bodies[3].clone()).send().await.unwrap();
            }
        }
        for seq in 0..4 {
            let path = format!("/v1/streams/demo/frames/{seq}.drc");
            draco.push(server.get(&path).await.bytes().await.unwrap());
        }
        results.push(draco);
    }
    assert_eq!(results[0], results[1]);
}

#[tokio::test]
async fn a_publisher_that_hangs_up_leaves_the_stream_as_it_was() {
    use tokio::io::AsyncWriteExt;
    let server = start().await;
    let body = frames(1).remove(0);
    let mut socket = tokio::net::TcpStream::connect(server.server.address().unwrap())
        .await
        .unwrap();
    let head = format!(
        "POST /v1/streams/demo/frames HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n",
        body.len()
    );
    socket.write_all(head.as_bytes()).await.unwrap();
    socket.write_all(&body[..body.len() / 2]).await.unwrap();
    drop(socket);
    let metrics = server.publish("demo", body).await;
    assert_eq!(metrics.seq, 0);
}

#[tokio::test]
async fn a_rig_whose_body_stalls_holds_no_place() {
    use tokio::io::AsyncWriteExt;
    let server = start_with(|config| config.streams.queue_depth = 1).await;
    let mut stalled = tokio::net::TcpStream::connect(server.server.address().unwrap())
        .await
        .unwrap();
    let head =
        "POST /v1/streams/demo/frames HTTP/1.1\r\nHost: localhost\r\nContent-Length: 900\r\n\r\nx";
    stalled.write_all(head.as_bytes()).await.unwrap();
    server.publish("demo", frames(1).remove(0)).await;
}

#[tokio::test]
async fn a_frame_of_another_size_altogether_is_simplified_without_tracking() {
    let server = start().await;
    let body = frames(1).remove(0);
    server.publish("demo", body.clone()).await;
    let mut frame = steadymesh_proto::NativeFrame::decode(&body).unwrap();
    frame
        .positions
        .iter_mut()
        .flatten()
        .for_each(|coordinate| *coordinate *= 1000.0);
    let metrics = server.publish("demo", frame.encode()).await;
    assert_eq!(
        (metrics.tracking, metrics.output.faces),
        (Tracking::Off, 400)
    );
    let error = metrics.registration_error.unwrap();
    assert!(error.contains("factor of 1000"), "{error}");
    assert_eq!(metrics.reset.unwrap(), "registration failed");
}
