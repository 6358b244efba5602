//! Frames with images: in, kept, and out.

use reqwest::header::{CACHE_CONTROL, CONTENT_TYPE, ETAG, IF_NONE_MATCH};
use reqwest::{RequestBuilder, StatusCode};
use serde_json::{Value, json};
use steadymesh_mesh_io::{Attribute, ImageBytes, ImageFormat, Limits, Mesh, glb, obj};
use steadymesh_proto::{Bundle, DeliveredFrame, FrameMetrics};
use tokio_tungstenite::tungstenite::Message;

use crate::support::{TestServer, problem, start, start_with};

const LIMITS: Limits = Limits {
    max_vertices: 100_000,
    max_faces: 100_000,
    max_memory_bytes: 1 << 28,
};

/// A tube of 32 x 16 quads whose texture goes around once, with a seam where it meets itself.
fn tube() -> Mesh {
    let (around, along) = (32_u32, 16_u32);
    let mut mesh = Mesh::default();
    let (mut coordinates, mut corners) = (Vec::new(), Vec::new());
    for row in 0..=along {
        for column in 0..around {
            let angle = f64::from(column) / f64::from(around) * std::f64::consts::TAU;
            let height = f64::from(row) / 4.0;
            mesh.positions.push([angle.cos(), angle.sin(), height]);
        }
        for column in 0..=around {
            coordinates.push([column as f32 / around as f32, row as f32 / along as f32]);
        }
    }
    for row in 0..along {
        for column in 0..around {
            let vertex = |row: u32, column: u32| row * around + column % around;
            let corner = |row: u32, column: u32| row * (around + 1) + column;
            let quad = |of: &dyn Fn(u32, u32) -> u32| {
                let [a, b] = [of(row, column), of(row, column + 1)];
                let [c, d] = [of(row + 1, column + 1), of(row + 1, column)];
                [[a, b, c], [a, c, d]]
            };
            mesh.faces.extend(quad(&vertex));
            corners.extend(quad(&corner));
        }
    }
    mesh.texture_coordinates = Some(Attribute {
        values: coordinates,
        faces: Some(corners),
    });
    mesh
}

