//! Bodies that are too large for a message, in JetStream's object store.

use async_nats::jetstream::Context;
use async_nats::jetstream::object_store::{Config, GetErrorKind, ObjectStore};
use bytes::Bytes;
use std::sync::Arc;
use tokio::io::AsyncReadExt;
use tokio::sync::OnceCell;
use tokio::time::timeout;

use super::{BusError, Options, TIMEOUT, unavailable};

/// The store, made when the first large body comes.
#[derive(Clone)]
pub(super) struct Objects {
    context: Context,
    config: Config,
    store: Arc<OnceCell<ObjectStore>>,
}

impl std::fmt::Debug for Objects {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Objects")
            .field("bucket", &self.config.bucket)
            .finish()
    }
}

impl Objects {
    pub fn new(context: Context, options: &Options) -> Self {
        let config = Config {
            bucket: format!("{}_large", options.prefix.replace('.', "_")),
            max_age: options.max_age * 2,
            // Beside the logs, which have as much.
            max_bytes: i64::try_from(options.max_bytes).unwrap_or(i64::MAX),
            num_replicas: options.replicas,
            ..Config::default()
        };
        Self {
            context,
            config,
            store: Arc::default(),
        }
    }

    /// Stores a body, and gives the name under which it is found.
    pub async fn put(&self, name: &str, body: &Bytes) -> Result<String, BusError> {
        let store = self.store().await?;
        let mut reader = body.as_ref();
        store.put(name, &mut reader).await.map_err(unavailable)?;
        Ok(name.to_owned())
    }

    /// A body; none if it is gone.
    pub async fn get(&self, name: &str) -> Result<Option<Bytes>, BusError> {
        let mut object = match self.store().await?.get(name).await {
            Ok(object) => object,
            Err(error) if error.kind() == GetErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(unavailable(error)),
        };
        let mut body = Vec::new();
        // One that is being taken away at this moment would never end.
        let read = timeout(TIMEOUT, object.read_to_end(&mut body)).await;
        read.map_err(unavailable)?.map_err(unavailable)?;
        Ok(Some(Bytes::from(body)))
    }

    async fn store(&self) -> Result<&ObjectStore, BusError> {
        let make = async || match self.context.get_object_store(&self.config.bucket).await {
            Ok(store) => Ok(store),
            Err(_) => self.context.create_object_store(self.config.clone()).await,
        };
        self.store.get_or_try_init(make).await.map_err(unavailable)
    }
}
