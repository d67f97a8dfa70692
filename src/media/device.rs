//! Cameras: the part of FFmpeg that reads devices, loaded when a camera is opened.
//!
//! It is not linked: `libavdevice` brings eighty more libraries (X11, SDL, PulseAudio, …) that every process of the service
//! would load at its start, the confined children too.

use std::ffi::CStr;

use ff::{ffi, format};
use ffmpeg_next as ff;

/// The format that reads devices of Video4Linux.
pub(super) const CAMERA: &CStr = c"video4linux2";

/// A format of `libavdevice`, or why there is none.
pub(super) fn format(name: &CStr) -> Result<format::Input, String> {
    // FFmpeg's libraries of one release bear one number, from FFmpeg 5 on.
    let library = format!("libavdevice.so.{}\0", format::version() >> 16);
    let missing = |what: &str| format!("{what}; install Debian's package libavdevice59 to capture from a camera");
    // SAFETY: the names are C strings. The library is FFmpeg's own, of the release of those that are linked, and stays
    // loaded. The function takes nothing and returns nothing; it may be called at any time and again.
    let found = unsafe {
        let library = libc::dlopen(library.as_ptr().cast(), libc::RTLD_NOW);
        if library.is_null() {
            return Err(missing("FFmpeg's libavdevice is not there"));
        }
        let register = libc::dlsym(library, c"avdevice_register_all".as_ptr());
        if register.is_null() {
            return Err(missing("FFmpeg's libavdevice is not the one that is needed"));
        }
        let register: extern "C" fn() = std::mem::transmute(register);
        register();
        ffi::av_find_input_format(name.as_ptr())
    };
    if found.is_null() {
        return Err(missing(&format!("FFmpeg's libavdevice has no {}", name.to_string_lossy())));
    }
    // SAFETY: the format is static; whoever opens an input with it only reads it.
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
