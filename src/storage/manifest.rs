//! What is known of a recording as a whole.

use bytes::Bytes;
use object_store::{ObjectStoreExt, PutMode};
use serde::{Deserialize, Serialize};
use steadymesh_proto::recording::{Record, RecordingEnd, TrackSummary};
use steadymesh_proto::stream::StreamConfig;

use super::layout::{Layout, Part, RecordingKey};
use super::reader::ReadFailed;
use super::store::Store;

/// The first object of a recording that is written, and the last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    pub version: u32,
    pub started_us: u64,
    pub record: Record,
    /// How the stream was configured when it began, defaults filled in.
    pub config: StreamConfig,
    /// None while it goes on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<End>,
}

/// How a recording ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct End {
    /// None for one that was found abandoned.
    pub reason: Option<RecordingEnd>,
    pub ended_us: Option<u64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<TrackSummary>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<TrackSummary>,
}

impl Manifest {
    pub const VERSION: u32 = 1;

    pub async fn read(
        store: &Store,
        layout: &Layout,
        key: &RecordingKey,
    ) -> Result<Self, ReadFailed> {
        let path = layout.object(key, Part::Manifest);
        let found = match store.objects.get(&path).await {
            Err(object_store::Error::NotFound { .. }) => {
                return Err(ReadFailed::NoRecording { key: key.clone() });
            }
            found => found?,
        };
        let bytes = found.bytes().await?;
        let manifest: Self =
            serde_json::from_slice(&bytes).map_err(|error| ReadFailed::Damaged {
                object: path.to_string(),
                reason: error.to_string(),
            })?;
        if manifest.version != Self::VERSION {
            return Err(ReadFailed::Damaged {
                object: path.to_string(),
                reason: format!("it is of version {}", manifest.version),
            });
        }
        Ok(manifest)
    }

    pub async fn write(
        &self,
        store: &Store,
        layout: &Layout,
        key: &RecordingKey,
        mode: PutMode,
    ) -> Result<(), object_store::Error> {
        // Names and numbers, which always serialize.
        let text = serde_json::to_vec_pretty(self).unwrap_or_default();
        let path = layout.object(key, Part::Manifest);
        let payload = Bytes::from(text).into();
        store.objects.put_opts(&path, payload, mode.into()).await?;
        Ok(())
    }
}
