//! The `steadymesh` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    steadymesh_heap::keep();
    steadymesh::cli::run()
}
