//! An enlarged crop of a frame, to draw on in the frame's pixel coordinates.

use std::path::Path;

use image::{ImageResult, Rgb, RgbImage};
use nalgebra::Vector2;

use super::letters;
use crate::vision::frame::Frame;

/// A colour to draw with.
pub(super) type Ink = [u8; 3];

/// Picture pixels per letter pixel.
const LETTER_PX: usize = 2;

/// Distance between text lines, picture pixels.
const LINE_PX: usize = 16;

/// The crop of a frame that is shown: its first column and row, its size, and the scale (picture pixels per frame
/// pixel).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrameCrop {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) scale: usize,
}

impl FrameCrop {
    /// The whole frame at scale 1.
    pub(super) fn whole(frame: &Frame<'_>) -> Self {
        Self { left: 0, top: 0, width: frame.width(), height: frame.height(), scale: 1 }
    }

    /// The crop between two corners, clipped to the frame and enlarged to at most 1000 pixels. `None` if it is empty.
    pub(super) fn around(low: Vector2<f64>, high: Vector2<f64>, frame: &Frame<'_>) -> Option<Self> {
        const MAX_CROP_PX: usize = 1000;
        const MAX_SCALE: usize = 12;
        let cut = |px: f64, most: usize| (px.max(0.0) as usize).min(most);
        let (left, top) = (cut(low.x, frame.width()), cut(low.y, frame.height()));
        let (right, bottom) = (cut(high.x + 1.0, frame.width()), cut(high.y + 1.0, frame.height()));
        let (width, height) = (right.checked_sub(left)?, bottom.checked_sub(top)?);
        let scale = (MAX_CROP_PX / width.max(height).max(1)).clamp(1, MAX_SCALE);
        (width > 0 && height > 0).then_some(Self { left, top, width, height, scale })
    }
}

/// A picture to draw on: lines of text, and the crop of the frame below them.
pub(super) struct Canvas {
    picture: RgbImage,
    crop: FrameCrop,
    header_px: usize,
    pen_px: i64,
}

impl Canvas {
    /// The crop of the frame with text lines above it, each in its own colour. `brightness` dims the frame's pixels.
    pub(super) fn new(frame: &Frame<'_>, part: FrameCrop, text: &[(Ink, String)], brightness: f64) -> Self {
        const PAPER: Rgb<u8> = Rgb([16, 16, 16]);
        let header_px = text.len() * LINE_PX + LETTER_PX;
        let longest = text.iter().map(|(_, line)| line.chars().count()).max().unwrap_or(0);
        let width = (part.width * part.scale).max(letter_x(longest));
        let height = part.height * part.scale + header_px;
        let picture = RgbImage::from_pixel(width as u32, height as u32, PAPER);
        let mut canvas = Self { picture, crop: part, header_px, pen_px: 1 };
        canvas.show(frame, brightness);
        text.iter().enumerate().for_each(|(line, (ink, text))| canvas.write(line, text, *ink));
        canvas
    }

    /// Sets the width of lines, picture pixels.
    pub(super) fn with_pen(self, pen_px: i64) -> Self {
        Self { pen_px, ..self }
    }

    fn show(&mut self, frame: &Frame<'_>, brightness: f64) {
        let FrameCrop { left, top, width, height, scale } = self.crop;
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let rgb = frame.encoding.rgb_of_codes(frame.yuv_at(left + x, top + y).map(f64::from));
            let ink = [rgb.x, rgb.y, rgb.z].map(|c| (c * 255.0 * brightness).round().clamp(0.0, 255.0) as u8);
            for (dx, dy) in (0..scale).flat_map(|dy| (0..scale).map(move |dx| (dx, dy))) {
                let (column, row) = (x * scale + dx, y * scale + dy + self.header_px);
                self.picture.put_pixel(column as u32, row as u32, Rgb(ink));
            }
        }
    }

    fn write(&mut self, line: usize, text: &str, ink: Ink) {
        let top = line * LINE_PX + LETTER_PX;
        let (columns, rows) = letters::SIZE;
        for (place, letter) in text.chars().enumerate() {
            for (x, y) in (0..rows * LETTER_PX).flat_map(|y| (0..columns * LETTER_PX).map(move |x| (x, y))) {
                if letters::is_ink(letter, x / LETTER_PX, y / LETTER_PX) {
                    self.put((letter_x(place) + x) as i64, (top + y) as i64, ink);
                }
            }
        }
    }

    /// Draws a square dot of `size` picture pixels around a point of the frame.
    pub(super) fn dot(&mut self, at: Vector2<f64>, size: i64, ink: Ink) {
        let [x, y] = self.to_canvas(at);
        for (dx, dy) in (0..size).flat_map(|dy| (0..size).map(move |dx| (dx - size / 2, dy - size / 2))) {
            self.put_in_crop(x + dx, y + dy, ink);
        }
    }

    /// Draws a line between two points of the frame.
    pub(super) fn line(&mut self, from: Vector2<f64>, to: Vector2<f64>, ink: Ink) {
        const MAX_STEPS: f64 = 20_000.0;
        const STEPS_PER_PX: f64 = 2.0; // with one step per pixel, rounding leaves gaps
        let steps = ((to - from).amax() * self.crop.scale as f64 * STEPS_PER_PX).ceil().clamp(1.0, MAX_STEPS);
        for step in 0..=steps as u32 {
            self.dot(from + (to - from) * (f64::from(step) / steps), self.pen_px, ink);
        }
    }

    /// Draws lines through all points in order.
    pub(super) fn path(&mut self, places: &[Vector2<f64>], ink: Ink) {
        places.windows(2).for_each(|pair| self.line(pair[0], pair[1], ink));
    }

    /// Draws a cross at a point of the frame.
    pub(super) fn cross(&mut self, at: Vector2<f64>, half_px: f64, ink: Ink) {
        for arm in [Vector2::new(half_px, 0.0), Vector2::new(0.0, half_px)] {
            self.line(at - arm, at + arm, ink);
        }
    }

    /// Writes the picture as PNG.
    pub(super) fn save(&self, path: &Path) -> ImageResult<()> {
        self.picture.save(path)
    }

    /// Picture coordinates of a point of the frame. Frame pixel 0 is centred at 0 and covers `scale` picture pixels.
    fn to_canvas(&self, at: Vector2<f64>) -> [i64; 2] {
        let scale = self.crop.scale as f64;
        let shown = |px: f64, first: usize| ((px + 0.5 - first as f64) * scale).floor() as i64;
        [shown(at.x, self.crop.left), shown(at.y, self.crop.top) + self.header_px as i64]
    }

    /// Puts a pixel inside the crop only, so that lines that leave the crop do not cross the text.
    fn put_in_crop(&mut self, x: i64, y: i64, ink: Ink) {
        if y >= self.header_px as i64 && x < (self.crop.width * self.crop.scale) as i64 {
            self.put(x, y, ink);
        }
    }

    fn put(&mut self, x: i64, y: i64, ink: Ink) {
        if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
            && let Some(pixel) = self.picture.get_pixel_mut_checked(x, y)
        {
            *pixel = Rgb(ink);
        }
    }
}

