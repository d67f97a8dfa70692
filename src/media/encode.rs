//! Frames into an H.264 recording, each with its own time stamp, so that uneven and missing frames can be made.

use std::io::{Seek, Write};

use ff::{Dictionary, Packet, Rational, codec, encoder, format, frame, software::scaling, util::color};
use ffmpeg_next as ff;

use super::MediaError;
use crate::pipeline::frame::{Frame, Matrix, Plane, Range};

/// Ticks of a recording's clock in a second; the usual rate of video containers.
pub const TICKS_PER_S: i32 = 90_000;

/// How samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Samples {
    /// 8 bits, chroma halved in both directions: what every player plays.
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

impl Samples {
    fn pixel(self) -> format::Pixel {
        match self {
            Samples::Yuv420 => format::Pixel::YUV420P,
            Samples::Yuv422 => format::Pixel::YUV422P,
            Samples::Yuv444 => format::Pixel::YUV444P,
            Samples::Yuv420Deep => format::Pixel::YUV420P10LE,
            Samples::Yuv444Deep => format::Pixel::YUV444P10LE,
        }
    }
}

/// What a recording is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VideoSettings {
    /// Picture width, pixels; even unless chroma is full.
    pub width: u32,
    /// Picture height, pixels; even unless chroma is full.
    pub height: u32,
    /// Usual frame rate, Hz: a hint for the encoder; the time stamps decide.
    pub fps: f64,
    /// Sample format.
    pub samples: Samples,
    /// Constant rate factor, 0 (lossless) to 51; 20 is a good camera.
    pub crf: u8,
}

/// A recording in MP4 that is being written.
pub struct VideoWriter {
    output: format::context::Output,
    encoder: encoder::Video,
    stream_time_base: Rational,
    settings: VideoSettings,
    scaler: Option<scaling::Context>,
    last_ticks: Option<i64>,
}

impl VideoWriter {
    /// Begins a recording. Writes nothing that depends on the clock, the machine or its number of cores.
    pub fn create(bytes: impl Write + Seek + Send + 'static, settings: VideoSettings) -> Result<Self, MediaError> {
        ff::init().map_err(failed("starting FFmpeg"))?;
        ff::log::set_level(ff::log::Level::Quiet);
        let io = format::context::StreamIo::from_write_seek(bytes).map_err(failed("opening the recording"))?;
        let mut output =
            format::output_to_stream(io, None, Some("mp4")).map_err(failed("preparing an MP4 recording"))?;
        let encoder = open_encoder(&settings)?;
        let mut stream = output.add_stream_with(&encoder).map_err(failed("adding the video stream"))?;
        stream.set_time_base(Rational(1, TICKS_PER_S));
        let mut options = Dictionary::new();
        options.set("fflags", "+bitexact");
        output.write_header_with(options).map(drop).map_err(failed("writing the recording's header"))?;
        let stream_time_base = output.stream(0).map_or(Rational(1, TICKS_PER_S), |s| s.time_base());
        Ok(Self { output, encoder, stream_time_base, settings, scaler: None, last_ticks: None })
    }

    /// Adds a frame; its time must lie after the one before.
    pub fn write(&mut self, picture: &Frame<'_>) -> Result<(), MediaError> {
        let ticks = ticks(picture.time_s);
        if self.last_ticks.is_some_and(|last| ticks <= last) {
            return Err(MediaError::Order { time_s: picture.time_s });
        }
        self.last_ticks = Some(ticks);
        let mut video = self.convert(copied(picture)?)?;
        video.set_pts(Some(ticks));
        self.encoder.send_frame(&video).map_err(failed("encoding a frame"))?;
        self.drain()
    }

    /// Ends the recording. Without it the file cannot be played.
    pub fn finish(mut self) -> Result<(), MediaError> {
        self.encoder.send_eof().map_err(failed("ending the encoder"))?;
        self.drain()?;
        self.output.write_trailer().map_err(failed("writing the recording's end"))
    }

    fn convert(&mut self, video: frame::Video) -> Result<frame::Video, MediaError> {
        let (from, to) = (video.format(), self.settings.samples.pixel());
        if from == to {
            return Ok(video);
        }
        let (width, height) = (video.width(), video.height());
        let scaler = match &mut self.scaler {
            Some(scaler) if scaler.input().format == from => scaler,
            slot => slot.insert(
                scaling::Context::get(from, width, height, to, width, height, scaling::Flags::BILINEAR)
                    .map_err(failed("converting samples"))?,
            ),
        };
        let mut converted = frame::Video::empty();
        scaler.run(&video, &mut converted).map_err(failed("converting samples"))?;
        converted.set_color_space(video.color_space());
        converted.set_color_range(video.color_range());
        Ok(converted)
    }

    fn drain(&mut self) -> Result<(), MediaError> {
        let mut packet = Packet::empty();
        while self.encoder.receive_packet(&mut packet).is_ok() {
            packet.set_stream(0);
            packet.rescale_ts(Rational(1, TICKS_PER_S), self.stream_time_base);
            packet.write_interleaved(&mut self.output).map_err(failed("writing the recording"))?;
        }
        Ok(())
    }
}

/// A time as the recording's clock stores it.
pub fn ticks(time_s: f64) -> i64 {
    (time_s * f64::from(TICKS_PER_S)).round() as i64
}

fn open_encoder(settings: &VideoSettings) -> Result<encoder::Video, MediaError> {
    let h264 = encoder::find_by_name("libx264").ok_or(MediaError::NoEncoder)?;
    let mut video =
        codec::Context::new_with_codec(h264).encoder().video().map_err(failed("preparing the encoder"))?;
    video.set_width(settings.width);
    video.set_height(settings.height);
    video.set_format(settings.samples.pixel());
    video.set_time_base(Rational(1, TICKS_PER_S));
    video.set_frame_rate(Some(Rational((settings.fps * 1000.0).round() as i32, 1000)));
    video.set_colorspace(color::Space::BT709);
    video.set_color_range(color::Range::MPEG);
    video.set_gop((2.0 * settings.fps).round().max(1.0) as u32);
    video.set_flags(codec::Flags::GLOBAL_HEADER | codec::Flags::BITEXACT);
    let mut options = Dictionary::new();
    options.set("preset", "veryfast");
    options.set("crf", &settings.crf.to_string());
    options.set("threads", "2"); // fixed: the number of threads changes the bits
    video.open_with(options).map_err(|source| MediaError::Encoder {
        width: settings.width,
        height: settings.height,
        source,
    })
}

/// A frame's planes in memory that FFmpeg owns.
fn copied(picture: &Frame<'_>) -> Result<frame::Video, MediaError> {
    let pixel = match (picture.shift_x, picture.shift_y) {
        (1, 1) => format::Pixel::YUV420P,
        (1, 0) => format::Pixel::YUV422P,
        (0, 0) => format::Pixel::YUV444P,
        (x, y) => return Err(MediaError::PixelFormat(format!("with chroma shifted by {x} and {y}"))),
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

fn failed(doing: &'static str) -> impl Fn(ff::Error) -> MediaError {
    move |source| MediaError::Ffmpeg { doing, source }
}
