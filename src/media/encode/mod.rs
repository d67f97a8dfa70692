//! Encodes frames into an H.264 recording, each with its own time stamp, so that uneven and missing frames are
//! possible.

use std::io::{Seek, Write};

use ff::{Dictionary, Packet, Rational, codec, encoder, format, frame, software::scaling, util::color};
use ffmpeg_next as ff;

use crate::vision::frame::{Frame, Matrix, Plane, Range};

/// Ticks of a recording's clock in a second; the usual rate of video containers.
pub const TICKS_PER_S: i32 = 90_000;

/// The sample format of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleFormat {
    /// 8 bits, chroma halved in both directions: every player supports it.
    Yuv420,
    /// 8 bits, chroma halved across.
    Yuv422,
    /// 8 bits, full chroma.
    Yuv444,
    /// 10 bits, chroma halved in both directions: phones in HDR.
    Yuv420Deep,
    /// 10 bits, full chroma.
    Yuv444Deep,
}

impl SampleFormat {
    fn pixel(self) -> format::Pixel {
        match self {
            SampleFormat::Yuv420 => format::Pixel::YUV420P,
            SampleFormat::Yuv422 => format::Pixel::YUV422P,
            SampleFormat::Yuv444 => format::Pixel::YUV444P,
            SampleFormat::Yuv420Deep => format::Pixel::YUV420P10LE,
            SampleFormat::Yuv444Deep => format::Pixel::YUV444P10LE,
        }
    }
}

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// A frame is not later than the previous one.
    #[error("the frame at {time_s} s is not later than the previous frame")]
    Order {
        /// Time of the frame, s.
        time_s: f64,
    },
    /// This FFmpeg cannot write H.264.
    #[error("this FFmpeg has no libx264 encoder; install a build that has it (Debian: libavcodec59)")]
    NoEncoder,
    /// The encoder refuses the size or the sample format.
    #[error(
        "libx264 cannot encode {width}×{height} pixels in this format ({source}); sizes must be even unless chroma is \
         full"
    )]
    Refused {
        /// Picture width, pixels.
        width: u32,
        /// Picture height, pixels.
        height: u32,
        /// FFmpeg's error.
        source: ff::Error,
    },
    /// A chroma resolution that H.264 does not support.
    #[error("chroma shifted by {x} and {y} cannot be encoded; use 4:2:0, 4:2:2 or 4:4:4")]
    Chroma {
        /// Shift across.
        x: u8,
        /// Shift down.
        y: u8,
    },
    /// FFmpeg failed.
    #[error("while {doing}: {source}")]
    Ffmpeg {
        /// The operation that failed.
        doing: &'static str,
        /// FFmpeg's error.
        source: ff::Error,
    },
}

/// Settings of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VideoSettings {
    /// Picture width, pixels; even unless chroma is full.
    pub width: u32,
    /// Picture height, pixels; even unless chroma is full.
    pub height: u32,
    /// Usual frame rate, Hz: a hint for the encoder; the time stamps decide.
    pub fps: f64,
    /// Sample format.
    pub samples: SampleFormat,
    /// Constant rate factor, 0 (lossless) to 51; 20 is like a good camera.
    pub crf: u8,
}

/// Writes an MP4 recording.
pub struct VideoWriter {
    output: format::context::Output,
    encoder: encoder::Video,
    stream_time_base: Rational,
    settings: VideoSettings,
    scaler: Option<scaling::Context>,
    last_ticks: Option<i64>,
}

impl VideoWriter {
    /// Begins a recording. The bytes do not depend on the clock, the machine or its number of cores.
    ///
    /// # Errors
    /// [`EncodeError`] if the encoder is missing or refuses the settings.
    pub fn create(bytes: impl Write + Seek + Send + 'static, settings: VideoSettings) -> Result<Self, EncodeError> {
        ff::init().map_err(ffmpeg_error("starting FFmpeg"))?;
        ff::log::set_level(ff::log::Level::Quiet);
        let io = format::context::StreamIo::from_write_seek(bytes).map_err(ffmpeg_error("opening the recording"))?;
        let mut output =
            format::output_to_stream(io, None, Some("mp4")).map_err(ffmpeg_error("preparing an MP4 recording"))?;
        let encoder = open_encoder(&settings)?;
        let mut stream = output.add_stream_with(&encoder).map_err(ffmpeg_error("adding the video stream"))?;
        stream.set_time_base(Rational(1, TICKS_PER_S));
        let mut options = Dictionary::new();
        options.set("fflags", "+bitexact");
        output.write_header_with(options).map(drop).map_err(ffmpeg_error("writing the recording's header"))?;
        let stream_time_base = output.stream(0).map_or(Rational(1, TICKS_PER_S), |s| s.time_base());
        Ok(Self { output, encoder, stream_time_base, settings, scaler: None, last_ticks: None })
    }

    /// Adds a frame; its time must be later than that of the previous frame.
    ///
    /// # Errors
    /// [`EncodeError`] if the time is not later, the chroma resolution is not supported, or FFmpeg fails.
    pub fn write(&mut self, picture: &Frame<'_>) -> Result<(), EncodeError> {
        let ticks = ticks(picture.time_s);
        if self.last_ticks.is_some_and(|last| ticks <= last) {
            return Err(EncodeError::Order { time_s: picture.time_s });
        }
        self.last_ticks = Some(ticks);
        let mut video = self.convert(copy_frame(picture)?)?;
        video.set_pts(Some(ticks));
        self.encoder.send_frame(&video).map_err(ffmpeg_error("encoding a frame"))?;
        self.drain()
    }