/// Left edge of the letter with this index, picture pixels.
fn letter_x(place: usize) -> usize {
    (place * (letters::SIZE.0 + 1) + 2) * LETTER_PX
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};

    const INK: Ink = [255, 0, 0];
    const PAPER: Ink = [16, 16, 16];
    /// The grey with code 100 in full range, at half brightness.
    const GREY: Ink = [50, 50, 50];

    /// Four columns by three rows of a frame from its pixel (2, 1), at scale 10, below two lines of text.
    fn canvas() -> Canvas {
        let data = [[100; 48], [128; 48], [128; 48]];
        let [y, u, v] = data.each_ref().map(|data| Plane { data, stride: 8, width: 8, height: 6 });
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let frame = Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, encoding };
        let part = FrameCrop { left: 2, top: 1, width: 4, height: 3, scale: 10 };
        Canvas::new(&frame, part, &[(INK, "h".to_owned()), (INK, "two lines".to_owned())], 0.5)
    }

    fn inked(canvas: &Canvas, ink: Ink) -> Vec<(u32, u32)> {
        canvas.picture.enumerate_pixels().filter(|(_, _, pixel)| pixel.0 == ink).map(|(x, y, _)| (x, y)).collect()
    }

    #[test]
    fn the_crop_is_drawn_below_the_text() {
        let canvas = canvas();
        assert_eq!(canvas.picture.dimensions(), (76, 64), "as wide as nine letters, two lines and thirty rows high");
        let rectangle = |left, right, top, bottom| (top..bottom).flat_map(move |y| (left..right).map(move |x| (x, y)));
        assert_eq!(inked(&canvas, GREY), rectangle(0, 40, 34, 64).collect::<Vec<_>>());
        let h: Vec<_> = inked(&canvas, INK).into_iter().filter(|(_, y)| *y < 18).collect();
        assert_eq!((h.len(), h.first(), h.last()), (44, Some(&(4, 2)), Some(&(9, 11))), "eleven dots of two by two");
    }

    #[test]
    fn drawings_are_at_frame_coordinates_and_never_over_the_text() {
        let blank = canvas();
        let new = |canvas: &Canvas| {
            let was_there = inked(&blank, INK);
            inked(canvas, INK).into_iter().filter(|at| !was_there.contains(at)).collect::<Vec<_>>()
        };
        let mut dotted = canvas();
        dotted.dot(Vector2::new(3.0, 2.0), 1, INK);
        assert_eq!(new(&dotted), [(15, 49)], "the middle of the enlarged pixel");
        let mut lined = canvas();
        lined.line(Vector2::new(3.0, 2.0), Vector2::new(3.0, -40.0), INK);
        assert_eq!(new(&lined), (34..50).map(|y| (15, y)).collect::<Vec<_>>(), "without gaps");
        lined.line(Vector2::new(3.0, 3.0), Vector2::new(90.0, 3.0), INK);
        assert!(inked(&lined, PAPER).len() == inked(&blank, PAPER).len(), "nor beside the part");
    }

    #[test]
    fn a_crop_is_clipped_to_the_frame_and_enlarged_to_a_thousand_pixels() {
        let data = [0; 300 * 200];
        let plane = Plane { data: &data, stride: 300, width: 300, height: 200 };
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let frame = Frame { index: 0, time_s: 0.0, y: plane, u: plane, v: plane, shift_x: 0, shift_y: 0, encoding };
        let around = |low: [f64; 2], high: [f64; 2]| FrameCrop::around(low.into(), high.into(), &frame);
        let corner = FrameCrop { left: 0, top: 0, width: 101, height: 51, scale: 9 };
        assert_eq!(around([-5.0, -9.0], [100.0, 50.0]), Some(corner));
        let small = FrameCrop { left: 290, top: 190, width: 10, height: 10, scale: 12 };
        assert_eq!(around([290.0, 190.0], [400.0, 400.0]), Some(small));
        assert_eq!(around([310.0, 10.0], [400.0, 50.0]), None);
    }
}
