//! The binary: a server that ends with the test, and other commands.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStderr, Command, Output, Stdio};

/// A running `steadymesh serve`, which ends with the test.
pub struct Server {
    process: Child,
    /// Kept open, so that the server can go on writing to it.
    _log: BufReader<ChildStderr>,
    /// `host:port`.
    pub address: String,
}

impl Server {
    /// Starts one with settings from the environment.
    pub fn start_with(settings: &[(&str, &str)]) -> Self {
        let mut process = steadymesh("serve --listen 127.0.0.1:0 --internal-listen 127.0.0.1:0")
            .envs(settings.iter().copied())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut log = BufReader::new(process.stderr.take().unwrap());
        let mut line = String::new();
        log.read_line(&mut line).unwrap();
        let (_, after) = line.split_once("http://").unwrap();
        let address = after.split(',').next().unwrap().to_owned();
        Self {
            process,
            _log: log,
            address,
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

pub fn steadymesh(arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_steadymesh"));
    command.args(arguments.split_whitespace());
    command
}

pub fn run(arguments: &str) -> Output {
    steadymesh(arguments).output().unwrap()
}
