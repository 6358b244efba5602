//! What the registry hears on the bus: streams of other nodes, and what becomes of frames.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

use crate::bus::{BusError, Outcomes, Processed, Records, StreamRecord};

use super::parts::Request;
use super::registry::Origin;
use super::stream::Stream;
use super::{Configured, Registry, StreamName};

/// When nothing has been heard of streams for so long, all that there are have been.
const QUIET: Duration = Duration::from_millis(300);

impl Registry {
    /// Begins to hear what other nodes say on the bus, if there is one: streams that there are, and
    /// what becomes of frames. Goes on until `stop`.
    ///
    /// # Errors
    ///
    /// [`BusError`] if it cannot be listened to.
    pub async fn follow_bus(&self, stop: CancellationToken) -> Result<(), BusError> {
        let Some(bus) = &self.shared.bus else {
            return Ok(());
        };
        // The outcomes first, so that none of a stream that is heard of is missed.
        let outcomes = bus.outcomes().await?;
        let mut records = bus.records().await?;
        // Those that there are, before anybody can ask for one.
        while let Ok((name, record)) = timeout(QUIET, records.next()).await {
            self.hear_of(&name, &record);
        }
        let registry = self.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = registry.follow(outcomes, records) => {}
                () = stop.cancelled() => {}
            }
        });
        Ok(())
    }

    async fn follow(&self, mut outcomes: Outcomes, mut records: Records) {
        let mut last: BTreeMap<String, Processed> = BTreeMap::new();
        loop {
            tokio::select! {
                biased;
                (name, record) = records.next() => {
                    let stream = self.hear_of(&name, &record);
                    // Its newest frame, which may have been heard of before it.
                    match (stream, last.get(&name)) {
                        (Some(stream), Some(outcome)) => stream.take_outcome(outcome.clone()),
                        (Some(_), None) => {}
                        (None, _) => _ = last.remove(&name),
                    }
                }
                outcome = outcomes.next() => {
                    let name = StreamName::parse(&outcome.stream).ok();
                    if let Some(stream) = name.and_then(|name| self.get(&name)) {
                        stream.take_outcome(outcome.clone());
                    }
                    last.insert(outcome.stream.clone(), outcome);
                }
            }
        }
    }

    /// Takes what another node, or this one, has said of a stream.
    fn hear_of(&self, name: &str, record: &StreamRecord) -> Option<Arc<Stream>> {
        let name = StreamName::parse(name).ok()?;
        {
            let instances = self.shared.instances.lock();
            let mut instances = instances.unwrap_or_else(PoisonError::into_inner);
            let last = instances.entry(name.clone()).or_default();
            *last = record.instance.max(*last);
        }
        let known = self.get(&name);
        if let Some(reason) = record.ended {
            let ended = known.filter(|stream| stream.created_us() <= record.instance);
            if let Some(stream) = ended {
                tracing::info!(stream = %name, ?reason, "another node has ended the stream");
                self.shared.lock().remove(&name);
                stream.request(Request::Follow);
            }
            return None;
        }
        let max_faces = self.shared.options.load().limits.max_faces;
        let configured = Configured::new(&[&record.config], max_faces);
        let configured = configured.map_err(|error| {
            tracing::error!(stream = %name, %error, "what another node says of the stream cannot be used");
        });
        let configured = configured.ok()?;
        match known {
            Some(stream) if stream.created_us() == record.instance => {
                stream.take_configuration(configured, record.revision);
                return Some(stream);
            }
            Some(stream) if record.instance < stream.created_us() => return Some(stream),
            // One that was made anew elsewhere.
            Some(stream) => {
                self.shared.lock().remove(&name);
                stream.request(Request::Follow);
            }
            None => {}
        }
        let (timeout, origin) = (
            self.shared.options.load().idle_timeout,
            Origin::Bus {
                instance: record.instance,
                revision: record.revision,
            },
        );
        let adopted = self.shared.insert(&name, configured, timeout, origin);
        match adopted {
            Ok((stream, _)) => Some(stream),
            Err(error) => {
                tracing::warn!(stream = %name, %error, "a stream of another node cannot be followed");
                None
            }
        }
    }
}
