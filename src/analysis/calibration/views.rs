//! Reads the pictures of a calibration: photos, or a video, with the board in each.

use std::io::{BufRead, Read, Seek};

use crate::media::{MediaError, MediaLimits, VideoFile, photo};
use crate::vision::camera::checkerboard::{self, BoardReason};
use crate::vision::camera::view_picker::ViewPicker;
use crate::vision::camera::{Board, BoardView, PhotoReason};
use crate::vision::space::Pixel;

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

/// Maximum number of sizes that a refusal lists.
const MAX_LISTED_SIZES: usize = 4;

/// `none of the 3 files is `, or of a single one.
fn none_of(given: usize) -> String {
    if given == 1 { "the file is not ".to_owned() } else { format!("none of the {given} files is ") }
}

/// Why photos or a video give no views.
#[derive(Debug, thiserror::Error)]
pub enum ViewsError {
    /// No photo was given, or too many.
    #[error("{0} photos given; give 3 to {MAX_PHOTOS}, best about 20 with the board tilted to different sides")]
    Count(usize),
    /// None of the files is a photo that can be read.
    #[error("{}a photo that can be read; {name}: {reason}", none_of(*given))]
    NoPhoto {
        /// Files given.
        given: usize,
        /// Name of the first file.
        name: String,
        /// Why it cannot be read.
        reason: String,
    },
    /// No size is that of more than half of the photos.
    #[error(
        "the photos have different sizes, and none of them is that of most photos: {}; a camera is calibrated at the \
         picture size of its recordings, so give only photos of that size", list_sizes(.0)
    )]
    SizesDiffer(Vec<PhotoSize>),
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

/// A size that some of the photos have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhotoSize {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// Number of photos of this size.
    pub count: usize,
    /// Name of the first of them.
    pub name: String,
}

fn list_sizes(sizes: &[PhotoSize]) -> String {
    let describe = |PhotoSize { size: (width, height), count, name }: &PhotoSize| match count {
        1 => format!("{width}×{height} ({name})"),
        more => format!("{width}×{height} ({more} photos, such as {name})"),
    };
    let mut listed: Vec<String> = sizes.iter().take(MAX_LISTED_SIZES).map(describe).collect();
    if let Some(more) = sizes.len().checked_sub(MAX_LISTED_SIZES).filter(|more| *more > 0) {
        listed.push(format!("{more} other sizes"));
    }
    listed.join(", ")
}

/// A photo that was read, and the board in it.
struct SearchedPhoto {
    size: (u32, u32),
    /// Its EXIF orientation.
    turn: u8,
    corners: Result<Vec<Pixel>, BoardReason>,
}

impl SearchedPhoto {
    fn read(bytes: impl BufRead + Seek, board: Board, limits: MediaLimits) -> Result<Self, MediaError> {
        let luma = photo::read_luma(bytes, limits)?;
        let corners = checkerboard::find(&luma.plane(), board);
        Ok(Self { size: (luma.width(), luma.height()), turn: luma.orientation().to_exif(), corners })
    }

    /// The corners, if the photo has the usual size.
    fn corners_at(self, usual: (u32, u32)) -> Result<Vec<Pixel>, PhotoReason> {
        let size = self.size;
        if size == usual { Ok(self.corners?) } else { Err(PhotoReason::OtherSize { size, usual }) }
    }
}

/// A photo's name, and what it shows or why it cannot be read.
type NamedPhoto = (String, Result<SearchedPhoto, MediaError>);

/// Whether a file with these first bytes is a photo.
pub fn is_photo(first_bytes: &[u8]) -> bool {
    photo::is_photo(first_bytes)
}

/// Looks for the board in each photo, in order; calls `done` with the name of each. Files that are no photos, and photos
/// of another size than most, are left out with their reason.
///
/// # Errors
/// [`ViewsError`] if no file is a photo, no size is that of most photos, or the photos are turned differently.
pub fn views_of_photos<R: BufRead + Seek>(
    photos: impl ExactSizeIterator<Item = (String, R)>,
    board: Board,
    limits: MediaLimits,
    mut done: impl FnMut(&str),
) -> Result<Views, ViewsError> {
    let count = photos.len();
    if count == 0 || count > MAX_PHOTOS {
        return Err(ViewsError::Count(count));
    }
    let mut first_turn: Option<(String, u8)> = None;
    let mut searched: Vec<NamedPhoto> = Vec::with_capacity(count);
    for (name, bytes) in photos {
        let photo = SearchedPhoto::read(bytes, board, limits);
        if let Ok(photo) = &photo {
            check_turn(&mut first_turn, &name, photo.turn)?;
        }
        done(&name);
        searched.push((name, photo));
    }
    let usual = usual_size(&searched)?;
    let view = |(name, photo): NamedPhoto| {
        let corners = photo.map_err(|error| PhotoReason::Unreadable(error.to_string()));
        BoardView { name, corners: corners.and_then(|photo| photo.corners_at(usual)) }
    };
    Ok(Views { views: searched.into_iter().map(view).collect(), width: usual.0, height: usual.1 })
}

/// An error if a photo is turned in another way than the first.
fn check_turn(first: &mut Option<(String, u8)>, name: &str, turn: u8) -> Result<(), ViewsError> {
    let (first_name, first_turn) = first.get_or_insert_with(|| (name.to_owned(), turn));
    if *first_turn == turn {
        return Ok(());
    }
    let (first_name, first_turn) = (first_name.clone(), *first_turn);
    Err(ViewsError::TurnDiffers { name: name.to_owned(), turn, first_name, first_turn })
}

