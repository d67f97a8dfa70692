//! Sources of frames: a camera, a file or an address that a box's agent captures, or a stream that a sender pushes.
//! Frames keep their coding if the feed supports the codec; other frames are decoded, turned upright, and coded as
//! good JPEGs.
//!
//! | source | frames |
//! |---|---|
//! | H.264 | unchanged, in Annex B form, parameter sets with every key frame |
//! | MJPEG | unchanged |
//! | H.264 without presentation times, or with frames that players hide; pictures that are turned or mirrored for display; any other codec; raw pictures | JPEG |

use std::ffi::CString;
use std::io::Read;
use std::os::unix::fs::FileTypeExt;

use ff::{Dictionary, Packet, codec, format, media};
use ffmpeg_next as ff;
use serde::{Deserialize, Serialize};

use super::annexb::{AnnexB, is_hidden};
use super::clock::{FrameClock, GAP_S, JITTER_S};
use super::encode::EncodeError;
use super::file::{
    MAX_FAILED_READS, check_codec, check_size, check_streams, clock_of, first_shown, hides_frames, is_before, start_of,
    stated_size, untrusted_options,
};
use super::jpeg::{JpegMaker, JpegStyle};
use super::orientation::PictureOrientation;
use super::{MediaError, MediaLimits, VideoFile, device};
use crate::domain::feed::record::{GapReason, RecordBody};
use crate::domain::feed::{FrameCodec, MAX_DURATION_S, MAX_PAYLOAD, TimeBase};

/// Containers of live streams: they can be read from beginning to end without seeking, and are valid wherever they are
/// cut.
const LIVE_CONTAINERS: &str = "mpegts,matroska,webm";

/// Duration of a pushed stream that is probed before its first frame is returned, µs; it must contain a key frame. A
/// longer time delays the first positions; a shorter one finds no picture in streams with rare key frames.
const PROBE_US: &str = "2000000";

/// Bytes of a pushed stream that are kept while it is probed: FFmpeg goes back to the beginning of a transport stream.
const PROBE_BYTES: usize = 1 << 20;

/// Why a source cannot be captured, or not any longer.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The address is invalid.
    #[error("the source's name holds a zero byte")]
    Address,
    /// Cameras cannot be read.
    #[error("{0}")]
    Device(String),
    /// FFmpeg cannot open the source.
    #[error("the source cannot be opened ({0})")]
    Open(ff::Error),
    /// FFmpeg can no longer read the source.
    #[error("the source can no longer be read ({0})")]
    Read(ff::Error),
    /// The source's contents cannot be used.
    #[error(transparent)]
    Media(#[from] MediaError),
    /// The source's pictures cannot be coded.
    #[error("the source's pictures cannot be coded: {0}")]
    Encode(#[from] EncodeError),
}

/// Properties of a source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceInfo {
    /// The codec of the returned frames.
    pub codec: FrameCodec,
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// The clock of [`CapturedFrame::time`]: the source's own if a feed allows it.
    pub time_base: TimeBase,
    /// The source's codec, if its frames are coded again.
    pub coded_from: Option<String>,
    /// True if it has an end of its own, such as a file. The end of a camera or live stream is a fault.
    pub has_end: bool,
    /// True for a file, which can be read at any speed.
    pub is_file: bool,
    /// True for a camera.
    pub is_camera: bool,
}

/// A captured frame; frames come in decoding order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CapturedFrame {
    /// Presentation time, ticks since the recording's start; not checked against a feed's limits.
    pub time: i64,
    /// Decoding time, s since the first frame.
    pub due_s: f64,
    /// True if the frame can be decoded without earlier frames.
    pub is_key: bool,
    /// Its bytes; empty if the frame was damaged.
    pub bytes: Vec<u8>,
}

impl CapturedFrame {
    /// The frame as a record of a feed. A frame that a feed does not accept, because it is damaged, too long or out of
    /// time, becomes a gap.
    pub fn body(&self, number: u64, clock: TimeBase) -> RecordBody<'_> {
        let is_in_time = (0.0..=MAX_DURATION_S).contains(&clock.seconds(self.time));
        if (1..=MAX_PAYLOAD).contains(&self.bytes.len()) && is_in_time {
            return RecordBody::Frame { time: self.time, is_key: self.is_key, payload: &self.bytes };
        }
        RecordBody::Gap { last: number, reason: GapReason::Camera }
    }
}

/// An open source.
pub struct CaptureSource {
    info: SourceInfo,
    frames: FrameReader,
}

