//! The raw frames of a recording: on a server, or in a store that this machine reaches itself.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, bail};
use bytes::Bytes;
use reqwest::{Client, Response, Url};
use steadymesh_proto::recording::{RecordedFrame, RecordedFrames, RecordingSummary, Track};

use crate::storage::{Cursor, RecordingKey, Recordings, Start};
use crate::telemetry::Telemetry;

use super::remote::{Refusal, Remote};
use super::stream_url::StreamUrl;

const EXAMPLE: &str = "http://127.0.0.1:8080/v1/recordings/demo/20261129T215703Z-3f9a, or the \
                       recording's folder";

/// Where a recording is.
#[derive(Debug, Clone)]
pub(super) enum RecordingPlace {
    Server(StreamUrl),
    /// A store, and the recording in it.
    Store {
        url: Url,
        key: RecordingKey,
    },
}

impl RecordingPlace {
    /// Reads the address of a recording on a server, its folder, or its address in a store: the
    /// last two parts are the stream's name and the recording's.
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text.starts_with("http://") || text.starts_with("https://") {
            return StreamUrl::parse_recording(text).map(Self::Server);
        }
        let none = || format!("it is no recording: {EXAMPLE} is expected");
        let mut url = match Url::parse(text) {
            Ok(url) => url,
            Err(_) => {
                let path = Path::new(text).canonicalize();
                let path = path.map_err(|error| format!("the folder {text}: {error}"))?;
                Url::from_directory_path(path).map_err(|()| none())?
            }
        };
        let path = url.path().trim_end_matches('/').to_owned();
        let mut parts = path.rsplitn(3, '/');
        let (id, stream, root) = (parts.next(), parts.next(), parts.next());
        let id = id.filter(|id| RecordingKey::is_id(id)).ok_or_else(none)?;
        let key = RecordingKey {
            stream: stream.ok_or_else(none)?.to_owned(),
            id: id.to_owned(),
        };
        url.set_path(&format!("{}/", root.unwrap_or_default()));
        Ok(Self::Store { url, key })
    }
}

/// The raw frames of a recording, one after the other.
pub(super) struct RecordedSource {
    pub summary: RecordingSummary,
    frames: Frames,
}

enum Frames {
    Server(Box<ServerFrames>),
    Store(Box<Cursor>),
}

struct ServerFrames {
    client: Client,
    url: StreamUrl,
    /// What is known of the next frames, and whether there are more behind them.
    known: std::vec::IntoIter<RecordedFrame>,
    more: bool,
    next_seq: u64,
}

impl RecordedSource {
    /// Opens a recording at frame `from_seq` or the first one behind it.
    ///
    /// # Errors
    ///
    /// If there is no such recording, or it has no raw frames.
    pub async fn open(
        place: &RecordingPlace,
        token: Option<&str>,
        from_seq: u64,
    ) -> anyhow::Result<Self> {
        let source = match place {
            RecordingPlace::Server(url) => {
                let client = Remote::with_token(url, token).http_client()?;
                let answer = get(&client, url.under("")).await?;
                Self {
                    summary: answer.json().await?,
                    frames: Frames::Server(Box::new(ServerFrames {
                        client,
                        url: url.clone(),
                        known: Vec::new().into_iter(),
                        more: true,
                        next_seq: from_seq,
                    })),
                }
            }
            RecordingPlace::Store { url, key } => {
                let recordings = Recordings::open_to_read(url, Arc::new(Telemetry::new()?))?;
                let recording = recordings.find(key).await?;
                Self {
                    summary: recording.summary(),
                    frames: Frames::Store(Box::new(
                        recording.cursor(Track::Raw, Start::Seq(from_seq))?,
                    )),
                }
            }
        };
        if source.summary.raw.is_none() {
            bail!("the recording has no raw frames: \"record\" was not \"raw\" or \"both\"");
        }
        Ok(source)
    }

    /// The next frame; none after the last.
    ///
    /// # Errors
    ///
    /// If it cannot be read.
    pub async fn next(&mut self) -> anyhow::Result<Option<(RecordedFrame, Bytes)>> {
        match &mut self.frames {
            Frames::Server(frames) => frames.next().await,
            Frames::Store(cursor) => {
                let frame = cursor.next().await?;
                Ok(frame.map(|frame| (frame.frame, frame.body)))
            }
        }
    }
}

impl ServerFrames {
    async fn next(&mut self) -> anyhow::Result<Option<(RecordedFrame, Bytes)>> {
        let frame = match self.known.next() {
            Some(frame) => frame,
            None if !self.more => return Ok(None),
            None => {
                let mut url = self.url.under("frames");
                let from = self.next_seq.to_string();
                let parameters = [("track", "raw"), ("from_seq", &from)];
                url.query_pairs_mut().extend_pairs(parameters);
                let answer: RecordedFrames = get(&self.client, url).await?.json().await?;
                (self.known, self.more) = (answer.frames.into_iter(), answer.more);
                match self.known.next() {
                    Some(frame) => frame,
                    None => return Ok(None),
                }
            }
        };
        self.next_seq = frame.seq + 1;
        let url = self.url.under(&format!("raw/{}", frame.seq));
        let body = get(&self.client, url).await?.bytes().await?;
        Ok(Some((frame, body)))
    }
}

async fn get(client: &Client, url: Url) -> anyhow::Result<Response> {
    let address = url.to_string();
    let answer = client.get(url).send().await;
    let answer = answer.with_context(|| format!("{address} cannot be reached"))?;
    if answer.status().is_success() {
        return Ok(answer);
    }
    let status = answer.status();
    let body = answer.bytes().await.unwrap_or_default();
    Err(Refusal::of(status, &body).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_found_by_the_last_two_parts_of_its_address() {
        let text = "s3://studio/captures/demo/20261129T215703Z-3f9a";
        let RecordingPlace::Store { url, key } = RecordingPlace::parse(text).unwrap() else {
            panic!("it is in a store");
        };
        assert_eq!(url.as_str(), "s3://studio/captures/");
        assert_eq!(
            (key.stream.as_str(), key.id.as_str()),
            ("demo", "20261129T215703Z-3f9a")
        );
        for text in ["s3://studio/captures/demo", "/nowhere/at/all", "demo"] {
            assert!(RecordingPlace::parse(text).is_err(), "{text}");
        }
    }
}
