//! What becomes of a frame that has one before it.

use reqwest::StatusCode;
use serde_json::json;
use steadymesh_proto::NativeFrame;
use steadymesh_proto::metrics::{FrameMetrics, Tracking};

use crate::support::{TestServer, frames, frames_of, start, start_with};

async fn configure(server: &TestServer, config: serde_json::Value) {
    let url = server.url("/v1/streams/demo");
    let made = server.client.put(url).json(&config).send().await.unwrap();
    assert!(made.status().is_success());
}

/// A sphere of the figure's height that stands where it does.
fn sphere() -> Vec<u8> {
    let (rings, segments) = (30_u32, 60_u32);
    let mut frame = NativeFrame::default();
    for ring in 0..=rings {
        let polar = std::f32::consts::PI * ring as f32 / rings as f32;
        for segment in 0..segments {
            let around = std::f32::consts::TAU * segment as f32 / segments as f32;
            frame.positions.push([
                0.9 * polar.sin() * around.sin(),
                0.9 + 0.9 * polar.cos(),
                0.9 * polar.sin() * around.cos(),
            ]);
        }
    }
    for ring in 0..rings {
        for segment in 0..segments {
            let at = |ring: u32, segment: u32| ring * segments + segment % segments;
            let [a, b] = [at(ring, segment), at(ring, segment + 1)];
            let [c, d] = [at(ring + 1, segment), at(ring + 1, segment + 1)];
            frame.faces.extend([[a, c, b], [b, c, d]]);
        }
    }
    frame.encode()
}

fn assert_measured(metrics: &FrameMetrics, is_measured: bool) {
    let previous = |pair: &Option<steadymesh_proto::metrics::DistancePair>| {
        pair.as_ref().is_some_and(|pair| pair.previous.is_some())
    };
    assert_eq!(metrics.consistency.is_some(), is_measured, "{metrics:?}");
    assert_eq!(previous(&metrics.surface_distance), is_measured);
    assert_eq!(previous(&metrics.vertex_distance), is_measured);
    assert_eq!(metrics.reference_seq, is_measured.then(|| metrics.seq - 1));
}

#[tokio::test]
async fn full_metrics_say_what_came_back_whatever_the_mode() {
    for mode in ["off", "paper", "robust"] {
        let server = start().await;
        configure(&server, json!({"tracking": mode, "target_faces": 300})).await;
        let mut bodies = frames(4);
        let last = bodies.remove(3);
        for body in bodies {
            // Not waited for: several frames are in work at a time.
            let posted = server.post("demo", body).send().await.unwrap();
            assert_eq!(posted.status(), StatusCode::ACCEPTED);
        }
        server.publish("demo", last).await;
        let all = server.json("/v1/streams/demo/metrics").await;
        let all: Vec<FrameMetrics> = serde_json::from_value(all["frames"].clone()).unwrap();
        for metrics in &all {
            assert_measured(metrics, 0 < metrics.seq);
            assert_eq!(metrics.registration.is_some(), 0 < metrics.seq);
            if 0 < metrics.seq {
                assert_eq!(json!(metrics.tracking), mode);
            }
        }
        let text = server.internal("/metrics").await.text().await.unwrap();
        for series in ["vertex_persistence", "edge_persistence", "flicker"] {
            let series = format!("steadymesh_{series}_ratio{{stream=\"demo\"}} 0.");
            assert!(text.contains(&series), "{mode}: {series} is not in\n{text}");
        }
    }
}

#[tokio::test]
async fn a_stream_without_tracking_and_full_metrics_registers_nothing() {
    for metrics in ["sampled", "off"] {
        let server = start().await;
        configure(&server, json!({"tracking": "off", "metrics": metrics})).await;
        for body in frames(2) {
            let metrics = server.publish("demo", body).await;
            assert_eq!(metrics.registration, None);
            assert_measured(&metrics, false);
        }
    }
}

#[tokio::test]
async fn another_scene_is_a_first_frame_and_says_why() {
    for mode in ["off", "paper", "robust"] {
        let server = start().await;
        configure(&server, json!({"tracking": mode, "target_faces": 300})).await;
        let mut figures = frames_of(3000, 3).into_iter();
        for _ in 0..2 {
            let metrics = server.publish("demo", figures.next().unwrap()).await;
            assert_eq!(metrics.reset, None);
        }
        for body in [sphere(), figures.next().unwrap()] {
            let metrics = server.publish("demo", body).await;
            assert_eq!(metrics.tracking, Tracking::Off);
            assert_measured_as_first(&metrics);
            assert!(metrics.reset.unwrap().contains("scene cut: "));
            assert!(metrics.registration.is_some());
        }
        let text = server.internal("/metrics").await.text().await.unwrap();
        assert!(
            text.contains("steadymesh_resets_total{stream=\"demo\"} 2"),
            "{mode}: {text}"
        );
    }
}

fn assert_measured_as_first(metrics: &FrameMetrics) {
    assert_eq!(metrics.reference_seq, None);
    assert_measured(metrics, false);
    assert!(metrics.surface_distance.is_some());
}

#[tokio::test]
async fn frames_are_tracked_robustly_and_half_as_strongly_as_may_be_unless_asked_otherwise() {
    let server = start_with(|config| config.streams.defaults.target_faces = Some(300)).await;
    for body in frames(2) {
        server.publish("demo", body).await;
    }
    let stream = server.json("/v1/streams/demo").await;
    assert_eq!(stream["config"]["tracking"], "robust");
    assert_eq!(stream["config"]["tracking_strength"], 0.5);
    let latest = server.json("/v1/streams/demo/frames/latest/metrics").await;
    assert_eq!(latest["tracking"], "robust");
}

#[tokio::test]
async fn the_stronger_the_tracking_the_more_vertices_come_back() {
    let mut persistences = Vec::new();
    for strength in [0.0, 0.5, 1.0] {
        let server = start().await;
        configure(
            &server,
            json!({"tracking_strength": strength, "target_faces": 600}),
        )
        .await;
        let mut sum = 0.0;
        for body in frames_of(3000, 3) {
            let metrics = server.publish("demo", body).await;
            sum += metrics.consistency.map_or(0.0, |c| c.vertex_persistence);
        }
        persistences.push(sum);
    }
    assert!(persistences.is_sorted(), "{persistences:?}");
    assert!(1.2 * persistences[0] < persistences[1], "{persistences:?}");
}
