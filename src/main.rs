//! The `steadymesh` command. Its subcommands come with the server.

fn main() {}
