//! Pictures into good JPEGs.

use ff::{Packet, Rational, codec, encoder, format, frame, software::scaling, util::color};
use ffmpeg_next as ff;
use ffmpeg_next::ffi;

use super::encode::{EncodeError, copied};
use crate::domain::feed::MOST_PAYLOAD;
use crate::pipeline::frame::{ColourEncoding, Frame, Matrix, Range};

/// Quantiser scales, best first: the next one is taken where a picture is longer than the protocol allows. The first costs
/// an edge less than the camera's own noise.
const QUANTISERS: [i32; 4] = [2, 4, 8, 16];

/// Codes the pictures of one recording.
pub(super) struct JpegCoder {
    encoder: encoder::Video,
    scaler: scaling::Context,
    of: Of,
}

/// What a coder is made for.
#[derive(Clone, Copy, PartialEq)]
struct Of {
    width: usize,
    height: usize,
    shift: (u8, u8),
    encoding: ColourEncoding,
}

// SAFETY: encoder and scaler are bound to no thread, and only whoever owns them can use them.
unsafe impl Send for JpegCoder {}

impl JpegCoder {
    fn new(of: Of) -> Result<Self, EncodeError> {
        use format::Pixel::*;
        let (from, to) = match of.shift {
            (1, 1) => (YUV420P, YUVJ420P),
            (1, 0) => (YUV422P, YUVJ422P),
            (0, 0) => (YUV444P, YUVJ444P),
            (x, y) => return Err(EncodeError::Chroma { x, y }),
        };
        let (width, height) = (of.width as u32, of.height as u32);
        let codec = encoder::find(codec::Id::MJPEG).ok_or(EncodeError::NoEncoder)?;
        let context = codec::Context::new_with_codec(codec);
        let mut video = context.encoder().video().map_err(failed("preparing the JPEG encoder"))?;
        video.set_width(width);
        video.set_height(height);
        video.set_format(to);
        video.set_color_range(color::Range::JPEG);
        video.set_time_base(Rational(1, 90_000)); // of no use to JPEG; FFmpeg wants one
        video.set_flags(codec::Flags::QSCALE);
        let encoder = video.open().map_err(failed("opening the JPEG encoder"))?;
        let flags = scaling::Flags::BILINEAR | scaling::Flags::ACCURATE_RND;
        let mut scaler = scaling::Context::get(from, width, height, to, width, height, flags)
            .map_err(failed("preparing the conversion to JPEG's colours"))?;
        let matrix = match of.encoding.matrix {
            Matrix::Bt601 => ffi::SWS_CS_ITU601,
            Matrix::Bt709 => ffi::SWS_CS_ITU709,
            Matrix::Bt2020 => ffi::SWS_CS_BT2020,
        };
        let is_full = i32::from(of.encoding.range == Range::Full);
        // SAFETY: the context was just made; the tables of coefficients are static. JPEG's (JFIF) are those of BT.601, full.
        let set = unsafe {
            let (from, to) = (ffi::sws_getCoefficients(matrix), ffi::sws_getCoefficients(ffi::SWS_CS_ITU601));
            ffi::sws_setColorspaceDetails(scaler.as_mut_ptr(), from, is_full, to, 1, 0, 1 << 16, 1 << 16)
        };
        if set < 0 {
            return Err(failed("preparing the conversion to JPEG's colours")(ff::Error::from(set)));
        }
        Ok(Self { encoder, scaler, of })
    }

    fn code(&mut self, picture: &Frame<'_>) -> Result<Vec<u8>, EncodeError> {
        let mut converted = frame::Video::empty();
        self.scaler.run(&copied(picture)?, &mut converted).map_err(failed("converting to JPEG's colours"))?;
        let mut packet = Packet::empty();
        for (tried, quantiser) in QUANTISERS.into_iter().enumerate() {
            converted.set_pts(Some((picture.index as i64) * QUANTISERS.len() as i64 + tried as i64));
            // SAFETY: the frame is whole and this function's own.
            unsafe { (*converted.as_mut_ptr()).quality = quantiser * ffi::FF_QP2LAMBDA };
            self.encoder.send_frame(&converted).map_err(failed("coding a JPEG"))?;
            self.encoder.receive_packet(&mut packet).map_err(failed("coding a JPEG"))?;
            if packet.size() <= MOST_PAYLOAD {
                break;
            }
        }
        Ok(packet.data().unwrap_or_default().to_vec())
    }
}

/// The JPEG of a picture; the coder is made at the first one.
pub(super) fn code(coder: &mut Option<JpegCoder>, picture: &Frame<'_>) -> Result<Vec<u8>, EncodeError> {
    let of = Of {
        width: picture.width(),
        height: picture.height(),
        shift: (picture.shift_x, picture.shift_y),
        encoding: picture.encoding,
    };
    match coder {
        Some(coder) if coder.of == of => coder.code(picture),
        slot => slot.insert(JpegCoder::new(of)?).code(picture),
    }
}

fn failed(doing: &'static str) -> impl Fn(ff::Error) -> EncodeError {
    move |source| EncodeError::Ffmpeg { doing, source }
}

#[cfg(test)]
mod tests {
    use image::{DynamicImage, ImageFormat};

    use super::*;
    use crate::pipeline::frame::Plane;

    /// A picture of one colour as the camera's samples have it, and what a JPEG decoder shows.
    fn shown(codes: [u8; 3], encoding: ColourEncoding) -> [u8; 3] {
        let plane = |code: u8| vec![code; 64 * 48];
        let planes = codes.map(plane);
        let lend = |data| Plane { data, stride: 64, width: 64, height: 48 };
        let [y, u, v] = [&planes[0], &planes[1], &planes[2]].map(|data| lend(data.as_slice()));
        let frame = Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, encoding };
        let bytes = code(&mut None, &frame).unwrap();
        let decoded: DynamicImage = image::load_from_memory_with_format(&bytes, ImageFormat::Jpeg).unwrap();
        decoded.into_rgb8().get_pixel(30, 20).0
    }

    #[test]
    fn colours_are_those_of_the_source_whatever_its_matrix_and_range() {
        // Pure red in each encoding, by the standards' own formulas.
        let red = |matrix, range, codes| (shown(codes, ColourEncoding { range, matrix }), [255, 0, 0]);
        for (shown, meant) in [
            red(Matrix::Bt601, Range::Full, [76, 85, 255]),
            red(Matrix::Bt601, Range::Limited, [81, 90, 240]),
            red(Matrix::Bt709, Range::Limited, [63, 102, 240]),
        ] {
            let off = (0..3).map(|i| u8::abs_diff(shown[i], meant[i])).max().unwrap();
            assert!(off <= 4, "{shown:?} for {meant:?}");
        }
    }
}
