//! A recording that lies whole in a file: frames in presentation order, in display orientation.

use std::io::{Read, Seek};

use ff::{Dictionary, codec, format, frame, media, software::scaling};
use ffmpeg_next as ff;

use super::picture::{Picture, Rotation};
use super::{Limits, MediaError};

/// Containers that are accepted. FFmpeg would otherwise follow playlists to other files (TRUST, finding 1).
const CONTAINERS: &str = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts";

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

/// What the container says before a frame is decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordingInfo {
    /// Width as displayed, pixels.
    pub width: u32,
    /// Height as displayed, pixels.
    pub height: u32,
    /// Frames, as the container claims or its duration and rate suggest; for progress only.
    pub frames_expected: Option<u64>,
    /// Duration, s, as the container claims.
    pub duration_s: Option<f64>,
}

/// An open recording.
pub struct VideoFile {
    input: format::context::Input,
    decoder: ff::decoder::Video,
    stream: usize,
    seconds_per_tick: f64,
    start_ticks: i64,
    rotation: Rotation,
    info: RecordingInfo,
    limits: Limits,
    scaler: Option<scaling::Context>,
    decoded: u64,
    drained: bool,
    first_size: Option<(u32, u32)>,
}

impl VideoFile {
    /// Opens a recording from an open descriptor or any other seekable bytes.
    pub fn open(bytes: impl Read + Seek + Send + 'static, limits: Limits) -> Result<Self, MediaError> {
        ff::init().map_err(failed("starting FFmpeg"))?;
        ff::log::set_level(ff::log::Level::Quiet);
        let io = format::context::StreamIo::from_read_seek(bytes).map_err(failed("opening the recording"))?;
        let mut options = Dictionary::new();
        options.set("format_whitelist", CONTAINERS);
        options.set("protocol_whitelist", "");
        options.set("max_streams", &limits.streams.to_string());
        let input =
            format::input_from_stream(io, None, Some(options)).map_err(|e| MediaError::Container(e.to_string()))?;
        Self::from_input(input, limits)
    }

    fn from_input(input: format::context::Input, limits: Limits) -> Result<Self, MediaError> {
        let streams = input.streams().count();
        if streams > limits.streams {
            return Err(over("the number of streams", streams, limits.streams));
        }
        let stream = input.streams().best(media::Type::Video).ok_or(MediaError::NoVideo)?;
        let id = stream.parameters().id();
        if !CODECS.contains(&id) {
            return Err(MediaError::Codec(id.name().to_owned()));
        }
        let time_base = stream.time_base();
        let seconds_per_tick = f64::from(time_base.numerator()) / f64::from(time_base.denominator());
        let start_ticks = if stream.start_time() == ff::ffi::AV_NOPTS_VALUE { 0 } else { stream.start_time() };
        let duration_s = (input.duration() > 0).then(|| input.duration() as f64 / f64::from(ff::ffi::AV_TIME_BASE));
        if let Some(duration_s) = duration_s.filter(|d| *d > limits.duration_s) {
            return Err(over("the duration in seconds", duration_s, limits.duration_s));
        }
        let rate = f64::from(stream.avg_frame_rate());
        let frames_expected = match stream.frames() {
            n if n > 0 => Some(n as u64),
            _ => duration_s.filter(|_| rate.is_finite() && rate > 0.0).map(|d| (d * rate).round() as u64),
        };
        let rotation = rotation_of(&stream);
        let index = stream.index();
        let decoder = open_decoder(&stream, limits)?;
        let (width, height) = match rotation {
            Rotation::None | Rotation::Half => (decoder.width(), decoder.height()),
            Rotation::Right | Rotation::Left => (decoder.height(), decoder.width()),
        };
        check_size(decoder.width(), decoder.height(), limits)?;
        Ok(Self {
            info: RecordingInfo { width, height, frames_expected, duration_s },
            input,
            decoder,
            stream: index,
            seconds_per_tick,
            start_ticks,
            rotation,
            limits,
            scaler: None,
            decoded: 0,
            drained: false,
            first_size: None,
        })
    }

    /// What the container says of itself.
    pub fn info(&self) -> RecordingInfo {
        self.info
    }

