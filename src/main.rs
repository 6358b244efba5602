//! The `steadymesh` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    steadymesh::cli::run()
}
