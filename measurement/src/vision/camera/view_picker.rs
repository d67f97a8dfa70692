//! Picks a few sharp and different views from a video of a board, as a person would take photos.
//!
//! In: the luma planes of a recording, one after the other. Out: views for [`super::calibrate()`]. Method: frames are
//! grouped into windows, and only the sharpest frame of a window is searched for the board (a moving board blurs most
//! frames). A view is kept if its corners lie elsewhere than in every view kept before. Neighbouring frames are nearly
//! equal; to use them all would make the standard deviations look smaller than they are.

use super::checkerboard::{self, BoardReason};
use super::{Board, BoardView, MIN_PHOTOS};
use crate::vision::frame::Plane;
use crate::vision::space::Pixel;

/// Target number of frames searched for the board: more cost time and hardly add views.
const TARGET_SEARCHES: u64 = 150;

/// Maximum of views kept; with more, the camera's standard deviations fall no further in practice.
const MAX_VIEWS: usize = 40;

/// A view is new if its corners moved by more than this share of the picture's diagonal, on average.
const MIN_MOVE: f64 = 0.03;

/// Frames in one window, if the recording's length is unknown.
const DEFAULT_WINDOW: u64 = 10;

/// Picks views from a recording.
pub struct ViewPicker {
    board: Board,
    window: u64,
    frames_seen: u64,
    searches: u64,
    sharpest: Option<SharpestFrame>,
    views: Vec<(String, Vec<Pixel>)>,
    failures: Vec<(String, BoardReason)>,
}

struct SharpestFrame {
    sharpness: f64,
    name: String,
    data: Vec<u8>,
    width: usize,
    height: usize,
}

impl ViewPicker {
    /// Prepares for a recording of `frames` frames, if that is known.
    pub fn new(board: Board, frames: Option<u64>) -> Self {
        let window = frames.map_or(DEFAULT_WINDOW, |n| n.div_ceil(TARGET_SEARCHES).max(1));
        Self { board, window, frames_seen: 0, searches: 0, sharpest: None, views: Vec::new(), failures: Vec::new() }
    }

    /// Takes the next frame; `name` is for the report.
    pub fn add_frame(&mut self, name: impl FnOnce() -> String, luma: &Plane<'_>) {
        let sharpness = sharpness(luma);
        if self.sharpest.as_ref().is_none_or(|best| sharpness > best.sharpness) {
            let data = (0..luma.height).flat_map(|y| luma.row(y)).copied().collect();
            self.sharpest =
                Some(SharpestFrame { sharpness, name: name(), data, width: luma.width, height: luma.height });
        }
        self.frames_seen += 1;
        if self.frames_seen.is_multiple_of(self.window) {
            self.search_sharpest();
        }
    }

    /// The sharp and different views. If they are too few for a calibration, the frames without a board are added, each
    /// with its reason.
    pub fn into_views(mut self) -> Vec<BoardView> {
        self.search_sharpest();
        let mut views: Vec<_> =
            self.views.into_iter().map(|(name, corners)| BoardView { name, corners: Ok(corners) }).collect();
        if views.len() < MIN_PHOTOS {
            let failed = |(name, reason): (String, BoardReason)| BoardView { name, corners: Err(reason.into()) };
            views.extend(self.failures.into_iter().map(failed));
        }
        views
    }

    /// Searches the sharpest frame of the window that ends here.
    fn search_sharpest(&mut self) {
        let Some(frame) = self.sharpest.take() else { return };
        let plane = Plane { data: &frame.data, stride: frame.width, width: frame.width, height: frame.height };
        match checkerboard::find(&plane, self.board) {
            Ok(corners) => {
                let diagonal = (frame.width as f64).hypot(frame.height as f64);
                let new = self.views.iter().all(|(_, kept)| mean_move(kept, &corners) > MIN_MOVE * diagonal);
                if new && self.views.len() < MAX_VIEWS {
                    self.views.push((frame.name, corners));
                }
            }
            Err(reason) => self.failures.push((frame.name, reason)),
        }
        self.searches += 1;
        if self.searches.is_multiple_of(2 * TARGET_SEARCHES) {
            self.window = self.window.saturating_mul(2); // the recording is longer than stated
        }
    }
}

/// Mean distance of the corners of two views. The second view may be numbered from either end; the nearer numbering
/// counts.
fn mean_move(a: &[Pixel], b: &[Pixel]) -> f64 {
    let mean = |b: &mut dyn Iterator<Item = &Pixel>| {
        a.iter().zip(b).map(|(p, q)| (p.0 - q.0).norm()).sum::<f64>() / a.len().max(1) as f64
    };
    mean(&mut b.iter()).min(mean(&mut b.iter().rev()))
}

/// Mean square difference of pixels two apart, on every fourth row; it falls with blur in any direction.
fn sharpness(luma: &Plane<'_>) -> f64 {
    const STRIDE: usize = 4;
    let difference = |a: u8, b: u8| f64::from(i32::from(a) - i32::from(b)).powi(2);
    let rows = (0..luma.height.saturating_sub(2)).step_by(STRIDE);
    let sum: f64 = rows
        .map(|y| {
            let (row, below) = (luma.row(y), luma.row(y + 2));
            let across = row.iter().zip(row.iter().skip(2)).map(|(&a, &b)| difference(a, b)).sum::<f64>();
            across + row.iter().zip(below).map(|(&a, &b)| difference(a, b)).sum::<f64>()
        })
        .sum();
    sum / (luma.width * luma.height).max(1) as f64
}
