//! Checks what the kernel offers for confinement, before any child is started.

use std::io;
use std::ptr;

/// Why this kernel does not enforce Landlock, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum LandlockUnavailable {
    /// The kernel is too old, or was built without it.
    #[error("this kernel has no Landlock: Linux 5.13 or newer is needed, built with CONFIG_SECURITY_LANDLOCK")]
    Missing,
    /// Landlock is built in but not enabled at boot.
    #[error("this kernel (Linux 5.13 or newer) has Landlock disabled: add `landlock` to its boot parameter `lsm=`")]
    SwitchedOff,
    /// Something else refuses it, such as a container.
    #[error("this system refuses Landlock (Linux 5.13 or newer; a container's profile must allow its calls): {0}")]
    Refused(io::Error),
}

/// Version of the kernel's Landlock.
pub fn landlock_version() -> Result<u32, LandlockUnavailable> {
    const ASK_FOR_THE_VERSION: libc::c_uint = 1;
    // SAFETY: only asks for a number; the kernel accesses no memory of this process.
    let answer = unsafe {
        libc::syscall(libc::SYS_landlock_create_ruleset, ptr::null::<libc::c_void>(), 0_usize, ASK_FOR_THE_VERSION)
    };
    u32::try_from(answer).map_err(|_| {
        let error = io::Error::last_os_error();
        match error.raw_os_error() {
            Some(libc::ENOSYS) => LandlockUnavailable::Missing,
            Some(libc::EOPNOTSUPP) => LandlockUnavailable::SwitchedOff,
            _ => LandlockUnavailable::Refused(error),
        }
    })
}
