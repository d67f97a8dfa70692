//! A decoded picture in planar 8-bit YUV and display orientation, lent to the pipeline as a [`Frame`].

use ffmpeg_next::{format, frame, software::scaling, util::color};

use super::MediaError;
use super::fields::one_field;
use crate::pipeline::frame::{ColourEncoding, Frame, Matrix, Plane, Range};

/// A quarter turn's multiple, clockwise, that display asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rotation {
    /// As recorded.
    None,
    /// 90° clockwise.
    Right,
    /// 180°.
    Half,
    /// 270° clockwise.
    Left,
}

impl Rotation {
    /// Width and height as displayed.
    pub(super) fn turned(self, width: u32, height: u32) -> (u32, u32) {
        match self {
            Rotation::None | Rotation::Half => (width, height),
            Rotation::Right | Rotation::Left => (height, width),
        }
    }
}

/// One decoded picture; owns its memory.
pub struct Picture {
    index: u64,
    time_s: f64,
    planes: Planes,
    shift: (u8, u8),
    encoding: ColourEncoding,
}

enum Planes {
    Decoded(frame::Video),
    Owned([OwnedPlane; 3]),
}

pub(super) struct OwnedPlane {
    pub(super) data: Vec<u8>,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Picture {
    pub(super) fn new(
        decoded: frame::Video,
        index: u64,
        time_s: f64,
        rotation: Rotation,
        scaler: &mut Option<scaling::Context>,
    ) -> Result<Self, MediaError> {
        let first_line = decoded.is_interlaced().then(|| usize::from(!decoded.is_top_first()));
        let planar = to_planar(decoded, scaler)?;
        let (sx, sy) = chroma_shift(planar.format());
        let encoding = encoding_of(&planar);
        let shift = if matches!(rotation, Rotation::None | Rotation::Half) { (sx, sy) } else { (sy, sx) };
        let each_plane = |change: &dyn Fn(Plane<'_>) -> OwnedPlane| [0, 1, 2].map(|i| change(plane_of(&planar, i)));
        let planes = match (first_line, rotation) {
            (None, Rotation::None) => Planes::Decoded(planar),
            (Some(first), Rotation::None) => Planes::Owned(each_plane(&|plane| one_field(plane, first))),
            (None, turn) => Planes::Owned(each_plane(&|plane| turn_plane(plane, turn))),
            (Some(first), turn) => {
                Planes::Owned(each_plane(&|plane| turn_plane(one_field(plane, first).borrow(), turn)))
            }
        };
        Ok(Self { index, time_s, planes, shift, encoding })
    }

    /// A still picture of packed R, G, B as a frame at time 0, coded as a JPEG would be: full range, BT.601, no subsampling.
    pub(super) fn from_rgb(rgb: &[u8], width: usize, height: usize, index: u64) -> Self {
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let [mut y, mut u, mut v] = [const { Vec::new() }; 3];
        for &[r, g, b] in rgb.as_chunks().0 {
            let codes = encoding.codes_of(encoding.colour_of_rgb([r, g, b].map(|c| f64::from(c) / 255.0)));
            y.push(codes[0]);
            u.push(codes[1]);
            v.push(codes[2]);
        }
        let planes = [y, u, v].map(|data| OwnedPlane { data, width, height });
        Self { index, time_s: 0.0, planes: Planes::Owned(planes), shift: (0, 0), encoding }
    }

    /// The picture as the pipeline sees it.
    pub fn frame(&self) -> Frame<'_> {
        let [y, u, v] = [0, 1, 2].map(|i| match &self.planes {
            Planes::Decoded(video) => plane_of(video, i),
            Planes::Owned(planes) => planes[i].borrow(),
        });
        Frame {
            index: self.index,
            time_s: self.time_s,
            y,
            u,
            v,
            shift_x: self.shift.0,
            shift_y: self.shift.1,
            encoding: self.encoding,
        }
    }
}

impl OwnedPlane {
    fn borrow(&self) -> Plane<'_> {
        Plane { data: &self.data, stride: self.width, width: self.width, height: self.height }
    }
}

fn plane_of(video: &frame::Video, i: usize) -> Plane<'_> {
    Plane {
        data: video.data(i),
        stride: video.stride(i),
        width: video.plane_width(i) as usize,
        height: video.plane_height(i) as usize,
    }
}

fn chroma_shift(format: format::Pixel) -> (u8, u8) {
    format.descriptor().map_or((0, 0), |d| (d.log2_chroma_w(), d.log2_chroma_h()))
}

fn is_planar_8_bit(format: format::Pixel) -> bool {
    use format::Pixel::*;
    matches!(format, YUV420P | YUVJ420P | YUV422P | YUVJ422P | YUV444P | YUVJ444P | YUV440P | YUVJ440P)
}

