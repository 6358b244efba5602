//! What every bus does: one contract, over the one in memory and over a real `nats-server`.

#![allow(clippy::unwrap_used, reason = "this is test code")]

#[macro_use]
#[path = "support/nats.rs"]
mod nats;

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use bytes::Bytes;
use steadymesh::bus::{
    Bus, BusError, Frame, Job, Options, Outcome, Position, Predecessor, Processed, StreamRecord,
};
use steadymesh_proto::stream::{DropReason, EndReason, StreamConfig};
use tokio::time::timeout;

use nats::{ACK_WAIT, Nats};

const PATIENCE: Duration = Duration::from_secs(15);

over_both! {
    frames_are_given_out_in_order_with_everything_known_of_them
    a_frame_that_is_not_answered_for_comes_again
    a_frame_that_is_worked_on_does_not_come_again
    a_frame_that_is_put_back_comes_again_later
    a_frame_is_appended_behind_the_last_one_only
    the_same_frame_is_stored_once
    frames_are_shared_among_workers
    a_predecessor_is_there_until_it_is_forgotten
    each_outcome_is_heard_once_and_in_order
    whoever_comes_late_hears_the_last_outcome_of_each_stream
    records_are_heard_by_everybody_and_the_latest_by_who_comes_late
    a_stream_begins_once
    an_empty_log_has_no_last_frame
}

fn frame(stream: &str, seq: u64, predecessor: Option<Predecessor>) -> Frame {
    Frame {
        stream: stream.to_owned(),
        instance: 1_700_000_000_000_000,
        seq,
        capture_time_us: seq.is_multiple_of(2).then_some(seq * 33_333),
        received_us: 1_700_000_000_000_001,
        content_type: "model/ply".to_owned(),
        predecessor,
        body: Bytes::from(format!("frame {seq} of {stream}")),
    }
}

/// Appends frames 0, 2, 4, … and gives them with their positions.
async fn append(bus: &Bus, stream: &str, count: u64) -> Vec<(Position, Frame)> {
    let mut appended: Vec<(Position, Frame)> = Vec::new();
    for index in 0..count {
        let predecessor = appended.last().map(|(position, before)| Predecessor {
            position: *position,
            seq: before.seq,
        });
        let frame = frame(stream, index * 2, predecessor);
        let behind = predecessor.map(|before| before.position);
        appended.push((bus.append(&frame, behind).await.unwrap(), frame));
    }
    appended
}

async fn pull(bus: &Bus) -> Job {
    timeout(PATIENCE, async {
        loop {
            if let Some(job) = bus.pull().await.unwrap() {
                return job;
            }
        }
    })
    .await
    .expect("a frame is given out")
}

fn processed(stream: &str, seq: u64) -> Processed {
    Processed {
        stream: stream.to_owned(),
        instance: 1,
        seq,
        outcome: Outcome::Delivered(Bytes::from(format!("result {seq} of {stream}"))),
    }
}

async fn frames_are_given_out_in_order_with_everything_known_of_them(bus: Bus) {
    let appended = append(&bus, "a", 3).await;
    for (position, frame) in appended {
        let job = pull(&bus).await;
        assert_eq!((job.position, job.deliveries), (position, 1));
        assert_eq!(job.frame, frame);
        job.done().await.unwrap();
    }
}

async fn a_frame_that_is_not_answered_for_comes_again(bus: Bus) {
    let appended = append(&bus, "a", 1).await;
    // As when a worker dies.
    drop(pull(&bus).await);
    let began = Instant::now();
    let again = pull(&bus).await;
    assert_eq!((again.position, again.deliveries), (appended[0].0, 2));
    assert!(ACK_WAIT / 2 < began.elapsed(), "{:?}", began.elapsed());
    again.done().await.unwrap();
    tokio::time::sleep(ACK_WAIT * 2).await;
    append_after(&bus, &appended[0]).await;
    assert_eq!(pull(&bus).await.frame.seq, 2);
}

async fn append_after(bus: &Bus, (position, before): &(Position, Frame)) -> Position {
    let predecessor = Predecessor {
        position: *position,
        seq: before.seq,
    };
    let next = frame(&before.stream, before.seq + 2, Some(predecessor));
    bus.append(&next, Some(*position)).await.unwrap()
}

async fn a_frame_that_is_worked_on_does_not_come_again(bus: Bus) {
    append(&bus, "a", 2).await;
    let slow = pull(&bus).await;
    for _ in 0..6 {
        tokio::time::sleep(ACK_WAIT / 3).await;
        slow.keep().await;
    }
    let next = pull(&bus).await;
    assert_eq!((next.frame.seq, next.deliveries), (2, 1));
    slow.done().await.unwrap();
}

async fn a_frame_that_is_put_back_comes_again_later(bus: Bus) {
    append(&bus, "a", 1).await;
    let delay = Duration::from_millis(300);
    pull(&bus).await.put_back(delay).await;
    let began = Instant::now();
    let again = pull(&bus).await;
    assert_eq!(again.deliveries, 2);
    let waited = began.elapsed();
    assert!(
        delay * 2 / 3 < waited && waited < PATIENCE / 2,
        "{waited:?}"
    );
}

