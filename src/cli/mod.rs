//! The command line: files, progress bars, exit codes.
//!
//! Data goes to the named files, everything said to people to standard error. The exit code is
//! 0 for done, 1 for failed, 2 for wrong usage.

mod frame_files;
mod simplify;
mod stopwatch;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Volumetric video that does not flicker.
#[derive(Debug, Parser)]
#[command(name = "steadymesh", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simplify a sequence of frame files.
    Simplify(simplify::Arguments),
}

/// Runs the command that the process was started with.
#[must_use]
pub fn run() -> ExitCode {
    // Wrong usage ends here, with exit code 2.
    let Cli { command } = Cli::parse();
    let outcome = match command {
        Command::Simplify(arguments) => simplify::run(&arguments),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say(&format!("error: {error:#}"));
            ExitCode::FAILURE
        }
    }
}

/// Says something to the person at the terminal.
#[expect(
    clippy::print_stderr,
    reason = "standard error is where commands talk to people"
)]
fn say(message: &str) {
    eprintln!("{message}");
}
