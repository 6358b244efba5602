//! Whatever publishers and players do in whatever order, a stream's promises hold.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use proptest::prelude::*;
use steadymesh::compute::ComputePool;
use steadymesh::config::Config;
use steadymesh::streams::{
    Delivery, Outcome, Publication, Refused, Registry, Seat, Session, Stream, StreamName,
    Submission, Subscription, Ticket,
};
use steadymesh::telemetry::Telemetry;
use steadymesh_mesh_io::Format;
use steadymesh_proto::NativeFrame;
use steadymesh_proto::metrics::Tracking;
use steadymesh_proto::stream::{EndReason, Overload, StreamConfig};

/// What somebody does.
#[derive(Debug, Clone)]
enum Step {
    /// A frame by the connected publisher if there is one, else by POST; its number relative to
    /// the highest one so far.
    Send {
        offset: Option<i64>,
    },
    /// A frame by POST whoever is connected.
    Post {
        takeover: bool,
    },
    /// A body that is not a mesh.
    SendGarbage,
    Connect {
        takeover: bool,
    },
    Vanish,
    Return,
    Leave,
    Join,
    Quit,
    Read,
    Configure {
        live: bool,
        tracking: Tracking,
    },
    /// Waits until all that was sent has been answered and come out.
    Settle,
}

fn step() -> impl Strategy<Value = Step> {
    let tracking = prop_oneof![
        Just(Tracking::Off),
        Just(Tracking::Paper),
        Just(Tracking::Robust)
    ];
    prop_oneof![
        12 => proptest::option::of(-2i64..4).prop_map(|offset| Step::Send { offset }),
        2 => any::<bool>().prop_map(|takeover| Step::Post { takeover }),
        1 => Just(Step::SendGarbage),
        1 => any::<bool>().prop_map(|takeover| Step::Connect { takeover }),
        1 => Just(Step::Vanish),
        1 => Just(Step::Return),
        1 => Just(Step::Leave),
        2 => Just(Step::Join),
        1 => Just(Step::Quit),
        3 => Just(Step::Read),
        1 => (any::<bool>(), tracking)
            .prop_map(|(live, tracking)| Step::Configure { live, tracking }),
        1 => Just(Step::Settle),
    ]
}

/// How a case goes on to its end.
#[derive(Debug, Clone, Copy)]
enum End {
    Delete,
    Drain,
}

/// A figure of twenty faces, larger with every frame.
fn body(index: u64) -> Vec<u8> {
    let size = 1.0 + 0.01 * (index % 10) as f32;
    let ring = (0..10).map(|i| {
        let angle = std::f32::consts::TAU * i as f32 / 10.0;
        [size * angle.cos(), size * angle.sin(), 0.0]
    });
    let positions = ring.chain([[0.0, 0.0, size], [0.0, 0.0, -size]]).collect();
    let above = (0..10).map(|i| [10, i, (i + 1) % 10]);
    let below = (0..10).map(|i| [11, (i + 1) % 10, i]);
    let native = NativeFrame {
        positions,
        faces: above.chain(below).collect(),
        ..NativeFrame::default()
    };
    native.encode()
}

fn submission(seq: Option<u64>, body: Vec<u8>) -> Submission {
    Submission {
        bytes: body.into(),
        format: Format::Native,
        seq,
        capture_time_us: None,
        arrived: Instant::now(),
    }
}

/// A player, and what it has seen.
struct Player {
    _seat: Seat,
    subscription: Subscription,
    seen: Vec<u64>,
    missed: u64,
}

impl Player {
    fn take(&mut self, delivery: &Delivery) -> Option<EndReason> {
        match delivery {
            Delivery::Frame(frame) => {
                assert!(
                    self.seen.last() < Some(&frame.metrics.seq),
                    "{:?}",
                    self.seen
                );
                self.seen.push(frame.metrics.seq);
            }
            Delivery::Skipped(missed) => self.missed += missed,
            Delivery::End(reason) => return Some(*reason),
        }
        None
    }
}

