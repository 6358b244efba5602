//! A stream's configuration and state, as the HTTP interface gives and takes them.

use serde::{Deserialize, Serialize};

use crate::metrics::Tracking;
use crate::recording::Record;

/// How a stream's frames are processed: the body of `PUT /v1/streams/{stream}`.
///
/// What is left out has the default. Exactly one of the two targets may be given.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StreamConfig {
    /// How many faces each frame is to have.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_faces: Option<usize>,
    /// Which share of its faces each frame is to keep, above 0 and at most 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_ratio: Option<f64>,
    /// Whether the previous frame takes part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracking: Option<Tracking>,
    /// How strongly `robust` tracking holds a frame to the one before, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracking_strength: Option<f64>,
    /// How much attributes count in the simplification beside the shape, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attribute_weight: Option<f64>,
    /// How the simplified mesh is compressed.
    #[serde(default, skip_serializing_if = "DracoConfig::is_default")]
    pub draco: DracoConfig,
    /// What becomes of the images that come with frames.
    #[serde(default, skip_serializing_if = "TextureConfig::is_default")]
    pub texture: TextureConfig,
    /// Whether distances are measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metrics: Option<MetricsMode>,
    /// What happens when frames come faster than they are processed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overload: Option<Overload>,
    /// What is recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record: Option<Record>,
}

/// How the simplified mesh is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DracoConfig {
    /// Bits per coordinate over the largest extent of the bounding box, 6 to 20.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_bits: Option<u8>,
    /// 0 (smallest) to 10 (fastest, several times larger).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<u8>,
    /// Bits of a texture coordinate, 6 to 20.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture_coordinate_bits: Option<u8>,
    /// Bits of a normal, 6 to 16.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_bits: Option<u8>,
}

/// What becomes of the images that come with frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TextureConfig {
    /// In which format they are delivered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<TextureFormat>,
    /// The quality of a JPEG that the server makes, 1 to 100.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<u8>,
    /// The largest width and height, 16 to 16,384; larger images are made smaller.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_size: Option<u32>,
}

impl TextureConfig {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// In which format images are delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TextureFormat {
    /// As they came, unless they are too large.
    #[default]
    Original,
    /// As JPEG.
    Jpeg,
    /// Not at all.
    None,
}

impl DracoConfig {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Whether distances are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MetricsMode {
    /// The distances of every vertex of every frame, which for that is registered even if tracking
    /// is `off`.
    #[default]
    Full,
    /// The surface distances of at most 1,000 vertices a frame and direction, evenly strided, and
    /// no vertex distances.
    Sampled,
    /// None; frames cost less.
    Off,
}

/// What happens when frames come faster than they are processed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Overload {
    /// The publisher is told to wait: 429 with `Retry-After`. No frame is lost.
    #[default]
    Lossless,
    /// The newest frame wins: the oldest waiting one is dropped and counted.
    Live,
}

/// A stream as `GET /v1/streams/{stream}` shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamSummary {
    /// Its name.
    pub stream: String,
    /// Whether frames have come lately.
    pub state: StreamState,
    /// Its configuration, defaults filled in.
    pub config: StreamConfig,
    /// Counts since it was created.
    pub counters: StreamCounters,
    /// Players connected at this moment.
    pub subscribers: usize,
    /// Frames accepted and not yet out.
    pub queued: usize,
    /// The number of the newest frame that is out; none before the first.
    pub latest_seq: Option<u64>,
    /// When it was created, in microseconds since 1970-01-01T00:00:00Z.
    pub created_us: u64,
    /// The recording that is being made of it; none if none is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordingStatus>,
}

/// A recording that is being made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingStatus {
    /// Its name: it is at `/v1/recordings/{stream}/{id}` once its first second is stored.
    pub id: String,
    /// Frames stored, of both tracks.
    pub frames: u64,
    /// Frames that could not be stored.
    pub lost_frames: u64,
    /// What is wrong with the storage at this moment; none if nothing is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failing: Option<String>,
}

/// Whether frames come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StreamState {
    /// A frame has come within the last seconds.
    Live,
    /// None has.
    Idle,
}

/// Counts since a stream was created.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct StreamCounters {
    /// Frames accepted.
    pub received: u64,
    /// Frames that came out.
    pub published: u64,
    /// Frames accepted that did not come out.
    pub dropped: u64,
    /// Frames refused, with a 4xx answer.
    pub rejected: u64,
    /// Bytes of the accepted frames.
    pub bytes_in: u64,
    /// Draco bytes of the frames that came out.
    pub bytes_out: u64,
}

/// The answer to `GET /v1/streams`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamList {
    /// All streams, by name.
    pub streams: Vec<StreamSummary>,
}

/// The answer to a frame that waits for its turn: 202.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Accepted {
    /// The frame's number.
    pub seq: u64,
    /// Frames of the stream that are not out yet, this one included.
    pub queued: usize,
    /// The frame had been sent before, and nothing was done.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub duplicate: bool,
}

