//! How many files the process may have open: each connection is one.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Files beside connections: listeners, clients that are being sent away, the runtime's own.
const SPARE: u64 = 256;

/// Raises the limit as far as the system lets anybody, and says so if it is still too low. Many
/// systems allow 1,024 unless a process asks for more, and a server that has none left can not
/// even be asked whether it is alive.
pub(super) fn allow(connections: usize) {
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: maximum,
        maximum,
    };
    if let Err(error) = setrlimit(Resource::Nofile, raised) {
        tracing::warn!(%error, "the limit of open files cannot be raised");
    }
    let wanted = connections as u64 + SPARE;
    if let Some(limit) = getrlimit(Resource::Nofile).current
        && limit < wanted
    {
        tracing::warn!(
            limit,
            wanted,
            "the system allows fewer open files than limits.connections needs: raise it \
             (ulimit -n, or LimitNOFILE of a systemd unit)"
        );
    }
}