/// 8-bit planar pictures pass untouched; deeper ones keep their chroma resolution, anything else becomes 4:4:4.
fn to_planar(decoded: frame::Video, scaler: &mut Option<scaling::Context>) -> Result<frame::Video, MediaError> {
    let from = decoded.format();
    if is_planar_8_bit(from) {
        return has_whole_planes(&decoded)
            .then_some(decoded)
            .ok_or_else(|| MediaError::PixelFormat(format!("{from:?}")));
    }
    let to = match chroma_shift(from) {
        (1, 1) => format::Pixel::YUV420P,
        (1, 0) => format::Pixel::YUV422P,
        _ => format::Pixel::YUV444P,
    };
    let unusable = |_| MediaError::PixelFormat(format!("{from:?}"));
    let (width, height) = (decoded.width(), decoded.height());
    let context = match scaler {
        Some(context) if context.input().format == from => context,
        slot => slot.insert(
            scaling::Context::get(from, width, height, to, width, height, scaling::Flags::POINT).map_err(unusable)?,
        ),
    };
    let mut planar = frame::Video::empty();
    context.run(&decoded, &mut planar).map_err(unusable)?;
    if is_rgb_or_grey(from) {
        // What the scaler makes of them.
        planar.set_color_range(color::Range::MPEG);
        planar.set_color_space(color::Space::SMPTE170M);
    } else {
        planar.set_color_range(decoded.color_range());
        planar.set_color_space(decoded.color_space());
    }
    Ok(planar)
}

fn is_rgb_or_grey(format: format::Pixel) -> bool {
    let name = format.descriptor().map_or("", |d| d.name());
    ["gbr", "rgb", "bgr", "gray", "pal"].iter().any(|family| name.starts_with(family))
}

/// Three planes whose rows run downwards and hold the width: what [`plane_of`] relies on.
fn has_whole_planes(video: &frame::Video) -> bool {
    const WIDEST_STRIDE: usize = 1 << 20; // a bottom-up picture's negative stride reads as far more
    video.planes() >= 3 && (0..3).all(|i| (video.plane_width(i) as usize..WIDEST_STRIDE).contains(&video.stride(i)))
}

fn encoding_of(video: &frame::Video) -> ColourEncoding {
    use format::Pixel::*;
    let jpeg = matches!(video.format(), YUVJ420P | YUVJ422P | YUVJ444P | YUVJ440P);
    let range = if jpeg || video.color_range() == color::Range::JPEG { Range::Full } else { Range::Limited };
    let matrix = match video.color_space() {
        color::Space::BT709 => Matrix::Bt709,
        color::Space::BT2020NCL | color::Space::BT2020CL => Matrix::Bt2020,
        color::Space::BT470BG | color::Space::SMPTE170M | color::Space::FCC => Matrix::Bt601,
        // Unlabelled: players take 709 from 720 lines on.
        _ if !jpeg && video.height() >= 720 => Matrix::Bt709,
        _ => Matrix::Bt601,
    };
    ColourEncoding { range, matrix }
}

fn turn_plane(plane: Plane<'_>, turn: Rotation) -> OwnedPlane {
    let (w, h) = (plane.width, plane.height);
    let (width, height) = if turn == Rotation::Half { (w, h) } else { (h, w) };
    let mut data = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            data.push(match turn {
                Rotation::None => plane.at(x, y),
                Rotation::Right => plane.at(y, h - 1 - x),
                Rotation::Half => plane.at(w - 1 - x, h - 1 - y),
                Rotation::Left => plane.at(w - 1 - y, x),
            });
        }
    }
    OwnedPlane { data, width, height }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_still_picture_gives_back_the_colours_it_was_made_of() {
        let rgb = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [0, 0, 0], [200, 120, 40]];
        let picture = Picture::from_rgb(rgb.as_flattened(), 3, 2, 7);
        let frame = picture.frame();
        for (i, wanted) in rgb.iter().enumerate() {
            let seen = frame.encoding.rgb_of_codes(frame.yuv_at(i % 3, i / 3).map(f64::from)) * 255.0;
            assert!(seen.iter().zip(wanted).all(|(s, w)| (s - f64::from(*w)).abs() < 2.0), "{wanted:?}: {seen}");
        }
        assert_eq!(frame.index, 7);
    }

    #[test]
    fn a_quarter_turn_moves_the_top_left_corner_to_the_top_right() {
        let plane = Plane { data: &[1, 2, 3, 4, 5, 6], stride: 3, width: 3, height: 2 };
        let right = turn_plane(plane, Rotation::Right);
        assert_eq!((right.width, right.height, right.data), (2, 3, vec![4, 1, 5, 2, 6, 3]));
        let left = turn_plane(plane, Rotation::Left);
        assert_eq!(left.data, [3, 6, 2, 5, 1, 4]);
        assert_eq!(turn_plane(plane, Rotation::Half).data, [6, 5, 4, 3, 2, 1]);
    }
}