/// What is known of a source by its address.
struct SourceKind {
    has_end: bool,
    is_file: bool,
    is_camera: bool,
}

enum FrameReader {
    Copied(CopiedFrames),
    Recoded { video: Box<VideoFile>, coder: JpegMaker },
}

struct CopiedFrames {
    input: format::context::Input,
    stream: usize,
    first: Option<Packet>,
    first_shown: Option<i64>,
    annex_b: Option<AnnexB>,
    clock: StampClock,
}

impl CaptureSource {
    /// Opens a source, with options for FFmpeg. Reading ends soon after `is_over` returns true.
    ///
    /// # Errors
    /// [`SourceError`] if the source cannot be opened or holds no usable video.
    pub fn open(
        address: &str,
        options: &[(String, String)],
        is_over: impl FnMut() -> bool + Send + 'static,
    ) -> Result<Self, SourceError> {
        CString::new(address).map_err(|_| SourceError::Address)?; // FFmpeg's wrapper panics on it
        ff::init().map_err(SourceError::Open)?;
        ff::log::set_level(ff::log::Level::Quiet);
        let mut dictionary = Dictionary::new();
        dictionary.set("rtsp_transport", "tcp"); // over UDP, frames are lost without notice
        options.iter().for_each(|(key, value)| dictionary.set(key, value));
        let kind = std::fs::metadata(address).map(|found| found.file_type());
        let is_pipe = kind.as_ref().is_ok_and(FileTypeExt::is_fifo)
            || ["pipe:", "fd:"].iter().any(|scheme| address.starts_with(scheme));
        let (is_file, is_camera) = kind.map_or((false, false), |kind| (kind.is_file(), kind.is_char_device()));
        let mut input = if is_camera {
            // The kernel's time stamps, from its monotonic clock.
            dictionary.set("timestamps", "default");
            let camera = ff::Format::Input(device::format(device::CAMERA).map_err(SourceError::Device)?);
            format::open_with(address, &camera, dictionary).map_err(SourceError::Open)?.input()
        } else {
            let address = if is_file { format!("file:{address}") } else { address.to_owned() };
            format::input_with_interrupt_and_dictionary(&address, is_over, dictionary).map_err(SourceError::Open)?
        };
        let has_end = match is_playlist(&input) {
            true => has_duration(&input),
            false => is_file || is_pipe || has_length(&mut input),
        };
        Self::of(input, SourceKind { has_end, is_file, is_camera })
    }

    /// Opens a live stream that a sender pushes: MPEG-TS or Matroska from bytes that can be read once. The bytes are
    /// not trusted, like those of a [`VideoFile`].
    ///
    /// # Errors
    /// [`SourceError`] if the stream cannot be read, exceeds the limits or holds no usable video.
    pub fn pushed(bytes: impl Read + Send + 'static, limits: MediaLimits) -> Result<Self, SourceError> {
        ff::init().map_err(SourceError::Open)?;
        ff::log::set_level(ff::log::Level::Quiet);
        let io = format::context::StreamIo::from_read_with_capacity(bytes, PROBE_BYTES).map_err(SourceError::Open)?;
        let mut options = untrusted_options(LIVE_CONTAINERS);
        options.set("analyzeduration", PROBE_US);
        let input = format::input_from_stream(io, None, Some(options)).map_err(SourceError::Open)?;
        check_streams(&input, limits)?;
        check_codec(&input)?;
        let stream = input.streams().best(media::Type::Video).ok_or(MediaError::NoVideo)?;
        let (width, height) = stated_size(&stream)?;
        check_size(width, height, limits)?;
        Self::of(input, SourceKind { has_end: true, is_file: false, is_camera: false })
    }

