//! A photo in a complete file: its luma, or its colours as a frame, in display orientation.
//!
//! Photos come from strangers: only JPEG, PNG and BMP are decoded (in Rust, without FFmpeg), and sizes and memory are
//! bounded before a pixel is read. The EXIF orientation is applied, as [`super::VideoFile`] applies a video's rotation;
//! otherwise a phone's photos and its videos would calibrate two different cameras.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader};

use super::file::check_size;
use super::photo_format::{FORMAT_BYTES, UnreadFormat};
use super::{MediaError, MediaLimits, Picture, VideoFile};
use crate::vision::frame::Plane;

/// Maximum memory for decoding one photo, bytes. A picture of the largest size in [`MediaLimits`] with four channels of
/// sixteen bits takes 75 MB.
const MAX_BYTES: u64 = 256 << 20;

/// The luma of a photo, 0–255; owns its memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Luma {
    data: Vec<u8>,
    width: u32,
    height: u32,
    orientation: Orientation,
}

impl Luma {
    /// The photo as the pipeline sees it.
    pub fn plane(&self) -> Plane<'_> {
        let (width, height) = (self.width as usize, self.height as usize);
        Plane { data: &self.data, stride: width, width, height }
    }

    /// Columns, pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows, pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// How its stored pixels were turned or mirrored for display.
    pub fn orientation(&self) -> Orientation {
        self.orientation
    }
}

/// True if a file with these first bytes is a photo of any format, and not a video.
pub fn is_photo(first_bytes: &[u8]) -> bool {
    image::guess_format(first_bytes).is_ok() || UnreadFormat::of(first_bytes).is_some()
}

/// Reads a JPEG, PNG or BMP photo. [`MediaError::Photo`] if it is none or damaged, [`MediaError::PhotoFormat`] if it is
/// of another format, [`MediaError::OverLimit`] if it is larger than a recording may be.
pub fn read_luma(bytes: impl BufRead + Seek, limits: MediaLimits) -> Result<Luma, MediaError> {
    let (picture, orientation) = decode(bytes, limits)?;
    let (width, height) = (picture.width(), picture.height());
    Ok(Luma { data: luma(picture), width, height, orientation })
}

/// The picture of a photo, or the first frame of a video. Errors as [`read_luma`] and [`VideoFile`].
pub fn first_picture(file: File, limits: MediaLimits) -> Result<Picture, MediaError> {
    match picture_of_photo(&file, limits)? {
        Some(picture) => Ok(picture),
        None => VideoFile::open(file, limits)?.next_picture()?.ok_or(MediaError::NoFrames),
    }
}

/// The picture of a photo; `None` if the file is none, and may be a video. Errors as [`read_luma`].
pub fn picture_of_photo(mut file: &File, limits: MediaLimits) -> Result<Option<Picture>, MediaError> {
    let is_photo = is_photo(&first_bytes(&mut file).map_err(unreadable)?);
    is_photo.then(|| read_picture(BufReader::new(file), 0, limits)).transpose()
}

/// Reads a JPEG, PNG or BMP photo in colour, as the frame of this number in a recording. Errors as [`read_luma`].
pub fn read_picture(bytes: impl BufRead + Seek, index: u64, limits: MediaLimits) -> Result<Picture, MediaError> {
    let rgb = decode(bytes, limits)?.0.into_rgb8();
    let (width, height) = rgb.dimensions();
    Ok(Picture::from_rgb(rgb.as_raw(), width as usize, height as usize, index))
}

