//! Codes pictures as good JPEGs.

use ff::{Dictionary, Packet, Rational, codec, encoder, format, frame, software::scaling, util::color};
use ffmpeg_next as ff;
use ffmpeg_next::ffi;

use super::encode::{EncodeError, copy_frame};
use crate::domain::feed::MAX_PAYLOAD;
use crate::vision::frame::{ColourEncoding, Frame, Matrix, Range};

/// Size and quality of JPEGs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JpegStyle {
    /// Maximum width, pixels; a wider picture is shrunk by a whole factor.
    max_width: usize,
    /// Quantiser scales, best first; the next one is used if a picture is longer than a feed allows.
    quantisers: [i32; 4],
}

impl JpegStyle {
    /// For measurement: the first scale shifts an edge by less than the camera's own noise.
    pub const FULL: Self = Self { max_width: usize::MAX, quantisers: [2, 4, 8, 16] };
    /// For viewing at many frames a second: 960×540 take some 40 KB.
    pub const SMALL: Self = Self { max_width: 960, quantisers: [5, 8, 12, 16] };
}

/// Codes pictures as JPEGs.
pub struct JpegMaker {
    style: JpegStyle,
    coder: Option<JpegCoder>,
}

impl JpegMaker {
    /// A coder for JPEGs of this style.
    pub fn new(style: JpegStyle) -> Self {
        Self { style, coder: None }
    }

    /// Codes a picture as a JPEG with the same colours.
    ///
    /// # Errors
    /// A chroma resolution that JPEG does not support, or FFmpeg's error if the encoder or memory is missing.
    pub fn code(&mut self, picture: &Frame<'_>) -> Result<Vec<u8>, EncodeError> {
        let of = PictureKind {
            width: picture.width(),
            height: picture.height(),
            shift: (picture.shift_x, picture.shift_y),
            encoding: picture.encoding,
        };
        match &mut self.coder {
            Some(coder) if coder.kind == of => coder.code(picture, self.style),
            slot => slot.insert(JpegCoder::new(of, self.style)?).code(picture, self.style),
        }
    }
}

/// The encoder for pictures of one kind.
struct JpegCoder {
    encoder: encoder::Video,
    scaler: scaling::Context,
    kind: PictureKind,
    coded_count: i64,
}

/// The kind of pictures that a coder is made for.
#[derive(Clone, Copy, PartialEq)]
struct PictureKind {
    width: usize,
    height: usize,
    shift: (u8, u8),
    encoding: ColourEncoding,
}

// SAFETY: encoder and scaler are not bound to a thread, and only their owner can use them.
unsafe impl Send for JpegCoder {}

impl JpegCoder {
    fn new(of: PictureKind, style: JpegStyle) -> Result<Self, EncodeError> {
        use format::Pixel::*;
        let (from, to) = match of.shift {
            (1, 1) => (YUV420P, YUVJ420P),
            (1, 0) => (YUV422P, YUVJ422P),
            (0, 1) => (YUV440P, YUVJ444P),
            (0, 0) => (YUV444P, YUVJ444P),
            (x, y) => return Err(EncodeError::Chroma { x, y }),
        };
        let step = of.width.div_ceil(style.max_width).max(1);
        let ((width, height), small) = ((of.width as u32, of.height as u32), |size: usize| (size / step).max(1) as u32);
        let (to_width, to_height) = (small(of.width), small(of.height));
        let codec = encoder::find(codec::Id::MJPEG).ok_or(EncodeError::NoEncoder)?;
        let context = codec::Context::new_with_codec(codec);
        let mut video = context.encoder().video().map_err(ffmpeg_error("preparing the JPEG encoder"))?;
        video.set_width(to_width);
        video.set_height(to_height);
        video.set_format(to);
        video.set_color_range(color::Range::JPEG);
        video.set_time_base(Rational(1, 90_000)); // JPEG does not use it, but FFmpeg requires one
        video.set_flags(codec::Flags::QSCALE);
        let mut options = Dictionary::new();
        options.set("threads", "1");
        let encoder = video.open_with(options).map_err(ffmpeg_error("opening the JPEG encoder"))?;
        // Not the fast bilinear scaler: it generates machine code at run time, which a confined child must not do.
        let flags =
            if step > 1 { scaling::Flags::AREA } else { scaling::Flags::BILINEAR | scaling::Flags::ACCURATE_RND };
        let mut scaler = scaling::Context::get(from, width, height, to, to_width, to_height, flags)
            .map_err(ffmpeg_error("preparing the conversion to JPEG's colours"))?;
        let matrix = match of.encoding.matrix {
            Matrix::Bt601 => ffi::SWS_CS_ITU601,
            Matrix::Bt709 => ffi::SWS_CS_ITU709,
            Matrix::Bt2020 => ffi::SWS_CS_BT2020,
        };
        let is_full = i32::from(of.encoding.range == Range::Full);
        // SAFETY: the context was just created; the tables of coefficients are static. JPEG (JFIF) uses BT.601, full
        // range.
        let set = unsafe {
            let (from, to) = (ffi::sws_getCoefficients(matrix), ffi::sws_getCoefficients(ffi::SWS_CS_ITU601));
            ffi::sws_setColorspaceDetails(scaler.as_mut_ptr(), from, is_full, to, 1, 0, 1 << 16, 1 << 16)
        };
        if set < 0 {
            return Err(ffmpeg_error("preparing the conversion to JPEG's colours")(ff::Error::from(set)));
        }
        Ok(Self { encoder, scaler, kind: of, coded_count: 0 })
    }

