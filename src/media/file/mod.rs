//! A recording in a complete file: frames in presentation order, in display orientation.
//!
//! A file may be cut anywhere, damaged anywhere or made to harm. So every loop here has a bound, a damaged packet costs
//! only that packet, and every failure has a reason.

mod by_number;
mod extent;
mod presentation;
mod stamps;
mod statements;

use std::io::{Read, Seek};

use ff::{Dictionary, codec, format, frame, media};
use ffmpeg_next as ff;

use extent::{FrameStatement, FramesRead};
pub(super) use presentation::{first_shown, hides_frames, is_before, start_of};
pub(super) use statements::stated_size;
pub use statements::{RecordingInfo, WholeRecording};
use statements::{capture_rate_of, created_at_of, is_plausible_duration, shown_size, stated_duration};

use super::clock::FrameClock;
use super::orientation::PictureOrientation;
use super::picture::Picture;
use super::picture_maker::PictureMaker;
use super::unread_recording::UnreadRecording;
use super::{MediaError, MediaLimits};

/// Accepted containers. FFmpeg would otherwise follow playlists to other files.
const CONTAINERS: &str = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts";

/// Decoders that may run, also while the file is probed: a decoder that never runs cannot be attacked.
const DECODERS: &str = "h264,hevc,vp8,vp9,libdav1d,av1,mjpeg,mpeg4,mpeg2video";

/// Maximum of streams that FFmpeg opens for the count; a file with more ends with an out-of-memory error.
const MAX_OPENED_STREAMS: &str = "64";

/// Maximum of failed reads in a row; a demuxer that always fails must not block the process.
pub(super) const MAX_FAILED_READS: u32 = 1_000;

/// Maximum of packets in a row without a picture. Ten seconds until a key frame, with sound, are under 2,000 packets.
const MAX_PACKETS_WITHOUT_PICTURE: u32 = 50_000;

const CODECS: [codec::Id; 8] = [
    codec::Id::H264,
    codec::Id::HEVC,
    codec::Id::VP8,
    codec::Id::VP9,
    codec::Id::AV1,
    codec::Id::MJPEG,
    codec::Id::MPEG4,
    codec::Id::MPEG2VIDEO,
];

/// An open recording.
pub struct VideoFile {
    input: format::context::Input,
    decoder: ff::decoder::Video,
    stream: usize,
    clock: FrameClock,
    /// Frames with an earlier stamp are not shown.
    first_shown: Option<i64>,
    statement: FrameStatement,
    /// Every time is the clock's, multiplied by this factor.
    time_factor: f64,
    maker: PictureMaker,
    info: RecordingInfo,
    limits: MediaLimits,
    decoded: u64,
    /// Decoded frames before the presentation's start.
    before_start: u64,
    /// Times of the first and the latest picture, s.
    times_s: Option<[f64; 2]>,
    starts_at_s: f64,
    pending: Option<ff::Packet>,
    drained: bool,
    first_size: Option<(u32, u32)>,
}

impl VideoFile {
    /// Opens a recording from an open descriptor or any other seekable bytes.
    ///
    /// # Errors
    /// [`MediaError`] if the recording cannot be read, is not accepted or exceeds the limits.
    pub fn open(mut bytes: impl Read + Seek + Send + 'static, limits: MediaLimits) -> Result<Self, MediaError> {
        let shown = UnreadRecording::of(&mut bytes);
        ff::init().map_err(ffmpeg_error("starting FFmpeg"))?;
        ff::log::set_level(ff::log::Level::Quiet);
        let is_cut = extent::is_cut(&mut bytes).map_err(|error| MediaError::Container(error.to_string()))?;
        let io = format::context::StreamIo::from_read_seek(bytes).map_err(ffmpeg_error("opening the recording"))?;
        let input = format::input_from_stream(io, None, Some(untrusted_options(CONTAINERS)))
            .map_err(|source| unopened(source, shown))?;
        check_codec(&input)?;
        Self::of(input, is_cut, limits)
    }

