//! Decodes recordings and photos into pictures with time stamps. This is the only module that names FFmpeg.
//!
//! Recordings come from strangers and are not trusted. Only listed containers and codecs are accepted, no protocols at
//! all (bytes are read from an open descriptor), and pixels, frames, streams and time have limits. The process that
//! decodes is confined by [`crate::sandbox`].
//!
//! A [`CaptureSource`] belongs to the person who runs a box's agent and is trusted: a camera, file or address. The
//! agent captures its frames without decoding them, where possible.
//!
//! A [`VideoFile`] decodes on the caller's thread; a [`ReadAhead`] decodes on its own thread while the caller processes
//! the previous picture.

mod annexb;
mod brightness;
mod clock;
mod device;
mod encode;
mod feed_decoder;
mod fields;
mod file;
mod frame_size;
mod jpeg;
mod limits;
mod mux;
mod orientation;
pub mod photo;
mod photo_format;
mod picture;
mod picture_maker;
mod read_ahead;
mod source;
#[cfg(test)]
pub(crate) mod testing;
mod unread_recording;

pub use brightness::{BLOCK_COLUMNS, BLOCK_ROWS, block_means, mean_luma};
pub use encode::{EncodeError, SampleFormat, TICKS_PER_S, VideoSettings, VideoWriter, ticks};
pub use feed_decoder::FeedDecoder;
pub use file::{RecordingInfo, VideoFile, WholeRecording};
pub use frame_size::frame_size;
pub use jpeg::{JpegMaker, JpegStyle};
pub use limits::MediaLimits;
pub use mux::{CodedFrame, MuxError, Muxer, Stream, can_start_decoding};
pub use photo_format::UnreadFormat;
pub use picture::Picture;
pub use read_ahead::ReadAhead;
pub use source::{CaptureSource, CapturedFrame, SourceError, SourceInfo};

/// Why a recording cannot be read, or not to its end.
#[derive(Debug, thiserror::Error)]
pub enum MediaError {
    /// The container is not accepted, or the file is no video at all.
    #[error("not a video that can be read ({0}); accepted are MP4/MOV, Matroska/WebM, AVI and MPEG-TS")]
    Container(String),
    /// A photo, also one with the name of a video.
    #[error(
        "this file is a picture, not a video: send the recording that the camera made (MP4/MOV, Matroska/WebM, AVI or \
         MPEG-TS)"
    )]
    PictureFile,
    /// A container that is not accepted.
    #[error(
        "{name} is not accepted; accepted are MP4/MOV, Matroska/WebM, AVI and MPEG-TS: convert it, for example with \
         {convert}"
    )]
    OtherContainer {
        /// The container's name.
        name: &'static str,
        /// A command that converts it.
        convert: &'static str,
    },
    /// The recorder did not write the index of an MP4 or MOV file, which is its last part.
    #[error(
        "the recording was cut off before its index was written: the recorder was stopped by force, or the disk or card was \
         full; without the index no picture can be found. Let the recorder repair the file if it can (cameras do so when \
         the card is put back), or send another copy; to be safe, record as MKV or fragmented MP4"
    )]
    CutOff,
    /// There is no video stream, for example only sound.
    #[error("the file holds no video stream; record the camera's picture, not only sound")]
    NoVideo,
    /// A codec outside the accepted list.
    #[error("video codec {0} is not accepted; use H.264, H.265, VP8, VP9, AV1, MJPEG or MPEG-4")]
    Codec(String),
    /// The file exceeds one of the limits of a recording.
    #[error("{what} is {value}, above the limit of {limit}")]
    OverLimit {
        /// The limited quantity.
        what: &'static str,
        /// Its value in the file.
        value: String,
        /// Its limit.
        limit: String,
    },
    /// The picture changed its size during the recording.
    #[error(
        "the picture changes from {}×{} to {}×{} at frame {frame}; record each size in a separate file",
        from.0, from.1, to.0, to.1
    )]
    SizeChanged {
        /// Width and height so far.
        from: (u32, u32),
        /// Width and height now.
        to: (u32, u32),
        /// First frame of the new size.
        frame: u64,
    },
    /// No frame could be decoded.
    #[error("the video stream holds no frame that can be decoded; the file may be cut before its first picture")]
    NoFrames,
    /// The process's memory limit was reached.
    #[error(
        "reading the recording needs more memory than allowed: its picture or its tables are too large, or it is \
         damaged"
    )]
    Memory,
    /// A pixel format that cannot be converted to planar YUV.
    #[error("pixel format {0} cannot be converted")]
    PixelFormat(String),
    /// The picture must be shown in another way than turned by quarters or mirrored.
    #[error(
        "the file asks players to show its picture {0}; only quarter turns and mirror images, stated once for the whole \
         file, can be measured. Export the recording from a video editor, which turns the pixels themselves, and send \
         that file"
    )]
    Orientation(String),
    /// Codes of high dynamic range. The tracker takes codes for those of standard video, so colours and the light at
    /// edges would both be wrong.
    #[error(
        "the recording has high dynamic range ({0}), which cannot be measured: switch off HDR video in the settings of \
         the camera or its app, and record again"
    )]
    HighDynamicRange(&'static str),
    /// Not a photo, or a damaged one.
    #[error("not a photo that can be read ({0}); accepted are JPEG, PNG and BMP")]
    Photo(String),
    /// A photo of a format that is not decoded.
    #[error(
        "{0} photos cannot be read: save or export the photo as JPEG or PNG at its full size{advice}, and give that file",
        advice = if *.0 == UnreadFormat::Heic { " (iPhone: Settings > Camera > Formats > Most Compatible)" } else { "" }
    )]
    PhotoFormat(UnreadFormat),
    /// FFmpeg failed.
    #[error("while {doing}: {source}")]
    Ffmpeg {
        /// The operation that failed.
        doing: &'static str,
        /// FFmpeg's error.
        source: ffmpeg_next::Error,
    },
}
