//! What operators and their tools see.

use std::collections::BTreeSet;

use reqwest::StatusCode;

use crate::support::{frames, start};

#[tokio::test]
async fn health_and_metrics_are_on_the_internal_listener_only() {
    let server = start().await;
    for path in ["/livez", "/readyz", "/metrics"] {
        assert_eq!(
            server.internal(path).await.status(),
            StatusCode::OK,
            "{path}"
        );
        assert_eq!(
            server.get(path).await.status(),
            StatusCode::NOT_FOUND,
            "{path}"
        );
    }
    assert_eq!(
        server.internal("/v1/streams").await.status(),
        StatusCode::NOT_FOUND
    );
}

#[tokio::test]
async fn a_streams_series_are_there_while_it_lives() {
    let server = start().await;
    let made = server
        .client
        .put(server.url("/v1/streams/demo"))
        .json(&serde_json::json!({"tracking": "robust"}))
        .send()
        .await
        .unwrap();
    assert!(made.status().is_success());
    for body in frames(2) {
        server.publish("demo", body).await;
    }
    let response = server.internal("/metrics").await;
    let content_type = response.headers()["content-type"]
        .to_str()
        .unwrap()
        .to_owned();
    assert!(
        content_type.starts_with("text/plain; version=0.0.4"),
        "{content_type}"
    );
    let text = response.text().await.unwrap();
    for series in [
        "steadymesh_frames_received_total{stream=\"demo\"} 2",
        "steadymesh_frames_published_total{stream=\"demo\"} 2",
        "steadymesh_frames_dropped_total{reason=\"overload\",stream=\"demo\"} 0",
        "steadymesh_resets_total{stream=\"demo\"} 0",
        "steadymesh_frame_latency_seconds_count{stream=\"demo\"} 2",
        "steadymesh_stage_duration_seconds_count{stage=\"simplify\",stream=\"demo\"} 2",
        "steadymesh_surface_distance_ratio{reference=\"previous\",stream=\"demo\"} 0.0",
        "steadymesh_vertex_distance_ratio{reference=\"current\",stream=\"demo\"} 0.0",
        "steadymesh_registration_residual_ratio{stream=\"demo\"} 0.0",
        "steadymesh_vertex_persistence_ratio{stream=\"demo\"} 0.",
        "steadymesh_edge_persistence_ratio{stream=\"demo\"} 0.",
        "steadymesh_flicker_ratio{stream=\"demo\"} 0.0",
        "steadymesh_build_info{version=",
        "process_resident_memory_bytes ",
    ] {
        assert!(text.contains(series), "{series} is not in\n{text}");
    }
    server
        .client
        .delete(server.url("/v1/streams/demo"))
        .send()
        .await
        .unwrap();
    for _ in 0..200 {
        let text = server.internal("/metrics").await.text().await.unwrap();
        if !text.contains("stream=\"demo\"") {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    panic!("the series of a deleted stream are still there");
}

#[tokio::test]
async fn every_metric_has_its_help_and_type() {
    let server = start().await;
    server.publish("demo", frames(1).remove(0)).await;
    let text = server.internal("/metrics").await.text().await.unwrap();
    let described = |kind: &str| -> BTreeSet<&str> {
        let lines = text.lines().filter_map(|line| line.strip_prefix(kind));
        lines.filter_map(|line| line.split(' ').next()).collect()
    };
    let (help, types) = (described("# HELP "), described("# TYPE "));
    assert_eq!(help, types);
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let name = line.split(['{', ' ']).next().unwrap();
        let family = ["_bucket", "_sum", "_count"].iter().find_map(|suffix| {
            name.strip_suffix(suffix)
                .filter(|family| types.contains(family))
        });
        assert!(types.contains(family.unwrap_or(name)), "{name}");
    }
}

#[tokio::test]
async fn the_page_is_served_under_a_strict_policy_or_says_how_to_build_it() {
    let server = start().await;
    for path in ["/", "/watch/demo"] {
        let response = server.get(path).await;
        if response.status() == StatusCode::SERVICE_UNAVAILABLE {
            assert!(response.text().await.unwrap().contains("npm run build"));
            continue;
        }
        assert_eq!(response.status(), StatusCode::OK);
        let policy = response.headers()["content-security-policy"]
            .to_str()
            .unwrap();
        assert!(policy.contains("default-src 'none'"), "{policy}");
    }
    assert_eq!(
        server.get("/assets/none.js").await.status(),
        StatusCode::NOT_FOUND
    );
    assert_eq!(
        server.get("/assets/..%2Findex.html").await.status(),
        StatusCode::NOT_FOUND
    );
}
