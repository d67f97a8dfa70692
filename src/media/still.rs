//! Small JPEGs of frames, many a second: for people who watch a feed.

use ff::{Dictionary, Packet, Rational, codec, encoder, format, frame, software::scaling};
use ffmpeg_next as ff;

use super::encode::{EncodeError, copied};
use crate::pipeline::frame::Frame;

/// Widest picture, pixels.
const WIDEST: u32 = 960;

/// The encoder's quantiser, 1 (best) to 31: 960×540 take some 40 KB.
const QUANTISER: &str = "5";

/// Makes JPEGs of frames of one size.
#[derive(Default)]
pub struct StillMaker(Option<Parts>);

struct Parts {
    scaler: scaling::Context,
    encoder: encoder::Video,
    made: i64,
}

impl StillMaker {
    /// A frame as a JPEG, at most 960 pixels wide.
    ///
    /// # Errors
    /// FFmpeg's, where it lacks the encoder or the memory.
    pub fn jpeg(&mut self, frame: &Frame<'_>) -> Result<Vec<u8>, EncodeError> {
        let full = copied(frame)?;
        let parts = match &mut self.0 {
            Some(parts) if parts.scaler.input().format == full.format() => parts,
            slot => slot.insert(Parts::new(&full)?),
        };
        let mut small = frame::Video::empty();
        parts.scaler.run(&full, &mut small).map_err(failed("shrinking a picture"))?;
        small.set_pts(Some(parts.made)); // each later than the one before, or the encoder refuses it
        parts.made += 1;
        parts.encoder.send_frame(&small).map_err(failed("encoding a picture"))?;
        let mut packet = Packet::empty();
        parts.encoder.receive_packet(&mut packet).map_err(failed("encoding a picture"))?;
        Ok(packet.data().unwrap_or_default().to_vec())
    }
}

impl Parts {
    fn new(full: &frame::Video) -> Result<Self, EncodeError> {
        let (width, height) = (full.width(), full.height());
        let step = width.div_ceil(WIDEST).max(1);
        // Chroma is halved: even sizes.
        let (to_width, to_height) = ((width / step).max(2) & !1, (height / step).max(2) & !1);
        let to = format::Pixel::YUVJ420P;
        // Not the fast bilinear scaler: it makes machine code as it goes, which a confined child must not.
        let scaler = scaling::Context::get(full.format(), width, height, to, to_width, to_height, scaling::Flags::AREA)
            .map_err(failed("shrinking a picture"))?;
        let jpeg =
            encoder::find(codec::Id::MJPEG).ok_or_else(|| failed("encoding a picture")(ff::Error::EncoderNotFound))?;
        let mut video =
            codec::Context::new_with_codec(jpeg).encoder().video().map_err(failed("preparing the encoder"))?;
        video.set_width(to_width);
        video.set_height(to_height);
        video.set_format(to);
        video.set_time_base(Rational(1, 25));
        let mut options = Dictionary::new();
        options.set("threads", "1");
        options.set("qmin", QUANTISER);
        options.set("qmax", QUANTISER);
        let encoder = video.open_with(options).map_err(failed("opening the encoder"))?;
        Ok(Self { scaler, encoder, made: 0 })
    }
}

fn failed(doing: &'static str) -> impl Fn(ff::Error) -> EncodeError {
    move |source| EncodeError::Ffmpeg { doing, source }
}
