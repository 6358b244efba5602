//! One provider of cryptography for the process: ring, which builds without a C toolchain of its
//! own.

/// Makes TLS work in this process. To be called before the first client or listener that speaks
/// it; later calls do nothing.
pub fn set_up() {
    // Fails only if one has been installed before, which is as good.
    rustls::crypto::ring::default_provider()
        .install_default()
        .ok();
}
