//! Detects the container format from a file's first bytes, only for the `Content-Type` of a recording.
//!
//! The sandboxed child process finds out whether it can be decoded. The sender's file name is never used.

/// Number of bytes to look at.
pub const HEAD_BYTES: usize = 400;

/// The media type of a recording by its first bytes.
pub fn media_type(head: &[u8]) -> &'static str {
    let at = |offset: usize, magic: &[u8]| head.get(offset..).is_some_and(|rest| rest.starts_with(magic));
    if at(4, b"ftypqt  ") {
        "video/quicktime"
    } else if at(4, b"ftyp") {
        "video/mp4"
    } else if at(0, b"\x1A\x45\xDF\xA3") {
        if head.windows(4).any(|window| window == b"webm") { "video/webm" } else { "video/x-matroska" }
    } else if at(0, b"RIFF") && at(8, b"AVI ") {
        "video/x-msvideo"
    } else if at(0, b"\x47") && at(188, b"\x47") {
        "video/mp2t"
    } else {
        "application/octet-stream"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn containers_are_known_by_their_first_bytes() {
        assert_eq!(media_type(b"\0\0\0\x20ftypisom\0\0"), "video/mp4");
        assert_eq!(media_type(b"\0\0\0\x14ftypqt  \0\0"), "video/quicktime");
        assert_eq!(media_type(b"\x1A\x45\xDF\xA3\x01\0\0\x42\x82\x84webm"), "video/webm");
        assert_eq!(media_type(b"\x1A\x45\xDF\xA3\x01\0\0\x42\x82\x88matroska"), "video/x-matroska");
        assert_eq!(media_type(b"RIFF\0\0\0\0AVI LIST"), "video/x-msvideo");
    }

    #[test]
    fn a_page_named_like_a_video_is_no_page_to_a_browser() {
        for head in [&b"<html><script>"[..], b"", b"G", b"#EXTM3U"] {
            assert_eq!(media_type(head), "application/octet-stream");
        }
    }
}