/// The picture as displayed, and how it was turned for that.
fn decode(mut bytes: impl BufRead + Seek, limits: MediaLimits) -> Result<(DynamicImage, Orientation), MediaError> {
    if let Some(format) = UnreadFormat::of(&first_bytes(&mut bytes).map_err(unreadable)?) {
        return Err(MediaError::PhotoFormat(format));
    }
    let mut reader = ImageReader::new(bytes).with_guessed_format().map_err(unreadable)?;
    let mut bounds = image::Limits::default();
    bounds.max_alloc = Some(MAX_BYTES);
    reader.limits(bounds);
    let mut decoder = reader.into_decoder().map_err(unreadable)?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(unreadable("it has no pixels")); // decoders may panic on it
    }
    check_size(width, height, limits)?;
    let orientation = decoder.orientation().map_err(unreadable)?;
    let mut picture = DynamicImage::from_decoder(decoder).map_err(unreadable)?;
    picture.apply_orientation(orientation);
    Ok((picture, orientation))
}

/// The first bytes of a file, which show its format; the file is rewound.
fn first_bytes(file: &mut (impl Read + Seek)) -> std::io::Result<Vec<u8>> {
    let mut beginning = Vec::new();
    file.take(FORMAT_BYTES as u64).read_to_end(&mut beginning)?;
    file.rewind()?;
    Ok(beginning)
}

/// Luma of a picture. Grey pictures stay unchanged; colour uses the weights of BT.601, which give the Y stored in a
/// JPEG. (`into_luma8` uses BT.709: with a lens that has colour fringes its edges lie elsewhere, half a pixel on a real
/// laparoscope.)
fn luma(picture: DynamicImage) -> Vec<u8> {
    if !picture.color().has_color() {
        return picture.into_luma8().into_raw();
    }
    let weigh =
        |[r, g, b]: [u8; 3]| (19_595 * u32::from(r) + 38_470 * u32::from(g) + 7_471 * u32::from(b) + 32_768) >> 16;
    picture.into_rgb8().pixels().map(|p| weigh(p.0) as u8).collect() // the weights add up to 1: at most 255
}

