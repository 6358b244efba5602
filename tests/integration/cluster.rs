//! Gateways and workers on one bus: what players get is what one node would have made.

use std::sync::Arc;
use std::time::Duration;

use reqwest::StatusCode;
use serde_json::{Value, json};
use steadymesh::bus::Bus;
use steadymesh::compute::ComputePool;
use steadymesh::config::Config;
use steadymesh::telemetry::Telemetry;
use steadymesh::worker::Worker;

use crate::nats::{ACK_WAIT, Nats};
use crate::support::{TestServer, frames, problem, start, start_on};
use crate::textures::{bundle, png};

over_both! {
    two_workers_make_what_one_node_makes
    frames_wait_for_a_worker_and_are_bounded
    frames_of_a_worker_that_is_gone_come_out_all_the_same
    a_stream_is_the_same_at_every_gateway
    what_is_wrong_with_a_frame_is_heard_at_the_gateway
    a_gateway_that_stops_leaves_its_streams_to_others
    a_burst_through_two_gateways_comes_out_whole
    an_image_goes_with_its_frame_to_every_gateway
}

async fn worker(bus: &Bus) -> Worker {
    let mut config = Config::default();
    config.compute.threads = 1;
    config.bus.ack_wait_secs = ACK_WAIT.as_secs_f64();
    let pool = Arc::new(ComputePool::new(config.compute()).unwrap());
    let telemetry = Arc::new(Telemetry::new().unwrap());
    Worker::start(bus.clone(), pool, telemetry, config.worker())
        .await
        .unwrap()
}