    fn of(mut input: format::context::Input, kind: SourceKind) -> Result<Self, SourceError> {
        let SourceKind { has_end, is_file, is_camera } = kind;
        let stream = input.streams().best(media::Type::Video).ok_or(MediaError::NoVideo)?;
        let (index, id) = (stream.index(), stream.parameters().id());
        let orientation = PictureOrientation::of_stream(&stream)?;
        let size = stated_size(&stream)?;
        let ticks = stream.time_base();
        let time_base = feed_time_base(ticks)?;
        let reorders = id == codec::Id::H264 && may_reorder(&stream);
        let first_shown = first_shown(&input);
        let stamps = StampClock::new(&stream, first_shown, reorders, time_base)?;
        let hides_frames = hides_frames(&stream);
        let annex_b = (id == codec::Id::H264).then(|| AnnexB::new(&stream.parameters(), ticks)).transpose();
        let annex_b = annex_b.map_err(SourceError::Open)?;
        let first = read_packet(&mut input, index)?.ok_or(MediaError::NoFrames)?;
        let is_upright = orientation == PictureOrientation::UPRIGHT;
        let is_whole = !hides_frames && !is_hidden(&first) && !is_before(first.pts(), first_shown);
        let is_plain = is_upright && is_whole && (!reorders || first.pts().is_some());
        let codec = match id {
            codec::Id::H264 if is_plain => FrameCodec::H264,
            _ => FrameCodec::Jpeg,
        };
        if is_plain && [codec::Id::H264, codec::Id::MJPEG].contains(&id) {
            let info = SourceInfo { codec, size, time_base, coded_from: None, has_end, is_file, is_camera };
            let passed = CopiedFrames { input, stream: index, first: Some(first), first_shown, annex_b, clock: stamps };
            return Ok(Self { info, frames: FrameReader::Copied(passed) });
        }
        // One thread: more threads would delay frames.
        let mut video = Box::new(VideoFile::from_input(input, MediaLimits { threads: 1, ..MediaLimits::default() })?);
        video.put_back(first);
        let size = (video.info().width, video.info().height);
        let coded_from = Some(id.name().to_owned());
        let info = SourceInfo { codec, size, time_base, coded_from, has_end, is_file, is_camera };
        Ok(Self { info, frames: FrameReader::Recoded { video, coder: JpegMaker::new(JpegStyle::FULL) } })
    }

    /// Properties of the source.
    pub fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// The next frame, or `None` at the source's end.
    ///
    /// # Errors
    /// [`SourceError`] if the source can no longer be read, or a picture cannot be coded.
    pub fn next_frame(&mut self) -> Result<Option<CapturedFrame>, SourceError> {
        match &mut self.frames {
            FrameReader::Copied(passed) => passed.next_frame(),
            FrameReader::Recoded { video, coder } => {
                let Some(picture) = video.next_picture()? else { return Ok(None) };
                let bytes = coder.code(&picture.frame())?;
                let due_s = picture.frame().time_s;
                video.recycle(picture);
                Ok(Some(CapturedFrame { time: in_ticks(due_s, self.info.time_base), due_s, is_key: true, bytes }))
            }
        }
    }
}

impl CopiedFrames {
    /// The next packet that is shown. A frame before the presentation's start, if it comes after the first key frame, is
    /// needed by none that is shown.
    fn next_packet(&mut self) -> Result<Option<Packet>, SourceError> {
        if let Some(first) = self.first.take() {
            return Ok(Some(first));
        }
        loop {
            match read_packet(&mut self.input, self.stream)? {
                Some(packet) if is_before(packet.pts(), self.first_shown) => {}
                packet => return Ok(packet),
            }
        }
    }

    fn next_frame(&mut self) -> Result<Option<CapturedFrame>, SourceError> {
        let Some(packet) = self.next_packet()? else { return Ok(None) };
        let (time, due_s) = self.clock.of(&packet);
        let is_key = packet.is_key() || self.annex_b.is_none();
        let bytes = match &mut self.annex_b {
            Some(filter) => filter.access_unit(packet).unwrap_or_default(), // damaged
            None => packet.data().unwrap_or_default().to_vec(),
        };
        Ok(Some(CapturedFrame { time, due_s, is_key, bytes }))
    }
}

/// Computes the time of a frame from its packet's stamps; [`VideoFile`] will compute the same time from the recording.
struct StampClock {
    order: StampOrder,
    seconds_per_tick: f64,
    time_base: TimeBase,
}

enum StampOrder {
    /// Presentation order equals decoding order.
    AsDecoded(FrameClock),
    /// Frames are presented in another order. `ahead` is the offset between the stream's stamps and the recording's
    /// times, in ticks of the stream; it changes if the decoding stamps jump because a clock was set. `last` is the
    /// latest decoding stamp, and `step` its latest step.
    Reordered { ahead: Option<i64>, last: Option<i64>, step: i64 },
}

impl StampClock {
    fn new(
        stream: &format::stream::Stream<'_>,
        first_shown: Option<i64>,
        reorders: bool,
        time_base: TimeBase,
    ) -> Result<Self, MediaError> {
        let order = match reorders {
            true => StampOrder::Reordered { ahead: start_of(stream, first_shown), last: None, step: 0 },
            false => StampOrder::AsDecoded(clock_of(stream, first_shown, f64::from(stream.avg_frame_rate()))?),
        };
        Ok(Self { order, seconds_per_tick: f64::from(stream.time_base()), time_base })
    }

