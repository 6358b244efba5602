//! What an endpoint is told: the body of a message.

use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use steadymesh_proto::stream::EndReason;

use super::{Figure, Limit};

/// What has happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// A stream's first frame is out.
    #[serde(rename = "stream.started")]
    Started,
    /// A stream that had started is over.
    #[serde(rename = "stream.ended")]
    Ended,
    /// No frame has come out for a while.
    #[serde(rename = "stream.stalled")]
    Stalled,
    /// A frame has come out after that.
    #[serde(rename = "stream.resumed")]
    Resumed,
    /// A figure is out of a bound.
    #[serde(rename = "consistency.exceeded")]
    Exceeded,
    /// It is within the bound again.
    #[serde(rename = "consistency.restored")]
    Restored,
}

/// A message's body, in the form that Standard Webhooks recommends.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Notice {
    /// What has happened.
    pub r#type: Kind,
    /// When, as RFC 3339 has it, in UTC.
    #[serde(serialize_with = "rfc3339")]
    pub timestamp: SystemTime,
    /// To what, and how.
    pub data: Details,
}

/// What there is to say beside that.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Details {
    /// With [`Kind::Started`].
    Started {
        /// The stream.
        stream: String,
        /// Its first frame's number.
        seq: u64,
    },
    /// With [`Kind::Ended`].
    Ended(Ending),
    /// With [`Kind::Stalled`] and [`Kind::Resumed`].
    Silence(Silence),
    /// With [`Kind::Exceeded`] and [`Kind::Restored`].
    Crossing(Crossing),
}

/// The end of a stream.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ending {
    /// The stream.
    pub stream: String,
    /// Why.
    pub reason: EndReason,
    /// Frames that came out.
    pub published: u64,
    /// Accepted frames that did not.
    pub dropped: u64,
    /// The newest frame's number.
    pub latest_seq: Option<u64>,
}

/// A stream without frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Silence {
    /// The stream.
    pub stream: String,
    /// The last frame before the silence, or the first one after it.
    pub seq: u64,
    /// How long it has lasted, in seconds.
    pub silent_secs: f64,
}

/// A figure that has crossed a bound.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Crossing {
    /// The stream.
    pub stream: String,
    /// The newest frame.
    pub seq: u64,
    /// Which figure.
    pub figure: Figure,
    /// What it is in that frame.
    pub value: f64,
    /// What it may be.
    pub bound: Limit,
    /// For how many frames in a row it has been on this side.
    pub frames: u32,
}

impl Kind {
    /// Its name in messages and in the configuration.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Started => "stream.started",
            Self::Ended => "stream.ended",
            Self::Stalled => "stream.stalled",
            Self::Resumed => "stream.resumed",
            Self::Exceeded => "consistency.exceeded",
            Self::Restored => "consistency.restored",
        }
    }
}

fn rfc3339<S: serde::Serializer>(time: &SystemTime, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&humantime::format_rfc3339_micros(*time))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_has_one_name() {
        use Kind::{Ended, Exceeded, Restored, Resumed, Stalled, Started};
        for kind in [Started, Ended, Stalled, Resumed, Exceeded, Restored] {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.as_str());
        }
    }
}
