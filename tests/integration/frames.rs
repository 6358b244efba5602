//! Single frames and their metrics.

use reqwest::StatusCode;
use serde_json::json;
use steadymesh_mesh_io::{Format, Limits, read};

use crate::support::{frames, problem, start, start_with};

const LIMITS: Limits = Limits {
    max_vertices: 10_000,
    max_faces: 10_000,
    max_memory_bytes: 1 << 26,
};

#[tokio::test]
async fn a_frame_can_be_had_in_every_format() {
    let server = start().await;
    let metrics = server.publish("demo", frames(1).remove(0)).await;
    for (extension, content_type, format) in [
        ("drc", "application/vnd.draco", Format::Drc),
        ("glb", "model/gltf-binary", Format::Glb),
        ("ply", "model/ply", Format::Ply),
    ] {
        for which in ["0", "latest"] {
            let path = format!("/v1/streams/demo/frames/{which}.{extension}");
            let response = server.get(&path).await;
            assert_eq!(response.status(), StatusCode::OK, "{path}");
            assert_eq!(response.headers()["content-type"], content_type);
            let location = format!("/v1/streams/demo/frames/0.{extension}");
            assert_eq!(response.headers()["content-location"], location.as_str());
            let mesh = read(&response.bytes().await.unwrap(), format, &LIMITS).unwrap();
            assert_eq!(mesh.faces.len(), metrics.output.faces);
        }
    }
}

#[tokio::test]
async fn a_frame_that_the_client_has_is_not_sent_again() {
    let server = start().await;
    server.publish("demo", frames(1).remove(0)).await;
    let path = "/v1/streams/demo/frames/latest.drc";
    let first = server.get(path).await;
    assert_eq!(first.headers()["cache-control"], "no-cache");
    let etag = first.headers()["etag"].clone();
    let again = server
        .client
        .get(server.url(path))
        .header("if-none-match", &etag);
    let again = again.send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    assert_eq!(again.headers()["etag"], etag);
    server.publish("demo", frames(2).remove(1)).await;
    let newer = server
        .client
        .get(server.url(path))
        .header("if-none-match", &etag);
    assert_eq!(newer.send().await.unwrap().status(), StatusCode::OK);
}

#[tokio::test]
async fn a_frame_number_of_a_stream_that_began_anew_is_another_frame() {
    let server = start().await;
    let etag = async |body| {
        server.publish("demo", body).await;
        server.get("/v1/streams/demo/frames/0.drc").await.headers()["etag"].clone()
    };
    let before = etag(frames(2).remove(0)).await;
    server
        .client
        .delete(server.url("/v1/streams/demo"))
        .send()
        .await
        .unwrap();
    assert_ne!(etag(frames(2).remove(1)).await, before);
}

#[tokio::test]
async fn metrics_can_be_had_for_one_frame_and_for_the_last() {
    let server = start().await;
    for body in frames(3) {
        server.publish("demo", body).await;
    }
    let one = server.json("/v1/streams/demo/frames/1/metrics").await;
    assert_eq!(one["seq"], 1);
    let latest = server.json("/v1/streams/demo/frames/latest/metrics").await;
    assert_eq!(latest["seq"], 2);
    let last = server.json("/v1/streams/demo/metrics?last=2").await;
    assert_eq!(last["stream"], "demo");
    assert_eq!(last["frames"], json!([one, latest]));
    let all = server.json("/v1/streams/demo/metrics").await;
    assert_eq!(all["frames"].as_array().unwrap().len(), 3);
}

#[tokio::test]
async fn robust_tracking_goes_on_from_the_last_result_however_fast_frames_come() {
    let mut results = Vec::new();
    for waits in [true, false] {
        let server = start().await;
        let url = server.url("/v1/streams/demo");
        let config = json!({"tracking": "robust", "target_faces": 300, "overload": "lossless"});
        let made = server.client.put(url).json(&config).send().await.unwrap();
        assert_eq!(made.status(), StatusCode::CREATED);
        let mut bodies = frames(4);
        let last = bodies.remove(3);
        for body in bodies {
            if waits {
                server.publish("demo", body).await;
            } else {
                let posted = server.post("demo", body).send().await.unwrap();
                assert_eq!(posted.status(), StatusCode::ACCEPTED);
            }
        }
        server.publish("demo", last).await;
        let all = server.json("/v1/streams/demo/metrics").await;
        let modes = ["off", "robust", "robust", "robust"];
        for (metrics, mode) in all["frames"].as_array().unwrap().iter().zip(modes) {
            assert_eq!(metrics["tracking"], mode);
            assert_eq!(metrics["consistency"].is_object(), mode == "robust");
        }
        let drc = server.get("/v1/streams/demo/frames/3.drc").await;
        results.push(drc.bytes().await.unwrap());
    }
    assert_eq!(results[0], results[1]);
}

#[tokio::test]
async fn frames_that_are_forgotten_or_never_were_are_not_found_with_the_reason() {
    let server = start_with(|config| config.streams.history = 2).await;
    for body in frames(3) {
        server.publish("demo", body).await;
    }
    for (path, words) in [
        ("/v1/streams/demo/frames/0.drc", "frames 1 to 2"),
        ("/v1/streams/demo/frames/9/metrics", "frames 1 to 2"),
        ("/v1/streams/demo/frames/2.stl", ".drc, .glb or .ply"),
        ("/v1/streams/other/frames/latest.drc", "no stream other"),
    ] {
        let response = server.get(path).await;
        assert_eq!(response.status(), StatusCode::NOT_FOUND, "{path}");
        let detail = problem(response).await["detail"]
            .as_str()
            .unwrap()
            .to_owned();
        assert!(detail.contains(words), "{path}: {detail}");
    }
}