    fn code(&mut self, picture: &Frame<'_>, style: JpegStyle) -> Result<Vec<u8>, EncodeError> {
        let mut converted = frame::Video::empty();
        self.scaler.run(&copy_frame(picture)?, &mut converted).map_err(ffmpeg_error("converting to JPEG's colours"))?;
        let mut packet = Packet::empty();
        for quantiser in style.quantisers {
            self.coded_count += 1;
            converted.set_pts(Some(self.coded_count)); // must increase, or the encoder refuses the frame
            // SAFETY: the frame is valid and owned by this function.
            unsafe { (*converted.as_mut_ptr()).quality = quantiser * ffi::FF_QP2LAMBDA };
            self.encoder.send_frame(&converted).map_err(ffmpeg_error("coding a JPEG"))?;
            self.encoder.receive_packet(&mut packet).map_err(ffmpeg_error("coding a JPEG"))?;
            if packet.size() <= MAX_PAYLOAD {
                break;
            }
        }
        Ok(packet.data().unwrap_or_default().to_vec())
    }
}

fn ffmpeg_error(doing: &'static str) -> impl Fn(ff::Error) -> EncodeError {
    move |source| EncodeError::Ffmpeg { doing, source }
}

#[cfg(test)]
mod tests {
    use image::{DynamicImage, ImageFormat};

    use super::*;
    use crate::vision::frame::Plane;

    /// Codes a picture of one colour, given as camera samples, and returns the colour that a JPEG decoder shows.
    fn shown(codes: [u8; 3], encoding: ColourEncoding) -> [u8; 3] {
        let plane = |code: u8| vec![code; 64 * 48];
        let planes = codes.map(plane);
        let lend = |data| Plane { data, stride: 64, width: 64, height: 48 };
        let [y, u, v] = [&planes[0], &planes[1], &planes[2]].map(|data| lend(data.as_slice()));
        let frame =
            Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, chroma_first_px: [0.0; 2], encoding };
        let bytes = JpegMaker::new(JpegStyle::FULL).code(&frame).unwrap();
        let decoded: DynamicImage = image::load_from_memory_with_format(&bytes, ImageFormat::Jpeg).unwrap();
        decoded.into_rgb8().get_pixel(30, 20).0
    }

    #[test]
    fn what_is_only_looked_at_is_shrunk_by_a_whole_number() {
        let (width, height) = (2001, 33);
        let luma = vec![90; width * height];
        let plane = Plane { data: &luma[..], stride: width, width, height };
        let encoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: plane,
            u: plane,
            v: plane,
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding,
        };
        let mut maker = JpegMaker::new(JpegStyle::SMALL);
        for _ in 0..2 {
            let small = image::load_from_memory(&maker.code(&frame).unwrap()).unwrap();
            assert_eq!((small.width(), small.height()), (667, 11));
        }
    }

    #[test]
    fn colours_are_those_of_the_source_for_any_matrix_and_range() {
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
