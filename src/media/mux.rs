//! Writes coded frames into an MP4 recording: nothing is decoded or coded again.

use std::io::{Seek, Write};

use ff::{Dictionary, Packet, Rational, codec, ffi, format, packet};
use ffmpeg_next as ff;

use crate::domain::feed::{FrameCodec, TimeBase};

/// Why a recording cannot be assembled.
#[derive(Debug, thiserror::Error)]
pub enum MuxError {
    /// The first H.264 frame has no parameter sets.
    #[error("the first key frame has no parameter sets (SPS and PPS); senders must repeat them with every key frame")]
    NoParameterSets,
    /// FFmpeg failed.
    #[error("while {doing}: {source}")]
    Ffmpeg {
        /// The operation that failed.
        doing: &'static str,
        /// FFmpeg's error.
        source: ff::Error,
    },
}

/// Properties of the video stream of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stream<'a> {
    /// Codec of the frames.
    pub codec: FrameCodec,
    /// Picture width and height, pixels.
    pub size: (u32, u32),
    /// The clock of [`CodedFrame::pts`] and [`CodedFrame::dts`].
    pub time_base: TimeBase,
    /// The first frame that will be written.
    pub first: &'a [u8],
}

/// A coded frame to write into a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodedFrame<'a> {
    /// Presentation time, ticks.
    pub pts: i64,
    /// Decoding time, ticks: later than that of the previous frame, and not after the presentation time.
    pub dts: i64,
    /// Duration, ticks.
    pub duration: i64,
    /// True if the frame can be decoded without earlier frames.
    pub is_key: bool,
    /// Its bytes.
    pub bytes: &'a [u8],
}

/// Assembles an MP4 recording from coded frames.
pub struct Muxer {
    output: format::context::Output,
    from: Rational,
    to: Rational,
}

impl Muxer {
    /// Begins a recording.
    ///
    /// # Errors
    /// [`MuxError`] if the first frame has no parameter sets, or FFmpeg fails.
    pub fn create(bytes: impl Write + Seek + Send + 'static, stream: Stream<'_>) -> Result<Self, MuxError> {
        ff::init().map_err(ffmpeg_error("starting FFmpeg"))?;
        ff::log::set_level(ff::log::Level::Quiet);
        let io = format::context::StreamIo::from_write_seek(bytes).map_err(ffmpeg_error("opening the recording"))?;
        let mut output =
            format::output_to_stream(io, None, Some("mp4")).map_err(ffmpeg_error("preparing an MP4 recording"))?;
        let (num, den) = stream.time_base.fraction();
        let from = Rational(num as i32, den as i32); // checked: at most i32::MAX
        let mut track = output.add_stream(None::<ff::Codec>).map_err(ffmpeg_error("adding the video"))?;
        track.set_time_base(from);
        track.set_parameters(parameters(stream)?);
        let mut options = Dictionary::new();
        options.set("fflags", "+bitexact");
        options.set("video_track_timescale", &den.to_string()); // keeps the times exact
        output.write_header_with(options).map(drop).map_err(ffmpeg_error("writing the recording's header"))?;
        let to = output.stream(0).map_or(from, |s| s.time_base());
        Ok(Self { output, from, to })
    }

    /// Adds a frame.
    pub fn write(&mut self, frame: CodedFrame<'_>) -> Result<(), MuxError> {
        let mut packet = Packet::copy(frame.bytes);
        packet.set_stream(0);
        packet.set_pts(Some(frame.pts));
        packet.set_dts(Some(frame.dts));
        packet.set_duration(frame.duration);
        if frame.is_key {
            packet.set_flags(packet::Flags::KEY);
        }
        packet.rescale_ts(self.from, self.to);
        packet.write(&mut self.output).map(drop).map_err(ffmpeg_error("writing the recording"))
    }

    /// Ends the recording. Without it the file cannot be played.
    pub fn finish(mut self) -> Result<(), MuxError> {
        self.output.write_trailer().map_err(ffmpeg_error("writing the recording's end"))
    }
}

