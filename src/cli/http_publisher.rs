//! Sends frames by HTTP, one after the other, and does what the server asks.

use std::time::{Duration, Instant};

use reqwest::{Client, Response, StatusCode, header};
use steadymesh_proto::stream::{Accepted, Problem};

use super::frame_source::SourceFrame;
use super::remote::{Refusal, Remote};

/// A server that restarts is back within this time; one that is not is given up.
const PATIENCE: Duration = Duration::from_secs(30);
const FIRST_RETRY: Duration = Duration::from_millis(200);
const MAX_RETRY: Duration = Duration::from_secs(5);

/// What became of a frame.
#[derive(Debug)]
pub(super) enum Sent {
    Accepted,
    /// The server's reason; the next frame may do better.
    Refused(String),
}

/// A publisher of one stream.
#[derive(Debug)]
pub(super) struct HttpPublisher {
    remote: Remote,
    client: Client,
    frames: reqwest::Url,
    /// The next frame's number, once the server has given one. With it a frame whose answer was
    /// lost can be sent again without coming twice.
    next_seq: Option<u64>,
    /// Whether the first frame ends the connection of another publisher.
    takeover: bool,
}

impl HttpPublisher {
    pub fn new(remote: &Remote, takeover: bool) -> anyhow::Result<Self> {
        Ok(Self {
            remote: remote.clone(),
            client: remote.http_client()?,
            frames: remote.url.under("frames"),
            next_seq: None,
            takeover,
        })
    }

    /// Sends a frame, waiting where the server asks for it; each wait is counted in `waits`.
    ///
    /// # Errors
    ///
    /// If the server cannot be reached, or would refuse all other frames too.
    pub async fn send(&mut self, frame: &SourceFrame, waits: &mut u64) -> anyhow::Result<Sent> {
        let seq = frame.recorded.map(|recorded| recorded.seq);
        let mut url = self.frames.clone();
        {
            let mut query = url.query_pairs_mut();
            if let Some(captured) = frame.capture_time_us()? {
                query.append_pair("capture_time_us", &captured.to_string());
            }
            if let Some(seq) = seq.or(self.next_seq) {
                query.append_pair("seq", &seq.to_string());
            }
            if self.next_seq.is_none() && self.takeover {
                query.append_pair("takeover", "true");
            }
        }
        let (started, mut delay) = (Instant::now(), FIRST_RETRY);
        loop {
            let request = self
                .client
                .post(url.clone())
                .header(header::CONTENT_TYPE, &*frame.content_type)
                .body(frame.body.clone());
            let response = match request.send().await {
                Ok(response) => response,
                // The very first frame finds out whether there is a server at all.
                Err(error) if self.next_seq.is_none() || PATIENCE < started.elapsed() => {
                    return Err(self.remote.unreachable(&error));
                }
                Err(_) => {
                    tokio::time::sleep(delay).await;
                    delay = (delay * 2).min(MAX_RETRY);
                    *waits += 1;
                    continue;
                }
            };
            match response.status() {
                StatusCode::TOO_MANY_REQUESTS | StatusCode::SERVICE_UNAVAILABLE => {
                    tokio::time::sleep(retry_after(response).await).await;
                    *waits += 1;
                }
                status if status.is_success() => {
                    let accepted: Accepted = response.json().await?;
                    self.next_seq = Some(accepted.seq + 1);
                    return Ok(Sent::Accepted);
                }
                status => return refused(status, response).await,
            }
        }
    }
}

/// How long the server asks to wait, a second if it does not say.
async fn retry_after(response: Response) -> Duration {
    let value = response.headers().get(header::RETRY_AFTER);
    let seconds = value.and_then(|value| value.to_str().ok()?.parse().ok());
    let problem = response.json::<Problem>().await.ok();
    let milliseconds = problem.and_then(|problem| problem.retry_after_ms);
    milliseconds.map_or(
        Duration::from_secs(seconds.unwrap_or(1)),
        Duration::from_millis,
    )
}

/// A frame that is wrong is refused alone; anything else would be refused for ever.
async fn refused(status: StatusCode, response: Response) -> anyhow::Result<Sent> {
    let text = response.text().await.unwrap_or_default();
    match status {
        StatusCode::PAYLOAD_TOO_LARGE
        | StatusCode::UNSUPPORTED_MEDIA_TYPE
        | StatusCode::UNPROCESSABLE_ENTITY => {
            let problem = serde_json::from_str::<Problem>(&text);
            Ok(Sent::Refused(
                problem.map_or(text, |problem| problem.detail),
            ))
        }
        _ => Err(Refusal::of(status, text.as_bytes()).into_publisher_error()),
    }
}