fn unreadable(error: impl std::fmt::Display) -> MediaError {
    MediaError::Photo(error.to_string())
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use image::codecs::jpeg::JpegEncoder;
    use image::{ExtendedColorType, GrayImage, ImageEncoder, ImageFormat, Luma as Grey, Rgb, RgbImage};
    use rand::rngs::SmallRng;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::media::testing::exif;

    fn png(picture: &DynamicImage) -> Cursor<Vec<u8>> {
        coded(picture, ImageFormat::Png)
    }

    fn coded(picture: &DynamicImage, format: ImageFormat) -> Cursor<Vec<u8>> {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.rewind().unwrap();
        bytes
    }

    #[test]
    fn grey_levels_come_through_untouched() {
        let picture = GrayImage::from_fn(5, 3, |x, y| Grey([(40 * x + y) as u8]));
        let luma = read_luma(png(&picture.clone().into()), MediaLimits::default()).unwrap();
        assert_eq!((luma.width(), luma.height(), luma.plane().data), (5, 3, picture.as_raw().as_slice()));
    }

    #[test]
    fn colour_weighs_as_in_a_jpegs_own_luma() {
        let colours = [[255, 255, 255], [255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 0, 0]];
        let picture = RgbImage::from_fn(5, 1, |x, _| Rgb(colours[x as usize]));
        let luma = read_luma(png(&picture.into()), MediaLimits::default()).unwrap();
        assert_eq!(luma.plane().data, [255, 76, 150, 29, 0]);
    }

    #[test]
    fn a_photo_is_turned_as_it_is_displayed() {
        let picture = GrayImage::from_fn(32, 16, |x, _| Grey([if x < 16 { 20 } else { 220 }]));
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 95);
        encoder.set_exif_metadata(exif(6)).unwrap(); // display a quarter turn clockwise
        encoder.write_image(picture.as_raw(), 32, 16, ExtendedColorType::L8).unwrap();
        bytes.rewind().unwrap();
        let luma = read_luma(bytes, MediaLimits::default()).unwrap();
        assert_eq!((luma.width(), luma.height(), luma.orientation().to_exif()), (16, 32, 6));
        assert!(luma.plane().at(8, 2) < 60 && luma.plane().at(8, 29) > 180);
    }

    #[test]
    fn what_is_no_photo_is_refused() {
        for bytes in [&b""[..], b"not a photo at all", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0"] {
            let refused = read_luma(Cursor::new(bytes), MediaLimits::default());
            assert!(matches!(refused, Err(MediaError::Photo(_))), "{bytes:?}: {refused:?}");
        }
    }

    #[test]
    fn a_bmp_photo_has_the_pixels_of_its_png() {
        let picture = DynamicImage::from(RgbImage::from_fn(37, 21, |x, y| Rgb([(5 * x) as u8, (9 * y) as u8, 77])));
        let limits = MediaLimits::default();
        let [bmp, png] = [ImageFormat::Bmp, ImageFormat::Png].map(|format| coded(&picture, format));
        assert_eq!(read_luma(bmp, limits).unwrap(), read_luma(png, limits).unwrap());
    }

    #[test]
    fn a_photo_of_another_format_is_refused_with_its_format_and_a_way_out() {
        for bytes in [&b"\0\0\0\x18ftypheic\0\0\0\0mif1heic"[..], b"RIFF\x10\0\0\0WEBPVP8 ", b"MM\0*\0\0\0\x08"] {
            assert!(is_photo(bytes), "not to be taken for a video");
            let refused = read_luma(Cursor::new(bytes), MediaLimits::default()).unwrap_err();
            let MediaError::PhotoFormat(format) = refused else { panic!("{refused:?}") };
            let text = refused.to_string();
            assert!(text.contains(&format.to_string()) && text.contains("as JPEG or PNG"), "{text}");
        }
    }

    #[test]
    fn damaged_bmp_photos_are_refused_without_a_panic() {
        let mut random = SmallRng::seed_from_u64(8);
        let colours = RgbImage::from_fn(19, 11, |x, y| Rgb([(x * 13) as u8, (y * 23) as u8, 5]));
        let photos = [DynamicImage::from(colours.clone()), DynamicImage::from(colours).grayscale()];
        let whole = photos.map(|photo| coded(&photo, ImageFormat::Bmp).into_inner());
        for round in 0..4000 {
            let mut bytes = whole[round % 2].clone();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(2..64);
                bytes[at] = random.random();
            }
            bytes.truncate(random.random_range(2..=bytes.len()));
            let _ = read_luma(Cursor::new(bytes), MediaLimits::default());
        }
        let mut empty = whole[1].clone();
        empty[18..22].fill(0); // the width
        assert!(matches!(read_luma(Cursor::new(empty), MediaLimits::default()), Err(MediaError::Photo(_))));
    }

    #[test]
    fn a_cut_photo_is_refused() {
        let mut bytes = png(&GrayImage::from_fn(64, 64, |x, y| Grey([(x * y) as u8])).into()).into_inner();
        bytes.truncate(bytes.len() / 2);
        assert!(matches!(read_luma(Cursor::new(bytes), MediaLimits::default()), Err(MediaError::Photo(_))));
    }

    #[test]
    fn a_huge_photo_is_refused_before_its_pixels_are_read() {
        let mut bytes = png(&GrayImage::new(1, 1).into()).into_inner();
        bytes[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x22, 0]); // 16384×8704 in the header, nothing behind it
        let sum = crc(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        let refused = read_luma(Cursor::new(bytes), MediaLimits::default());
        let Err(MediaError::OverLimit { value, .. }) = refused else { panic!("{refused:?}") };
        assert!(value.contains("16384×8704"), "{value}");
    }

    /// PNG's checksum.
    fn crc(bytes: &[u8]) -> u32 {
        let step = |crc: u32, _| if crc & 1 == 1 { (crc >> 1) ^ 0xEDB8_8320 } else { crc >> 1 };
        !bytes.iter().fold(!0, |crc: u32, &byte| (0..8).fold(crc ^ u32::from(byte), step))
    }
}
