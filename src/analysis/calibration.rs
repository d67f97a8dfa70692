//! Finds the board in photos or in a video and returns the views that a camera is calibrated from.
//!
//! The command line and the service's confined child both use this; they only add where the bytes come from.

use std::io::{BufRead, Read, Seek};

use crate::media::{MediaError, MediaLimits, VideoFile, photo};
use crate::vision::camera::checkerboard;
use crate::vision::camera::view_picker::ViewPicker;
use crate::vision::camera::{Board, BoardView};

/// Most photos of one calibration; 40 are plenty.
pub const MAX_PHOTOS: usize = 500;

/// The board in each photo or chosen frame, and their common picture size.
#[derive(Clone, Debug, PartialEq)]
pub struct Views {
    /// One view per photo, or per chosen frame.
    pub views: Vec<BoardView>,
    /// Width of every photo, pixels.
    pub width: u32,
    /// Height of every photo, pixels.
    pub height: u32,
}

/// Why photos or a video give no views.
#[derive(Debug, thiserror::Error)]
pub enum ViewsError {
    /// No photo was given, or too many.
    #[error("{0} photos given; give 3 to {MAX_PHOTOS}, best about 20 with the board tilted to different sides")]
    Count(usize),
    /// A photo cannot be read.
    #[error("photo {name}: {source}")]
    Photo {
        /// The photo's name.
        name: String,
        /// Why it cannot be read.
        source: MediaError,
    },
    /// A photo has another size than the first.
    #[error(
        "photo {name} is {}×{}, {first_name} is {}×{}: a camera is calibrated at the picture size of its recordings; \
         give only photos of that size",
        size.0, size.1, first_size.0, first_size.1
    )]
    SizeDiffers {
        /// The photo that differs.
        name: String,
        /// Its width and height.
        size: (u32, u32),
        /// Name of the first photo.
        first_name: String,
        /// Its width and height.
        first_size: (u32, u32),
    },
    /// A photo is turned or mirrored for display in another way than the first. A camera's centre is not in the middle of its
    /// picture, so a photo that is turned by itself shows another camera.
    #[error(
        "the photos' orientation tags differ: photo {name} has EXIF {turn}, {first_name} has EXIF {first_turn}; hold the \
         camera the same way for all photos, as it is for recordings, or remove the tag from photos whose pixels are \
         right as stored"
    )]
    TurnDiffers {
        /// The photo that differs.
        name: String,
        /// Its EXIF orientation, 1 to 8.
        turn: u8,
        /// Name of the first photo.
        first_name: String,
        /// Its EXIF orientation.
        first_turn: u8,
    },
    /// The video cannot be read.
    #[error("video {name}: {source}")]
    Video {
        /// The video's name.
        name: String,
        /// Why it cannot be read.
        source: MediaError,
    },
}

/// Whether a file with these first bytes is a photo.
pub fn is_photo(first_bytes: &[u8]) -> bool {
    photo::is_photo(first_bytes)
}

/// Looks for the board in each photo, in order; calls `done` after each.
pub fn views_of_photos<R: BufRead + Seek>(
    photos: impl ExactSizeIterator<Item = (String, R)>,
    board: Board,
    limits: MediaLimits,
    mut done: impl FnMut(&BoardView),
) -> Result<Views, ViewsError> {
    let count = photos.len();
    if count == 0 || count > MAX_PHOTOS {
        return Err(ViewsError::Count(count));
    }
    let mut views: Vec<BoardView> = Vec::with_capacity(count);
    let (mut first_size, mut first_turn) = (None, None);
    for (name, bytes) in photos {
        let luma =
            photo::read_luma(bytes, limits).map_err(|source| ViewsError::Photo { name: name.clone(), source })?;
        let turn = luma.orientation().to_exif();
        let first = *first_turn.get_or_insert(turn);
        if let Some(first_view) = views.first().filter(|_| first != turn) {
            let first_name = first_view.name.clone();
            return Err(ViewsError::TurnDiffers { name, turn, first_name, first_turn: first });
        }
        let size = (luma.width(), luma.height());
        let first = *first_size.get_or_insert(size);
        if let Some(first_view) = views.first().filter(|_| first != size) {
            return Err(ViewsError::SizeDiffers { name, size, first_name: first_view.name.clone(), first_size: first });
        }
        let view = BoardView { name, corners: checkerboard::find(&luma.plane(), board) };
        done(&view);
        views.push(view);
    }
    let (width, height) = first_size.ok_or(ViewsError::Count(0))?;
    Ok(Views { views, width, height })
}

/// Picks sharp and different views of the board from a video. Calls `done` after each decoded frame with the number of
/// frames so far and, if known, in all.
pub fn views_of_video(
    name: &str,
    video: impl Read + Seek + Send + 'static,
    board: Board,
    limits: MediaLimits,
    mut done: impl FnMut(u64, Option<u64>),
) -> Result<Views, ViewsError> {
    let failed = |source| ViewsError::Video { name: name.to_owned(), source };
    let mut file = VideoFile::open(video, limits).map_err(failed)?;
    let expected = file.info().frames_expected;
    let mut film = ViewPicker::new(board, expected);
    let (mut width, mut height) = (0, 0);
    while let Some(picture) = file.next_picture().map_err(failed)? {
        let frame = picture.frame();
        (width, height) = (frame.width() as u32, frame.height() as u32); // bounded by the limits
        film.add_frame(|| format!("frame {} ({:.2} s)", frame.index, frame.time_s), &frame.y);
        done(frame.index + 1, expected);
    }
    Ok(Views { views: film.into_views(), width, height })
}
