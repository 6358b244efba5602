//! What each module needs to know of the configuration.

use std::time::Duration;

use steadymesh_mesh_io::Limits;

use super::{Config, Role};
use crate::{bus, compute, server, storage, streams, worker};

impl Config {
    /// For the pool.
    #[must_use]
    pub fn compute(&self) -> compute::Options {
        let cores = std::thread::available_parallelism().map_or(1, Into::into);
        let asked = self.compute.threads;
        compute::Options {
            threads: if asked == 0 { cores } else { asked },
            // More than fits would panic in the semaphore behind it.
            queue: self.compute.queue.min(1 << 20),
        }
    }

    /// For the streams.
    #[must_use]
    pub fn streams(&self) -> streams::Options {
        streams::Options {
            max_streams: self.streams.max,
            queue_depth: self.streams.queue_depth,
            parallel_frames: self.streams.parallel_frames,
            history: streams::HistoryLimits {
                frames: self.streams.history,
                bytes: self.streams.history_bytes,
            },
            subscriber_queue: self.streams.subscriber_queue,
            linger: Duration::from_secs(self.streams.linger_secs),
            idle_timeout: Duration::from_secs(self.streams.idle_timeout_secs),
            limits: Limits {
                max_vertices: self.limits.vertices,
                max_faces: self.limits.faces,
                max_memory_bytes: self.limits.decode_memory_bytes,
            },
            defaults: self.streams.defaults.clone(),
            rules: self.streams.rules.clone(),
            records: self.recordings.url.is_some(),
            relayed_frames: self.bus.frames,
        }
    }

    /// For the bus, if there is to be one.
    #[must_use]
    pub fn bus(&self) -> Option<bus::Options> {
        Some(bus::Options {
            url: self.bus.nats_url.clone()?,
            credentials_file: self.bus.credentials_file.clone(),
            prefix: self.bus.prefix.clone(),
            replicas: self.bus.replicas,
            // Checked before.
            ack_wait: Duration::try_from_secs_f64(self.bus.ack_wait_secs).unwrap_or_default(),
            max_bytes: self.bus.max_bytes,
            max_age: Duration::from_secs(self.bus.max_age_secs),
        })
    }

    /// For the worker, which has as many frames in work as there are threads.
    #[must_use]
    pub fn worker(&self) -> worker::Options {
        let streams = self.streams();
        worker::Options {
            limits: streams.limits,
            ack_wait: Duration::try_from_secs_f64(self.bus.ack_wait_secs).unwrap_or_default(),
            live_max_age: Duration::from_millis(self.bus.live_max_age_ms),
        }
    }

    /// For the recordings, if there are to be any.
    #[must_use]
    pub fn recordings(&self) -> Option<storage::Options> {
        let own = &self.recordings;
        Some(storage::Options {
            url: own.url.clone()?,
            // Checked when the store is opened: what is no duration is out of range.
            segment: Duration::try_from_secs_f64(own.segment_secs).unwrap_or_default(),
            segment_bytes: own.segment_bytes,
            queue_bytes: own.queue_bytes,
            max_age: own.max_age_secs.map(Duration::from_secs),
            max_bytes: own.max_bytes,
            sweep_interval: Duration::from_secs(own.sweep_interval_secs),
            farewell: Duration::from_secs(own.farewell_secs),
        })
    }

    /// For the server.
    #[must_use]
    pub fn server(&self) -> server::Options {
        server::Options {
            listen: (self.role != Role::Worker).then_some(self.listen),
            internal_listen: self.internal_listen,
            tls: self.tls.clone(),
            auth: self.auth.clone(),
            allowed_origins: self.http.allowed_origins.clone(),
            allowed_hosts: self.http.allowed_hosts.clone(),
            max_memory_bytes: self.limits.memory_bytes,
            max_connections: self.limits.connections,
            max_connections_per_address: self.limits.connections_per_address,
            max_subscribers: self.limits.subscribers_per_stream,
            max_playbacks: self.limits.playbacks,
            shutdown_grace: Duration::from_secs(self.shutdown_grace_secs),
            max_body_bytes: self.limits.body_bytes,
            header_timeout: Duration::from_secs(self.limits.header_timeout_secs),
            body_timeout: Duration::from_secs(self.limits.body_timeout_secs),
            idle_timeout: Duration::from_secs(self.limits.idle_timeout_secs),
            send_buffer_bytes: self.limits.send_buffer_bytes,
            send_timeout: Duration::from_secs(self.limits.send_timeout_secs),
        }
    }
}
