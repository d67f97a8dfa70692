//! Turns decoded frames into [`Picture`]s: planar, 8 bits, in display orientation. The memory of returned pictures is
//! reused, so that nothing is allocated here after the first few pictures.

use ffmpeg_next::{chroma, format, frame, software::scaling, util::color};

use super::MediaError;
use super::fields::keep_one_field;
use super::orientation::PictureOrientation;
use super::picture::{OwnedPlane, Picture, PlanarFrame, Planes, middle_px, plane_of};
use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};

/// Makes the pictures of one recording.
pub(super) struct PictureMaker {
    orientation: PictureOrientation,
    scaler: Option<Scaler>,
    spare: SpareMemory,
}

/// Memory of returned pictures. Its amount equals the number of pictures in use, which the caller bounds.
#[derive(Default)]
struct SpareMemory {
    decoded: Vec<frame::Video>,
    converted: Vec<frame::Video>,
    turned: Vec<[OwnedPlane; 3]>,
}

impl PictureMaker {
    pub(super) fn new(orientation: PictureOrientation) -> Self {
        Self { orientation, scaler: None, spare: SpareMemory::default() }
    }

    /// A frame for the decoder to fill; the buffer that it still refers to then goes back to the decoder.
    pub(super) fn frame_to_fill(&mut self) -> frame::Video {
        self.spare.decoded.pop().unwrap_or_else(frame::Video::empty)
    }

    /// Takes the memory of a picture that is no longer needed.
    pub(super) fn recycle(&mut self, picture: Picture) {
        match picture.into_planes() {
            Planes::Frame(planar) => self.spare.keep(planar),
            Planes::Owned(planes) => self.spare.turned.push(planes),
            Planes::Copied(_) => {}
        }
    }

    /// The decoded picture, or its first field if interlaced; nothing is copied if it is planar, of 8 bits, progressive
    /// and upright.
    pub(super) fn make(&mut self, decoded: frame::Video, index: u64, time_s: f64) -> Result<Picture, MediaError> {
        check_dynamic_range(&decoded)?;
        self.orientation.check_frame(&decoded)?;
        let first_line = decoded.is_interlaced().then(|| usize::from(!decoded.is_top_first()));
        let planar = self.planar(decoded)?;
        Ok(self.picture_of(planar, first_line, index, time_s))
    }

    /// The frame as a picture; if interlaced, only the field that begins at `first_line`.
    fn picture_of(&mut self, planar: PlanarFrame, first_line: Option<usize>, index: u64, time_s: f64) -> Picture {
        let encoding = encoding_of(&planar.frame);
        let size = (planar.frame.width(), planar.frame.height());
        let stored_shift = chroma_shift(planar.frame.format());
        let repeats_chroma = self.orientation.splits_chroma(size, stored_shift);
        let (shift, first_px) = match (repeats_chroma, stored_shift, planar.chroma_first_px) {
            (false, shift, first_px) => (shift, first_px),
            (true, (x, y), first_px) => ((0, 0), [first_px[0] - middle_px(x), first_px[1] - middle_px(y)]),
        };
        let chroma_first_px = self.orientation.displayed_chroma(first_px, shift);
        let planes = match first_line {
            None if self.orientation == PictureOrientation::UPRIGHT => Planes::Frame(planar),
            first_line => {
                let mut changed = self.spare.turned.pop().unwrap_or_default();
                for (i, into) in changed.iter_mut().enumerate() {
                    let repeat = if repeats_chroma && i > 0 { stored_shift } else { (0, 0) };
                    let stored = StoredPlane { plane: plane_of(&planar.frame, i), repeat, picture_size: size };
                    stored.copy_displayed(first_line, self.orientation, into);
                }
                self.spare.keep(planar);
                Planes::Owned(changed)
            }
        };
        let shift = self.orientation.displayed(shift);
        let picture = Picture::new(planes, shift, encoding, index, time_s).with_chroma_at(chroma_first_px);
        if first_line.is_some() { picture.into_one_field() } else { picture }
    }

