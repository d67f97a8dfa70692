//! Reads the picture's size from the header of a coded frame; nothing is decoded.

use ffmpeg_next::ffi;

use crate::domain::feed::FrameCodec;

/// Width and height of the picture, pixels; `None` if the frame does not state them, as in H.264 between key frames.
pub fn frame_size(codec: FrameCodec, frame: &[u8]) -> Option<(u32, u32)> {
    match codec {
        FrameCodec::Jpeg => jpeg_size(frame),
        FrameCodec::H264 => h264_size(frame),
    }
}

/// Reads the frame header: the first segment with one of the `SOF` markers (ITU-T T.81, B.2.2).
fn jpeg_size(mut bytes: &[u8]) -> Option<(u32, u32)> {
    bytes = bytes.strip_prefix(&[0xff, 0xd8])?;
    loop {
        let [0xff, marker, rest @ ..] = bytes else { return None };
        match marker {
            0xff => bytes = &bytes[1..], // fill
            0x01 | 0xd0..=0xd7 => bytes = rest,
            0xd8..=0xda => return None, // coded data without a frame header before it
            _ => {
                let length = usize::from(u16::from_be_bytes(*rest.first_chunk()?));
                if matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
                    let [_, _, _, h1, h0, w1, w0, ..] = rest else { return None };
                    return Some((u16::from_be_bytes([*w1, *w0]).into(), u16::from_be_bytes([*h1, *h0]).into()));
                }
                bytes = rest.get(length..)?;
            }
        }
    }
}

/// True if a sequence parameter set comes before the frame's first slice; the parser does not look further either. The
/// byte after the start code gives the unit's type (ITU-T H.264, B.1 and table 7-1).
fn has_parameter_set(frame: &[u8]) -> bool {
    const SLICES: [u8; 2] = [1, 5];
    const PARAMETERS: u8 = 7;
    let units = frame.windows(4).filter(|bytes| bytes.starts_with(&[0, 0, 1])).map(|bytes| bytes[3] & 0x1f);
    units.take_while(|unit| !SLICES.contains(unit)).any(|unit| unit == PARAMETERS)
}

/// Reads the sequence parameter set with FFmpeg's parser. Most frames have none, so no parser is created for them.
fn h264_size(frame: &[u8]) -> Option<(u32, u32)> {
    if !has_parameter_set(frame) {
        return None;
    }
    let length = i32::try_from(frame.len()).ok()?;
    let mut padded = frame.to_vec();
    padded.resize(frame.len() + ffi::AV_INPUT_BUFFER_PADDING_SIZE as usize, 0);
    // SAFETY: parser and context are created here, used while they live, and freed once in every case (freeing null is
    // allowed). The parser reads `length` bytes and the padding after them, which `padded` holds until the end.
    let size = unsafe {
        let mut context = ffi::avcodec_alloc_context3(std::ptr::null());
        let parser = ffi::av_parser_init(ffi::AVCodecID::AV_CODEC_ID_H264 as i32);
        let mut size = (0, 0);
        if !context.is_null() && !parser.is_null() {
            (*parser).flags |= ffi::PARSER_FLAG_COMPLETE_FRAMES;
            let (mut out, mut out_length) = (std::ptr::null_mut(), 0);
            let none = ffi::AV_NOPTS_VALUE;
            ffi::av_parser_parse2(parser, context, &mut out, &mut out_length, padded.as_ptr(), length, none, none, 0);
            size = ((*parser).width, (*parser).height);
        }
        ffi::av_parser_close(parser);
        ffi::avcodec_free_context(&mut context);
        size
    };
    match (u32::try_from(size.0), u32::try_from(size.1)) {
        (Ok(width @ 1..), Ok(height @ 1..)) => Some((width, height)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use image::codecs::jpeg::JpegEncoder;
    use image::{ImageEncoder, RgbImage};
    use proptest::prelude::*;

    use super::*;

    fn jpeg(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let picture = RgbImage::new(width, height);
        let rgb = image::ExtendedColorType::Rgb8;
        JpegEncoder::new(&mut bytes).write_image(&picture, width, height, rgb).unwrap();
        bytes
    }

    #[test]
    fn a_jpeg_says_its_size() {
        assert_eq!(frame_size(FrameCodec::Jpeg, &jpeg(321, 47)), Some((321, 47)));
        assert_eq!(frame_size(FrameCodec::Jpeg, &jpeg(321, 47)[..20]), None);
    }

    #[test]
    fn a_frame_of_h264_says_its_size_before_its_first_slice_or_not_at_all() {
        let (delimiter, parameters, slice) = ([0, 0, 1, 9, 0xf0], [0, 0, 1, 0x67, 0x42], [0, 0, 1, 0x65, 0x88]);
        assert!(has_parameter_set(&[delimiter, parameters, slice].concat()));
        assert!(!has_parameter_set(&[delimiter, slice, parameters].concat()));
        assert!(!has_parameter_set(&delimiter[..3]));
    }

    proptest! {
        #[test]
        fn what_is_no_frame_has_no_size_and_does_no_harm(
            bytes in prop::collection::vec(any::<u8>(), 0..300), at in 0usize..600,
        ) {
            let mut damaged = jpeg(40, 30);
            let at = at % damaged.len();
            damaged[at] ^= bytes.first().unwrap_or(&1);
            let _ = frame_size(FrameCodec::Jpeg, &damaged);
            let _ = frame_size(FrameCodec::Jpeg, &[&[0xff, 0xd8][..], &bytes].concat());
            let _ = frame_size(FrameCodec::H264, &[&[0, 0, 1, 0x67][..], &bytes].concat());
        }
    }
}
