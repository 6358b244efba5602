//! Looks again when the page has been built anew: it is embedded.

fn main() {
    println!("cargo:rerun-if-changed=web/dist");
}