    /// Converts to 8-bit planar: 8-bit planar frames stay unchanged, deeper ones keep their chroma resolution, any
    /// other format becomes 4:4:4.
    fn planar(&mut self, decoded: frame::Video) -> Result<PlanarFrame, MediaError> {
        let from = decoded.format();
        let unusable = || MediaError::PixelFormat(format!("{from:?}"));
        if is_planar_8_bit(from) {
            if !has_whole_planes(&decoded) {
                return Err(unusable());
            }
            let chroma_first_px = first_chroma_px(&decoded);
            return Ok(PlanarFrame { frame: decoded, chroma_first_px, is_converted: false });
        }
        let to = match chroma_shift(from) {
            (1, 1) => format::Pixel::YUV420P,
            (1, 0) => format::Pixel::YUV422P,
            _ => format::Pixel::YUV444P,
        };
        let (width, height) = (decoded.width(), decoded.height());
        let scaler = match &mut self.scaler {
            Some(scaler) if scaler.0.input().format == from => scaler,
            slot => slot.insert(Scaler(
                scaling::Context::get(from, width, height, to, width, height, scaling::Flags::POINT)
                    .map_err(|_| unusable())?,
            )),
        };
        let fits = |spare: &frame::Video| (spare.format(), spare.width(), spare.height()) == (to, width, height);
        let mut planar = self.spare.converted.pop().filter(fits).unwrap_or_else(frame::Video::empty);
        scaler.0.run(&decoded, &mut planar).map_err(|_| unusable())?;
        if is_rgb_or_grey(from) {
            // The scaler's output for these formats.
            planar.set_color_range(color::Range::MPEG);
            planar.set_color_space(color::Space::SMPTE170M);
        } else {
            planar.set_color_range(decoded.color_range());
            planar.set_color_space(decoded.color_space());
        }
        let chroma_first_px = if to == format::Pixel::YUV444P { [0.0; 2] } else { first_chroma_px(&decoded) };
        self.spare.decoded.push(decoded);
        Ok(PlanarFrame { frame: planar, chroma_first_px, is_converted: true })
    }
}

impl SpareMemory {
    fn keep(&mut self, planar: PlanarFrame) {
        let spare = if planar.is_converted { &mut self.converted } else { &mut self.decoded };
        spare.push(planar.frame);
    }
}

struct Scaler(scaling::Context);

// SAFETY: a scaler is not bound to a thread, and only its owner can use it.
unsafe impl Send for Scaler {}

fn chroma_shift(format: format::Pixel) -> (u8, u8) {
    format.descriptor().map_or((0, 0), |d| (d.log2_chroma_w(), d.log2_chroma_h()))
}

/// Refuses the transfer functions of high dynamic range (ITU-R BT.2100).
fn check_dynamic_range(video: &frame::Video) -> Result<(), MediaError> {
    match video.color_transfer_characteristic() {
        color::TransferCharacteristic::SMPTE2084 => Err(MediaError::HighDynamicRange("PQ")),
        color::TransferCharacteristic::ARIB_STD_B67 => Err(MediaError::HighDynamicRange("HLG")),
        _ => Ok(()),
    }
}

fn is_planar_8_bit(format: format::Pixel) -> bool {
    use format::Pixel::*;
    matches!(format, YUV420P | YUVJ420P | YUV422P | YUVJ422P | YUV444P | YUVJ444P | YUV440P | YUVJ440P)
}

fn is_jpeg(format: format::Pixel) -> bool {
    use format::Pixel::*;
    matches!(format, YUVJ420P | YUVJ422P | YUVJ444P | YUVJ440P)
}

fn is_rgb_or_grey(format: format::Pixel) -> bool {
    let name = format.descriptor().map_or("", |d| d.name());
    ["gbr", "rgb", "bgr", "gray", "pal"].iter().any(|family| name.starts_with(family))
}

/// True if there are three planes with rows in top-down order that hold the width; [`plane_of`] relies on this.
fn has_whole_planes(video: &frame::Video) -> bool {
    const WIDEST_STRIDE: usize = 1 << 20; // a bottom-up picture's negative stride reads as far more
    video.planes() >= 3 && (0..3).all(|i| (video.plane_width(i) as usize..WIDEST_STRIDE).contains(&video.stride(i)))
}

fn encoding_of(video: &frame::Video) -> ColourEncoding {
    let jpeg = is_jpeg(video.format());
    let range = if jpeg || video.color_range() == color::Range::JPEG { Range::Full } else { Range::Limited };
    let matrix = match video.color_space() {
        color::Space::BT709 => Matrix::Bt709,
        color::Space::BT2020NCL | color::Space::BT2020CL => Matrix::Bt2020,
        color::Space::BT470BG | color::Space::SMPTE170M | color::Space::FCC => Matrix::Bt601,
        // Unlabelled: players assume BT.709 from 720 lines on.
        _ if !jpeg && video.height() >= 720 => Matrix::Bt709,
        _ => Matrix::Bt601,
    };
    ColourEncoding { range, matrix }
}