struct Case {
    registry: Registry,
    stream: Arc<Stream>,
    name: StreamName,
    publication: Option<Publication>,
    last_session: Option<Session>,
    /// Whether others are kept out.
    held: bool,
    tickets: Vec<Ticket>,
    accepted: Vec<u64>,
    highest: u64,
    sent: u64,
    players: Vec<Player>,
}

impl Case {
    fn new(queue_depth: usize, history: usize) -> Self {
        let mut config = Config::default();
        config.compute.threads = 2;
        config.streams.queue_depth = queue_depth;
        config.streams.history = history;
        config.streams.subscriber_queue = 5;
        config.streams.linger_secs = 3600;
        config.streams.defaults.target_faces = Some(10);
        let pool = Arc::new(ComputePool::new(config.compute()).unwrap());
        let telemetry = Arc::new(Telemetry::new().unwrap());
        let registry = Registry::new(config.streams(), pool, telemetry, None, None).unwrap();
        let name = StreamName::parse("demo").unwrap();
        let (stream, is_new) = registry.configure(&name, &StreamConfig::default()).unwrap();
        assert!(is_new);
        Self {
            registry,
            stream,
            name,
            publication: None,
            last_session: None,
            held: false,
            tickets: Vec::new(),
            accepted: Vec::new(),
            highest: 0,
            sent: 0,
            players: Vec::new(),
        }
    }

    async fn apply(&mut self, step: &Step) {
        match *step {
            Step::Send { offset } => {
                let seq = offset.map(|offset| self.highest.saturating_add_signed(offset));
                self.highest = self.highest.max(seq.unwrap_or(0));
                let body = body(self.sent);
                self.send(seq, body);
            }
            Step::SendGarbage => self.send(None, b"not a mesh".to_vec()),
            Step::Post { takeover } => {
                let place = self.stream.reserve(takeover);
                let occupied = matches!(place, Err(Refused::Occupied(_)));
                assert_eq!(occupied, self.held && !takeover);
                if !occupied {
                    self.held = false;
                }
            }
            Step::Connect { takeover } => {
                self.sent += 1;
                let session = Session::new(u128::from(self.sent).to_le_bytes());
                self.connect(session, takeover, self.held && !takeover);
            }
            Step::Return => {
                if let Some(session) = self.last_session.clone() {
                    self.connect(session, false, false);
                }
            }
            Step::Vanish => drop(self.publication.take()),
            Step::Leave => {
                if let Some(publication) = self.publication.take() {
                    publication.end();
                    self.held = false;
                }
            }
            Step::Join => {
                let seat = self.stream.take_seat(100).unwrap();
                self.players.push(Player {
                    subscription: seat.subscribe(),
                    _seat: seat,
                    seen: Vec::new(),
                    missed: 0,
                });
            }
            Step::Quit => drop(self.players.pop()),
            Step::Read => {
                for player in self.players.iter_mut().step_by(2) {
                    while let Some(delivery) = player.subscription.next_if_there() {
                        assert_eq!(player.take(&delivery), None);
                    }
                }
            }
            Step::Configure { live, tracking } => {
                let config = StreamConfig {
                    overload: Some(if live {
                        Overload::Live
                    } else {
                        Overload::Lossless
                    }),
                    tracking: Some(tracking),
                    ..StreamConfig::default()
                };
                self.registry.configure(&self.name, &config).unwrap();
            }
            Step::Settle => self.settle().await,
        }
    }

    fn connect(&mut self, session: Session, takeover: bool, is_refused: bool) {
        match self.stream.publish(session.clone(), takeover) {
            Ok(publication) => {
                assert!(!is_refused);
                self.publication = Some(publication);
                self.last_session = Some(session);
                self.held = true;
            }
            Err(_) => assert!(self.held),
        }
    }

    fn send(&mut self, seq: Option<u64>, body: Vec<u8>) {
        self.sent += 1;
        let place = match &self.publication {
            Some(publication) => publication.reserve(),
            None => self.stream.reserve(false),
        };
        let place = match place {
            Ok(place) => place,
            Err(Refused::QueueFull) => return,
            Err(Refused::Occupied(_)) => {
                assert!(self.held && self.publication.is_none());
                return;
            }
            Err(refused) => panic!("{refused}"),
        };
        self.tickets
            .push(place.submit(submission(seq, body)).unwrap());
    }

