//! Cameras: the part of FFmpeg that reads devices, loaded when a camera is opened.
//!
//! It is not linked, because `libavdevice` needs eighty more libraries (X11, SDL, PulseAudio, …). Every process of the
//! service would load them at its start, the confined children too.

use std::ffi::CStr;

use ff::{ffi, format};
use ffmpeg_next as ff;

/// Name of FFmpeg's format that reads Video4Linux devices.
pub(super) const CAMERA: &CStr = c"video4linux2";

/// Loads `libavdevice` and returns one of its formats.
///
/// # Errors
/// Why the format is not available, with the package to install.
pub(super) fn format(name: &CStr) -> Result<format::Input, String> {
    // From FFmpeg 5 on, all libraries of one release have the same number.
    let library = format!("libavdevice.so.{}\0", format::version() >> 16);
    let missing = |what: &str| format!("{what}; install Debian's package libavdevice59 to capture from a camera");
    // SAFETY: the names are C strings. The library belongs to the linked FFmpeg release and stays loaded. The function
    // takes and returns nothing; it may be called at any time, and more than once.
    let found = unsafe {
        let library = libc::dlopen(library.as_ptr().cast(), libc::RTLD_NOW);
        if library.is_null() {
            return Err(missing("FFmpeg's libavdevice is not installed"));
        }
        let register = libc::dlsym(library, c"avdevice_register_all".as_ptr());
        if register.is_null() {
            return Err(missing("FFmpeg's libavdevice is not the right version"));
        }
        let register: extern "C" fn() = std::mem::transmute(register);
        register();
        ffi::av_find_input_format(name.as_ptr())
    };
    if found.is_null() {
        return Err(missing(&format!("FFmpeg's libavdevice has no {}", name.to_string_lossy())));
    }
    // SAFETY: the format is static, and FFmpeg only reads it when it opens an input.
    Ok(unsafe { format::Input::wrap(found.cast_mut()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_known_once_the_library_is_loaded() {
        assert_eq!(format(CAMERA).unwrap().name(), "video4linux2,v4l2");
        assert!(format(c"no-such-device").is_err());
    }
}
