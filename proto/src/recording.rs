//! What is recorded of streams, as the HTTP interface gives it, in JSON.

use serde::{Deserialize, Serialize};

use crate::stream::{EndReason, StreamConfig};

/// What of a stream is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Record {
    /// Nothing.
    #[default]
    Off,
    /// The frames as they came in, to be processed again.
    Raw,
    /// The simplified frames with their metrics, to be played.
    Output,
    /// Both.
    Both,
}

impl Record {
    /// The name in JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Raw => "raw",
            Self::Output => "output",
            Self::Both => "both",
        }
    }

    /// Whether `track` is recorded.
    #[must_use]
    pub fn has(self, track: Track) -> bool {
        match self {
            Self::Off => false,
            Self::Raw => track == Track::Raw,
            Self::Output => track == Track::Output,
            Self::Both => true,
        }
    }
}

/// One of the two sequences of frames that a recording may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Track {
    /// The frames as they came in.
    Raw,
    /// The simplified frames with their metrics.
    Output,
}

impl Track {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Raw, Self::Output];

    /// The name in JSON and in addresses.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Output => "output",
        }
    }
}

/// The answer to `GET /v1/recordings`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingList {
    /// By stream, then oldest first.
    pub recordings: Vec<RecordingSummary>,
}

/// A recording: one stretch of one stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingSummary {
    /// The stream's name.
    pub stream: String,
    /// When it began, in UTC, and four digits that tell it from any other:
    /// `20261129T215703Z-3f9a`.
    pub id: String,
    /// Whether it goes on.
    pub state: RecordingState,
    /// When it began, in microseconds since 1970-01-01T00:00:00Z.
    pub started_us: u64,
    /// When it ended; none while it goes on, and if nobody could say.
    pub ended_us: Option<u64>,
    /// How the stream was configured when it began, defaults filled in.
    pub config: StreamConfig,
    /// The frames as they came in, if they are recorded.
    pub raw: Option<TrackSummary>,
    /// The simplified frames, if they are recorded.
    pub output: Option<TrackSummary>,
}

/// Whether a recording goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordingState {
    /// Frames are being added.
    Recording,
    /// It was ended: all of it is there, but for its gaps.
    Complete,
    /// Whoever recorded is gone without having ended it: what it had not yet written is lost.
    Interrupted,
}

/// Why a recording ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordingEnd {
    /// Somebody asked for it.
    Stopped,
    /// The stream was deleted.
    Deleted,
    /// The stream ended for lack of frames.
    Idle,
    /// The server stopped.
    Shutdown,
}

impl From<EndReason> for RecordingEnd {
    fn from(reason: EndReason) -> Self {
        match reason {
            EndReason::Deleted => Self::Deleted,
            EndReason::Idle => Self::Idle,
            // A stream does not end as a recording that is played does.
            EndReason::Shutdown | EndReason::Finished => Self::Shutdown,
        }
    }
}

/// What there is of one sequence of frames.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TrackSummary {
    /// Frames.
    pub frames: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Files that hold them.
    pub segments: u64,
    /// The first frame's number; none without frames.
    pub first_seq: Option<u64>,
    /// The last frame's number.
    pub last_seq: Option<u64>,
    /// The first frame's time, in microseconds since 1970-01-01T00:00:00Z: when it was captured, or
    /// when it came if the rig did not say.
    pub first_time_us: Option<u64>,
    /// The last frame's.
    pub last_time_us: Option<u64>,
    /// Frames that could not be recorded.
    pub gaps: Vec<Gap>,
}

/// Frames that could not be recorded, because the storage was full, slow or away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gap {
    /// The number of the first one.
    pub first_seq: u64,
    /// The number of the last one.
    pub last_seq: u64,
    /// How many.
    pub frames: u64,
}

/// The answer to `GET /v1/recordings/{stream}/{id}/frames`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedFrames {
    /// In their order.
    pub frames: Vec<RecordedFrame>,
    /// Whether there are more after these: ask again from the number after the last.
    pub more: bool,
}

/// What is known of a recorded frame without its body.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedFrame {
    /// Its number.
    pub seq: u64,
    /// When it was captured, in microseconds since 1970-01-01T00:00:00Z, if the rig said so.
    pub capture_time_us: Option<u64>,
    /// When it came in or out.
    pub stored_us: u64,
    /// The type of its body: of a raw frame what the rig sent, else a delivered frame
    /// ([`DELIVERED_CONTENT_TYPE`](crate::DELIVERED_CONTENT_TYPE)).
    pub content_type: String,
    /// Its body's length.
    pub bytes: u64,
}

impl RecordedFrame {
    /// When it was captured, or stored if the rig did not say.
    #[must_use]
    pub fn time_us(&self) -> u64 {
        self.capture_time_us.unwrap_or(self.stored_us)
    }
}

/// A text message of a player to `play`, told apart by `type`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub enum PlayerMessage {
    /// Go on at another place: give one of both.
    Seek {
        /// At the first frame with this number or a later one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seq: Option<u64>,
        /// At the first frame of this time or a later one, in microseconds since 1970.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        time_us: Option<u64>,
    },
    /// Go on at another speed.
    Speed {
        /// 1 is the speed at which it was captured; 0 is as fast as the connection takes it.
        speed: f64,
    },
    /// Send nothing more until `resume` or `seek`; a `seek` sends one frame.
    Pause {},
    /// Go on.
    Resume {},
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_players_wishes_have_the_documented_form() {
        let seek: PlayerMessage = serde_json::from_str(r#"{"type":"seek","seq":41}"#).unwrap();
        let expected = PlayerMessage::Seek {
            seq: Some(41),
            time_us: None,
        };
        assert_eq!(seek, expected);
        let pause: PlayerMessage = serde_json::from_str(r#"{"type":"pause"}"#).unwrap();
        assert_eq!(pause, PlayerMessage::Pause {});
        for wrong in [
            r#"{"type":"seek","frame":1}"#,
            r#"{"type":"pause","seconds":1}"#,
        ] {
            assert!(
                serde_json::from_str::<PlayerMessage>(wrong).is_err(),
                "{wrong}"
            );
        }
    }

    #[test]
    fn what_is_recorded_says_which_tracks_there_are() {
        let tracks = |record: Record| Track::ALL.map(|track| record.has(track));
        assert_eq!(tracks(Record::Off), [false, false]);
        assert_eq!(tracks(Record::Raw), [true, false]);
        assert_eq!(tracks(Record::Output), [false, true]);
        assert_eq!(tracks(Record::Both), [true, true]);
    }
}