/// Posts frames, one after the other, and waits for the last; gives all Draco bytes.
async fn meshes(server: &TestServer, count: u64) -> Vec<Vec<u8>> {
    for body in frames(count) {
        loop {
            let answer = server.post("demo", body.clone()).send().await.unwrap();
            if answer.status() == StatusCode::ACCEPTED {
                break;
            }
            assert_eq!(answer.status(), StatusCode::TOO_MANY_REQUESTS);
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
    let mut meshes = Vec::new();
    for seq in 0..count {
        let path = format!("/v1/streams/demo/frames/{seq}.drc");
        let mesh = eventually(async || {
            let answer = server.get(&path).await;
            (answer.status() == StatusCode::OK).then_some(answer)
        });
        meshes.push(mesh.await.bytes().await.unwrap().to_vec());
    }
    meshes
}

async fn eventually<T>(mut attempt: impl AsyncFnMut() -> Option<T>) -> T {
    for _ in 0..400 {
        if let Some(done) = attempt().await {
            return done;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("it does not happen");
}

async fn two_workers_make_what_one_node_makes(bus: Bus) {
    let alone = meshes(&start().await, 8).await;
    let (_first, _second) = (worker(&bus).await, worker(&bus).await);
    let gateway = start_on(Some(bus), |_| {}).await;
    assert_eq!(meshes(&gateway, 8).await, alone);
    let metrics = gateway.json("/v1/streams/demo/frames/5/metrics").await;
    assert_eq!(metrics["reference_seq"], 4);
    assert_eq!(metrics["quality"], "full");
    assert!(0 < metrics["stage_us"]["register"].as_u64().unwrap());
}

async fn frames_wait_for_a_worker_and_are_bounded(bus: Bus) {
    let gateway = start_on(Some(bus.clone()), |config| config.bus.frames = 3).await;
    let mut bodies = frames(4).into_iter();
    for _ in 0..3 {
        let answer = gateway.post("demo", bodies.next().unwrap()).send().await;
        assert_eq!(answer.unwrap().status(), StatusCode::ACCEPTED);
    }
    let refused = gateway
        .post("demo", bodies.next().unwrap())
        .send()
        .await
        .unwrap();
    assert_eq!(refused.status(), StatusCode::TOO_MANY_REQUESTS);
    assert_eq!(gateway.json("/v1/streams/demo").await["queued"], 3);
    let _worker = worker(&bus).await;
    eventually(async || {
        let summary = gateway.json("/v1/streams/demo").await;
        (summary["counters"]["published"] == 3 && summary["queued"] == 0).then_some(())
    })
    .await;
}

async fn frames_of_a_worker_that_is_gone_come_out_all_the_same(bus: Bus) {
    let alone = meshes(&start().await, 8).await;
    let gateway = start_on(Some(bus.clone()), |_| {}).await;
    // Takes frames, and answers for none.
    let thief = {
        let bus = bus.clone();
        tokio::spawn(async move {
            for _ in 0..3 {
                drop(bus.pull().await.unwrap());
            }
        })
    };
    let _worker = worker(&bus).await;
    assert_eq!(meshes(&gateway, 8).await, alone);
    thief.await.unwrap();
}

async fn a_stream_is_the_same_at_every_gateway(bus: Bus) {
    let _worker = worker(&bus).await;
    let near = start_on(Some(bus.clone()), |_| {}).await;
    let far = start_on(Some(bus.clone()), |_| {}).await;
    let put = near.client.put(near.url("/v1/streams/demo"));
    let put = put
        .json(&json!({"target_faces": 200}))
        .send()
        .await
        .unwrap();
    assert_eq!(put.status(), StatusCode::CREATED);
    eventually(async || {
        let summary = far.json("/v1/streams/demo").await;
        (summary["config"]["target_faces"] == 200).then_some(())
    })
    .await;
    let mut player = far.subscribe("demo").await;
    player.control().await;
    let mut bodies = frames(3).into_iter();
    let published = near.publish("demo", bodies.next().unwrap()).await;
    assert_eq!(published.output.faces, 200);
    assert_eq!(player.frame().await.0.seq, 0);
    // The other gateway goes on where the first one was.
    assert_eq!(far.publish("demo", bodies.next().unwrap()).await.seq, 1);
    assert_eq!(near.publish("demo", bodies.next().unwrap()).await.seq, 2);
    assert_eq!(player.frame().await.0.seq, 1);
    assert_eq!(player.frame().await.0.seq, 2);
    // A number that goes back is refused wherever it comes in.
    let back = far.url("/v1/streams/demo/frames?seq=0");
    let refused = far
        .client
        .post(back)
        .body(frames(1).remove(0))
        .send()
        .await
        .unwrap();
    assert_eq!(refused.status(), StatusCode::CONFLICT);
    assert_eq!(
        problem(refused).await["type"],
        "urn:steadymesh:problem:seq-goes-back"
    );

    let deleted = far
        .client
        .delete(far.url("/v1/streams/demo"))
        .send()
        .await
        .unwrap();
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);
    eventually(async || {
        let gone = near.get("/v1/streams/demo").await.status() == StatusCode::NOT_FOUND;
        gone.then_some(())
    })
    .await;
    assert_eq!(player.control().await["reason"], "deleted");
    // A stream of the same name begins anew.
    assert_eq!(near.publish("demo", frames(1).remove(0)).await.seq, 0);
}

async fn an_image_goes_with_its_frame_to_every_gateway(bus: Bus) {
    let _worker = worker(&bus).await;
    let near = start_on(Some(bus.clone()), |_| {}).await;
    let far = start_on(Some(bus.clone()), |_| {}).await;
    // Noise, so that it is larger than a message may be.
    let mut state = 1_u32;
    let noise = image::RgbImage::from_fn(800, 600, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        image::Rgb([24, 16, 8].map(|shift| (state >> shift) as u8))
    });
    let mut large = std::io::Cursor::new(Vec::new());
    noise.write_to(&mut large, image::ImageFormat::Png).unwrap();
    let large = large.into_inner();
    assert!(1 << 20 < large.len());
    for (seq, image) in [large, png(5)].iter().enumerate() {
        let request = near.client.post(near.url("/v1/streams/demo/frames"));
        let request = request.header("prefer", "wait").body(bundle(image));
        assert_eq!(request.send().await.unwrap().status(), StatusCode::OK);
        let path = format!("/v1/streams/demo/frames/{seq}/texture");
        let answer = eventually(async || {
            let answer = far.get(&path).await;
            (answer.status() == StatusCode::OK).then_some(answer)
        });
        assert_eq!(answer.await.bytes().await.unwrap(), *image);
    }
}

async fn what_is_wrong_with_a_frame_is_heard_at_the_gateway(bus: Bus) {
    let gateway = start_on(Some(bus), |_| {}).await;
    let refused = gateway
        .post("demo", b"no mesh".to_vec())
        .send()
        .await
        .unwrap();
    assert_eq!(refused.status(), StatusCode::UNPROCESSABLE_ENTITY);
    let summary: Value = gateway.json("/v1/streams/demo").await;
    assert_eq!(summary["counters"]["rejected"], 1);
}

async fn a_gateway_that_stops_leaves_its_streams_to_others(bus: Bus) {
    let near = start_on(Some(bus.clone()), |config| config.shutdown_grace_secs = 1).await;
    let far = start_on(Some(bus.clone()), |_| {}).await;
    // Nobody processes them before it has to stop.
    for body in frames(2) {
        let answer = near.post("demo", body).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::ACCEPTED);
    }
    eventually(async || {
        let status = far.get("/v1/streams/demo").await.status();
        (status == StatusCode::OK).then_some(())
    })
    .await;
    near.server.shut_down().await;
    let _worker = worker(&bus).await;
    eventually(async || {
        let summary = far.json("/v1/streams/demo").await;
        (summary["latest_seq"] == 1).then_some(())
    })
    .await;
    assert_eq!(far.publish("demo", frames(1).remove(0)).await.seq, 2);
}

async fn a_burst_through_two_gateways_comes_out_whole(bus: Bus) {
    let _workers = (worker(&bus).await, worker(&bus).await);
    let near = start_on(Some(bus.clone()), |_| {}).await;
    assert_eq!(near.publish("demo", frames(1).remove(0)).await.seq, 0);
    let far = start_on(Some(bus.clone()), |_| {}).await;
    eventually(async || {
        let status = far.get("/v1/streams/demo").await.status();
        (status == StatusCode::OK).then_some(())
    })
    .await;
    // Without numbers, both at once, as many as there are places.
    let burst = async |gateway: &TestServer| {
        let mut seqs = Vec::new();
        for body in frames(15) {
            let answer = gateway.post("demo", body).send().await.unwrap();
            assert_eq!(answer.status(), StatusCode::ACCEPTED);
            let accepted: Value = answer.json().await.unwrap();
            seqs.push(accepted["seq"].as_u64().unwrap());
        }
        seqs
    };
    let (first, second) = tokio::join!(burst(&near), burst(&far));
    let mut all: Vec<_> = first.into_iter().chain(second).collect();
    all.sort_unstable();
    assert_eq!(all, (1..31).collect::<Vec<u64>>());
    for gateway in [&near, &far] {
        let summary = eventually(async || {
            let summary = gateway.json("/v1/streams/demo").await;
            (summary["latest_seq"] == 30).then_some(summary)
        })
        .await;
        assert_eq!(summary["counters"]["dropped"], 0, "{summary}");
    }
}

#[tokio::test]
async fn a_stream_goes_on_when_the_bus_has_lost_everything() {
    let mut nats = Nats::start();
    let bus = nats.bus().await;
    let _worker = worker(&bus).await;
    let near = start_on(Some(bus.clone()), |_| {}).await;
    let far = start_on(Some(nats.bus().await), |_| {}).await;
    let mut bodies = frames(8).into_iter();
    for seq in 0..4 {
        assert_eq!(near.publish("demo", bodies.next().unwrap()).await.seq, seq);
    }
    nats.kill();
    nats.restart_empty();
    // One that knows nothing yet.
    let late = eventually(async || {
        let answer = near.post("demo", bodies.next()?).send().await.unwrap();
        (answer.status() == StatusCode::ACCEPTED).then_some(())
    });
    late.await;
    let _new = worker(&nats.bus().await).await;
    for gateway in [&near, &far] {
        eventually(async || {
            let summary = gateway.json("/v1/streams/demo").await;
            (summary["latest_seq"].as_u64() >= Some(4)).then_some(())
        })
        .await;
    }
}
