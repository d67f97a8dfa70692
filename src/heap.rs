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

/// Blocks of this size and more are taken from the system one by one, and returned to it when they are freed, bytes.
const LARGE_BLOCK_BYTES: i32 = 1 << 20;

/// Returns large blocks to the system as soon as they are freed. By default glibc raises that size to the largest block
/// freed so far, up to 32 MiB, and keeps smaller ones in the heap of the thread that asked for them: after a hundred
/// sign-ins, each with 19 MiB for a moment, the service held 0.7 GiB. Call this while the process has one thread.
///
/// # Errors
/// The C library refuses.
pub fn return_large_blocks() -> io::Result<()> {
    #[cfg(target_env = "gnu")]
    {
        // SAFETY: a plain call with plain numbers.
        if unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE_BLOCK_BYTES) } != 1 {
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
