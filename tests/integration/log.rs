//! The log, as operators grep it.

use futures_util::StreamExt;
use reqwest::{Client, StatusCode};
use steadymesh_proto::NATIVE_CONTENT_TYPE;
use tokio_tungstenite::tungstenite;

use crate::process::{Process, parse, request_id};
use crate::support::frames;

/// `steadymesh token` made these.
const TOKEN: &str = "a-token-that-is-only-for-this-test";

fn socket_url(process: &Process, path: &str) -> String {
    process.url(path).replacen("http", "ws", 1)
}

async fn post(process: &Process, id: &str, body: Vec<u8>) -> reqwest::Response {
    let request = Client::new()
        .post(process.url("/v1/streams/demo/frames"))
        .header("content-type", NATIVE_CONTENT_TYPE)
        .header("prefer", "wait")
        .header("x-request-id", id)
        .body(body);
    request.send().await.unwrap()
}

#[tokio::test]
async fn a_request_is_one_line_at_most_and_refusals_are_no_errors() {
    let limits = "limits.subscribers_per_stream = 1";
    let process = Process::start("info", limits, &[]);
    let answer = post(&process, "first", frames(1).remove(0)).await;
    assert_eq!(answer.status(), StatusCode::OK);
    assert_eq!(answer.headers()["x-request-id"], "first");
    let answer = post(&process, "second", b"no mesh".to_vec()).await;
    assert_eq!(answer.status(), StatusCode::UNPROCESSABLE_ENTITY);
    let url = socket_url(&process, "/v1/streams/demo/subscribe");
    let (mut player, _) = tokio_tungstenite::connect_async(url.clone()).await.unwrap();
    player.next().await.unwrap().unwrap();
    let refused = tokio_tungstenite::connect_async(url).await.unwrap_err();
    let tungstenite::Error::Http(refused) = refused else {
        panic!("a refusal is expected, not {refused}");
    };
    assert_eq!(refused.status(), StatusCode::SERVICE_UNAVAILABLE);
    assert_eq!(refused.headers()["x-request-id"].len(), 16);
    drop(player);
    let log = process.stop();
    let lines: Vec<_> = log.iter().map(|line| parse(line)).collect();
    let of = |id: &str| {
        lines
            .iter()
            .filter(|line| request_id(line) == Some(id))
            .count()
    };
    // The first one has made the stream.
    assert_eq!((of("first"), of("second")), (1, 0), "{log:#?}");
    for line in &lines {
        assert_eq!(line["level"], "INFO", "{line}");
    }
}

#[tokio::test]
async fn every_line_of_a_request_has_its_id_also_after_its_answer() {
    let mut process = Process::start("debug", "", &[]);
    post(&process, "first", frames(1).remove(0)).await;
    let url = socket_url(&process, "/v1/streams/demo/subscribe");
    let mut request = tungstenite::client::IntoClientRequest::into_client_request(url).unwrap();
    let id = tungstenite::http::HeaderValue::from_static("player-1");
    request.headers_mut().insert("x-request-id", id);
    let (player, _) = tokio_tungstenite::connect_async(request).await.unwrap();
    drop(player);
    let line = process.wait_for("subscriber leaves");
    assert_eq!(request_id(&parse(&line)), Some("player-1"), "{line}");
    let log = process.stop();
    let answered: Vec<_> = log.iter().map(|line| parse(line)).collect();
    let answered = answered
        .iter()
        .filter(|line| line["message"] == "request answered");
    let answered: Vec<_> = answered
        .map(|line| (request_id(line), &line["status"]))
        .collect();
    assert!(answered.contains(&(Some("first"), &200.into())), "{log:#?}");
    assert!(
        answered.contains(&(Some("player-1"), &101.into())),
        "{log:#?}"
    );
}

#[tokio::test]
async fn neither_a_token_nor_a_ticket_is_in_any_line() {
    let hash = steadymesh::server::auth::TokenHash::of(TOKEN);
    let hash: String = hash.into();
    let auth = format!("[[auth.tokens]]\nname = 'rig'\nhash = '{hash}'\nscopes = ['admin']\n");
    let process = Process::start("trace", &auth, &[]);
    let client = Client::new();
    let wrong = "a-token-that-nobody-knows";
    for (token, path) in [
        (TOKEN, "/v1/streams"),
        (wrong, "/v1/streams"),
        (
            TOKEN,
            "/v1/streams/demo/metrics?last=x&ticket=a-ticket-of-old",
        ),
        (wrong, "/nowhere?ticket=a-ticket-of-old"),
    ] {
        client
            .get(process.url(path))
            .bearer_auth(token)
            .send()
            .await
            .unwrap();
    }
    let frame = client
        .post(process.url("/v1/streams/demo/frames"))
        .bearer_auth(TOKEN);
    let frame = frame.header("prefer", "wait").body(frames(1).remove(0));
    assert_eq!(frame.send().await.unwrap().status(), StatusCode::OK);
    let asked = client.post(process.url("/v1/tickets")).bearer_auth(TOKEN);
    let asked = asked
        .body(r#"{"stream": "demo", "scope": "subscribe"}"#)
        .send()
        .await
        .unwrap();
    let answer: serde_json::Value = asked.json().await.unwrap();
    let ticket = answer["ticket"].as_str().unwrap();
    let url = socket_url(
        &process,
        &format!("/v1/streams/demo/subscribe?ticket={ticket}"),
    );
    let (mut player, _) = tokio_tungstenite::connect_async(url.clone()).await.unwrap();
    player.next().await.unwrap().unwrap();
    // A second time it opens nothing.
    tokio_tungstenite::connect_async(url).await.unwrap_err();
    drop(player);
    let log = process.stop();
    assert!(log.iter().any(|line| line.contains("request answered")));
    for line in &log {
        for secret in [TOKEN, wrong, "a-ticket-of-old", ticket] {
            assert!(!line.contains(secret), "{line}");
        }
    }
}