/// Position of the first chroma sample before any rotation, pixels of luma. An unlabelled JPEG has it in the middle of
/// the pixels that share it (JFIF), any other unlabelled video on the first column (H.264, HEVC and MPEG-4).
fn first_chroma_px(video: &frame::Video) -> [f32; 2] {
    use chroma::Location::*;
    let (shift_x, shift_y) = chroma_shift(video.format());
    let [middle_x, middle_y] = [shift_x, shift_y].map(middle_px);
    let is_jpeg = is_jpeg(video.format());
    match video.chroma_location() {
        Center => [middle_x, middle_y],
        Unspecified if is_jpeg => [middle_x, middle_y],
        Left | Unspecified => [0.0, middle_y],
        TopLeft => [0.0, 0.0],
        Top => [middle_x, 0.0],
        BottomLeft => [0.0, 2.0 * middle_y],
        Bottom => [middle_x, 2.0 * middle_y],
    }
}

/// A plane as stored, and how often its samples are repeated for display.
struct StoredPlane<'a> {
    plane: Plane<'a>,
    /// Each sample becomes `1 << repeat` samples in x and y.
    repeat: (u8, u8),
    /// Columns and rows of the picture.
    picture_size: (u32, u32),
}

impl StoredPlane<'_> {
    /// Fills a plane with this one, or one field of it, as displayed.
    fn copy_displayed(&self, first_line: Option<usize>, orientation: PictureOrientation, into: &mut OwnedPlane) {
        match first_line {
            Some(first) if orientation == PictureOrientation::UPRIGHT => keep_one_field(self.plane, first, into),
            Some(first) => {
                let mut field = OwnedPlane::default();
                keep_one_field(self.plane, first, &mut field);
                StoredPlane { plane: field.borrow(), ..*self }.copy_turned(orientation, into);
            }
            None => self.copy_turned(orientation, into),
        }
    }

    fn copy_turned(&self, orientation: PictureOrientation, into: &mut OwnedPlane) {
        let (repeat_x, repeat_y) = self.repeat;
        let size = match self.repeat {
            (0, 0) => (self.plane.width, self.plane.height),
            _ => (self.picture_size.0 as usize, self.picture_size.1 as usize),
        };
        (into.width, into.height) = orientation.displayed(size);
        into.data.clear();
        for y in 0..into.height {
            for x in 0..into.width {
                let (x, y) = orientation.stored_place((x, y), size);
                into.data.push(self.plane.at(x >> repeat_x, y >> repeat_y));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of 4:2:2 whose lines have the codes 10, 11, 12, … in luma, 100, … in blue and 200, … in red.
    fn lined(format: format::Pixel) -> PlanarFrame {
        let mut frame = frame::Video::new(format, 4, 4);
        for plane in 0..3 {
            let stride = frame.stride(plane);
            let codes = frame.data_mut(plane).chunks_mut(stride).zip([10, 100, 200][plane]..);
            codes.for_each(|(line, code)| line.fill(code));
        }
        PlanarFrame { chroma_first_px: first_chroma_px(&frame), frame, is_converted: false }
    }

    #[test]
    fn high_dynamic_range_is_refused_by_name_and_unlabelled_video_is_not() {
        let made = |transfer: color::TransferCharacteristic| {
            let mut frame = lined(format::Pixel::YUV422P).frame;
            frame.set_color_transfer_characteristic(transfer);
            PictureMaker::new(PictureOrientation::UPRIGHT).make(frame, 0, 0.0)
        };
        for (transfer, name) in
            [(color::TransferCharacteristic::SMPTE2084, "PQ"), (color::TransferCharacteristic::ARIB_STD_B67, "HLG")]
        {
            let refused = made(transfer).err().unwrap().to_string();
            assert!(refused.contains(name) && refused.contains("switch off HDR"), "{refused}");
        }
        assert!(made(color::TransferCharacteristic::BT709).is_ok());
        assert!(made(color::TransferCharacteristic::Unspecified).is_ok());
    }

    #[test]
    fn a_field_is_taken_before_the_picture_is_turned() {
        let mut maker = PictureMaker::new(PictureOrientation::RIGHT);
        let picture = maker.picture_of(lined(format::Pixel::YUV422P), Some(1), 3, 0.5);
        assert!(picture.is_interlaced());
        let frame = picture.frame();
        assert_eq!((frame.index, frame.time_s, frame.shift_x, frame.shift_y), (3, 0.5, 0, 1));
        // The second and the fourth line stay, and the last one comes first.
        assert_eq!(frame.y.data, [13, 12, 11, 11].repeat(4));
        assert_eq!(frame.u.data, [103, 102, 101, 101].repeat(2));
        assert_eq!(frame.v.data, [203, 202, 201, 201].repeat(2));
    }

    #[test]
    fn an_upright_progressive_picture_is_the_decoder_s_own_memory() {
        let planar = lined(format::Pixel::YUV422P);
        let place = planar.frame.data(0).as_ptr();
        let picture = PictureMaker::new(PictureOrientation::UPRIGHT).picture_of(planar, None, 0, 0.0);
        let frame = picture.frame();
        assert!(!picture.is_interlaced() && frame.y.data.as_ptr() == place);
        assert_eq!((frame.shift_x, frame.shift_y), (1, 0));
    }

    /// A frame of 4:2:0 whose samples have the codes of their places.
    fn odd_frame() -> PlanarFrame {
        let mut frame = frame::Video::new(format::Pixel::YUV420P, 5, 3);
        for plane in 0..3 {
            let (stride, width) = (frame.stride(plane), frame.plane_width(plane) as usize);
            for (y, line) in frame.data_mut(plane).chunks_mut(stride).enumerate() {
                line.iter_mut().take(width).zip(40 * plane..).for_each(|(code, at)| *code = (at + 10 * y) as u8);
            }
        }
        PlanarFrame { chroma_first_px: [0.0, 0.5], frame, is_converted: false }
    }

    #[test]
    fn each_pixel_of_an_odd_picture_keeps_its_colour_when_the_picture_is_turned() {
        let stored = PictureMaker::new(PictureOrientation::UPRIGHT).picture_of(odd_frame(), None, 0, 0.0);
        for orientation in PictureOrientation::ALL {
            let shown = PictureMaker::new(orientation).picture_of(odd_frame(), None, 0, 0.0);
            let frame = shown.frame();
            assert_eq!((frame.width(), frame.height()), orientation.displayed((5, 3)), "{orientation:?}");
            for (x, y) in (0..frame.width()).flat_map(|x| (0..frame.height()).map(move |y| (x, y))) {
                let (from_x, from_y) = orientation.stored_place((x, y), (5, 3));
                assert_eq!(frame.yuv_at(x, y), stored.frame().yuv_at(from_x, from_y), "{orientation:?} {x} {y}");
            }
        }
    }

    #[test]
    fn an_unlabelled_jpeg_has_its_chroma_between_two_columns_and_other_video_on_the_first() {
        let first = |format| first_chroma_px(&frame::Video::new(format, 64, 64));
        assert_eq!(first(format::Pixel::YUVJ420P), [0.5, 0.5]);
        assert_eq!(first(format::Pixel::YUV420P), [0.0, 0.5]);
        assert_eq!(first(format::Pixel::YUV422P), [0.0, 0.0]);
        assert_eq!(first(format::Pixel::YUV444P), [0.0, 0.0]);
    }

    #[test]
    fn what_is_converted_keeps_its_range_and_its_matrix() {
        let encoding = |from, space: color::Space| {
            let mut decoded = frame::Video::new(from, 96, 64);
            decoded.set_color_range(color::Range::JPEG);
            decoded.set_color_space(space);
            PictureMaker::new(PictureOrientation::UPRIGHT).make(decoded, 0, 0.0).unwrap().frame().encoding
        };
        let full = ColourEncoding { range: Range::Full, matrix: Matrix::Bt2020 };
        assert_eq!(encoding(format::Pixel::YUV420P10LE, color::Space::BT2020NCL), full);
        let from_rgb = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt601 };
        assert_eq!(encoding(format::Pixel::RGB24, color::Space::RGB), from_rgb, "as the scaler makes it");
    }

    #[test]
    fn the_memory_of_a_picture_that_is_done_with_serves_the_next() {
        let decoded = || frame::Video::new(format::Pixel::YUV420P10LE, 96, 64);
        let mut maker = PictureMaker::new(PictureOrientation::RIGHT);
        let first = maker.make(decoded(), 0, 0.0).unwrap();
        let place = first.frame().y.data.as_ptr();
        maker.recycle(first);
        let spare = |maker: &PictureMaker| {
            let SpareMemory { decoded, converted, turned } = &maker.spare;
            (decoded.len(), converted.len(), turned.len())
        };
        assert_eq!(spare(&maker), (1, 1, 1));
        let to_fill = maker.frame_to_fill();
        assert_eq!(spare(&maker), (0, 1, 1));
        drop(to_fill);
        let second = maker.make(decoded(), 1, 0.04).unwrap();
        assert_eq!(second.frame().y.data.as_ptr(), place);
        assert_eq!(spare(&maker), (1, 1, 0), "converted into the spare buffer, which is spare again once turned");
    }

    #[test]
    fn a_copy_leaves_no_memory_behind() {
        let mut maker = PictureMaker::new(PictureOrientation::UPRIGHT);
        let picture = maker.make(frame::Video::new(format::Pixel::YUV420P, 96, 64), 0, 0.0).unwrap();
        let copy = picture.copied();
        maker.recycle(copy);
        assert_eq!((maker.spare.decoded.len(), maker.spare.turned.len()), (0, 0));
        maker.recycle(picture);
        assert_eq!(maker.spare.decoded.len(), 1);
    }
}
