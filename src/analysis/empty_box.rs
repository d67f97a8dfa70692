//! The picture of a box without tools. From it the tracker of bare shafts learns what stands still in the box.

use std::fs::File;
use std::io::BufReader;

use crate::media::{MediaError, MediaLimits, Picture, photo};

/// Why a picture of the empty box cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum EmptyBoxError {
    /// It is not a photo that can be read.
    #[error("the picture of the empty box cannot be used: {0}")]
    Media(#[from] MediaError),
    /// It has another size than the recording.
    #[error(
        "the picture of the empty box has {}×{} pixels, but the recording has {}×{}: take it with the same camera, at \
         the recorded size, or leave it out",
        picture[0], picture[1], recording[0], recording[1]
    )]
    OtherSize {
        /// Columns and rows of the picture, as displayed.
        picture: [usize; 2],
        /// Columns and rows of the recording, as displayed.
        recording: [usize; 2],
    },
}

/// Reads a photo of the empty box for recordings of this size, columns and rows. Its colours are coded as in a JPEG,
/// for any encoding of the recording.
///
/// # Errors
/// It is no photo, or has another size.
pub fn read_empty_box(file: File, recording: [usize; 2], limits: MediaLimits) -> Result<Picture, EmptyBoxError> {
    let picture = photo::read_picture(BufReader::new(file), 0, limits)?;
    let size = [picture.frame().width(), picture.frame().height()];
    if size == recording { Ok(picture) } else { Err(EmptyBoxError::OtherSize { picture: size, recording }) }
}

#[cfg(test)]
mod tests {
    use std::io::{Seek, Write};

    use image::{Rgb, RgbImage};

    use super::*;

    fn photo_file(width: u32, height: u32) -> File {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let picture = RgbImage::from_fn(width, height, |x, _| Rgb([(9 * x) as u8, 90, 30]));
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        file_of(bytes.get_ref())
    }

    fn file_of(bytes: &[u8]) -> File {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        file.rewind().unwrap();
        file
    }

    #[test]
    fn a_photo_of_the_recorded_size_becomes_a_frame_and_others_are_refused() {
        let read = |file, size| read_empty_box(file, size, MediaLimits::default());
        let picture = read(photo_file(24, 16), [24, 16]).unwrap();
        let frame = picture.frame();
        assert_eq!([frame.width(), frame.height()], [24, 16]);
        let red = frame.encoding.rgb_of_codes(frame.yuv_at(20, 3).map(f64::from)).x;
        assert!((red * 255.0 - 180.0).abs() < 2.0, "{red}");
        let other = read(photo_file(16, 24), [24, 16]).map(drop).unwrap_err();
        assert!(other.to_string().contains("has 16×24 pixels, but the recording has 24×16"), "{other}");
        assert!(matches!(read(file_of(b"no photo"), [24, 16]), Err(EmptyBoxError::Media(MediaError::Photo(_)))));
    }
}
