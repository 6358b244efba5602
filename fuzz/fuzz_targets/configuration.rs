//! Any text as a configuration file.

#![no_main]

use libfuzzer_sys::fuzz_target;
use steadymesh::config::Config;

fuzz_target!(|text: &str| {
    if let Ok(config) = Config::parse(text) {
        let _ = config.check();
        let _ = config.streams().check();
        let _ = config.server();
    }
});