    /// The next frame in presentation order, or `None` at the end. A damaged packet is skipped; a file cut short ends
    /// where its bytes end.
    pub fn next_picture(&mut self) -> Result<Option<Picture>, MediaError> {
        let mut video = frame::Video::empty();
        loop {
            match self.decoder.receive_frame(&mut video) {
                Ok(()) => return self.picture(video).map(Some),
                Err(ff::Error::Eof) => {
                    return if self.decoded == 0 { Err(MediaError::NoFrames) } else { Ok(None) };
                }
                Err(ff::Error::Other { errno: ff::error::EAGAIN }) if !self.drained => self.feed()?,
                Err(_) if self.drained => return if self.decoded == 0 { Err(MediaError::NoFrames) } else { Ok(None) },
                Err(_) => self.feed()?,
            }
        }
    }

    /// Gives the decoder one more packet, or its end. Damaged input costs that packet, never the recording.
    fn feed(&mut self) -> Result<(), MediaError> {
        const MOST_FAILED_READS: usize = 1_000; // a demuxer that fails for ever must not hold us
        let mut packet = ff::Packet::empty();
        for _ in 0..MOST_FAILED_READS {
            match packet.read(&mut self.input) {
                Ok(()) if packet.stream() != self.stream => return Ok(()),
                Ok(()) => {
                    // A refused packet is a damaged one: the frames around it still count.
                    let _ = self.decoder.send_packet(&packet);
                    return Ok(());
                }
                Err(ff::Error::Eof) => break,
                Err(_) => continue,
            }
        }
        self.drained = true;
        self.decoder.send_eof().map_err(failed("ending the decoder"))
    }

    fn picture(&mut self, video: frame::Video) -> Result<Picture, MediaError> {
        let size = (video.width(), video.height());
        check_size(size.0, size.1, self.limits)?;
        let first = *self.first_size.get_or_insert(size);
        if first != size {
            return Err(MediaError::SizeChanged { from: first, to: size, frame: self.decoded });
        }
        if self.decoded >= self.limits.frames {
            return Err(over("the number of frames", self.decoded + 1, self.limits.frames));
        }
        let ticks = video.timestamp().or(video.pts()).map_or(self.decoded as i64, |t| t - self.start_ticks);
        let time_s = ticks as f64 * self.seconds_per_tick;
        let picture = Picture::new(video, self.decoded, time_s, self.rotation, &mut self.scaler)?;
        self.decoded += 1;
        Ok(picture)
    }
}

fn open_decoder(stream: &format::stream::Stream<'_>, limits: Limits) -> Result<ff::decoder::Video, MediaError> {
    let context = codec::Context::from_parameters(stream.parameters()).map_err(failed("reading codec parameters"))?;
    let mut options = Dictionary::new();
    options.set("threads", &limits.threads.max(1).to_string());
    options.set("thread_type", "frame+slice");
    options.set("max_pixels", &(u64::from(limits.width) * u64::from(limits.height)).to_string());
    let mut decoder = context.decoder();
    decoder.set_packet_time_base(stream.time_base());
    decoder.open_with(options).and_then(|opened| opened.video()).map_err(failed("opening the decoder"))
}

fn rotation_of(stream: &format::stream::Stream<'_>) -> Rotation {
    let matrix = stream.side_data().find(|d| d.kind() == codec::packet::side_data::Type::DisplayMatrix);
    let Some(bytes) = matrix.as_ref().map(|d| d.data()).filter(|d| d.len() >= 36) else { return Rotation::None };
    let entry = |i: usize| i32::from_ne_bytes([bytes[4 * i], bytes[4 * i + 1], bytes[4 * i + 2], bytes[4 * i + 3]]);
    // The matrix's upper left 2×2 part, 16.16 fixed point: (a b; c d) maps stored to displayed.
    match (entry(0).signum(), entry(1).signum(), entry(3).signum(), entry(4).signum()) {
        (0, 1, -1, 0) => Rotation::Right,
        (-1, 0, 0, -1) => Rotation::Half,
        (0, -1, 1, 0) => Rotation::Left,
        _ => Rotation::None,
    }
}

fn check_size(width: u32, height: u32, limits: Limits) -> Result<(), MediaError> {
    let (long, short) = (width.max(height), width.min(height));
    if long > limits.width.max(limits.height) || short > limits.width.min(limits.height) {
        return Err(over(
            "the picture",
            format!("{width}×{height} pixels"),
            format!("{}×{}", limits.width, limits.height),
        ));
    }
    Ok(())
}

fn failed(doing: &'static str) -> impl Fn(ff::Error) -> MediaError {
    move |source| MediaError::Ffmpeg { doing, source }
}

fn over(what: &'static str, value: impl ToString, limit: impl ToString) -> MediaError {
    MediaError::OverLimit { what, value: value.to_string(), limit: limit.to_string() }
}