async fn a_frame_is_appended_behind_the_last_one_only(bus: Bus) {
    let appended = append(&bus, "a", 2).await;
    for behind in [Some(appended[0].0), None] {
        let refused = bus.append(&frame("a", 8, None), behind).await;
        assert!(matches!(refused, Err(BusError::Conflict)), "{refused:?}");
    }
    let (position, last) = bus.last("a").await.unwrap().unwrap();
    assert_eq!((position, last.seq), (appended[1].0, 2));
    // Another stream begins for itself, and one of the same name behind the first.
    append(&bus, "b", 1).await;
    let anew = Frame {
        instance: 7,
        ..frame("a", 0, None)
    };
    bus.append(&anew, Some(position)).await.unwrap();
    assert_eq!(bus.last("a").await.unwrap().unwrap().1.instance, 7);
}

async fn the_same_frame_is_stored_once(bus: Bus) {
    let appended = append(&bus, "a", 2).await;
    let behind = Some(appended[0].0);
    let again = bus.append(&appended[1].1, behind).await.unwrap();
    assert_eq!(again, appended[1].0);
    assert_eq!(bus.waiting().await, Some(2));
    // One that another gateway gave the same number is another one.
    let other = Frame {
        received_us: 7,
        ..appended[1].1.clone()
    };
    let refused = bus.append(&other, behind).await;
    assert!(matches!(refused, Err(BusError::Conflict)), "{refused:?}");
}

async fn frames_are_shared_among_workers(bus: Bus) {
    append(&bus, "a", 20).await;
    let worker = async |bus: Bus| {
        let mut seqs = Vec::new();
        while seqs.len() < 10 {
            let job = pull(&bus).await;
            seqs.push(job.frame.seq);
            job.done().await.unwrap();
        }
        seqs
    };
    let (first, second) = tokio::join!(worker(bus.clone()), worker(bus.clone()));
    let all: BTreeSet<_> = first.iter().chain(&second).copied().collect();
    assert_eq!(all, (0..20).map(|index| index * 2).collect());
}

async fn a_predecessor_is_there_until_it_is_forgotten(bus: Bus) {
    let appended = append(&bus, "a", 2).await;
    let job = pull(&bus).await;
    job.done().await.unwrap();
    let (position, first) = &appended[0];
    assert_eq!(bus.frame(*position).await.unwrap().as_ref(), Some(first));
    bus.forget(*position).await.unwrap();
    assert_eq!(bus.frame(*position).await.unwrap(), None);
    // It can be forgotten twice, and the one behind it is not.
    bus.forget(*position).await.unwrap();
    assert_eq!(pull(&bus).await.frame, appended[1].1);
    append_after(&bus, &appended[1]).await;
}

async fn each_outcome_is_heard_once_and_in_order(bus: Bus) {
    let mut outcomes = bus.outcomes().await.unwrap();
    for seq in [0, 1, 1, 2] {
        bus.publish(&processed("a", seq)).await.unwrap();
    }
    let lost = Processed {
        outcome: Outcome::Lost(DropReason::Overload),
        ..processed("a", 3)
    };
    bus.publish(&lost).await.unwrap();
    for seq in 0..3 {
        let heard = timeout(PATIENCE, outcomes.next()).await.unwrap();
        assert_eq!(heard, processed("a", seq));
    }
    assert_eq!(timeout(PATIENCE, outcomes.next()).await.unwrap(), lost);
}

async fn whoever_comes_late_hears_the_last_outcome_of_each_stream(bus: Bus) {
    for (stream, seq) in [("a", 0), ("b", 7), ("a", 1)] {
        bus.publish(&processed(stream, seq)).await.unwrap();
    }
    let mut outcomes = bus.outcomes().await.unwrap();
    let mut heard = Vec::new();
    for _ in 0..2 {
        let outcome = timeout(PATIENCE, outcomes.next()).await.unwrap();
        heard.push((outcome.stream, outcome.seq));
    }
    heard.sort();
    assert_eq!(heard, [("a".to_owned(), 1), ("b".to_owned(), 7)]);
    bus.publish(&processed("b", 8)).await.unwrap();
    assert_eq!(timeout(PATIENCE, outcomes.next()).await.unwrap().seq, 8);
}

async fn records_are_heard_by_everybody_and_the_latest_by_who_comes_late(bus: Bus) {
    let record = |faces| StreamRecord {
        instance: 1,
        revision: faces as u64,
        config: StreamConfig {
            target_faces: Some(faces),
            ..StreamConfig::default()
        },
        ended: None,
    };
    let mut early = bus.records().await.unwrap();
    for faces in [100, 200] {
        bus.announce("a", &record(faces)).await.unwrap();
    }
    // One that comes late is not heard.
    bus.announce("a", &record(150)).await.unwrap();
    loop {
        let heard = timeout(PATIENCE, early.next()).await.unwrap();
        if heard == ("a".to_owned(), record(200)) {
            break;
        }
        assert_eq!(heard, ("a".to_owned(), record(100)));
    }
    let heard = timeout(PATIENCE, bus.records().await.unwrap().next())
        .await
        .unwrap();
    assert_eq!(heard, ("a".to_owned(), record(200)));
}