    /// Wraps an input that is already open, with any codec: for trusted sources.
    pub(super) fn from_input(input: format::context::Input, limits: MediaLimits) -> Result<Self, MediaError> {
        Self::of(input, false, limits)
    }

    fn of(input: format::context::Input, is_cut: bool, limits: MediaLimits) -> Result<Self, MediaError> {
        check_streams(&input, limits)?;
        let stream = input.streams().best(media::Type::Video).ok_or(MediaError::NoVideo)?;
        let (width, height) = stated_size(&stream)?;
        check_size(width, height, limits)?;
        let rate = f64::from(stream.avg_frame_rate());
        let first_shown = first_shown(&input);
        let clock = clock_of(&stream, first_shown, rate)?;
        let listed = u64::try_from(stream.frames()).ok().filter(|&n| n > 0);
        let duration_s = stated_duration(input.duration());
        if let Some(duration_s) = duration_s.filter(|&d| d > limits.duration_s && is_plausible_duration(d, listed)) {
            return Err(over_limit("the duration in seconds", duration_s, limits.duration_s));
        }
        let has_rate = rate.is_finite() && rate > 0.0;
        let frames_expected = listed
            .and_then(|_| presentation::table_length(&stream))
            .or(listed)
            .or(duration_s.filter(|_| has_rate).map(|d| (d * rate).round() as u64));
        let orientation = PictureOrientation::of_stream(&stream)?;
        let index = stream.index();
        let decoder = open_decoder(&stream, limits)?;
        let shown_size = orientation.displayed(shown_size(&stream, (width, height)));
        let (width, height) = orientation.displayed((width, height));
        Ok(Self {
            info: RecordingInfo {
                width,
                height,
                shown_size,
                frames_expected,
                duration_s,
                rate_hz: has_rate.then_some(rate),
                capture_rate_hz: capture_rate_of(&input),
                created_at_ms: created_at_of(&input),
            },
            statement: FrameStatement::of(&input, listed, is_cut),
            input,
            decoder,
            stream: index,
            clock,
            first_shown,
            time_factor: 1.0,
            maker: PictureMaker::new(orientation),
            limits,
            decoded: 0,
            before_start: 0,
            times_s: None,
            starts_at_s: 0.0,
            pending: None,
            drained: false,
            first_size: None,
        })
    }

    /// The container's statements.
    pub fn info(&self) -> RecordingInfo {
        self.info
    }

    /// Multiplies the times of all frames by this factor. Call it before the first picture.
    pub fn scale_times(&mut self, factor: f64) {
        self.time_factor = factor;
    }

    /// The next frame in presentation order, or `None` at the end. A damaged packet is skipped; a file that was cut
    /// ends where its bytes end.
    ///
    /// # Errors
    /// [`MediaError`] if no frame can be decoded, the picture changes its size or a limit is exceeded.
    pub fn next_picture(&mut self) -> Result<Option<Picture>, MediaError> {
        let mut video = self.maker.frame_to_fill();
        let mut waited = 0;
        while waited < MAX_PACKETS_WITHOUT_PICTURE {
            waited += 1;
            match self.decoder.receive_frame(&mut video) {
                Ok(()) if is_before(video.pts(), self.first_shown) => {
                    self.before_start += 1;
                    self.check_frame_count()?;
                    waited = 0;
                }
                Ok(()) => return self.picture(video).map(Some),
                Err(NO_MEMORY) => return Err(MediaError::Memory),
                Err(ff::Error::Eof) => return self.end(),
                Err(_) if self.drained => return self.end(),
                Err(_) => self.feed(),
            }
        }
        self.end()
    }

    /// What is known of the file after the last picture.
    pub fn whole(&self) -> WholeRecording {
        WholeRecording { frames_stated: self.frames_stated(), starts_at_s: self.starts_at_s }
    }

