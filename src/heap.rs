//! Limits the memory that glibc's allocator holds on to. With other C libraries these functions do nothing.

use std::io;

/// Makes all threads share one heap. By default glibc gives threads heaps of their own; each heap keeps the memory
/// freed in it for its own threads and reserves 64 MiB of address space. Call this while the process has one thread,
/// and only where few threads allocate at the same time.
///
/// # Errors
/// The C library refuses.
pub fn use_single_heap() -> io::Result<()> {
    #[cfg(target_env = "gnu")]
    {
        // SAFETY: a plain call with plain numbers.
        if unsafe { libc::mallopt(libc::M_ARENA_MAX, 1) } != 1 {
            return Err(io::Error::other("the C library refuses"));
        }
    }
    Ok(())
}

/// Returns free memory to the system. Otherwise glibc keeps what a decoder freed: at 1080p that is as much memory as an
/// hour of two tools' motion needs.
pub fn release_free_memory() {
    #[cfg(target_env = "gnu")]
    // SAFETY: a plain call with a plain number; the C library locks its heaps itself.
    unsafe {
        libc::malloc_trim(0);
    }
}
