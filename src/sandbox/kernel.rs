//! What the kernel offers to children that confine themselves, asked before any is started.

use std::io;
use std::ptr;

/// Why this kernel enforces no Landlock, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum NoLandlock {
    /// Too old, or built without it.
    #[error("this kernel has no Landlock: Linux 5.13 or newer is needed, built with CONFIG_SECURITY_LANDLOCK")]
    Missing,
    /// Built in, and not among the modules that were started.
    #[error(
        "this kernel (Linux 5.13 or newer) has Landlock switched off: add `landlock` to its start parameter `lsm=`"
    )]
    SwitchedOff,
    /// Somebody else's refusal, such as a container's.
    #[error("this system refuses Landlock (Linux 5.13 or newer; a container's profile must allow its calls): {0}")]
    Refused(io::Error),
}

/// The version of the kernel's Landlock.
pub fn landlock() -> Result<u32, NoLandlock> {
    const ASK_FOR_THE_VERSION: libc::c_uint = 1;
    // SAFETY: asks for a number; the kernel reads and writes no memory of ours.
    let answer = unsafe {
        libc::syscall(libc::SYS_landlock_create_ruleset, ptr::null::<libc::c_void>(), 0_usize, ASK_FOR_THE_VERSION)
    };
    u32::try_from(answer).map_err(|_| {
        let error = io::Error::last_os_error();
        match error.raw_os_error() {
            Some(libc::ENOSYS) => NoLandlock::Missing,
            Some(libc::EOPNOTSUPP) => NoLandlock::SwitchedOff,
            _ => NoLandlock::Refused(error),
        }
    })
}
