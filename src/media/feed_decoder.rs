//! Frames of a feed, decoded as they come: no container, one frame in, and as soon as the codec allows, one picture out.
//!
//! Frames come in the order of decoding, each with the moment it is shown. A damaged frame costs itself; behind a hole of
//! H.264 nothing counts until the next key frame, which is for the caller to know.

use ff::{Dictionary, Packet, Rational, codec};
use ffmpeg_next as ff;

use super::file::check_size;
use super::frame_size::frame_size;
use super::picture::Picture;
use super::picture_maker::{PictureMaker, Rotation};
use super::{Limits, MediaError};
use crate::domain::feed::{FrameCodec, TimeBase};

/// Frames that a decoder may keep back to put them in order: H.264 allows 16.
const MOST_KEPT_BACK: usize = 32;

/// The decoder of one feed.
pub struct FeedDecoder {
    codec: FrameCodec,
    decoder: ff::decoder::Video,
    maker: PictureMaker,
    time_base: TimeBase,
    size: (u32, u32),
    limits: Limits,
    /// Time, ticks, and number of frames that went in and have not come out.
    inside: Vec<(i64, u64)>,
    last_time: Option<i64>,
}

impl FeedDecoder {
    /// A decoder for frames of this size. One thread: with more, each picture would come frames later.
    pub fn new(codec: FrameCodec, size: (u32, u32), time_base: TimeBase, limits: Limits) -> Result<Self, MediaError> {
        ff::init().map_err(failed("starting FFmpeg"))?;
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
            .map_err(failed("opening the decoder"))?;
        let maker = PictureMaker::new(Rotation::None);
        Ok(Self { codec, decoder, maker, time_base, size, limits, inside: Vec::new(), last_time: None })
    }

    /// Takes the next frame: its number, the moment it is shown, ticks, and its bytes. Take the pictures before the next one.
    ///
    /// # Errors
    /// A picture of another size than was agreed.
    pub fn take(&mut self, number: u64, time: i64, bytes: &[u8]) -> Result<(), MediaError> {
        if let Some(size) = frame_size(self.codec, bytes).filter(|size| *size != self.size) {
            return Err(MediaError::SizeChanged { from: self.size, to: size, frame: number });
        }
        let mut packet = Packet::copy(bytes);
        packet.set_pts(Some(time));
        if self.decoder.send_packet(&packet).is_ok() {
            if self.inside.len() == MOST_KEPT_BACK {
                self.inside.remove(0); // damaged: it never came out
            }
            self.inside.push((time, number));
        }
        Ok(())
    }

    /// The next picture, if one is ready. A picture whose time does not come after the one before is left out.
    ///
    /// # Errors
    /// A picture of another size than was agreed, or one that cannot be brought to planar YUV.
    pub fn next_picture(&mut self) -> Result<Option<Picture>, MediaError> {
        loop {
            let mut video = self.maker.frame_to_fill();
            match self.decoder.receive_frame(&mut video) {
                Ok(()) => {}
                Err(ff::Error::Other { errno: ff::error::ENOMEM }) => return Err(MediaError::Memory),
                Err(_) => return Ok(None), // it needs more, or what it got is damaged
            }
            let Some(time) = video.timestamp().or(video.pts()) else { continue };
            let Some(place) = self.inside.iter().position(|(shown, _)| *shown == time) else { continue };
            let (_, number) = self.inside.swap_remove(place);
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

    /// Forgets what it was given: what comes next is a key frame behind a hole.
    pub fn start_over(&mut self) {
        self.decoder.flush();
        self.inside.clear();
    }

    /// Nothing more comes: the pictures that were kept back are ready.
    pub fn end(&mut self) {
        let _ = self.decoder.send_eof(); // refused only by a decoder that is at its end
    }

    /// Takes back a picture that is done with: its memory serves one to come.
    pub fn take_back(&mut self, picture: Picture) {
        self.maker.take_back(picture);
    }
}

fn failed(doing: &'static str) -> impl Fn(ff::Error) -> MediaError {
    move |source| MediaError::Ffmpeg { doing, source }
}
