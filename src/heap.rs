//! The C library's heaps, kept from keeping more than they need. Other C libraries do not keep it: there, nothing is done.

use std::io;

/// From now on, all threads share one heap. With one for each, every heap keeps what was freed in it for its own threads
/// alone, and reserves 64 MiB of address space. Call it while the process has one thread, which will allocate little while
/// others do.
///
/// # Errors
/// The C library refuses.
pub fn share_one() -> io::Result<()> {
    #[cfg(target_env = "gnu")]
    {
        // SAFETY: a plain call with plain numbers.
        if unsafe { libc::mallopt(libc::M_ARENA_MAX, 1) } != 1 {
            return Err(io::Error::other("the C library refuses"));
        }
    }
    Ok(())
}

/// Gives what is free back to the system. The C library keeps what a decoder freed, which at 1080p is as much as an hour of
/// two tools' motion needs.
pub fn give_back() {
    #[cfg(target_env = "gnu")]
    // SAFETY: a plain call with a plain number; the C library locks its heaps itself.
    unsafe {
        libc::malloc_trim(0);
    }
}
