//! A frame's body: read whole, within its limits of size and time.

use std::time::Duration;

use axum::body::{Body, HttpBody};
use axum::http::{HeaderMap, header};
use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::timeout;

use super::connection::Memory;
use super::error::Problem;

/// Not more than this is set aside on the word of a `Content-Length`.
const MAX_INITIAL_BYTES: usize = 4 << 20;
/// A body without a length is given memory in steps of this.
const MIN_GROWTH_BYTES: usize = 1 << 20;
/// How much of a body that is refused is read all the same. A connection that is closed while
/// the client is still sending is reset, and many clients then never see the answer.
const DRAIN_BYTES: usize = 1 << 30;
const DRAIN_TIME: Duration = Duration::from_secs(5);

/// How large and how slow a body may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub max_bytes: usize,
    pub timeout: Duration,
}

/// Reads a body.
///
/// # Errors
///
/// 413 if it is too large, 408 if it is too slow, 400 if it ends early.
pub(super) async fn read(
    mut body: Body,
    headers: &HeaderMap,
    limits: Limits,
    memory: &Memory,
) -> Result<(Bytes, OwnedSemaphorePermit), Problem> {
    let announced = body.size_hint().lower();
    if (limits.max_bytes as u64) < announced {
        discard(body, headers).await;
        return Err(too_large(limits, Some(announced)));
    }
    let capacity = usize::try_from(announced)
        .unwrap_or(0)
        .min(MAX_INITIAL_BYTES);
    let mut reserved = match memory.reserve(usize::try_from(announced).unwrap_or(usize::MAX)) {
        Ok(reserved) => reserved,
        Err(problem) => {
            discard(body, headers).await;
            return Err(problem);
        }
    };
    let collect = async {
        let mut bytes = BytesMut::with_capacity(capacity);
        while let Some(frame) = body.frame().await {
            let frame = frame.map_err(|error| {
                Problem::bad_request(format!("the body ends before it is complete: {error}"))
            })?;
            // Trailers say nothing that matters here.
            let Ok(data) = frame.into_data() else {
                continue;
            };
            if limits.max_bytes < bytes.len() + data.len() {
                return Ok(None);
            }
            // A body without a length takes what it needs as it comes.
            let missing = (bytes.len() + data.len()).saturating_sub(reserved.num_permits() << 10);
            if 0 < missing {
                reserved.merge(memory.reserve(missing.max(MIN_GROWTH_BYTES))?);
            }
            bytes.extend_from_slice(&data);
        }
        Ok(Some(bytes.freeze()))
    };
    let collected = timeout(limits.timeout, collect).await;
    match collected {
        Ok(Ok(Some(bytes))) => Ok((bytes, reserved)),
        Ok(Ok(None)) => {
            discard(body, headers).await;
            Err(too_large(limits, None))
        }
        Ok(Err(problem)) => Err(problem),
        Err(_) => Err(Problem::too_slow(format!(
            "the body was not complete after {} s, which is limits.body_timeout_secs",
            limits.timeout.as_secs()
        ))),
    }
}

/// Reads what is left of a body, within reason, and forgets it.
pub(super) async fn discard(mut body: Body, headers: &HeaderMap) {
    // Such a client waits with the body until it is asked for.
    if headers.contains_key(header::EXPECT) {
        return;
    }
    let read = async {
        let mut left = DRAIN_BYTES;
        while let Some(Ok(frame)) = body.frame().await {
            let length = frame.data_ref().map_or(0, Bytes::len);
            if left < length {
                return;
            }
            left -= length;
        }
    };
    // Whether it is through or not, the answer is sent now.
    timeout(DRAIN_TIME, read).await.ok();
}

fn too_large(limits: Limits, announced: Option<u64>) -> Problem {
    let found = announced.map_or_else(|| "more".to_owned(), |bytes| format!("{bytes} bytes"));
    Problem::too_large(format!(
        "the body has {found}, but the limit is {} bytes: send a smaller frame, or raise \
         limits.body_bytes in the configuration",
        limits.max_bytes
    ))
}
