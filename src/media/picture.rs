//! A decoded picture in planar 8-bit YUV and display orientation; the pipeline borrows it as a [`Frame`].

use ffmpeg_next::frame;

use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};

/// One decoded picture; owns its memory.
pub struct Picture {
    index: u64,
    time_s: f64,
    planes: Planes,
    shift: (u8, u8),
    chroma_first_px: [f32; 2],
    encoding: ColourEncoding,
    is_interlaced: bool,
}

/// The owner of a picture's planes.
pub(super) enum Planes {
    /// FFmpeg owns the memory.
    Frame(PlanarFrame),
    /// We own the memory, and reuse it.
    Owned([OwnedPlane; 3]),
    /// We own the memory of a copy; it is not reused.
    Copied([OwnedPlane; 3]),
}

/// An FFmpeg frame in planar 8-bit YUV.
pub(super) struct PlanarFrame {
    pub(super) frame: frame::Video,
    /// Position of its first chroma sample, pixels of luma.
    pub(super) chroma_first_px: [f32; 2],
    /// True if the frame was converted into a separate buffer; otherwise the buffer is the decoder's.
    pub(super) is_converted: bool,
}

/// A plane whose rows are packed.
#[derive(Default)]
pub(super) struct OwnedPlane {
    pub(super) data: Vec<u8>,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Picture {
    /// A picture whose first chroma sample lies midway between its pixels.
    pub(super) fn new(planes: Planes, shift: (u8, u8), encoding: ColourEncoding, index: u64, time_s: f64) -> Self {
        let chroma_first_px = [shift.0, shift.1].map(middle_px);
        Self { index, time_s, planes, shift, chroma_first_px, encoding, is_interlaced: false }
    }

    /// The same picture with its first chroma sample here, pixels of luma.
    pub(super) fn with_chroma_at(self, chroma_first_px: [f32; 2]) -> Self {
        Self { chroma_first_px, ..self }
    }

    /// The same picture, marked as one field of an interlaced frame.
    pub(super) fn into_one_field(self) -> Self {
        Self { is_interlaced: true, ..self }
    }

    /// True if the frame was interlaced; the picture is then its first field.
    pub fn is_interlaced(&self) -> bool {
        self.is_interlaced
    }

    /// A copy in separate memory. Use it for a picture that is kept for long: a decoder that has to allocate more
    /// buffers never frees them.
    pub fn copied(&self) -> Self {
        let frame = self.frame();
        let planes = [frame.y, frame.u, frame.v].map(OwnedPlane::of);
        Self { planes: Planes::Copied(planes), ..*self }
    }

    pub(super) fn into_planes(self) -> Planes {
        self.planes
    }

    /// A still picture of packed R, G, B as a frame at time 0, coded as a JPEG would be: full range, BT.601, no
    /// subsampling.
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
        Self {
            index,
            time_s: 0.0,
            planes: Planes::Owned(planes),
            shift: (0, 0),
            chroma_first_px: [0.0; 2],
            encoding,
            is_interlaced: false,
        }
    }

    /// Memory of its planes, bytes.
    pub(super) fn memory_bytes(&self) -> usize {
        let frame = self.frame();
        [frame.y, frame.u, frame.v].iter().map(|plane| plane.data.len()).sum()
    }

    /// The picture as the pipeline sees it.
    pub fn frame(&self) -> Frame<'_> {
        let [y, u, v] = [0, 1, 2].map(|i| match &self.planes {
            Planes::Frame(planar) => plane_of(&planar.frame, i),
            Planes::Owned(planes) | Planes::Copied(planes) => planes[i].borrow(),
        });
        Frame {
            index: self.index,
            time_s: self.time_s,
            y,
            u,
            v,
            shift_x: self.shift.0,
            shift_y: self.shift.1,
            chroma_first_px: self.chroma_first_px,
            encoding: self.encoding,
        }
    }
}

/// The middle of the pixels that share the first chroma sample of a plane halved this many times, pixels of luma.
pub(super) fn middle_px(halvings: u8) -> f32 {
    0.5 * (f32::from(1u16 << halvings) - 1.0)
}

impl OwnedPlane {
    fn of(plane: Plane<'_>) -> Self {
        let Plane { width, height, .. } = plane;
        let mut data = Vec::with_capacity(width * height);
        (0..height).for_each(|y| data.extend_from_slice(plane.row(y)));
        Self { data, width, height }
    }

    pub(super) fn borrow(&self) -> Plane<'_> {
        Plane { data: &self.data, stride: self.width, width: self.width, height: self.height }
    }
}

pub(super) fn plane_of(video: &frame::Video, i: usize) -> Plane<'_> {
    Plane {
        data: video.data(i),
        stride: video.stride(i),
        width: video.plane_width(i) as usize,
        height: video.plane_height(i) as usize,
    }
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
}
