//! Writes one track of a recording, segment by segment.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use object_store::{ObjectStoreExt, PutPayload};
use steadymesh_proto::recording::{Gap, RecordedFrame, Track, TrackSummary};
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::time::{Instant, sleep, sleep_until, timeout};

use super::index::{Page, Segment, add};
use super::layout::Part;
use super::recorder::Shared;
use super::segment::Builder;

const FIRST_RETRY: Duration = Duration::from_millis(100);
const MAX_RETRY: Duration = Duration::from_secs(5);
/// An attempt that takes longer is begun anew.
const ATTEMPT: Duration = Duration::from_secs(30);

/// What a writer is handed.
#[derive(Debug)]
pub(super) struct Message {
    /// What is missing before it.
    pub gap: Option<Gap>,
    /// A frame with its body, and the room that it takes until it is stored.
    pub frame: Option<(RecordedFrame, Bytes, OwnedSemaphorePermit)>,
    pub at: Instant,
}

/// Collects frames into segments, and stores one after the other.
#[derive(Debug)]
pub(super) struct TrackWriter {
    shared: Arc<Shared>,
    track: Track,
    messages: mpsc::UnboundedReceiver<Message>,
    /// The first message of the next segment.
    next: Option<Message>,
    ordinal: u32,
    page: Vec<Segment>,
    summary: TrackSummary,
}

/// A segment that is complete, with the room that its frames take.
#[derive(Debug, Default)]
struct Collected {
    builder: Builder,
    _rooms: Vec<OwnedSemaphorePermit>,
}

impl TrackWriter {
    pub fn new(
        shared: Arc<Shared>,
        track: Track,
        messages: mpsc::UnboundedReceiver<Message>,
    ) -> Self {
        Self {
            shared,
            track,
            messages,
            next: None,
            ordinal: 0,
            page: Vec::new(),
            summary: TrackSummary::default(),
        }
    }

    /// Writes until no more frames come, and says what has been written.
    pub async fn run(mut self) -> (Track, TrackSummary) {
        while let Some(collected) = self.collect().await {
            self.store(collected).await;
        }
        (self.track, self.summary)
    }

    /// Waits for a segment's frames: those of one stretch of time, or fewer if they are large.
    /// None when no more come.
    async fn collect(&mut self) -> Option<Collected> {
        let first = match self.next.take() {
            Some(first) => first,
            None => self.messages.recv().await?,
        };
        let end = first.at + self.shared.options.segment;
        let mut collected = Collected::default();
        collected.push(first);
        while collected.builder.body_bytes() < self.shared.options.segment_bytes {
            tokio::select! {
                // First what is there already: after a pause of the store that is a lot.
                biased;
                message = self.messages.recv() => match message {
                    Some(message) if message.at < end => collected.push(message),
                    Some(message) => {
                        self.next = Some(message);
                        break;
                    }
                    None => break,
                },
                () = sleep_until(end) => break,
            }
        }
        Some(collected)
    }

    /// Stores a segment, then says so in the index.
    async fn store(&mut self, collected: Collected) {
        let (pieces, footer) = collected.builder.finish();
        let length = pieces.iter().map(|piece| piece.len() as u64).sum();
        let segment = Segment::new(self.ordinal, length, &footer);
        let shared = Arc::clone(&self.shared);
        let path = shared
            .layout
            .object(&shared.key, Part::Segment(self.track, self.ordinal));
        let payload: PutPayload = pieces.into_iter().collect();
        let put = || async {
            shared.ensure_manifest().await?;
            shared.store.objects.put(&path, payload.clone()).await?;
            Ok(())
        };
        if !persist(&shared, put).await {
            self.give_up(&segment);
            return;
        }
        shared.count_stored(self.track, segment.frames, segment.bytes);
        add(&mut self.summary, &segment);
        if let Some(last) = self.page.last()
            && Page::of(last.ordinal) != Page::of(self.ordinal)
        {
            self.page.clear();
        }
        self.page.push(segment);
        self.write_page().await;
        // A recording of four billion segments is a century long.
        self.ordinal += 1;
    }

    async fn write_page(&self) {
        let shared = &self.shared;
        let page = Page::of(self.ordinal);
        let path = shared
            .layout
            .object(&shared.key, Part::Page(self.track, page));
        // Names and numbers, which always serialize.
        let text = serde_json::to_vec(&Page::new(self.page.clone())).unwrap_or_default();
        let payload = PutPayload::from(text);
        let put = || async {
            shared.store.objects.put(&path, payload.clone()).await?;
            Ok(())
        };
        // If there is no time for it, readers find the segment without it.
        persist(shared, put).await;
    }

    /// There is no time left to store a segment.
    fn give_up(&mut self, segment: &Segment) {
        self.shared.count_lost(self.track, segment.frames);
        let seqs = segment.first_seq.zip(segment.last_seq);
        self.summary.gaps.extend_from_slice(&segment.gaps);
        self.summary
            .gaps
            .extend(seqs.map(|(first_seq, last_seq)| Gap {
                first_seq,
                last_seq,
                frames: segment.frames,
            }));
        tracing::error!(
            stream = %self.shared.key.stream, recording = %self.shared.key.id,
            frames = segment.frames, "the last frames of the recording could not be written"
        );
    }
}

impl Collected {
    fn push(&mut self, message: Message) {
        if let Some(gap) = message.gap {
            self.builder.push_gap(gap);
        }
        if let Some((frame, body, room)) = message.frame {
            self.builder.push(frame, body);
            self._rooms.push(room);
        }
    }
}

/// Tries until it works; false if the recording is given up before.
pub(super) async fn persist<F>(shared: &Shared, attempt: impl Fn() -> F) -> bool
where
    F: Future<Output = Result<(), object_store::Error>>,
{
    let mut delay = FIRST_RETRY;
    let tries = async {
        loop {
            let error = match timeout(ATTEMPT, attempt()).await {
                Ok(Ok(())) => return,
                Ok(Err(error)) => error,
                Err(_) => object_store::Error::Generic {
                    store: "recordings",
                    source: format!("no answer within {} s", ATTEMPT.as_secs()).into(),
                },
            };
            shared.fails(&error);
            sleep(delay).await;
            delay = (delay * 2).min(MAX_RETRY);
        }
    };
    tokio::select! {
        () = tries => {
            shared.works();
            true
        }
        () = shared.give_up.cancelled() => false,
    }
}
