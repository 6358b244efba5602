//! Gives memory that was freed back to the system.
//!
//! The GNU C library keeps what threads have freed in arenas of their own, for their next
//! allocation. After a stream of large frames that is hundreds of megabytes, which nobody uses
//! and everybody sees.

/// Returns what is free to the system; does nothing where the C library is another one.
///
/// Takes milliseconds, during which other threads may wait for memory: not for hot paths.
#[cfg_attr(
    all(target_os = "linux", target_env = "gnu"),
    expect(unsafe_code, reason = "the C library's function")
)]
pub fn release() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: malloc_trim may be called at any time from any thread (it takes the arenas' locks),
    // and touches only memory that is free.
    unsafe {
        libc::malloc_trim(0);
    }
}
