//! Streams as such.

use reqwest::StatusCode;
use serde_json::json;

use crate::support::{frames, problem, start, start_with};

#[tokio::test]
async fn a_stream_is_made_changed_listed_and_ended() {
    let server = start().await;
    let url = server.url("/v1/streams/rig-1");
    let put = |config: serde_json::Value| server.client.put(&url).body(config.to_string()).send();
    let made = put(json!({"target_faces": 300, "tracking": "off"}))
        .await
        .unwrap();
    assert_eq!(made.status(), StatusCode::CREATED);
    assert_eq!(made.headers()["location"], "/v1/streams/rig-1");
    let changed = put(json!({"target_ratio": 0.1, "draco": {"position_bits": 14}}))
        .await
        .unwrap();
    assert_eq!(changed.status(), StatusCode::OK);

    let stream = server.json("/v1/streams/rig-1").await;
    assert_eq!(stream["config"]["target_ratio"], 0.1);
    assert_eq!(stream["config"]["target_faces"], json!(null));
    assert_eq!(stream["config"]["tracking"], "robust");
    assert_eq!(stream["config"]["draco"]["position_bits"], 14);
    assert_eq!(stream["state"], "idle");
    let list = server.json("/v1/streams").await;
    assert_eq!(list["streams"], json!([stream]));

    let deleted = server.client.delete(&url).send().await.unwrap();
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);
    let again = server.client.delete(&url).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_FOUND);
    assert_eq!(server.json("/v1/streams").await["streams"], json!([]));
}

#[tokio::test]
async fn a_new_configuration_counts_from_the_next_frame() {
    let server = start().await;
    let bodies = frames(2);
    assert_eq!(
        server.publish("demo", bodies[0].clone()).await.output.faces,
        400
    );
    let url = server.url("/v1/streams/demo");
    let config = json!({"target_faces": 200, "metrics": "off"}).to_string();
    server.client.put(url).body(config).send().await.unwrap();
    let metrics = server.publish("demo", bodies[1].clone()).await;
    assert_eq!(metrics.output.faces, 200);
    assert_eq!(metrics.surface_distance, None);
}

#[tokio::test]
async fn a_configuration_that_makes_no_sense_is_refused_by_name() {
    let server = start().await;
    let url = server.url("/v1/streams/demo");
    for (config, words) in [
        (r#"{"target_faces": 18446744073709551615}"#, "target_faces"),
        (r#"{"target_faces": 3}"#, "from 4 to"),
        (r#"{"target_face": 300}"#, "target_face"),
        (r#"{"tracking": "robusst"}"#, "robusst"),
        (
            r#"{"tracking_strength": 1.01}"#,
            "tracking_strength is 1.01: it must be from 0 to 1",
        ),
        (r#"{"target_ratio": 2}"#, "target_ratio is 2"),
        (r#"{"target_faces": 300, "target_ratio": 0.5}"#, "both"),
        (r#"{"draco": {"position_bits": 31}}"#, "position_bits is 31"),
        ("target_faces=300", "document"),
        ("[300]", "object is expected"),
    ] {
        let response = server.client.put(&url).body(config).send().await.unwrap();
        assert_eq!(response.status(), StatusCode::BAD_REQUEST, "{config}");
        let detail = problem(response).await["detail"]
            .as_str()
            .unwrap()
            .to_owned();
        assert!(detail.contains(words), "{config}: {detail}");
    }
    assert_eq!(
        server.get("/v1/streams/demo").await.status(),
        StatusCode::NOT_FOUND
    );
}

#[tokio::test]
async fn there_are_no_more_streams_than_allowed() {
    let server = start_with(|config| config.streams.max = 1).await;
    let body = frames(1).remove(0);
    server.publish("one", body.clone()).await;
    let response = server.post("two", body.clone()).send().await.unwrap();
    assert_eq!(response.status(), StatusCode::TOO_MANY_REQUESTS);
    let detail = problem(response).await["detail"].to_string();
    assert!(detail.contains("streams.max"), "{detail}");
    server
        .client
        .delete(server.url("/v1/streams/one"))
        .send()
        .await
        .unwrap();
    server.publish("two", body).await;
}

#[tokio::test]
async fn addresses_and_methods_that_do_not_exist_are_problems_too() {
    let server = start().await;
    let nothing = server.get("/v2/streams").await;
    assert_eq!(nothing.status(), StatusCode::NOT_FOUND);
    problem(nothing).await;
    let patch = server
        .client
        .patch(server.url("/v1/streams/demo"))
        .send()
        .await
        .unwrap();
    assert_eq!(patch.status(), StatusCode::METHOD_NOT_ALLOWED);
    assert!(patch.headers().contains_key("allow"));
    problem(patch).await;
    let name = server.get("/v1/streams/No_Such_Name").await;
    assert_eq!(name.status(), StatusCode::BAD_REQUEST);
    problem(name).await;
}