/// A text message of `subscribe`, told apart by `type`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum ControlMessage {
    /// The first message of a connection.
    Hello {
        /// [`SUBPROTOCOL`](crate::SUBPROTOCOL).
        protocol: String,
        /// The stream's name.
        stream: String,
        /// The newest frame's number; none before the first.
        latest_seq: Option<u64>,
        /// The stream's configuration, defaults filled in.
        config: StreamConfig,
    },
    /// The reader was too slow, and some frames were left out before the next one.
    Skipped {
        /// How many.
        missed: u64,
    },
    /// Nothing more will come.
    End {
        /// Why.
        reason: EndReason,
    },
}

/// A text message of a publisher to the server, told apart by `type`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub enum PublisherMessage {
    /// About the next binary message.
    Frame {
        /// The frame's number.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seq: Option<u64>,
        /// When it was captured, in microseconds since 1970-01-01T00:00:00Z.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        capture_time_us: Option<u64>,
    },
}

/// A text message of the server to a publisher, told apart by `type`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum PublishReply {
    /// The first message of a connection.
    Welcome {
        /// [`SUBPROTOCOL`](crate::SUBPROTOCOL).
        protocol: String,
        /// The stream's name.
        stream: String,
        /// What a publisher whose connection breaks presents to come back.
        session: String,
        /// The newest number that the stream has accepted; none before the first.
        latest_seq: Option<u64>,
        /// As in [`PublishReply::Credit`].
        credit: u64,
        /// The stream's configuration, defaults filled in.
        config: StreamConfig,
    },
    /// Frames whose `message` is below this number may be sent.
    Credit {
        /// It never falls.
        credit: u64,
    },
    /// What became of a frame.
    Ack {
        /// Which one: frames of a connection are counted from 0.
        message: u64,
        /// Its state.
        #[serde(flatten)]
        state: FrameState,
    },
}

/// What became of a frame that came by WebSocket.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "lowercase")]
pub enum FrameState {
    /// It is a good one and has its place.
    Accepted {
        /// Its number.
        seq: u64,
    },
    /// It had its place before: nothing was done.
    Duplicate {
        /// Its number.
        seq: u64,
    },
    /// It is not taken.
    Rejected {
        /// Why.
        problem: Problem,
    },
    /// It is out.
    Published {
        /// Its number.
        seq: u64,
    },
    /// It was accepted and is not coming.
    Dropped {
        /// Its number.
        seq: u64,
        /// Why.
        reason: DropReason,
    },
}

/// Why a frame that was accepted is not coming.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DropReason {
    /// A newer frame took its place.
    Overload,
    /// A defect of the server.
    Failed,
    /// The stream ended before.
    Ended,
}

/// Why a stream ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EndReason {
    /// Somebody deleted it.
    Deleted,
    /// No frame had come for a long time.
    Idle,
    /// The server stops.
    Shutdown,
    /// The recording that was played is over.
    Finished,
}

/// An error as RFC 9457 has it: the body of every answer from 400 on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// What kind of problem: a URI reference that stays the same.
    pub r#type: String,
    /// The kind in a few words.
    pub title: String,
    /// The HTTP status.
    pub status: u16,
    /// What happened here, and what to do.
    pub detail: String,
    /// When it is worth trying again, in milliseconds: finer than `Retry-After`, which every
    /// client understands and which counts seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retry_after_ms: Option<u64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_with_an_unknown_field_is_refused_with_its_name() {
        let text = r#"{"target_faces": 4000, "traking": "off"}"#;
        let error = serde_json::from_str::<StreamConfig>(text).unwrap_err();
        assert!(error.to_string().contains("traking"), "{error}");
    }

    #[test]
    fn control_messages_have_the_documented_form() {
        let skipped = serde_json::to_string(&ControlMessage::Skipped { missed: 3 }).unwrap();
        assert_eq!(skipped, r#"{"type":"skipped","missed":3}"#);
        let reason = EndReason::Deleted;
        let end = serde_json::to_string(&ControlMessage::End { reason }).unwrap();
        assert_eq!(end, r#"{"type":"end","reason":"deleted"}"#);
    }

    #[test]
    fn acknowledgements_have_the_documented_form() {
        let ack = |state| serde_json::to_string(&PublishReply::Ack { message: 3, state }).unwrap();
        assert_eq!(
            ack(FrameState::Accepted { seq: 41 }),
            r#"{"type":"ack","message":3,"state":"accepted","seq":41}"#
        );
        let reason = DropReason::Overload;
        assert_eq!(
            ack(FrameState::Dropped { seq: 41, reason }),
            r#"{"type":"ack","message":3,"state":"dropped","seq":41,"reason":"overload"}"#
        );
    }

    #[test]
    fn an_empty_configuration_is_the_default() {
        let config: StreamConfig = serde_json::from_str("{}").unwrap();
        assert_eq!(config, StreamConfig::default());
        assert_eq!(serde_json::to_string(&config).unwrap(), "{}");
    }
}