    /// Presentation time of a frame, ticks of the feed, and its decoding time, s.
    fn of(&mut self, packet: &Packet) -> (i64, f64) {
        let (shown_s, due_s) = match &mut self.order {
            StampOrder::AsDecoded(clock) => {
                let time_s = clock.time_s(packet.pts().or(packet.dts()));
                (time_s, time_s)
            }
            StampOrder::Reordered { ahead, last, step } => {
                let decoded = packet.dts().or(*last).or(packet.pts()).unwrap_or(0);
                let shown = packet.pts().unwrap_or(decoded);
                let ahead = ahead.get_or_insert(shown);
                if let Some(last) = *last {
                    let step_s = decoded.saturating_sub(last) as f64 * self.seconds_per_tick;
                    match (-JITTER_S..=GAP_S).contains(&step_s) {
                        true => *step = decoded - last,
                        false => *ahead = ahead.saturating_add(decoded - last - *step),
                    }
                }
                *last = packet.dts().or(*last);
                let seconds = |stamp: i64| stamp.saturating_sub(*ahead) as f64 * self.seconds_per_tick;
                (seconds(shown), seconds(decoded))
            }
        };
        (in_ticks(shown_s, self.time_base), due_s)
    }
}

fn in_ticks(time_s: f64, time_base: TimeBase) -> i64 {
    let (num, den) = time_base.fraction();
    (time_s * f64::from(den) / f64::from(num)).round() as i64
}

/// The stream's own clock; if that is too coarse, a finer one that contains its ticks exactly; otherwise the usual
/// video clock.
fn feed_time_base(ticks: ff::Rational) -> Result<TimeBase, MediaError> {
    const FINEST: u32 = 100_000;
    const VIDEO: u32 = 90_000;
    let own = u32::try_from(ticks.denominator()).ok().filter(|den| (1..=FINEST).contains(den));
    let den = match (ticks.numerator(), own) {
        (1, Some(den @ 1000..)) => den,
        (_, Some(den)) => den * (FINEST / den),
        (_, None) => VIDEO,
    };
    TimeBase::try_from([1, den]).map_err(|error| MediaError::Container(error.to_string()))
}

/// True for HLS and DASH: the address is that of a playlist, which has a length even if its stream is live.
fn is_playlist(input: &format::context::Input) -> bool {
    input.format().name().split(',').any(|name| ["hls", "dash"].contains(&name))
}

/// True if a playlist is complete: a live one states no duration, and FFmpeg may estimate one by the bit rate.
fn has_duration(input: &format::context::Input) -> bool {
    // SAFETY: the input is open.
    let origin = unsafe { (*input.as_ptr()).duration_estimation_method };
    input.duration() > 0 && origin != ff::ffi::AVDurationEstimationMethod::AVFMT_DURATION_FROM_BITRATE
}

/// True if the input states its length, as a file on a web server does and a live stream does not.
fn has_length(input: &mut format::context::Input) -> bool {
    // SAFETY: the input is open and not read meanwhile; its `pb` is null for cameras and some protocols.
    unsafe {
        let io = (*input.as_mut_ptr()).pb;
        !io.is_null() && ff::ffi::avio_size(io) > 0
    }
}

/// True if the presentation order may differ from the decoding order.
fn may_reorder(stream: &format::stream::Stream<'_>) -> bool {
    let parameters = stream.parameters();
    // SAFETY: the parameters live as long as `parameters`, and FFmpeg does not write to them after probing.
    unsafe { (*parameters.as_ptr()).video_delay > 0 }
}

/// The next packet of a stream, or `None` at the end. Damaged packets are skipped.
fn read_packet(input: &mut format::context::Input, stream: usize) -> Result<Option<Packet>, SourceError> {
    let mut failures = 0;
    loop {
        let mut packet = Packet::empty();
        match packet.read(input) {
            Ok(()) if packet.stream() == stream => return Ok(Some(packet)),
            Ok(()) => {}
            Err(ff::Error::Eof | ff::Error::Exit) => return Ok(None),
            Err(ff::Error::InvalidData) if failures < MAX_FAILED_READS => failures += 1,
            Err(error) => return Err(SourceError::Read(error)),
        }
    }
}

#[cfg(test)]
mod tests;
