//! What a recording or a feed shows of its box: frames spread over it, as cells, and the picture of the empty box.

use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::segmentation::cells::CellPicture;

/// Largest number of frames that are kept. They show the box well: the median of a cell over them is known to a sixth
/// of its noise. The number is even, so that halving keeps the spacing.
pub const SCENE_FRAMES: usize = 60;

/// Frames of the box, in time order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneSamples {
    pub(super) frames: Vec<CellPicture>,
    pub(super) empty: Option<CellPicture>,
    /// Frames passed to [`Self::add`].
    offered: u64,
    /// Of the offered frames, each is kept whose number is a multiple of two to this power.
    halvings: u32,
}

impl SceneSamples {
    /// Adds a frame of the recording. Of more than [`SCENE_FRAMES`] frames an evenly spread part is kept, at least half
    /// as many.
    pub fn add(&mut self, frame: &Frame<'_>) {
        let number = self.offered;
        self.offered += 1;
        if !number.is_multiple_of(1 << self.halvings) {
            return;
        }
        if self.frames.len() == SCENE_FRAMES {
            let mut is_kept = false;
            self.frames.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
            self.halvings += 1;
        }
        self.frames.push(CellPicture::of(frame));
    }

    /// Sets the picture of the empty box: of the frames' size, and in any encoding. `encoding` is that of the frames.
    pub fn set_empty(&mut self, picture: &Frame<'_>, encoding: ColourEncoding) {
        self.empty = Some(CellPicture::of(picture).with_encoding(picture.encoding, encoding));
    }

    /// Is there a picture of the empty box?
    pub fn has_empty(&self) -> bool {
        self.empty.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{Matrix, Plane, Range};

    /// A small picture of one brightness.
    fn add_grey(scene: &mut SceneSamples, luma: u8) {
        const SIDE: usize = 4;
        let (luma, chroma) = ([luma; SIDE * SIDE], [128; SIDE * SIDE]);
        let plane = |data| Plane { data, stride: SIDE, width: SIDE, height: SIDE };
        scene.add(&Frame {
            index: 0,
            time_s: 0.0,
            y: plane(&luma),
            u: plane(&chroma),
            v: plane(&chroma),
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding: ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 },
        });
    }

    fn lumas(frames: u8) -> Vec<u8> {
        let mut scene = SceneSamples::default();
        (0..frames).for_each(|number| add_grey(&mut scene, number));
        scene.frames.iter().map(|cells| cells.codes[0][0]).collect()
    }

    #[test]
    fn few_frames_are_all_kept_and_of_more_an_evenly_spread_half() {
        assert_eq!(lumas(60), (0..60).collect::<Vec<_>>());
        assert_eq!(lumas(61), (0..61).step_by(2).collect::<Vec<_>>());
        assert_eq!(lumas(120), (0..120).step_by(2).collect::<Vec<_>>());
        assert_eq!(lumas(250), (0..250).step_by(8).collect::<Vec<_>>());
    }
}