    fn frames_stated(&self) -> Option<u64> {
        let stream = self.input.stream(self.stream)?;
        let [first_s, last_s] = self.times_s?.map(|time_s| time_s / self.time_factor);
        let (shown, before_start) = (self.decoded, self.before_start);
        let read = FramesRead { shown, before_start, last_s: self.starts_at_s + last_s, span_s: last_s - first_s };
        self.statement.frames(&stream, read)
    }

    /// Puts back a packet that was read ahead.
    pub(super) fn put_back(&mut self, packet: ff::Packet) {
        self.pending = Some(packet);
    }

    /// Takes back a picture that is no longer needed, to reuse its memory.
    pub fn recycle(&mut self, picture: Picture) {
        self.maker.recycle(picture);
    }

    fn end(&self) -> Result<Option<Picture>, MediaError> {
        if self.decoded == 0 { Err(MediaError::NoFrames) } else { Ok(None) }
    }

    fn feed(&mut self) {
        let packet = self.next_packet();
        self.send(packet);
    }

    fn next_packet(&mut self) -> Option<ff::Packet> {
        self.pending.take().or_else(|| self.read_packet())
    }

    /// Sends the decoder one more packet, or the end of the stream. A refused packet is damaged and is dropped; the
    /// frames around it still count. A packet that the decoder has no room for yet is kept.
    fn send(&mut self, packet: Option<ff::Packet>) {
        match packet {
            Some(packet) if packet.stream() != self.stream => {}
            Some(packet) => {
                if self.decoder.send_packet(&packet) == Err(AGAIN) {
                    self.pending = Some(packet);
                }
            }
            None => {
                self.drained = true;
                // Only a decoder that is already at its end refuses this.
                let _ = self.decoder.send_eof();
            }
        }
    }

    fn read_packet(&mut self) -> Option<ff::Packet> {
        let mut packet = ff::Packet::empty();
        for _ in 0..MAX_FAILED_READS {
            match packet.read(&mut self.input) {
                Ok(()) => return Some(packet),
                Err(ff::Error::Eof) => return None,
                Err(_) => {}
            }
        }
        None
    }

    fn picture(&mut self, video: frame::Video) -> Result<Picture, MediaError> {
        let size = (video.width(), video.height());
        check_size(size.0, size.1, self.limits)?;
        let first = *self.first_size.get_or_insert(size);
        if first != size {
            return Err(MediaError::SizeChanged { from: first, to: size, frame: self.decoded });
        }
        self.check_frame_count()?;
        let pts = video.pts();
        let stamped_s = self.clock.time_s(video.timestamp().or(pts));
        let time_s = stamped_s * self.time_factor;
        if time_s > self.limits.duration_s {
            return Err(over_limit("the duration in seconds", time_s, self.limits.duration_s));
        }
        let picture = self.maker.make(video, self.decoded, time_s)?;
        self.decoded += 1;
        if self.times_s.is_none() {
            self.starts_at_s = self.players_time_s(pts).map_or(0.0, |players_s| (players_s - stamped_s).max(0.0));
        }
        self.times_s = Some([self.times_s.map_or(time_s, |[first_s, _]| first_s), time_s]);
        Ok(picture)
    }

    /// The time at which players show a frame of this stamp; `None` if the container does not count from their zero.
    fn players_time_s(&self, pts: Option<i64>) -> Option<f64> {
        pts.zip(self.first_shown).map(|(pts, zero)| self.clock.seconds(pts.saturating_sub(zero)))
    }

    fn check_frame_count(&self) -> Result<(), MediaError> {
        let decoded = self.decoded + self.before_start;
        if decoded >= self.limits.frames {
            return Err(over_limit("the number of frames", decoded + 1, self.limits.frames));
        }
        Ok(())
    }
}

const NO_MEMORY: ff::Error = ff::Error::Other { errno: ff::error::ENOMEM };
const AGAIN: ff::Error = ff::Error::Other { errno: ff::error::EAGAIN };

