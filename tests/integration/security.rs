//! Who may do what, from where, and how much of it.

use std::time::{Duration, SystemTime};

use futures_util::StreamExt;
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use steadymesh::config::Config;
use steadymesh::server::auth::{Scope, TokenHash, TokenOptions};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{Error, Message};

use crate::support::{TestServer, frames, problem, start, start_with};

fn token(secret: &str, scope: Scope, streams: &str) -> TokenOptions {
    TokenOptions {
        name: secret.to_owned(),
        hash: TokenHash::of(secret),
        scopes: vec![scope],
        streams: vec![streams.parse().unwrap()],
        expires: None,
    }
}

fn with_tokens(config: &mut Config) {
    config.auth.tokens = vec![
        token("rig", Scope::Publish, "rig-*"),
        token("player", Scope::Subscribe, "rig-1"),
        token("boss", Scope::Admin, "*"),
    ];
}

async fn status(server: &TestServer, method: Method, path: &str, token: &str) -> StatusCode {
    let request = server
        .client
        .request(method.clone(), server.url(path))
        .bearer_auth(token);
    let request = if method == Method::POST {
        request.body(frames(1).remove(0))
    } else if method == Method::PUT {
        request.body("{}")
    } else {
        request
    };
    request.send().await.unwrap().status()
}

#[tokio::test]
async fn each_token_opens_its_scope_for_its_streams() {
    let server = start_with(with_tokens).await;
    let (ok, forbidden) = (StatusCode::OK, StatusCode::FORBIDDEN);
    for (method, path, token, expected) in [
        (
            Method::POST,
            "/v1/streams/rig-1/frames",
            "rig",
            StatusCode::ACCEPTED,
        ),
        (Method::POST, "/v1/streams/other/frames", "rig", forbidden),
        (
            Method::POST,
            "/v1/streams/rig-1/frames",
            "player",
            forbidden,
        ),
        (
            Method::POST,
            "/v1/streams/rig-1/frames",
            "wrong",
            StatusCode::UNAUTHORIZED,
        ),
        (Method::PUT, "/v1/streams/rig-2", "rig", StatusCode::CREATED),
        (Method::GET, "/v1/streams/rig-1", "player", ok),
        (Method::GET, "/v1/streams/rig-1/metrics", "player", ok),
        (Method::GET, "/v1/streams/rig-2", "player", forbidden),
        (Method::DELETE, "/v1/streams/rig-1", "rig", forbidden),
        (
            Method::DELETE,
            "/v1/streams/rig-1",
            "boss",
            StatusCode::NO_CONTENT,
        ),
    ] {
        let found = status(&server, method.clone(), path, token).await;
        assert_eq!(found, expected, "{method} {path} {token}");
    }
}

#[tokio::test]
async fn without_a_token_the_answer_says_how_to_send_one() {
    let server = start_with(with_tokens).await;
    let response = server.get("/v1/streams").await;
    assert_eq!(response.status(), StatusCode::UNAUTHORIZED);
    let challenge = response.headers()["www-authenticate"]
        .to_str()
        .unwrap()
        .to_owned();
    assert!(challenge.starts_with("Bearer"), "{challenge}");
    assert!(
        problem(response).await["detail"]
            .to_string()
            .contains("Authorization: Bearer")
    );
    let text = server.internal("/metrics").await.text().await.unwrap();
    assert!(
        text.contains("steadymesh_denied_total{reason=\"missing\"} 1"),
        "{text}"
    );
}

#[tokio::test]
async fn a_list_shows_the_streams_of_the_token_only() {
    let server = start_with(with_tokens).await;
    for name in ["rig-1", "rig-2", "other"] {
        let path = format!("/v1/streams/{name}");
        assert_eq!(
            status(&server, Method::PUT, &path, "boss").await,
            StatusCode::CREATED
        );
    }
    let list = async |token: &str| {
        let request = server
            .client
            .get(server.url("/v1/streams"))
            .bearer_auth(token);
        let list: Value = request.send().await.unwrap().json().await.unwrap();
        list["streams"].as_array().unwrap().len()
    };
    assert_eq!(
        (list("rig").await, list("player").await, list("boss").await),
        (2, 1, 3)
    );
}

