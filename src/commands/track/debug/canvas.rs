//! An enlarged crop of a frame, to draw on in the frame's pixel coordinates.

use std::convert::Infallible;
use std::path::Path;

use embedded_graphics::Pixel;
use embedded_graphics::mono_font::iso_8859_1::FONT_8X13;
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Point, PointsIter, RgbColor, Size};
use embedded_graphics::primitives::{Line, Rectangle};
use embedded_graphics::text::{Baseline, Text};
use image::{ImageResult, Rgb, RgbImage};
use nalgebra::Vector2;

use crate::vision::frame::Frame;

/// A colour to draw with.
pub(super) type Ink = Rgb888;

/// Of the text above the picture.
const FONT: MonoFont = FONT_8X13;

/// Distance between text lines, picture pixels.
const LINE_PX: usize = 16;

/// Left and upper margin of the text, picture pixels.
const TEXT_MARGIN: Point = Point::new(4, 2);

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
    pen_px: u32,
}

impl Canvas {
    /// The crop of the frame with text lines above it, each in its own colour. `brightness` dims the frame's pixels.
    pub(super) fn new(frame: &Frame<'_>, crop: FrameCrop, text: &[(Ink, String)], brightness: f64) -> Self {
        const PAPER: Rgb<u8> = Rgb([16, 16, 16]);
        let FrameCrop { left, top, width, height, scale } = crop;
        let header_px = text.len() * LINE_PX + TEXT_MARGIN.y as usize;
        let letters = text.iter().map(|(_, line)| line.chars().count()).max().unwrap_or(0);
        let text_px = letters * FONT.character_size.width as usize + TEXT_MARGIN.x as usize;
        let size = [(width * scale).max(text_px), height * scale + header_px].map(|px| px as u32);
        let picture = RgbImage::from_fn(size[0], size[1], |column, row| {
            let column = column as usize / scale;
            match (row as usize).checked_sub(header_px) {
                Some(row) if column < width => dimmed_pixel(frame, left + column, top + row / scale, brightness),
                _ => PAPER,
            }
        });
        let mut canvas = Self { picture, crop, header_px, pen_px: 1 };
        for (line, (ink, text)) in text.iter().enumerate() {
            let at = TEXT_MARGIN + Point::new(0, (line * LINE_PX) as i32);
            let Ok(_) = Text::with_baseline(text, at, MonoTextStyle::new(&FONT, *ink), Baseline::Top).draw(&mut canvas);
        }
        canvas
    }

    /// Sets the width of lines, picture pixels.
    pub(super) fn with_pen(self, pen_px: u32) -> Self {
        Self { pen_px, ..self }
    }

    /// Draws a square dot of `size` picture pixels around a point of the frame.
    pub(super) fn dot(&mut self, at: Vector2<f64>, size: u32, ink: Ink) {
        self.square(self.to_canvas(at), size, ink);
    }

    /// Draws a line between two points of the frame.
    pub(super) fn line(&mut self, from: Vector2<f64>, to: Vector2<f64>, ink: Ink) {
        for point in Line::new(self.to_canvas(from), self.to_canvas(to)).points() {
            self.square(point, self.pen_px, ink);
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
    fn to_canvas(&self, at: Vector2<f64>) -> Point {
        /// Points farther outside are drawn at this distance: it limits the length of a line.
        const MAX_PX: f64 = 20_000.0;
        let scale = self.crop.scale as f64;
        let shown = |px: f64, first: usize| ((px + 0.5 - first as f64) * scale).floor().clamp(-MAX_PX, MAX_PX) as i32;
        Point::new(shown(at.x, self.crop.left), shown(at.y, self.crop.top) + self.header_px as i32)
    }

    /// Fills a square inside the crop only, so that lines that leave the crop do not cross the text.
    fn square(&mut self, centre: Point, size: u32, ink: Ink) {
        let FrameCrop { width, height, scale, .. } = self.crop;
        let crop_size = Size::new((width * scale) as u32, (height * scale) as u32);
        let crop = Rectangle::new(Point::new(0, self.header_px as i32), crop_size);
        let square = Rectangle::new(centre - Point::new_equal(size as i32 / 2), Size::new_equal(size));
        let Ok(()) = self.fill_solid(&square.intersection(&crop), ink);
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.picture.width(), self.picture.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Ink;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Ink>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(at, ink) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y))
                && let Some(pixel) = self.picture.get_pixel_mut_checked(x, y)
            {
                *pixel = Rgb([ink.r(), ink.g(), ink.b()]);
            }
        }
        Ok(())
    }
}