/// True if a decoder can begin with this frame.
pub fn can_start_decoding(codec: FrameCodec, frame: &[u8]) -> bool {
    codec == FrameCodec::Jpeg || parameter_sets(frame).is_some()
}

fn parameters(stream: Stream<'_>) -> Result<codec::Parameters, MuxError> {
    let (id, sets) = match stream.codec {
        FrameCodec::Jpeg => (codec::Id::MJPEG, Vec::new()),
        FrameCodec::H264 => (codec::Id::H264, parameter_sets(stream.first).ok_or(MuxError::NoParameterSets)?),
    };
    let mut parameters = codec::Parameters::new();
    parameters.set_medium(ff::media::Type::Video);
    parameters.set_id(id);
    // SAFETY: the pointer is that of parameters just created, which own everything put into them. The copied bytes lie
    // in memory from FFmpeg's allocator, with the zeroed padding that its readers require.
    unsafe {
        let raw = parameters.as_mut_ptr();
        (*raw).width = stream.size.0 as i32; // checked: at most 65,535
        (*raw).height = stream.size.1 as i32;
        if !sets.is_empty() {
            let padded = sets.len() + ffi::AV_INPUT_BUFFER_PADDING_SIZE as usize;
            let memory = ffi::av_mallocz(padded).cast::<u8>();
            if memory.is_null() {
                return Err(ffmpeg_error("making memory for parameter sets")(ff::Error::from(ffi::AVERROR(
                    libc::ENOMEM,
                ))));
            }
            std::ptr::copy_nonoverlapping(sets.as_ptr(), memory, sets.len());
            (*raw).extradata = memory;
            (*raw).extradata_size = sets.len() as i32; // at most the longest frame
        }
    }
    Ok(parameters)
}

/// Sequence and picture parameter sets of an access unit in Annex B form, each after a start code; `None` if one of the
/// two kinds is missing.
fn parameter_sets(access_unit: &[u8]) -> Option<Vec<u8>> {
    const SPS: u8 = 7;
    const PPS: u8 = 8;
    let mut sets = Vec::new();
    let mut found = [false; 2];
    for unit in nal_units(access_unit) {
        let kind = unit.first()? & 0x1f;
        if kind == SPS || kind == PPS {
            found[usize::from(kind - SPS)] = true;
            sets.extend([0, 0, 0, 1]);
            sets.extend(unit);
        }
    }
    found.into_iter().all(|one| one).then_some(sets)
}

/// The units between the start codes `00 00 01` of Annex B.
fn nal_units(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let starts: Vec<usize> =
        bytes.windows(3).enumerate().filter(|(_, code)| *code == [0, 0, 1]).map(|(at, _)| at).collect();
    (0..starts.len()).filter_map(move |i| {
        let end = starts.get(i + 1).copied().unwrap_or(bytes.len());
        let unit = &bytes[starts[i] + 3..end];
        let unpadded = unit.iter().rposition(|byte| *byte != 0)? + 1; // zeros before a start code belong to it
        Some(&unit[..unpadded])
    })
}

fn ffmpeg_error(doing: &'static str) -> impl Fn(ff::Error) -> MuxError {
    move |source| MuxError::Ffmpeg { doing, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameter_sets_are_found_behind_start_codes_of_both_lengths() {
        let unit =
            [&[0, 0, 0, 1, 9, 0x10][..], &[0, 0, 0, 1, 0x67, 1, 2], &[0, 0, 1, 0x68, 3], &[0, 0, 1, 0x65, 4]].concat();
        assert_eq!(parameter_sets(&unit).unwrap(), [0, 0, 0, 1, 0x67, 1, 2, 0, 0, 0, 1, 0x68, 3]);
        assert_eq!(parameter_sets(&unit[..13]), None, "no picture parameter set");
        assert_eq!(parameter_sets(&[]), None);
    }
}
