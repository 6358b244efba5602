//! A recording's life: written, read, interrupted, damaged, taken away.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use steadymesh_proto::recording::{Record, RecordingEnd, RecordingState, RecordingSummary, Track};
use steadymesh_proto::stream::StreamConfig;
use tempfile::TempDir;
use url::Url;

use super::{Options, RawFrame, ReadFailed, Recorder, Recording, Recordings, Start};
use crate::telemetry::Telemetry;

struct Place {
    recordings: Arc<Recordings>,
    /// Where they are kept.
    folder: PathBuf,
    _parent: TempDir,
}

fn place(change: impl FnOnce(&mut Options)) -> Place {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("recordings");
    let mut options = Options {
        url: Url::from_directory_path(&folder).unwrap(),
        segment: Duration::from_millis(100),
        segment_bytes: 1 << 20,
        queue_bytes: 64 << 10,
        max_age: None,
        max_bytes: None,
        sweep_interval: Duration::from_secs(60),
        farewell: Duration::from_secs(5),
    };
    change(&mut options);
    let recordings = Recordings::open(options, Arc::new(Telemetry::new().unwrap())).unwrap();
    Place {
        recordings: Arc::new(recordings),
        folder,
        _parent: parent,
    }
}

impl Place {
    fn record(&self) -> Recorder {
        let config = StreamConfig::default();
        self.recordings.record("rig", Record::Raw, &config)
    }

    async fn one(&self) -> Arc<Recording> {
        let summary = self.summary().await;
        let key = super::RecordingKey {
            stream: summary.stream,
            id: summary.id,
        };
        self.recordings.find(&key).await.unwrap()
    }

    async fn summary(&self) -> RecordingSummary {
        let listed = self.recordings.list(Some("rig")).await.unwrap();
        assert_eq!(listed.len(), 1);
        listed.into_iter().next().unwrap()
    }

    /// Every file whose name ends so, in order.
    fn files(&self, end: &str) -> Vec<PathBuf> {
        fn walk(folder: &Path, end: &str, found: &mut Vec<PathBuf>) {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    walk(&path, end, found);
                } else if path.to_string_lossy().ends_with(end) {
                    found.push(path);
                }
            }
        }
        let mut found = Vec::new();
        walk(&self.folder, end, &mut found);
        found.sort();
        found
    }
}

fn body(seq: u64) -> Bytes {
    Bytes::from(format!("frame {seq} ").repeat(150))
}

fn send(recorder: &Recorder, seq: u64) {
    recorder.raw(RawFrame {
        seq,
        capture_time_us: Some(seq * 33_333),
        content_type: "model/ply",
        body: body(seq),
    });
}

async fn end(recorder: &Recorder) {
    recorder.finish(RecordingEnd::Deleted);
    recorder.finished().await;
}

/// Segments of two frames each.
async fn record_frames(place: &Place, count: u64) {
    let recorder = place.record();
    for seq in 0..count {
        send(&recorder, seq);
        if !seq.is_multiple_of(2) {
            tokio::time::sleep(Duration::from_millis(130)).await;
        }
    }
    end(&recorder).await;
}

