//! `steadymesh health`: whether a server is ready, for container health checks.

use std::time::Duration;

use anyhow::{anyhow, bail};
use clap::Args;
use reqwest::Url;

use super::remote::cause;

const PATIENCE: Duration = Duration::from_secs(2);

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The address of operations.
    #[arg(default_value = "http://127.0.0.1:9090", value_parser = operations)]
    url: Url,
}

/// Runs the command: exit code 0 if the server is ready.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let url = format!("{}/readyz", arguments.url.as_str().trim_end_matches('/'));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let client = reqwest::Client::builder().timeout(PATIENCE).build()?;
        let response = client.get(&url).send().await;
        let response =
            response.map_err(|error| anyhow!("{url} does not answer: {}", cause(&error)))?;
        if !response.status().is_success() {
            bail!("{url} answers {}", response.status());
        }
        Ok(())
    })
}

fn operations(text: &str) -> Result<Url, String> {
    let url = Url::parse(text).ok();
    url.filter(|url| matches!(url.scheme(), "http" | "https"))
        .ok_or_else(|| {
            "an address that begins with http:// or https:// is expected, such as \
             http://127.0.0.1:9090"
                .to_owned()
        })
}
