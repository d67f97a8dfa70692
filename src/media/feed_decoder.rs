//! Decodes the frames of a feed as they arrive, without a container: one frame in, one picture out as soon as the codec
//! allows.
//!
//! Frames come in decoding order, each with its presentation time. A damaged frame costs only itself. After a gap in
//! H.264 the pictures are not valid until the next key frame; the caller has to handle this.

use ff::{Dictionary, Packet, Rational, codec};
use ffmpeg_next as ff;

use super::file::check_size;
use super::frame_size::frame_size;
use super::orientation::PictureOrientation;
use super::picture::Picture;
use super::picture_maker::PictureMaker;
use super::{MediaError, MediaLimits};
use crate::domain::feed::{FrameCodec, TimeBase};

/// Maximum of frames that a decoder may hold back for reordering: H.264 allows 16.
const MAX_HELD_BACK: usize = 32;

/// The decoder of one feed.
pub struct FeedDecoder {
    codec: FrameCodec,
    decoder: ff::decoder::Video,
    maker: PictureMaker,
    time_base: TimeBase,
    size: (u32, u32),
    limits: MediaLimits,
    /// Time, ticks, and number of each frame that was sent to the decoder and not yet returned.
    in_decoder: Vec<(i64, u64)>,
    last_time: Option<i64>,
}

impl FeedDecoder {
    /// Creates a decoder for frames of this size. It uses one thread; more threads would delay each picture by some
    /// frames.
    ///
    /// # Errors
    /// [`MediaError`] if the size exceeds the limits, or the decoder cannot be opened.
    pub fn new(
        codec: FrameCodec,
        size: (u32, u32),
        time_base: TimeBase,
        limits: MediaLimits,
    ) -> Result<Self, MediaError> {
        ff::init().map_err(ffmpeg_error("starting FFmpeg"))?;
        ff::log::set_level(ff::log::Level::Quiet);
        check_size(size.0, size.1, limits)?;
        let id = match codec {
            FrameCodec::Jpeg => codec::Id::MJPEG,
            FrameCodec::H264 => codec::Id::H264,
        };
        let found = codec::decoder::find(id).ok_or_else(|| MediaError::Codec(id.name().to_owned()))?;
        let mut options = Dictionary::new();
        options.set("threads", "1");
        options.set("max_pixels", &(u64::from(limits.width) * u64::from(limits.height)).to_string());
        let mut context = codec::Context::new_with_codec(found).decoder();
        let (num, den) = time_base.fraction();
        context.set_packet_time_base(Rational(num as i32, den as i32)); // checked: at most 100,000
        let decoder = context
            .open_as_with(found, options)
            .and_then(|opened| opened.video())
            .map_err(ffmpeg_error("opening the decoder"))?;
        let maker = PictureMaker::new(PictureOrientation::UPRIGHT);
        Ok(Self { codec, decoder, maker, time_base, size, limits, in_decoder: Vec::new(), last_time: None })
    }

    /// Takes the next frame: its number, its presentation time in ticks, and its bytes. Fetch all pictures with
    /// [`Self::next_picture`] before the next call.
    ///
    /// # Errors
    /// [`MediaError::SizeChanged`] if the frame states another picture size than was agreed.
    pub fn send_frame(&mut self, number: u64, time: i64, bytes: &[u8]) -> Result<(), MediaError> {
        if let Some(size) = frame_size(self.codec, bytes).filter(|size| *size != self.size) {
            return Err(MediaError::SizeChanged { from: self.size, to: size, frame: number });
        }
        let mut packet = Packet::copy(bytes);
        packet.set_pts(Some(time));
        if self.decoder.send_packet(&packet).is_ok() {
            if self.in_decoder.len() == MAX_HELD_BACK {
                self.in_decoder.remove(0); // damaged: the decoder never returned it
            }
            self.in_decoder.push((time, number));
        }
        Ok(())
    }

    /// The next picture, if one is ready. A picture that is not later than the previous one is left out.
    ///
    /// # Errors
    /// [`MediaError`] if the picture has another size than was agreed, or cannot be converted to planar YUV.
    pub fn next_picture(&mut self) -> Result<Option<Picture>, MediaError> {
        loop {
            let mut video = self.maker.frame_to_fill();
            match self.decoder.receive_frame(&mut video) {
                Ok(()) => {}
                Err(ff::Error::Other { errno: ff::error::ENOMEM }) => return Err(MediaError::Memory),
                Err(_) => return Ok(None), // it needs more frames, or the frames are damaged
            }
            let Some(time) = video.timestamp().or(video.pts()) else { continue };
            let Some(place) = self.in_decoder.iter().position(|(shown, _)| *shown == time) else { continue };
            let (_, number) = self.in_decoder.swap_remove(place);
            let size = (video.width(), video.height());
            if size != self.size {
                return Err(MediaError::SizeChanged { from: self.size, to: size, frame: number });
            }
            check_size(size.0, size.1, self.limits)?;
            if self.last_time.is_none_or(|last| time > last) {
                self.last_time = Some(time);
                return self.maker.make(video, number, self.time_base.seconds(time)).map(Some);
            }
        }
    }

    /// Drops all frames that were sent; the next frame must be a key frame after a gap.
    pub fn reset(&mut self) {
        self.decoder.flush();
        self.in_decoder.clear();
    }

    /// Ends the input; the pictures that the decoder held back are then ready.
    pub fn finish_input(&mut self) {
        let _ = self.decoder.send_eof(); // refused only by a decoder that is already at its end
    }

    /// Takes back a picture that is no longer needed, to reuse its memory.
    pub fn recycle(&mut self, picture: Picture) {
        self.maker.recycle(picture);
    }
}

fn ffmpeg_error(doing: &'static str) -> impl Fn(ff::Error) -> MediaError {
    move |source| MediaError::Ffmpeg { doing, source }
}