fn dimmed_pixel(frame: &Frame<'_>, column: usize, row: usize, brightness: f64) -> Rgb<u8> {
    let rgb = frame.encoding.rgb_of_codes(frame.yuv_at(column, row).map(f64::from));
    Rgb([rgb.x, rgb.y, rgb.z].map(|c| (c * 255.0 * brightness).round().clamp(0.0, 255.0) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};

    const INK: Ink = Ink::new(255, 0, 0);
    const PAPER: Ink = Ink::new(16, 16, 16);
    /// The grey with code 100 in full range, at half brightness.
    const GREY: Ink = Ink::new(50, 50, 50);

    /// Four columns by three rows of a frame from its pixel (2, 1), at scale 10, below two lines of text.
    fn canvas() -> Canvas {
        let data = [[100; 48], [128; 48], [128; 48]];
        let [y, u, v] = data.each_ref().map(|data| Plane { data, stride: 8, width: 8, height: 6 });
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let frame =
            Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, chroma_first_px: [0.0; 2], encoding };
        let part = FrameCrop { left: 2, top: 1, width: 4, height: 3, scale: 10 };
        Canvas::new(&frame, part, &[(INK, "h".to_owned()), (INK, "two lines".to_owned())], 0.5)
    }

    fn inked(canvas: &Canvas, ink: Ink) -> Vec<(u32, u32)> {
        let is_ink = |pixel: &Rgb<u8>| Ink::new(pixel.0[0], pixel.0[1], pixel.0[2]) == ink;
        canvas.picture.enumerate_pixels().filter(|(_, _, pixel)| is_ink(pixel)).map(|(x, y, _)| (x, y)).collect()
    }

    #[test]
    fn the_crop_is_drawn_below_the_text() {
        let canvas = canvas();
        assert_eq!(canvas.picture.dimensions(), (76, 64), "as wide as nine letters, two lines and thirty rows high");
        let rectangle = |left, right, top, bottom| (top..bottom).flat_map(move |y| (left..right).map(move |x| (x, y)));
        assert_eq!(inked(&canvas, GREY), rectangle(0, 40, 34, 64).collect::<Vec<_>>());
        let [first, second] = [0, 1].map(|line| {
            let rows = LINE_PX as u32 * line..LINE_PX as u32 * (line + 1);
            inked(&canvas, INK).into_iter().filter(|(_, y)| rows.contains(y)).map(|(x, _)| x).collect::<Vec<_>>()
        });
        assert!(first.len() > 10 && first.iter().all(|x| (4..12).contains(x)), "one letter: {first:?}");
        assert!(second.iter().any(|x| *x > 66), "nine letters: {second:?}");
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
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: plane,
            u: plane,
            v: plane,
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding,
        };
        let around = |low: [f64; 2], high: [f64; 2]| FrameCrop::around(low.into(), high.into(), &frame);
        let corner = FrameCrop { left: 0, top: 0, width: 101, height: 51, scale: 9 };
        assert_eq!(around([-5.0, -9.0], [100.0, 50.0]), Some(corner));
        let small = FrameCrop { left: 290, top: 190, width: 10, height: 10, scale: 12 };
        assert_eq!(around([290.0, 190.0], [400.0, 400.0]), Some(small));
        assert_eq!(around([310.0, 10.0], [400.0, 50.0]), None);
    }
}