    /// Ends the recording. Without it the file cannot be played.
    pub fn finish(mut self) -> Result<(), EncodeError> {
        self.encoder.send_eof().map_err(ffmpeg_error("ending the encoder"))?;
        self.drain()?;
        self.output.write_trailer().map_err(ffmpeg_error("writing the recording's end"))
    }

    fn convert(&mut self, video: frame::Video) -> Result<frame::Video, EncodeError> {
        let (from, to) = (video.format(), self.settings.samples.pixel());
        if from == to {
            return Ok(video);
        }
        let (width, height) = (video.width(), video.height());
        let scaler = match &mut self.scaler {
            Some(scaler) if scaler.input().format == from => scaler,
            slot => slot.insert(
                scaling::Context::get(from, width, height, to, width, height, scaling::Flags::BILINEAR)
                    .map_err(ffmpeg_error("converting samples"))?,
            ),
        };
        let mut converted = frame::Video::empty();
        scaler.run(&video, &mut converted).map_err(ffmpeg_error("converting samples"))?;
        converted.set_color_space(video.color_space());
        converted.set_color_range(video.color_range());
        Ok(converted)
    }

    fn drain(&mut self) -> Result<(), EncodeError> {
        let mut packet = Packet::empty();
        while self.encoder.receive_packet(&mut packet).is_ok() {
            packet.set_stream(0);
            // Without a duration the container ends at the start of its last frame, and players leave that frame out.
            packet.set_duration((f64::from(TICKS_PER_S) / self.settings.fps).round() as i64);
            packet.rescale_ts(Rational(1, TICKS_PER_S), self.stream_time_base);
            packet.write_interleaved(&mut self.output).map_err(ffmpeg_error("writing the recording"))?;
        }
        Ok(())
    }
}

/// A time in ticks of the recording's clock.
pub fn ticks(time_s: f64) -> i64 {
    (time_s * f64::from(TICKS_PER_S)).round() as i64
}

fn open_encoder(settings: &VideoSettings) -> Result<encoder::Video, EncodeError> {
    let h264 = encoder::find_by_name("libx264").ok_or(EncodeError::NoEncoder)?;
    let mut video =
        codec::Context::new_with_codec(h264).encoder().video().map_err(ffmpeg_error("preparing the encoder"))?;
    video.set_width(settings.width);
    video.set_height(settings.height);
    video.set_format(settings.samples.pixel());
    video.set_time_base(Rational(1, TICKS_PER_S));
    video.set_frame_rate(Some(Rational((settings.fps * 1000.0).round() as i32, 1000)));
    video.set_colorspace(color::Space::BT709);
    video.set_color_range(color::Range::MPEG);
    video.set_gop((2.0 * settings.fps).round().max(1.0) as u32);
    // Closed groups: after a browser seeks to a key frame, no picture may need the previous group.
    video.set_flags(codec::Flags::GLOBAL_HEADER | codec::Flags::BITEXACT | codec::Flags::CLOSED_GOP);
    let mut options = Dictionary::new();
    options.set("preset", "veryfast");
    options.set("crf", &settings.crf.to_string());
    options.set("chroma_sample_location", "center"); // as the simulator renders it, and as the scaler converts
    options.set("threads", "2"); // fixed: the number of threads changes the bits
    video.open_with(options).map_err(|source| EncodeError::Refused {
        width: settings.width,
        height: settings.height,
        source,
    })
}

/// Copies a frame's planes into memory that FFmpeg owns.
pub(super) fn copy_frame(picture: &Frame<'_>) -> Result<frame::Video, EncodeError> {
    let pixel = match (picture.shift_x, picture.shift_y) {
        (1, 1) => format::Pixel::YUV420P,
        (1, 0) => format::Pixel::YUV422P,
        (0, 1) => format::Pixel::YUV440P, // 4:2:2, turned by a quarter
        (0, 0) => format::Pixel::YUV444P,
        (x, y) => return Err(EncodeError::Chroma { x, y }),
    };
    let mut video = frame::Video::new(pixel, picture.width() as u32, picture.height() as u32);
    for (index, plane) in [picture.y, picture.u, picture.v].into_iter().enumerate() {
        copy_plane(plane, &mut video, index);
    }
    video.set_color_space(match picture.encoding.matrix {
        Matrix::Bt601 => color::Space::SMPTE170M,
        Matrix::Bt709 => color::Space::BT709,
        Matrix::Bt2020 => color::Space::BT2020NCL,
    });
    video.set_color_range(match picture.encoding.range {
        Range::Limited => color::Range::MPEG,
        Range::Full => color::Range::JPEG,
    });
    Ok(video)
}

fn copy_plane(plane: Plane<'_>, video: &mut frame::Video, index: usize) {
    let stride = video.stride(index);
    let rows = video.data_mut(index).chunks_mut(stride);
    for (y, row) in rows.take(plane.height).enumerate() {
        row[..plane.width].copy_from_slice(plane.row(y));
    }
}

fn ffmpeg_error(doing: &'static str) -> impl Fn(ff::Error) -> EncodeError {
    move |source| EncodeError::Ffmpeg { doing, source }
}

#[cfg(test)]
mod tests;
