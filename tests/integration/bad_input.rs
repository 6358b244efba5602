//! Every wrong body gets its 4xx with a sentence that helps, and the next good frame works.

use reqwest::StatusCode;
use steadymesh_proto::NativeFrame;

use crate::support::{TestServer, frames, problem, start, start_with};

/// Posts `body`, expects `status` and a detail that contains `words`, then posts a good frame.
async fn expect(server: &TestServer, body: Vec<u8>, status: u16, words: &[&str]) {
    let url = server.url("/v1/streams/demo/frames");
    let request = server
        .client
        .post(url)
        .header("content-type", "application/octet-stream");
    let response = request.body(body).send().await.unwrap();
    assert_eq!(response.status(), status, "{words:?}");
    let detail = problem(response).await["detail"]
        .as_str()
        .unwrap()
        .to_owned();
    for word in words {
        assert!(detail.contains(word), "{detail:?} does not say {word:?}");
    }
    server.publish("demo", frames(1).remove(0)).await;
}

fn ply(header: &str, body: &[u8]) -> Vec<u8> {
    let head = format!("ply\nformat binary_little_endian 1.0\n{header}end_header\n");
    [head.as_bytes(), body].concat()
}

const VERTEX: &str = "property float x\nproperty float y\nproperty float z\n";
const FACE: &str = "property list uchar int vertex_indices\n";

#[tokio::test]
async fn a_text_file_is_not_a_mesh() {
    let server = start().await;
    let words = ["OBJ", "PLY", "GLB"];
    expect(
        &server,
        b"Dear server, here is my mesh.".to_vec(),
        415,
        &words,
    )
    .await;
}

#[tokio::test]
async fn an_empty_body_is_called_empty() {
    let server = start().await;
    expect(&server, Vec::new(), 422, &["empty"]).await;
}

#[tokio::test]
async fn a_truncated_ply_says_what_is_missing() {
    let server = start().await;
    let header = format!("element vertex 3\n{VERTEX}element face 1\n{FACE}");
    expect(&server, ply(&header, &[0; 40]), 422, &["PLY"]).await;
}

#[tokio::test]
async fn a_header_that_promises_four_billion_vertices_is_not_believed() {
    let server = start().await;
    let header = format!("element vertex 4294967296\n{VERTEX}element face 1\n{FACE}");
    let response = server
        .client
        .post(server.url("/v1/streams/demo/frames"))
        .body(ply(&header, &[0; 100]))
        .send()
        .await
        .unwrap();
    assert!(response.status().is_client_error(), "{}", response.status());
    let detail = problem(response).await["detail"].to_string();
    assert!(detail.contains("4294967296"), "{detail}");
}

#[tokio::test]
async fn nan_positions_are_named() {
    let server = start().await;
    let mut frame = NativeFrame::decode(&frames(1)[0]).unwrap();
    frame.positions[17][1] = f32::NAN;
    expect(&server, frame.encode(), 422, &["vertex 17", "not finite"]).await;
    let obj = b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n".to_vec();
    expect(&server, obj, 422, &["line 3"]).await;
}

#[tokio::test]
async fn an_index_out_of_range_is_named() {
    let server = start().await;
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n".to_vec();
    expect(&server, obj, 422, &["9", "line 4"]).await;
}

#[tokio::test]
async fn no_faces_and_a_single_triangle_are_too_few() {
    let server = start().await;
    expect(
        &server,
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_vec(),
        422,
        &["no faces"],
    )
    .await;
    let triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec();
    expect(&server, triangle, 422, &["1 of 1", "at least 4"]).await;
}

#[tokio::test]
async fn a_body_over_the_limit_is_refused_with_the_way_to_raise_it() {
    let server = start_with(|config| config.limits.body_bytes = 100_000).await;
    let ten_times = vec![b'x'; 1_000_000];
    let words = ["1000000", "100000", "limits.body_bytes"];
    expect(&server, ten_times.clone(), 413, &words).await;

    // Without a length in its head it is found out on the way.
    let chunks = futures_util::stream::iter(
        ten_times
            .chunks(1000)
            .map(|chunk| Ok::<_, std::io::Error>(chunk.to_vec()))
            .collect::<Vec<_>>(),
    );
    let url = server.url("/v1/streams/demo/frames");
    let body = reqwest::Body::wrap_stream(chunks);
    let response = server.client.post(url).body(body).send().await.unwrap();
    assert_eq!(response.status(), StatusCode::PAYLOAD_TOO_LARGE);
}

#[tokio::test]
async fn more_vertices_than_allowed_are_refused_by_the_limits_name() {
    let server = start_with(|config| config.limits.vertices = 1500).await;
    let big = crate::support::frames_of(3000, 1).remove(0);
    expect(&server, big, 413, &["limits.vertices", "1500"]).await;
}

#[tokio::test]
async fn a_type_that_is_not_read_is_refused_with_those_that_are() {
    let server = start().await;
    for (name, value) in [("content-type", "image/png"), ("content-encoding", "gzip")] {
        let request = server.client.post(server.url("/v1/streams/demo/frames"));
        let response = request.header(name, value).body("x").send().await.unwrap();
        assert_eq!(response.status(), StatusCode::UNSUPPORTED_MEDIA_TYPE);
        let detail = problem(response).await["detail"].to_string();
        assert!(detail.contains(value), "{detail}");
    }
}

#[tokio::test]
async fn parameters_that_make_no_sense_are_named() {
    let server = start().await;
    for (query, word) in [
        ("seqq=1", "seqq"),
        ("seq=-1", "seq"),
        ("seq=1.5", "invalid digit"),
    ] {
        let url = server.url(&format!("/v1/streams/demo/frames?{query}"));
        let response = server.client.post(url).body("x").send().await.unwrap();
        assert_eq!(response.status(), StatusCode::BAD_REQUEST, "{query}");
        let detail = problem(response).await["detail"].to_string();
        assert!(detail.contains(word), "{query}: {detail}");
    }
}

#[tokio::test]
async fn a_body_that_does_not_come_in_time_is_given_up() {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    let server = start_with(|config| config.limits.body_timeout_secs = 1).await;
    let mut socket = tokio::net::TcpStream::connect(server.server.address().unwrap())
        .await
        .unwrap();
    let head =
        "POST /v1/streams/demo/frames HTTP/1.1\r\nHost: localhost\r\nContent-Length: 900\r\n\r\n";
    socket.write_all(head.as_bytes()).await.unwrap();
    let mut answer = [0; 12];
    socket.read_exact(&mut answer).await.unwrap();
    assert_eq!(&answer, b"HTTP/1.1 408");
}

#[tokio::test]
async fn half_a_head_does_not_hold_a_connection_for_ever() {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    let server = start_with(|config| config.limits.header_timeout_secs = 1).await;
    let mut socket = tokio::net::TcpStream::connect(server.server.address().unwrap())
        .await
        .unwrap();
    socket.write_all(b"GET / HTTP/1.1\r\nHos").await.unwrap();
    let mut rest = Vec::new();
    let read = socket.read_to_end(&mut rest);
    tokio::time::timeout(std::time::Duration::from_secs(10), read)
        .await
        .expect("it is closed")
        .ok();
}