async fn seqs(recording: &Arc<Recording>, start: Start) -> Vec<u64> {
    let mut cursor = recording.cursor(Track::Raw, start).unwrap();
    let mut seqs = Vec::new();
    loop {
        match cursor.next().await {
            Ok(Some(frame)) => {
                assert_eq!(frame.body, body(frame.frame.seq));
                seqs.push(frame.frame.seq);
            }
            Ok(None) => return seqs,
            Err(ReadFailed::Damaged { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
}

#[tokio::test]
async fn what_was_recorded_is_read_again() {
    let place = place(|_| {});
    record_frames(&place, 6).await;
    let summary = place.summary().await;
    assert_eq!(summary.state, RecordingState::Complete);
    let raw = summary.raw.unwrap();
    assert_eq!(
        (raw.frames, raw.first_seq, raw.last_seq),
        (6, Some(0), Some(5))
    );
    assert!(3 <= raw.segments && raw.gaps.is_empty(), "{raw:?}");
    assert_eq!(summary.output, None);

    let recording = place.one().await;
    assert_eq!(seqs(&recording, Start::Seq(0)).await, [0, 1, 2, 3, 4, 5]);
    assert_eq!(seqs(&recording, Start::Seq(4)).await, [4, 5]);
    assert_eq!(
        seqs(&recording, Start::Time(2 * 33_333 + 1)).await,
        [3, 4, 5]
    );
    let frame = recording.frame(Track::Raw, 3).await.unwrap();
    assert_eq!(
        (frame.body, frame.frame.capture_time_us),
        (body(3), Some(99_999))
    );
    assert!(recording.frame(Track::Raw, 6).await.is_err());
    assert!(recording.cursor(Track::Output, Start::Seq(0)).is_err());
    let (frames, more) = recording
        .frames(Track::Raw, Start::Seq(1), 3)
        .await
        .unwrap();
    assert_eq!(
        frames.iter().map(|frame| frame.seq).collect::<Vec<_>>(),
        [1, 2, 3]
    );
    assert!(more);
}

#[tokio::test]
async fn a_store_that_is_away_costs_a_gap_and_nothing_else() {
    let place = place(|_| {});
    let recorder = place.record();
    send(&recorder, 0);
    tokio::time::sleep(Duration::from_millis(400)).await;
    // A file where the folder was: nothing can be written.
    let aside = place.folder.with_extension("aside");
    std::fs::rename(&place.folder, &aside).unwrap();
    std::fs::write(&place.folder, b"").unwrap();
    // 64 KiB of room, 2 KiB a frame.
    for seq in 1..=100 {
        send(&recorder, seq);
    }
    tokio::time::sleep(Duration::from_millis(400)).await;
    let status = recorder.status();
    assert_eq!((status.frames, status.lost_frames), (1, 68));
    assert!(status.failing.is_some());

    std::fs::remove_file(&place.folder).unwrap();
    std::fs::rename(&aside, &place.folder).unwrap();
    for _ in 0..100 {
        if recorder.status().failing.is_none() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    send(&recorder, 101);
    end(&recorder).await;
    assert_eq!(recorder.status().failing, None);
    let raw = place.summary().await.raw.unwrap();
    let gap = raw.gaps[0];
    assert_eq!((gap.first_seq, gap.last_seq, gap.frames), (33, 100, 68));
    let read = seqs(&place.one().await, Start::Seq(0)).await;
    assert_eq!(read, (0..=32).chain([101]).collect::<Vec<_>>());
}

#[tokio::test]
async fn a_recording_that_cannot_be_ended_ends_all_the_same() {
    let place = place(|options| options.farewell = Duration::from_millis(300));
    std::fs::remove_dir(&place.folder).unwrap();
    std::fs::write(&place.folder, b"").unwrap();
    let recorder = place.record();
    send(&recorder, 0);
    recorder.finish(RecordingEnd::Shutdown);
    let patience = Duration::from_secs(3);
    tokio::time::timeout(patience, recorder.finished())
        .await
        .unwrap();
    assert_eq!(recorder.status().lost_frames, 1);
}

#[tokio::test]
async fn a_writer_killed_before_the_index_was_written_loses_nothing() {
    let place = place(|_| {});
    record_frames(&place, 4).await;
    // As it looks then: no end, and an index that is behind.
    for path in place.files(".index.json") {
        std::fs::remove_file(path).unwrap();
    }
    let manifest = &place.files("recording.json")[0];
    let mut text: serde_json::Value =
        serde_json::from_slice(&std::fs::read(manifest).unwrap()).unwrap();
    text.as_object_mut().unwrap().remove("end");
    std::fs::write(manifest, text.to_string()).unwrap();

    let summary = place.summary().await;
    assert_eq!(summary.state, RecordingState::Interrupted);
    assert_eq!(summary.raw.unwrap().frames, 4);
    assert_eq!(seqs(&place.one().await, Start::Seq(0)).await, [0, 1, 2, 3]);

    // Nobody comes back to it: it is closed.
    let later = SystemTime::now() + Duration::from_secs(3600);
    place.recordings.sweep(later).await.unwrap();
    let text = std::fs::read_to_string(manifest).unwrap();
    assert!(text.contains("\"end\""), "{text}");
    assert_eq!(place.summary().await.state, RecordingState::Interrupted);
}

#[tokio::test]
async fn what_is_damaged_is_named_and_the_rest_is_read() {
    let place = place(|_| {});
    record_frames(&place, 6).await;
    let segments = place.files(".segment");
    let mut bytes = std::fs::read(&segments[1]).unwrap();
    // Within the body of the segment's first frame, number 2.
    bytes[20] ^= 1;
    std::fs::write(&segments[1], bytes).unwrap();
    let recording = place.one().await;
    assert_eq!(seqs(&recording, Start::Seq(0)).await, [0, 1, 3, 4, 5]);
    let error = recording
        .frame(Track::Raw, 2)
        .await
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("00000001.segment is damaged: frame 2"),
        "{error}"
    );
}

#[tokio::test]
async fn what_is_too_old_is_taken_away_as_a_whole() {
    let place = place(|options| options.max_age = Some(Duration::from_secs(60)));
    record_frames(&place, 4).await;
    place.recordings.sweep(SystemTime::now()).await.unwrap();
    assert_eq!(place.summary().await.raw.unwrap().frames, 4);
    let later = SystemTime::now() + Duration::from_secs(120);
    place.recordings.sweep(later).await.unwrap();
    assert!(place.recordings.list(None).await.unwrap().is_empty());
    assert!(place.files("").is_empty());
}

#[tokio::test]
async fn a_recording_can_be_deleted_once_it_is_over() {
    let place = place(|_| {});
    let recorder = place.record();
    send(&recorder, 0);
    tokio::time::sleep(Duration::from_millis(300)).await;
    let key = recorder.key().clone();
    assert_eq!(place.summary().await.state, RecordingState::Recording);
    let refused = place.recordings.delete(&key).await;
    assert!(matches!(refused, Err(ReadFailed::GoesOn)));
    end(&recorder).await;
    // Whoever waits for the end is told at the same time.
    tokio::time::sleep(Duration::from_millis(50)).await;
    place.recordings.delete(&key).await.unwrap();
    assert!(place.files("").is_empty());
    let refused = place.recordings.delete(&key).await;
    assert!(matches!(refused, Err(ReadFailed::NoRecording { .. })));
}

#[tokio::test]
async fn what_a_killed_server_had_begun_to_write_is_removed() {
    let place = place(|_| {});
    let staged = place.folder.join("rig/00000003.segment#1");
    std::fs::create_dir_all(staged.parent().unwrap()).unwrap();
    std::fs::write(&staged, b"half").unwrap();
    place.recordings.sweep(SystemTime::now()).await.unwrap();
    assert!(staged.exists(), "it may be being written");
    let later = SystemTime::now() + Duration::from_secs(3600);
    place.recordings.sweep(later).await.unwrap();
    assert!(!staged.exists());
}

#[tokio::test]
async fn what_another_server_is_writing_stays() {
    let place = place(|options| options.max_bytes = Some(1));
    let recorder = place.record();
    send(&recorder, 0);
    tokio::time::sleep(Duration::from_millis(300)).await;
    // Another server with the same folder.
    let options = (*place.recordings.options).clone();
    let other = Recordings::open(options, Arc::new(Telemetry::new().unwrap())).unwrap();
    other.sweep(SystemTime::now()).await.unwrap();
    assert_eq!(place.files(".segment").len(), 1);
    end(&recorder).await;
    other.sweep(SystemTime::now()).await.unwrap();
    assert!(place.files("").is_empty());
}