/// The size of more than half of the photos that could be read.
fn usual_size(searched: &[NamedPhoto]) -> Result<(u32, u32), ViewsError> {
    let mut sizes: Vec<PhotoSize> = Vec::new();
    for (name, photo) in searched {
        let Ok(SearchedPhoto { size, .. }) = photo else { continue };
        match sizes.iter_mut().find(|known| known.size == *size) {
            Some(known) => known.count += 1,
            None => sizes.push(PhotoSize { size: *size, count: 1, name: name.clone() }),
        }
    }
    sizes.sort_by_key(|size| std::cmp::Reverse(size.count));
    let photos: usize = sizes.iter().map(|size| size.count).sum();
    match sizes.first() {
        Some(usual) if 2 * usual.count > photos => Ok(usual.size),
        Some(_) => Err(ViewsError::SizesDiffer(sizes)),
        None => Err(no_photo(searched)),
    }
}

fn no_photo(searched: &[NamedPhoto]) -> ViewsError {
    let unread = searched.iter().find_map(|(name, photo)| Some((name.clone(), photo.as_ref().err()?.to_string())));
    let (name, reason) = unread.unwrap_or_default();
    ViewsError::NoPhoto { given: searched.len(), name, reason }
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

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use image::{GrayImage, ImageFormat};

    use super::*;

    fn board() -> Board {
        Board::new(9, 6, 21.0).unwrap()
    }

    /// A photo of a 9x6 board that faces the camera.
    fn photo(width: u32, height: u32, format: ImageFormat) -> Vec<u8> {
        let code = |x: u32, y: u32| {
            let (column, row) = (x.wrapping_sub(60) / 20, y.wrapping_sub(50) / 20);
            let is_dark = column < 10 && row < 7 && (column + row) % 2 == 0;
            image::Luma([if is_dark { 30 } else { 210 }])
        };
        let mut bytes = Cursor::new(Vec::new());
        GrayImage::from_fn(width, height, code).write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    fn png(width: u32, height: u32) -> Vec<u8> {
        photo(width, height, ImageFormat::Png)
    }

    /// The views of files named a, b, c …
    fn views(files: &[Vec<u8>]) -> Result<Views, ViewsError> {
        let named = files.iter().zip('a'..).map(|(bytes, name)| (name.to_string(), Cursor::new(bytes)));
        let named: Vec<_> = named.collect();
        views_of_photos(named.into_iter(), board(), MediaLimits::default(), |_| {})
    }

    #[test]
    fn photos_of_another_size_than_most_are_left_out_with_their_reason() {
        let files = [png(320, 241), png(320, 240), png(320, 240), png(320, 240), png(240, 320)];
        let views = views(&files).unwrap();
        assert_eq!((views.width, views.height), (320, 240));
        let reason = |place: usize| views.views[place].corners.as_ref().err();
        for (place, size) in [(0, (320, 241)), (4, (240, 320))] {
            assert_eq!(reason(place), Some(&PhotoReason::OtherSize { size, usual: (320, 240) }));
        }
        assert!((1..4).all(|place| reason(place).is_none()), "{views:?}");
        let names: Vec<&str> = views.views.iter().map(|view| view.name.as_str()).collect();
        assert_eq!(names, ["a", "b", "c", "d", "e"], "the order of the files");
    }

    #[test]
    fn no_size_of_most_photos_is_refused_with_each_size_and_a_photo_of_it() {
        let tie = [png(320, 240), png(320, 241), png(320, 240), png(320, 241)];
        let most_without_half = [png(320, 240), png(320, 240), png(320, 241), png(320, 242), png(320, 243)];
        for files in [&tie[..], &most_without_half] {
            let text = views(files).unwrap_err().to_string();
            assert!(text.contains("320×240 (2 photos, such as a)") && text.contains("320×241"), "{text}");
        }
        let all: Vec<_> = (0..9).map(|taller| png(320, 240 + taller)).collect();
        let text = views(&all).unwrap_err().to_string();
        assert!(text.contains("320×243 (d), 5 other sizes"), "{text}");
    }

    #[test]
    fn files_that_are_no_photos_are_left_out_with_their_reason() {
        let heic = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic".to_vec();
        let cut = png(320, 240)[..200].to_vec();
        let bmp = photo(320, 240, ImageFormat::Bmp);
        let views = views(&[b"dear diary".to_vec(), heic, bmp, png(320, 240), cut]).unwrap();
        let reason = |place: usize| views.views[place].corners.as_ref().err().map(ToString::to_string);
        assert!(reason(0).unwrap().contains("not a photo that can be read"), "{views:?}");
        assert!(reason(1).unwrap().contains("HEIC photos cannot be read: save or export"), "{views:?}");
        assert_eq!((reason(2), reason(3)), (None, None), "BMP and PNG are read");
        assert!(reason(4).is_some());
    }

    #[test]
    fn files_without_a_single_photo_are_refused_with_the_first_reason() {
        let text = views(&[b"dear diary".to_vec(), b"GIF89a".to_vec()]).unwrap_err().to_string();
        assert!(text.starts_with("none of the 2 files") && text.contains("; a: not a photo"), "{text}");
    }
}
