//! `steadymesh config`: what can be set, and whether a file can be used.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use crate::config::{Config, default_file};
use crate::server::Server;
use crate::webhooks::Prepared;

use super::serve::UNUSABLE_DEFAULTS;

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub(super) struct Arguments {
    /// Print a file with all settings, their defaults and comments.
    #[arg(long)]
    print_default: bool,
    /// Say whether this file can be used, the environment after it.
    #[arg(long, value_name = "FILE")]
    check: Option<PathBuf>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(file) = &arguments.check {
        let config = Config::load(Some(file))?;
        config.check()?;
        config.streams().check().context(UNUSABLE_DEFAULTS)?;
        config.log.filter()?;
        let runtime = tokio::runtime::Builder::new_current_thread().build()?;
        runtime.block_on(Server::check(&config.server()))?;
        Prepared::new(&config.webhooks)?;
        super::say(&format!("{} can be used", file.display()));
        return Ok(());
    }
    super::print(default_file())
}