/// Connects a WebSocket with these headers.
async fn connect(
    server: &TestServer,
    path: &str,
    headers: &[(&'static str, &str)],
) -> Result<Value, u16> {
    let url = server.url(path).replacen("http", "ws", 1);
    let mut request = url.into_client_request().unwrap();
    for (name, value) in headers {
        request.headers_mut().insert(*name, value.parse().unwrap());
    }
    match tokio_tungstenite::connect_async(request).await {
        Ok((mut socket, _)) => match socket.next().await {
            Some(Ok(Message::Text(text))) => Ok(serde_json::from_str(&text).unwrap()),
            other => panic!("a text message was expected, not {other:?}"),
        },
        Err(Error::Http(response)) => Err(response.status().as_u16()),
        Err(error) => panic!("{error}"),
    }
}

#[tokio::test]
async fn a_page_sends_its_token_as_a_subprotocol_or_fetches_a_ticket() {
    let server = start_with(with_tokens).await;
    status(&server, Method::PUT, "/v1/streams/rig-1", "boss").await;
    let path = "/v1/streams/rig-1/subscribe";
    assert_eq!(connect(&server, path, &[]).await, Err(401));
    let protocols = [("sec-websocket-protocol", "steadymesh.v1, bearer.player")];
    assert_eq!(
        connect(&server, path, &protocols).await.unwrap()["type"],
        "hello"
    );
    let protocols = [("sec-websocket-protocol", "steadymesh.v1, bearer.wrong")];
    assert_eq!(connect(&server, path, &protocols).await, Err(401));

    let wanted = json!({"stream": "rig-1", "scope": "subscribe"}).to_string();
    let url = server.url("/v1/tickets");
    let answer = server
        .client
        .post(&url)
        .bearer_auth("player")
        .body(wanted.clone());
    let answer: Value = answer.send().await.unwrap().json().await.unwrap();
    let ticket = answer["ticket"].as_str().unwrap();
    let path = format!("{path}?ticket={ticket}");
    assert_eq!(connect(&server, &path, &[]).await.unwrap()["type"], "hello");
    assert_eq!(
        connect(&server, &path, &[]).await,
        Err(401),
        "it opens once"
    );
    let denied = server
        .client
        .post(&url)
        .bearer_auth("rig")
        .body(wanted)
        .send()
        .await
        .unwrap();
    assert_eq!(denied.status(), StatusCode::FORBIDDEN);
}

async fn ticket_for(server: &TestServer, token: &str, stream: &str) -> String {
    let wanted = json!({"stream": stream, "scope": "subscribe"}).to_string();
    let request = server.client.post(server.url("/v1/tickets"));
    let answer = request.bearer_auth(token).body(wanted).send().await;
    let answer: Value = answer.unwrap().json().await.unwrap();
    answer["ticket"].as_str().unwrap().to_owned()
}

#[tokio::test]
async fn a_ticket_is_not_used_up_by_a_handshake_that_fails_and_opens_one_connection_only() {
    let server = start_with(with_tokens).await;
    let ticket = ticket_for(&server, "player", "rig-1").await;
    let path = format!("/v1/streams/rig-1/subscribe?ticket={ticket}");
    assert_eq!(connect(&server, &path, &[]).await, Err(404));
    status(&server, Method::PUT, "/v1/streams/rig-1", "boss").await;
    let plain = server.get(&path).await;
    assert_eq!(plain.status(), StatusCode::BAD_REQUEST);
    let (one, other) = tokio::join!(connect(&server, &path, &[]), connect(&server, &path, &[]));
    let outcomes = [one.map(|_| ()), other.map(|_| ())];
    assert!(
        outcomes.contains(&Ok(())) && outcomes.contains(&Err(401)),
        "{outcomes:?}"
    );
    assert_eq!(connect(&server, &path, &[]).await, Err(401));
}

#[tokio::test]
async fn a_connection_ends_when_its_token_expires() {
    let server = start_with(|config| {
        let mut token = token("short", Scope::Admin, "*");
        token.expires = Some((SystemTime::now() + Duration::from_secs(2)).into());
        config.auth.tokens = vec![token];
    })
    .await;
    status(&server, Method::PUT, "/v1/streams/demo", "short").await;
    for path in ["subscribe", "publish"] {
        let url = server
            .url(&format!("/v1/streams/demo/{path}"))
            .replacen("http", "ws", 1);
        let mut request = url.into_client_request().unwrap();
        let bearer = "Bearer short".parse().unwrap();
        request.headers_mut().insert("authorization", bearer);
        let connected = tokio_tungstenite::connect_async(request).await;
        if path == "publish" {
            // The subscriber's two seconds were this one's too.
            assert!(matches!(connected, Err(Error::Http(response)) if response.status() == 401));
            continue;
        }
        let mut socket = connected.unwrap().0;
        let code = loop {
            if let Message::Close(Some(close)) = socket.next().await.unwrap().unwrap() {
                break close.code;
            }
        };
        assert_eq!(code, CloseCode::from(4401));
    }
}

#[tokio::test]
async fn pages_of_other_origins_are_refused_unless_they_are_configured() {
    let server = start_with(|config| {
        config.http.allowed_origins = vec!["https://studio.example".to_owned()];
    })
    .await;
    let request = async |origin: &str| {
        let request = server
            .client
            .put(server.url("/v1/streams/demo"))
            .header("origin", origin);
        request.body("{}").send().await.unwrap()
    };
    assert_eq!(
        request("https://evil.example").await.status(),
        StatusCode::FORBIDDEN
    );
    assert_eq!(request("null").await.status(), StatusCode::FORBIDDEN);
    let own = format!("http://{}", server.server.address().unwrap());
    assert!(request(&own).await.status().is_success());
    let allowed = request("https://studio.example").await;
    assert!(allowed.status().is_success());
    assert_eq!(
        allowed.headers()["access-control-allow-origin"],
        "https://studio.example"
    );
    let path = "/v1/streams/demo/publish";
    let evil = connect(&server, path, &[("origin", "https://evil.example")]).await;
    assert_eq!(evil, Err(403));
    assert!(connect(&server, path, &[("origin", &own)]).await.is_ok());
}

#[tokio::test]
async fn connections_over_the_limit_are_told_so_and_others_go_on() {
    let server = start_with(|config| config.limits.connections = 3).await;
    let mut open = Vec::new();
    for _ in 0..3 {
        let mut socket = tokio::net::TcpStream::connect(server.server.address().unwrap())
            .await
            .unwrap();
        socket
            .write_all(b"GET /v1/streams HTTP/1.1\r\nHost: localhost\r\n\r\n")
            .await
            .unwrap();
        let mut start = [0; 12];
        socket.read_exact(&mut start).await.unwrap();
        assert_eq!(&start, b"HTTP/1.1 200");
        open.push(socket);
    }
    let mut refused = tokio::net::TcpStream::connect(server.server.address().unwrap())
        .await
        .unwrap();
    let mut answer = String::new();
    refused.read_to_string(&mut answer).await.unwrap();
    assert!(
        answer.starts_with("HTTP/1.1 503") && answer.contains("limits.connections"),
        "{answer}"
    );
    drop(open);
    for _ in 0..200 {
        if let Ok(response) = server.client.get(server.url("/v1/streams")).send().await
            && response.status() == StatusCode::OK
        {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("the places of closed connections are not given back");
}

/// A certificate for 127.0.0.1 and its key, written where the server looks for them.
fn write_certificate(folder: &std::path::Path) -> reqwest::Certificate {
    let made = rcgen::generate_simple_self_signed(vec!["127.0.0.1".to_owned()]).unwrap();
    std::fs::write(folder.join("chain.pem"), made.cert.pem()).unwrap();
    std::fs::write(folder.join("key.pem"), made.signing_key.serialize_pem()).unwrap();
    reqwest::Certificate::from_pem(made.cert.pem().as_bytes()).unwrap()
}

fn trusting(certificate: reqwest::Certificate) -> reqwest::Client {
    reqwest::Client::builder()
        .tls_certs_only([certificate])
        .build()
        .unwrap()
}

#[tokio::test]
async fn tls_is_spoken_and_a_new_certificate_is_taken_without_dropping_a_connection() {
    let folder = tempfile::tempdir().unwrap();
    let first = write_certificate(folder.path());
    let mut config = Config::default();
    let server = start_with(|own| {
        own.tls = Some(steadymesh::server::TlsOptions {
            certificate_file: folder.path().join("chain.pem"),
            key_file: folder.path().join("key.pem"),
        });
        config = own.clone();
    })
    .await;
    let url = server.url("/v1/streams").replacen("http", "https", 1);
    let old = trusting(first);
    assert_eq!(old.get(&url).send().await.unwrap().status(), StatusCode::OK);
    let second = write_certificate(folder.path());
    server.server.reload(config.server()).await.unwrap();
    assert_eq!(
        trusting(second).get(&url).send().await.unwrap().status(),
        StatusCode::OK
    );
    // The connection that is there goes on; a new one would not trust the new certificate.
    assert_eq!(old.get(&url).send().await.unwrap().status(), StatusCode::OK);

    std::fs::write(folder.path().join("key.pem"), "not a key").unwrap();
    let error = server
        .server
        .reload(config.server())
        .await
        .unwrap_err()
        .to_string();
    assert!(error.contains("key.pem"), "{error}");
}

#[tokio::test]
async fn players_over_the_limit_are_told_so() {
    let server = start_with(|config| config.limits.subscribers_per_stream = 1).await;
    server.publish("demo", frames(1).remove(0)).await;
    let mut first = server.subscribe("demo").await;
    first.control().await;
    let second = connect(&server, "/v1/streams/demo/subscribe", &[]).await;
    assert_eq!(second, Err(503));
    assert_eq!(server.json("/v1/streams/demo").await["subscribers"], 1);
}

#[tokio::test]
async fn bodies_that_do_not_fit_into_memory_together_are_put_off() {
    let server = start_with(|config| config.limits.memory_bytes = 20_000).await;
    let body = frames(1).remove(0);
    assert!(20_000 < body.len());
    let response = server.post("demo", body).send().await.unwrap();
    assert_eq!(response.status(), StatusCode::SERVICE_UNAVAILABLE);
    assert!(response.headers().contains_key("retry-after"));
    let detail = problem(response).await["detail"].to_string();
    assert!(detail.contains("limits.memory_bytes"), "{detail}");
}

#[tokio::test]
async fn a_paced_player_gets_the_newest_frames_and_misses_nothing_it_wanted() {
    let server = start().await;
    let body = frames(1).remove(0);
    server.publish("demo", body.clone()).await;
    let url = server
        .url("/v1/streams/demo/subscribe?max_fps=2")
        .replacen("http", "ws", 1);
    let (socket, _) = tokio_tungstenite::connect_async(url).await.unwrap();
    let mut player = crate::support::Player { socket };
    player.control().await;
    assert_eq!(player.frame().await.0.seq, 0);
    let begun = std::time::Instant::now();
    for _ in 0..5 {
        server.publish("demo", body.clone()).await;
    }
    let (metrics, _) = player.frame().await;
    let newest = metrics.seq;
    assert!(
        Duration::from_millis(300) < begun.elapsed(),
        "{:?}",
        begun.elapsed()
    );
    assert!(2 < newest, "frame {newest} is not the newest by then");
    let refused = connect(&server, "/v1/streams/demo/subscribe?max_fps=0", &[]).await;
    assert_eq!(refused, Err(400));
}