async fn a_stream_begins_once(bus: Bus) {
    let record = |instance, ended| StreamRecord {
        instance,
        revision: 1,
        config: StreamConfig::default(),
        ended,
    };
    bus.begin("a", &record(1, None)).await.unwrap();
    bus.begin("a", &record(1, None)).await.unwrap();
    let refused = bus.begin("a", &record(2, None)).await;
    assert!(matches!(refused, Err(BusError::Conflict)), "{refused:?}");
    bus.begin("b", &record(2, None)).await.unwrap();
    let ended = record(1, Some(EndReason::Deleted));
    bus.announce("a", &ended).await.unwrap();
    bus.begin("a", &record(2, None)).await.unwrap();
}

async fn an_empty_log_has_no_last_frame(bus: Bus) {
    assert!(bus.last("a").await.unwrap().is_none());
    assert_eq!(bus.frame(Position(1)).await.unwrap(), None);
    assert_eq!(bus.waiting().await, Some(0));
}

#[tokio::test]
async fn a_body_that_is_larger_than_a_message_goes_by_reference() {
    let nats = Nats::start();
    let bus = nats.bus().await;
    let large = Frame {
        body: Bytes::from(vec![7; 3 << 20]),
        ..frame("a", 0, None)
    };
    let position = bus.append(&large, None).await.unwrap();
    let job = pull(&bus).await;
    assert_eq!(job.frame, large);
    assert_eq!(bus.frame(position).await.unwrap(), Some(large.clone()));
    let result = Processed {
        outcome: Outcome::Delivered(large.body),
        ..processed("a", 0)
    };
    let mut outcomes = bus.outcomes().await.unwrap();
    bus.publish(&result).await.unwrap();
    assert_eq!(timeout(PATIENCE, outcomes.next()).await.unwrap(), result);
}

#[tokio::test]
async fn nothing_that_was_stored_is_lost_when_the_server_is_killed() {
    let mut nats = Nats::start();
    let bus = nats.bus().await;
    let mut outcomes = bus.outcomes().await.unwrap();
    let appended = append(&bus, "a", 3).await;
    bus.publish(&processed("a", 0)).await.unwrap();
    assert_eq!(timeout(PATIENCE, outcomes.next()).await.unwrap().seq, 0);
    nats.kill();
    let refused = bus.append(&frame("b", 0, None), None).await;
    assert!(
        matches!(refused, Err(BusError::Unavailable(_))),
        "{refused:?}"
    );
    assert!(!bus.is_connected());
    nats.restart();
    let connected = async {
        while !bus.is_connected() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    timeout(PATIENCE, connected).await.unwrap();
    for (_, frame) in &appended {
        let job = loop {
            match bus.pull().await {
                Ok(Some(job)) => break job,
                Ok(None) | Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
            }
        };
        assert_eq!(&job.frame, frame);
        job.done().await.unwrap();
    }
    bus.publish(&processed("a", 1)).await.unwrap();
    assert_eq!(timeout(PATIENCE, outcomes.next()).await.unwrap().seq, 1);
}

#[tokio::test]
async fn a_full_log_refuses_and_loses_nothing() {
    let nats = Nats::start();
    let options = Options {
        max_bytes: 1 << 20,
        ..nats.options()
    };
    let bus = Bus::jet_stream(options).await.unwrap();
    let mut predecessor: Option<Predecessor> = None;
    for seq in 0.. {
        let large = Frame {
            body: Bytes::from(vec![1; 200_000]),
            ..frame("a", seq, predecessor)
        };
        let behind = predecessor.map(|before| before.position);
        match bus.append(&large, behind).await {
            Ok(position) => predecessor = Some(Predecessor { position, seq }),
            Err(BusError::Full) => {
                assert_eq!(seq, 5);
                break;
            }
            Err(error) => panic!("{error}"),
        }
    }
    let first = pull(&bus).await;
    assert_eq!(first.frame.seq, 0);
}

#[tokio::test]
async fn a_server_that_has_lost_everything_is_begun_anew_with() {
    let mut nats = Nats::start();
    let bus = nats.bus().await;
    let mut outcomes = bus.outcomes().await.unwrap();
    for seq in 0..5 {
        bus.publish(&processed("a", seq)).await.unwrap();
        assert_eq!(timeout(PATIENCE, outcomes.next()).await.unwrap().seq, seq);
    }
    let appended = append(&bus, "a", 3).await;
    nats.kill();
    nats.restart_empty();
    let position = timeout(PATIENCE, async {
        loop {
            let behind = bus.last("a").await.ok().flatten();
            let behind = behind.map(|(position, _)| position);
            match bus.append(&appended[2].1, behind).await {
                Ok(position) => return position,
                Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
            }
        }
    })
    .await
    .unwrap();
    assert_eq!(pull(&bus).await.position, position);
    // Whoever listened before hears what comes now, although it is counted from 1 again.
    bus.publish(&processed("a", 5)).await.unwrap();
    assert_eq!(timeout(PATIENCE, outcomes.next()).await.unwrap().seq, 5);
}
