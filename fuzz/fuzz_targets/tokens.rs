//! Any text as a token, its hash, a pattern and a name.

#![no_main]

use libfuzzer_sys::fuzz_target;
use steadymesh::server::auth::{Expiry, TokenHash};
use steadymesh::streams::{StreamName, StreamPattern};

fuzz_target!(|text: &str| {
    if let Ok(hash) = text.parse::<TokenHash>() {
        assert_eq!(hash.to_string().parse(), Ok(hash));
    }
    let _ = TokenHash::of(text);
    let _ = Expiry::try_from(text.to_owned());
    if let Ok(pattern) = text.parse::<StreamPattern>() {
        assert_eq!(String::from(pattern), text);
    }
    if let Ok(name) = StreamName::parse(text) {
        assert_eq!(name.as_str(), text);
    }
});
