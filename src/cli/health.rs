//! `steadymesh health`: whether a server is ready, for container health checks.

use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;

const PATIENCE: Duration = Duration::from_secs(2);

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The address of operations.
    #[arg(default_value = "http://127.0.0.1:9090")]
    url: String,
}

/// Runs the command: exit code 0 if the server is ready.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let url = format!("{}/readyz", arguments.url.trim_end_matches('/'));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let client = reqwest::Client::builder().timeout(PATIENCE).build()?;
        let response = client.get(&url).send().await;
        let response = response.with_context(|| format!("{url} does not answer"))?;
        if !response.status().is_success() {
            bail!("{url} answers {}", response.status());
        }
        Ok(())
    })
}
