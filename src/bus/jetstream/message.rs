//! Frames and outcomes as NATS messages: what is known of them in headers, their bytes as payload.

use std::str::FromStr;

use async_nats::HeaderMap;
use bytes::Bytes;
use steadymesh_proto::stream::DropReason;

use crate::bus::{Frame, InvalidMessage, Outcome, Position, Predecessor, Processed};

const INSTANCE: &str = "Steadymesh-Instance";
const SEQ: &str = "Steadymesh-Seq";
const CAPTURE_TIME: &str = "Steadymesh-Capture-Time-Us";
const RECEIVED: &str = "Steadymesh-Received-Us";
const PREDECESSOR: &str = "Steadymesh-Predecessor";
const PREDECESSOR_SEQ: &str = "Steadymesh-Predecessor-Seq";
const CONTENT_TYPE: &str = "Content-Type";
/// Of an outcome that is a loss.
const LOST: &str = "Steadymesh-Lost";
/// The name of the object that is the body, if it is too large for a message.
pub(super) const OBJECT: &str = "Steadymesh-Object";

pub(super) fn frame_headers(frame: &Frame) -> HeaderMap {
    let mut headers = HeaderMap::new();
    headers.insert(INSTANCE, frame.instance.to_string());
    headers.insert(SEQ, frame.seq.to_string());
    headers.insert(RECEIVED, frame.received_us.to_string());
    headers.insert(CONTENT_TYPE, frame.content_type.as_str());
    if let Some(time) = frame.capture_time_us {
        headers.insert(CAPTURE_TIME, time.to_string());
    }
    if let Some(before) = frame.predecessor {
        headers.insert(PREDECESSOR, before.position.0.to_string());
        headers.insert(PREDECESSOR_SEQ, before.seq.to_string());
    }
    headers
}

/// Reads a frame. A body that is an object is not read.
pub(super) fn frame(
    subject: &str,
    headers: &HeaderMap,
    body: Bytes,
) -> Result<Frame, InvalidMessage> {
    let position = optional(headers, PREDECESSOR)?;
    let predecessor = match position {
        None => None,
        Some(position) => Some(Predecessor {
            position: Position(position),
            seq: required(headers, PREDECESSOR_SEQ)?,
        }),
    };
    Ok(Frame {
        stream: stream_of(subject)?,
        instance: required(headers, INSTANCE)?,
        seq: required(headers, SEQ)?,
        capture_time_us: optional(headers, CAPTURE_TIME)?,
        received_us: required(headers, RECEIVED)?,
        content_type: required(headers, CONTENT_TYPE)?,
        predecessor,
        body,
    })
}

pub(super) fn outcome_parts(processed: &Processed) -> (HeaderMap, Bytes) {
    let mut headers = HeaderMap::new();
    headers.insert(INSTANCE, processed.instance.to_string());
    headers.insert(SEQ, processed.seq.to_string());
    match &processed.outcome {
        Outcome::Delivered(message) => (headers, message.clone()),
        Outcome::Lost(reason) => {
            headers.insert(LOST, name_of(*reason));
            (headers, Bytes::new())
        }
    }
}

/// Reads an outcome. A body that is an object is not read.
pub(super) fn outcome(
    subject: &str,
    headers: &HeaderMap,
    body: Bytes,
) -> Result<Processed, InvalidMessage> {
    let outcome = match optional::<String>(headers, LOST)? {
        None => Outcome::Delivered(body),
        Some(name) => Outcome::Lost(reason_of(&name).ok_or(InvalidMessage { what: LOST })?),
    };
    Ok(Processed {
        stream: stream_of(subject)?,
        instance: required(headers, INSTANCE)?,
        seq: required(headers, SEQ)?,
        outcome,
    })
}

/// An outcome with the body that it refers to; one whose body is gone is lost.
pub(super) fn with_body(mut processed: Processed, body: Option<Bytes>) -> Processed {
    processed.outcome = body.map_or(Outcome::Lost(DropReason::Failed), Outcome::Delivered);
    processed
}

/// The last part of a subject.
pub(super) fn stream_of(subject: &str) -> Result<String, InvalidMessage> {
    let last = subject.rsplit_once('.').map(|(_, stream)| stream);
    let stream = last.filter(|stream| !stream.is_empty());
    stream.map(str::to_owned).ok_or(InvalidMessage {
        what: "the subject",
    })
}

fn name_of(reason: DropReason) -> &'static str {
    match reason {
        DropReason::Overload => "overload",
        DropReason::Failed => "failed",
        DropReason::Ended => "ended",
    }
}

fn reason_of(name: &str) -> Option<DropReason> {
    let all = [DropReason::Overload, DropReason::Failed, DropReason::Ended];
    all.into_iter().find(|reason| name_of(*reason) == name)
}

fn optional<T: FromStr>(
    headers: &HeaderMap,
    name: &'static str,
) -> Result<Option<T>, InvalidMessage> {
    let value = headers.get(name).map(|value| value.as_str().parse());
    value.transpose().map_err(|_| InvalidMessage { what: name })
}

fn required<T: FromStr>(headers: &HeaderMap, name: &'static str) -> Result<T, InvalidMessage> {
    optional(headers, name)?.ok_or(InvalidMessage { what: name })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_comes_back_as_it_was_sent() {
        let frame_sent = Frame {
            stream: "rig-1".to_owned(),
            instance: 7,
            seq: 41,
            capture_time_us: None,
            received_us: 5,
            content_type: "model/ply".to_owned(),
            predecessor: Some(Predecessor {
                position: Position(99),
                seq: 39,
            }),
            body: Bytes::from_static(b"ply"),
        };
        let headers = frame_headers(&frame_sent);
        let body = frame_sent.body.clone();
        assert_eq!(
            frame("steadymesh.frames.rig-1", &headers, body),
            Ok(frame_sent)
        );
        let error = frame("steadymesh.frames.a", &HeaderMap::new(), Bytes::new()).unwrap_err();
        assert!(error.to_string().contains("Steadymesh-Instance"));
    }

    #[test]
    fn an_outcome_comes_back_as_it_was_sent() {
        for outcome_sent in [
            Outcome::Delivered(Bytes::from_static(b"SMDF")),
            Outcome::Lost(DropReason::Overload),
        ] {
            let sent = Processed {
                stream: "a".to_owned(),
                instance: 1,
                seq: 2,
                outcome: outcome_sent,
            };
            let (headers, body) = outcome_parts(&sent);
            assert_eq!(outcome("p.outcomes.a", &headers, body), Ok(sent));
        }
    }
}