    /// Every frame has one answer, and every accepted one an outcome; numbers ascend.
    async fn settle(&mut self) {
        for ticket in std::mem::take(&mut self.tickets) {
            let latest = self.accepted.last().copied();
            match ticket.accepted().await {
                Ok(accepted) if accepted.duplicate => assert_eq!(Some(accepted.seq), latest),
                Ok(accepted) => {
                    assert!(
                        latest < Some(accepted.seq),
                        "{latest:?} before {accepted:?}"
                    );
                    self.accepted.push(accepted.seq);
                }
                Err(Refused::SeqGoesBack {
                    seq,
                    latest: newest,
                }) => {
                    assert_eq!(Some(newest), latest);
                    assert!(seq < newest);
                }
                Err(Refused::NotAFrame(_)) => {}
                Err(refused) => panic!("{refused}"),
            }
        }
        self.highest = self.highest.max(self.accepted.last().copied().unwrap_or(0));
        if let Some(&last) = self.accepted.last() {
            self.stream.outcome(last).await;
            assert_eq!(self.stream.latest_accepted(), Some(last));
        }
        let summary = self.stream.summary();
        let counters = summary.counters;
        assert_eq!(counters.received, self.accepted.len() as u64);
        assert_eq!(counters.published + counters.dropped, counters.received);
        assert_eq!(
            (summary.queued, summary.subscribers),
            (0, self.players.len())
        );
    }

    async fn end(mut self, end: End, history: usize) {
        self.settle().await;
        // What the stream still remembers, in order.
        let remembered = &self.accepted[self.accepted.len().saturating_sub(history)..];
        let published: Vec<u64> = remembered
            .iter()
            .copied()
            .filter(|&seq| matches!(self.stream.find(seq), Some(Outcome::Delivered(_))))
            .collect();
        let all = self.stream.summary().counters.published;
        let reason = match end {
            End::Delete => {
                assert!(self.registry.delete(&self.name));
                EndReason::Deleted
            }
            End::Drain => {
                self.registry.shut_down(Duration::from_secs(60)).await;
                EndReason::Shutdown
            }
        };
        assert_eq!(self.stream.ended().await, reason);
        for player in &mut self.players {
            let found = loop {
                let delivery = player.subscription.next().await;
                if let Some(reason) = player.take(&delivery) {
                    break reason;
                }
            };
            assert_eq!(found, reason);
            assert_eq!(
                player.seen.last(),
                published.last(),
                "the newest comes last"
            );
            assert!(player.seen.len() as u64 + player.missed <= all);
            if let Some(first) = player.seen.first()
                && let Some(at) = published.iter().position(|seq| seq == first)
            {
                let since = (published.len() - at) as u64;
                assert_eq!(player.seen.len() as u64 + player.missed, since);
            }
        }
        assert!(self.registry.get(&self.name).is_none());
        // The last ones through the door are told so, too.
        if let Ok(place) = self.stream.reserve(true)
            && let Ok(ticket) = place.submit(submission(None, body(0)))
        {
            assert!(matches!(ticket.accepted().await, Err(Refused::Ended)));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_stream_keeps_its_promises_in_any_order_of_events(
        steps in proptest::collection::vec(step(), 1..80),
        queue_depth in 1usize..6,
        history in prop_oneof![Just(3usize), Just(300)],
        end in prop_oneof![Just(End::Delete), Just(End::Drain)],
    ) {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build()
            .unwrap();
        runtime.block_on(async {
            let run = async {
                let mut case = Case::new(queue_depth, history);
                for step in &steps {
                    case.apply(step).await;
                }
                case.end(end, history).await;
            };
            let limit = Duration::from_secs(60);
            assert!(tokio::time::timeout(limit, run).await.is_ok(), "it hangs");
        });
    }
}
