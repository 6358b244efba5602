//! Tells the C library what to do with memory that was freed.
//!
//! A frame takes some tens of megabytes in arrays of up to a few, all of which are freed again within
//! a tenth of a second. By itself the GNU C library gives such arrays back to the system and asks
//! for them anew thirty times a second, and the system clears every page of them; and what it does
//! keep, it keeps for good.

/// Has freed memory kept for the next allocation, up to some hundred megabytes, until [`release`]
/// is called. Does nothing where the C library is another one.
///
/// Saves one in ten to twenty milliseconds of a frame. For the start of a program.
#[cfg_attr(
    all(target_os = "linux", target_env = "gnu"),
    expect(unsafe_code, reason = "the C library's function")
)]
pub fn keep() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: mallopt may be called at any time from any thread and takes no pointers. A value that it
    // does not take changes nothing.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST_KEPT);
        libc::mallopt(libc::M_TRIM_THRESHOLD, MOST_KEPT);
    }
}

/// Larger arrays go back to the system at once: 32 MiB, the most that every version takes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGEST_KEPT: i32 = 32 << 20;

/// Most of what is free at the end of a thread's memory that is kept: two large frames' worth.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const MOST_KEPT: i32 = 64 << 20;

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
