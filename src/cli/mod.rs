//! The command line: files, progress bars, exit codes.
//!
//! Data goes to the named files or to standard output, everything said to people to standard
//! error. The exit code is 0 for done, 1 for failed, 2 for wrong usage.

mod config;
mod evaluate;
mod export;
mod frame_files;
mod frame_source;
mod frame_writer;
mod health;
mod http_publisher;
mod images;
mod open_files;
mod output_files;
mod progress;
mod publish;
mod publisher;
mod receiver;
mod recorded;
mod remote;
mod replay;
mod serve;
mod simplify;
mod stream_url;
mod subscribe;
mod takes;
mod target;
mod token;
mod tracking_mode;
mod websocket_publisher;

use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use anyhow::Context;
use clap::{CommandFactory, Parser, Subcommand};

/// Volumetric video that does not flicker.
#[derive(Debug, Parser)]
#[command(name = "steadymesh", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run the server.
    Serve(serve::Arguments),
    /// Print all settings, or check a configuration file.
    Config(config::Arguments),
    /// Whether a server is ready, by exit code.
    Health(health::Arguments),
    /// Make a token and its hash.
    Token,
    /// Send frames to a stream, as a capture rig does.
    Publish(publish::Arguments),
    /// Receive a stream's frames, as a player does.
    Subscribe(subscribe::Arguments),
    /// Send a recording's raw frames to a stream again.
    Replay(replay::Arguments),
    /// Write a stream's or a recording's frames as files that other players read.
    Export(export::Arguments),
    /// Simplify a sequence of frame files.
    Simplify(simplify::Arguments),
    /// Compare tracking with the original QEM on sequences of frames.
    Evaluate(evaluate::Arguments),
}

/// Runs the command that the process was started with.
#[must_use]
pub fn run() -> ExitCode {
    crate::tls::set_up();
    // Wrong usage ends here, with exit code 2.
    let Cli { command } = Cli::parse();
    let outcome = match command {
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Config(arguments) => config::run(&arguments),
        Command::Health(arguments) => health::run(&arguments),
        Command::Token => token::run(),
        Command::Publish(arguments) => publish::run(&arguments),
        Command::Subscribe(arguments) => subscribe::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Simplify(arguments) => simplify::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say(&format!("error: {error:#}"));
            ExitCode::FAILURE
        }
    }
}

/// Waits until the process is asked to end, by Ctrl-C or SIGTERM.
async fn interrupted() -> anyhow::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate())?;
    tokio::select! {
        interrupted = tokio::signal::ctrl_c() => interrupted?,
        _ = terminate.recv() => {}
    }
    Ok(())
}

/// Ends the process with exit code 2, for what the parser cannot find out by itself.
fn wrong_usage(message: &str) -> ! {
    Cli::command()
        .error(clap::error::ErrorKind::ValueValidation, message)
        .exit()
}

/// Says something to the person at the terminal.
fn say(message: &str) {
    // Unlike `eprintln!`, which panics, this goes on where nobody can be told: on a full disk, or
    // where the pipe has been closed.
    writeln!(std::io::stderr(), "{message}").ok();
}

/// Says what is data: on standard output.
fn print(text: &str) -> anyhow::Result<()> {
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        // Whoever closes the pipe, as `head` does, has read enough.
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("standard output cannot be written to"),
    }
}