/// FFmpeg options for untrusted bytes: only these containers, our decoders, and no access to anything else.
pub(super) fn untrusted_options(containers: &str) -> Dictionary<'static> {
    let mut options = Dictionary::new();
    options.set("format_whitelist", containers);
    options.set("protocol_whitelist", "");
    options.set("codec_whitelist", DECODERS);
    options.set("max_streams", MAX_OPENED_STREAMS);
    options
}

pub(super) fn check_codec(input: &format::context::Input) -> Result<(), MediaError> {
    match input.streams().best(media::Type::Video).map(|stream| stream.parameters().id()) {
        Some(id) if !CODECS.contains(&id) => Err(MediaError::Codec(id.name().to_owned())),
        _ => Ok(()),
    }
}

pub(super) fn check_streams(input: &format::context::Input, limits: MediaLimits) -> Result<(), MediaError> {
    let streams = input.streams().count();
    if streams > limits.streams { Err(over_limit("the number of streams", streams, limits.streams)) } else { Ok(()) }
}

pub(super) fn clock_of(
    stream: &format::stream::Stream<'_>,
    first_shown: Option<i64>,
    rate_hz: f64,
) -> Result<FrameClock, MediaError> {
    let seconds_per_tick = f64::from(stream.time_base());
    if !(seconds_per_tick.is_finite() && seconds_per_tick > 0.0) {
        return Err(MediaError::Container("its video stream has no unit of time".into()));
    }
    Ok(FrameClock::new(seconds_per_tick, start_of(stream, first_shown), rate_hz))
}

fn open_decoder(stream: &format::stream::Stream<'_>, limits: MediaLimits) -> Result<ff::decoder::Video, MediaError> {
    let context =
        codec::Context::from_parameters(stream.parameters()).map_err(ffmpeg_error("reading codec parameters"))?;
    let mut options = Dictionary::new();
    options.set("threads", &limits.threads.max(1).to_string());
    options.set("thread_type", "frame+slice");
    options.set("max_pixels", &(u64::from(limits.width) * u64::from(limits.height)).to_string());
    let mut decoder = context.decoder();
    decoder.set_packet_time_base(stream.time_base());
    decoder
        .open_as_with(stream.parameters().id(), options)
        .and_then(|opened| opened.video())
        .map_err(ffmpeg_error("opening the decoder"))
}

pub(super) fn check_size(width: u32, height: u32, limits: MediaLimits) -> Result<(), MediaError> {
    let (long, short) = (width.max(height), width.min(height));
    if long > limits.width.max(limits.height) || short > limits.width.min(limits.height) {
        return Err(over_limit(
            "the picture",
            format!("{width}×{height} pixels"),
            format!("{}×{}", limits.width, limits.height),
        ));
    }
    Ok(())
}

/// Why FFmpeg did not open a recording, given what its first bytes show.
fn unopened(source: ff::Error, shown: Option<UnreadRecording>) -> MediaError {
    match (source, shown) {
        (NO_MEMORY, _) => MediaError::Memory,
        (_, Some(UnreadRecording::CutOff)) => MediaError::CutOff,
        (_, Some(UnreadRecording::Container(name, convert))) => MediaError::OtherContainer { name, convert },
        (_, Some(UnreadRecording::Photo)) => MediaError::PictureFile,
        (ff::Error::Other { errno: ff::ffi::EINVAL }, None) => MediaError::Container("an unknown container".to_owned()),
        (ff::Error::InvalidData, None) => MediaError::Container("damaged, or no video".to_owned()),
        (other, None) => MediaError::Container(other.to_string()),
    }
}

fn ffmpeg_error(doing: &'static str) -> impl Fn(ff::Error) -> MediaError {
    move |source| MediaError::Ffmpeg { doing, source }
}

fn over_limit(what: &'static str, value: impl ToString, limit: impl ToString) -> MediaError {
    MediaError::OverLimit { what, value: value.to_string(), limit: limit.to_string() }
}

#[cfg(test)]
mod tests;