/// A picture of one color.
pub fn png(shade: u8) -> Vec<u8> {
    let image = image::RgbImage::from_pixel(64, 32, image::Rgb([shade, 90, 30]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

pub fn bundle(image: &[u8]) -> Vec<u8> {
    let mesh = obj::write(&tube());
    Bundle {
        seq: None,
        capture_time_us: Some(1_700_000_000_000_000),
        mesh: &mesh,
        image,
    }
    .encode()
}

fn post(server: &TestServer, content_type: &str, body: Vec<u8>) -> RequestBuilder {
    let url = server.url("/v1/streams/demo/frames");
    server
        .client
        .post(url)
        .header(CONTENT_TYPE, content_type)
        .body(body)
}

/// Posts a bundle and waits until it is out.
async fn publish(server: &TestServer, body: Vec<u8>) -> FrameMetrics {
    let request = post(server, "application/vnd.steadymesh.bundle", body);
    let response = request.header("prefer", "wait").send().await.unwrap();
    assert_eq!(response.status(), StatusCode::OK);
    response.json().await.unwrap()
}

fn texture_id(metrics: &FrameMetrics) -> String {
    metrics.texture.as_ref().expect("a texture").id.clone()
}

async fn message_of(player: &mut crate::support::Player) -> Vec<u8> {
    loop {
        if let Message::Binary(bytes) = player.message().await {
            return bytes.to_vec();
        }
    }
}

#[tokio::test]
async fn an_image_comes_in_by_a_bundle_by_parts_and_inside_a_glb() {
    let server = start().await;
    let image = png(200);
    let parts = b"--x\r\nContent-Disposition: form-data; name=\"mesh\"; filename=\"f.obj\"\r\n\r\n";
    let mut form = parts.to_vec();
    form.extend(obj::write(&tube()));
    form.extend(b"\r\n--x\r\nContent-Disposition: form-data; name=\"texture\"\r\n");
    form.extend(b"Content-Type: image/png\r\n\r\n");
    form.extend(&image);
    form.extend(b"\r\n--x--\r\n");
    let bodies = [
        ("application/vnd.steadymesh.bundle", bundle(&image)),
        ("application/octet-stream", bundle(&image)),
        ("multipart/form-data; boundary=x", form),
        (
            "model/gltf-binary",
            glb::write(&tube(), Some((ImageFormat::Png, &image))),
        ),
    ];
    for (seq, (content_type, body)) in bodies.into_iter().enumerate() {
        let request = post(&server, content_type, body).header("prefer", "wait");
        let response = request.send().await.unwrap();
        assert_eq!(response.status(), StatusCode::OK, "{content_type}");
        let metrics: FrameMetrics = response.json().await.unwrap();
        let texture = metrics.texture.clone().expect(content_type);
        assert_eq!((texture.width, texture.height), (64, 32));
        assert_eq!(
            (&*texture.media_type, texture.encoded),
            ("image/png", false)
        );
        // The seam's vertices have two points each.
        assert!(
            metrics.output.vertices < metrics.output.points,
            "{content_type}"
        );
        for path in [
            format!("/v1/streams/demo/textures/{}", texture.id),
            format!("/v1/streams/demo/frames/{seq}/texture"),
            "/v1/streams/demo/frames/latest/texture".to_owned(),
        ] {
            let answer = server.get(&path).await;
            assert_eq!(answer.headers()[CONTENT_TYPE], "image/png");
            assert_eq!(answer.headers()[ETAG], format!("\"{}\"", texture.id));
            assert_eq!(answer.bytes().await.unwrap(), image, "{path}");
        }
    }
}

#[tokio::test]
async fn an_image_may_be_kept_for_ever_and_is_not_sent_to_who_has_it() {
    let server = start().await;
    let metrics = publish(&server, bundle(&png(1))).await;
    let id = texture_id(&metrics);
    let url = server.url(&format!("/v1/streams/demo/textures/{id}"));
    let first = server.client.get(&url).send().await.unwrap();
    let cache = first.headers()[CACHE_CONTROL].to_str().unwrap();
    assert_eq!(cache, "public, max-age=31536000, immutable");
    let again = server
        .client
        .get(&url)
        .header(IF_NONE_MATCH, format!("\"{id}\""));
    assert_eq!(
        again.send().await.unwrap().status(),
        StatusCode::NOT_MODIFIED
    );
    let latest = server.get("/v1/streams/demo/frames/latest/texture").await;
    assert_eq!(latest.headers()[CACHE_CONTROL], "no-cache");
    let missing = server.get("/v1/streams/demo/textures/00").await;
    assert_eq!(problem(missing).await["status"], 404);
}

#[tokio::test]
async fn players_get_images_as_they_want_them_and_the_same_one_once() {
    let server = start().await;
    let (one, other) = (png(1), png(2));
    publish(&server, bundle(&one)).await;
    let mut inline = server
        .play("/v1/streams/demo/subscribe?textures=inline")
        .await;
    let mut reference = server.subscribe("demo").await;
    for image in [&one, &other, &one] {
        publish(&server, bundle(image)).await;
    }
    let mut images = Vec::new();
    for seq in 0..4 {
        let message = message_of(&mut inline).await;
        let with = DeliveredFrame::decode(&message).unwrap();
        images.push(with.image.map(<[u8]>::to_vec));
        let message = message_of(&mut reference).await;
        let without = DeliveredFrame::decode(&message).unwrap();
        assert_eq!((with.metrics.seq, without.metrics.seq), (seq, seq));
        assert_eq!(with.mesh, without.mesh);
        assert_eq!(without.image, None);
        assert_eq!(with.metrics.texture, without.metrics.texture);
    }
    assert_eq!(images, [Some(one.clone()), None, Some(other), Some(one)]);
}

#[tokio::test]
async fn a_glb_has_the_image_inside_and_reads_back_upright() {
    let server = start().await;
    let image = png(7);
    let metrics = publish(&server, bundle(&image)).await;
    let body = server.get("/v1/streams/demo/frames/latest.glb").await;
    let body = body.bytes().await.unwrap();
    let mesh = glb::read(&body, &LIMITS).unwrap();
    let ImageBytes::Within(range) = mesh.image.clone().unwrap().bytes else {
        panic!("the image is in the binary chunk");
    };
    assert_eq!(body[range], image);
    assert_eq!(mesh.positions.len(), metrics.output.points);
    // The texture goes up with the tube.
    let coordinates = &mesh.texture_coordinates.unwrap().values;
    for (position, [_, v]) in mesh.positions.iter().zip(coordinates) {
        let height = position[2] / 4.0;
        assert!((height - f64::from(*v)).abs() < 0.02, "{height} {v}");
    }
}

#[tokio::test]
async fn images_are_made_smaller_and_jpeg_or_left_out_as_configured() {
    let server = start().await;
    for (texture, expected) in [
        (
            json!({"format": "jpeg", "max_size": 16}),
            json!(["image/jpeg", 16, 8, true]),
        ),
        (json!({"max_size": 32}), json!(["image/png", 32, 16, true])),
        (json!({"format": "none"}), Value::Null),
    ] {
        let config = json!({"target_faces": 400, "texture": texture});
        let put = server.client.put(server.url("/v1/streams/demo"));
        put.json(&config).send().await.unwrap();
        let metrics = publish(&server, bundle(&png(3))).await;
        let found = metrics.texture.map_or(Value::Null, |texture| {
            json!([
                texture.media_type,
                texture.width,
                texture.height,
                texture.encoded
            ])
        });
        assert_eq!(found, expected, "{config}");
        assert_eq!(metrics.texture_error, None);
    }
}

#[tokio::test]
async fn a_damaged_image_does_not_cost_the_frame() {
    let server = start().await;
    let config = json!({"target_faces": 400, "texture": {"format": "jpeg"}});
    let put = server.client.put(server.url("/v1/streams/demo"));
    put.json(&config).send().await.unwrap();
    let metrics = publish(&server, bundle(&png(3)[..60])).await;
    assert_eq!(metrics.texture, None);
    let error = metrics.texture_error.unwrap();
    assert!(error.starts_with("image/png: "), "{error}");
    let missing = server.get("/v1/streams/demo/frames/latest/texture").await;
    assert_eq!(problem(missing).await["detail"], "frame 0 has no texture");
}

async fn refused(server: &TestServer, content_type: &str, body: Vec<u8>) -> (u64, String) {
    let request = post(server, content_type, body);
    let problem = problem(request.send().await.unwrap()).await;
    let detail = problem["detail"].as_str().unwrap().to_owned();
    (problem["status"].as_u64().unwrap(), detail)
}

#[tokio::test]
async fn what_is_wrong_with_parts_and_bundles_is_named() {
    let server = start().await;
    let form = |names: &[&str]| {
        let part = |name: &&str| {
            format!("--x\r\nContent-Disposition: form-data; name=\"{name}\"\r\n\r\nv 0 0 0\r\n")
        };
        let parts: String = names.iter().map(part).collect();
        format!("{parts}--x--\r\n").into_bytes()
    };
    let parts = "multipart/form-data; boundary=x";
    for (content_type, body, status, said) in [
        ("multipart/form-data", Vec::new(), 400, "no boundary"),
        (parts, form(&["texture"]), 400, "no part named \"mesh\""),
        (
            parts,
            form(&["mesh", "mesh"]),
            400,
            "two parts that are the mesh",
        ),
        (
            parts,
            form(&["mesh", "frame"]),
            400,
            "two parts that are the mesh",
        ),
        (
            parts,
            b"--x\r\nContent-Disposition: form-data; name=\"shoe\"\r\n\r\nlace\r\n--x--".to_vec(),
            400,
            "a part named \"shoe\"",
        ),
        (parts, b"--x\r\nCon".to_vec(), 400, "cannot be read"),
        (
            parts,
            form(&["mesh", "texture"]),
            422,
            "the image: it begins like none",
        ),
        (
            "application/vnd.steadymesh.bundle",
            bundle(&png(1))[..20].to_vec(),
            422,
            "bundle: ",
        ),
        (
            "application/octet-stream",
            bundle(b"GIF89a"),
            422,
            "the image: it begins like none",
        ),
    ] {
        let (found, detail) = refused(&server, content_type, body).await;
        assert_eq!(found, status, "{detail}");
        assert!(detail.contains(said), "{detail}");
    }
}

#[tokio::test]
async fn a_recording_has_the_images_too() {
    let folder = tempfile::tempdir().unwrap();
    let url = url::Url::from_directory_path(folder.path()).unwrap();
    let server = start_with(|config| {
        config.recordings.url = Some(url);
        config.streams.defaults.record = Some(steadymesh_proto::recording::Record::Output);
    })
    .await;
    let images = [png(1), png(1), png(2)];
    for image in &images {
        publish(&server, bundle(image)).await;
    }
    let stream = server.json("/v1/streams/demo").await;
    let id = stream["recording"]["id"].as_str().unwrap();
    let recording = format!("/v1/recordings/demo/{id}");
    let stopped = server.client.delete(server.url("/v1/streams/demo"));
    stopped.send().await.unwrap();
    // What has been added in the last second may be missing.
    while server.json(&recording).await["state"] != "complete" {
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    for (seq, image) in images.iter().enumerate() {
        let path = format!("{recording}/frames/{seq}/texture");
        assert_eq!(server.get(&path).await.bytes().await.unwrap(), *image);
        let glb = server.get(&format!("{recording}/frames/{seq}.glb")).await;
        let glb = glb.bytes().await.unwrap();
        assert!(glb::read(&glb, &LIMITS).unwrap().image.is_some());
    }
    for (wish, expected) in [
        ("inline", [Some(&images[0]), None, Some(&images[2])]),
        ("reference", [None; 3]),
    ] {
        let path = format!("{recording}/play?speed=0&textures={wish}");
        let mut player = server.play(&path).await;
        for expected in expected {
            let message = message_of(&mut player).await;
            let frame = DeliveredFrame::decode(&message).unwrap();
            assert_eq!(frame.image, expected.map(Vec::as_slice), "{wish}");
        }
    }
}
