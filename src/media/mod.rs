//! Bytes of a recording or photo in, decoded pictures with their time stamps out. The only place that names FFmpeg.
//!
//! Recordings come from strangers. A whitelist of containers and codecs, no protocols at all (bytes are read from an
//! open descriptor), and budgets for pixels, frames, streams and time bound what a file can do; the process around it
//! is confined by [`crate::sandbox`].
//!
//! A [`Source`] is a person's own: a camera, file or address from which a box's agent captures frames, coded as they are.
//!
//! A [`VideoFile`] decodes when it is asked; a [`ReadAhead`] does so on a thread of its own while its user looks at the
//! picture before.

mod ahead;
mod annexb;
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
pub mod photo;
mod picture;
mod picture_maker;
mod source;
#[cfg(test)]
mod testing;

pub use ahead::ReadAhead;
pub use encode::{EncodeError, Samples, TICKS_PER_S, VideoSettings, VideoWriter, ticks};
pub use feed_decoder::FeedDecoder;
pub use file::{RecordingInfo, VideoFile};
pub use frame_size::frame_size;
pub use jpeg::{JpegMaker, JpegStyle};
pub use limits::Limits;
pub use mux::{CodedFrame, MuxError, Muxer, Stream, can_begin_with};
pub use picture::Picture;
pub use source::{CapturedFrame, Source, SourceError, SourceInfo};

/// Why a recording cannot be read, or not further.
#[derive(Debug, thiserror::Error)]
pub enum MediaError {
    /// The container is none of those accepted, or the file is no video at all.
    #[error("not a video that can be read ({0}); accepted are MP4/MOV, Matroska/WebM, AVI and MPEG-TS")]
    Container(String),
    /// No video stream inside, e.g. sound alone.
    #[error("the file holds no video stream; record the camera's picture, not sound alone")]
    NoVideo,
    /// A codec outside the accepted list.
    #[error("video codec {0} is not accepted; use H.264, H.265, VP8, VP9, AV1, MJPEG or MPEG-4")]
    Codec(String),
    /// The file has more of something than a recording can need.
    #[error("{what} is {value}, above the limit of {limit}")]
    OverLimit {
        /// Of what.
        what: &'static str,
        /// How much there is.
        value: String,
        /// How much is accepted.
        limit: String,
    },
    /// The picture changed its size during the recording.
    #[error("the picture changes from {}×{} to {}×{} at frame {frame}; record each size to a file of its own", from.0, from.1, to.0, to.1)]
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
    /// Memory ran out under the process's limit.
    #[error(
        "reading it needs more memory than one recording may use: its picture or its tables are too large, or it is damaged"
    )]
    Memory,
    /// A pixel format that cannot be brought to planar YUV.
    #[error("pixel format {0} cannot be converted")]
    PixelFormat(String),
    /// Not a photo, or a damaged one.
    #[error("not a photo that can be read ({0}); accepted are JPEG and PNG")]
    Photo(String),
    /// FFmpeg failed.
    #[error("while {doing}: {source}")]
    Ffmpeg {
        /// What was being done.
        doing: &'static str,
        /// FFmpeg's word.
        source: ffmpeg_next::Error,
    },
}
