//! Laws of the comparison, on drawn boxes: mats of soft noise, seen by a camera that is moved, in other light.

use super::*;
use crate::random::Dice;
use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};

pub(super) const WIDTH: usize = 640;
pub(super) const HEIGHT: usize = 360;

/// A mat: luma at any place, in pixels.
pub(super) struct Mat {
    waves: Vec<[f64; 4]>,
}

/// How the camera shows the mat.
#[derive(Clone, Copy)]
pub(super) struct Shot {
    pub(super) shift_px: [f64; 2],
    pub(super) turn_deg: f64,
    pub(super) zoom: f64,
    /// Luma codes are multiplied by this and raised by the next.
    pub(super) gain: f64,
    pub(super) offset: f64,
    /// Largest noise of a pixel, codes.
    pub(super) noise: f64,
}

pub(super) const STRAIGHT: Shot =
    Shot { shift_px: [0.0; 2], turn_deg: 0.0, zoom: 1.0, gain: 1.0, offset: 0.0, noise: 4.0 };

impl Mat {
    /// A mat with structures of 20 to 120 pixels.
    pub(super) fn new(seed: u64) -> Self {
        let mut dice = Dice::new(seed, "mat");
        let wave = |_| {
            let (length, angle) = (dice.within(20.0, 120.0), dice.within(0.0, std::f64::consts::TAU));
            let turns = std::f64::consts::TAU / length;
            [turns * angle.cos(), turns * angle.sin(), dice.within(0.0, std::f64::consts::TAU), dice.within(4.0, 14.0)]
        };
        Self { waves: (0..12).map(wave).collect() }
    }

    pub(super) fn luma(&self, x: f64, y: f64) -> f64 {
        120.0 + self.waves.iter().map(|[a, b, phase, height]| height * (a * x + b * y + phase).sin()).sum::<f64>()
    }
}

/// Draws a picture; `paint` changes the luma of a pixel.
pub(super) fn shoot(mat: &Mat, shot: Shot, seed: u64, paint: impl Fn(usize, usize, f64) -> f64) -> Vec<u8> {
    let mut dice = Dice::new(seed, "noise");
    let (sin, cos) = shot.turn_deg.to_radians().sin_cos();
    let pixel = |index: usize| {
        let (column, row) = (index % WIDTH, index / WIDTH);
        let x = column as f64 - WIDTH as f64 / 2.0 - shot.shift_px[0];
        let y = row as f64 - HEIGHT as f64 / 2.0 - shot.shift_px[1];
        let luma = mat.luma((cos * x + sin * y) / shot.zoom, (cos * y - sin * x) / shot.zoom);
        let seen = shot.gain * paint(column, row, luma) + shot.offset + dice.within(-shot.noise, shot.noise);
        seen.round().clamp(0.0, 255.0) as u8
    };
    (0..WIDTH * HEIGHT).map(pixel).collect()
}

pub(super) fn with_frame<T>(luma: &[u8], index: u64, see: impl FnOnce(&Frame<'_>) -> T) -> T {
    let y = Plane { data: luma, stride: WIDTH, width: WIDTH, height: HEIGHT };
    let encoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
    let chroma_first_px = [0.0; 2];
    see(&Frame { index, time_s: index as f64 * 0.04, y, u: y, v: y, shift_x: 0, shift_y: 0, chroma_first_px, encoding })
}

/// The surroundings of a few frames of a still box.
fn seen(mat: &Mat, shot: Shot) -> Surroundings {
    let mut sampler = SurroundingsSampler::default();
    for index in 0..3 {
        with_frame(&shoot(mat, shot, index, |_, _, luma| luma), index, |frame| sampler.sample_frame(frame));
    }
    sampler.surroundings().unwrap()
}

#[test]
fn a_tool_that_moves_is_not_in_the_picture() {
    let mat = Mat::new(1);
    let mut sampler = SurroundingsSampler::default();
    for index in 0..40 {
        let left = 15 * index as usize;
        let tool = |x: usize, _: usize, luma: f64| if (left..left + 60).contains(&x) { 10.0 } else { luma };
        with_frame(&shoot(&mat, STRAIGHT, index, tool), index, |frame| sampler.sample_frame(frame));
    }
    let (own, shown) = (seen(&mat, STRAIGHT), sampler.surroundings().unwrap());
    let largest = own.luma.iter().zip(&shown.luma).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(largest <= Some(3), "{largest:?} codes");
}

#[test]
fn other_light_and_moved_tools_leave_the_surroundings_alike() {
    let mat = Mat::new(2);
    let dim = Shot { gain: 0.6, offset: 25.0, noise: 8.0, ..STRAIGHT };
    let tool = |x: usize, y: usize, luma: f64| if x.abs_diff(2 * y) < 50 { 30.0 } else { luma };
    let mut sampler = SurroundingsSampler::default();
    with_frame(&shoot(&mat, dim, 0, tool), 0, |frame| sampler.sample_frame(frame));
    let found = seen(&mat, STRAIGHT).compare(&sampler.surroundings().unwrap()).unwrap();
    assert!(found.correlation > 0.7 && found.shift < 0.005, "{found:?}");
    assert!(found.structured > 0.9, "{found:?}");
}

#[test]
fn a_nudged_camera_is_found_with_its_shift() {
    let mat = Mat::new(3);
    for (shift_px, turn_deg, zoom) in [([32.0, -12.0], 3.0, 1.04), ([-20.0, 25.0], -4.0, 0.95), ([0.0, 40.0], 1.0, 1.0)]
    {
        let nudged = Shot { shift_px, turn_deg, zoom, gain: 0.8, ..STRAIGHT };
        let found = seen(&mat, STRAIGHT).compare(&seen(&mat, nudged)).unwrap();
        let expected = shift_px[0].hypot(shift_px[1]) / WIDTH as f64;
        assert!(found.correlation > 0.7, "{found:?}");
        assert!((found.shift - expected).abs() < 0.005, "{found:?}, expected {expected}");
        assert!((f64::from(found.alignment.turn_deg) - turn_deg).abs() < 0.6, "{found:?}");
    }
}

#[test]
fn another_mat_correlates_as_little_as_a_mirrored_picture() {
    let own = seen(&Mat::new(4), STRAIGHT);
    for seed in 5..8 {
        let found = own.compare(&seen(&Mat::new(seed), STRAIGHT)).unwrap();
        let chance = found.chance.unwrap();
        assert!(found.correlation < 0.45 && (found.correlation - chance).abs() < 0.15, "{found:?}");
        assert!(found.structured > 0.9, "there is much that differs: {found:?}");
    }
}

#[test]
fn a_symmetric_board_fits_its_mirror_image_as_well() {
    let holes = |x: usize, y: usize, _: f64| if x % 32 < 9 && y % 32 < 9 { 20.0 } else { 150.0 };
    let picture = |shift: usize| {
        let mut sampler = SurroundingsSampler::default();
        let board = |x: usize, y: usize, luma: f64| holes(x + shift, y + shift, luma);
        let blurred = Shot { noise: 25.0, gain: 0.2, offset: 100.0, ..STRAIGHT };
        with_frame(&shoot(&Mat::new(1), blurred, shift as u64, board), 0, |frame| sampler.sample_frame(frame));
        sampler.surroundings().unwrap()
    };
    let found = picture(0).compare(&picture(11)).unwrap();
    assert!(found.chance.is_none_or(|chance| found.correlation < chance + 0.1), "{found:?}");
}

#[test]
fn a_plain_mat_has_no_structure() {
    let plain = |_: usize, _: usize, _: f64| 90.0;
    let picture = |seed: u64| {
        let mut sampler = SurroundingsSampler::default();
        with_frame(&shoot(&Mat::new(1), STRAIGHT, seed, plain), 0, |frame| sampler.sample_frame(frame));
        sampler.surroundings().unwrap()
    };
    let found = picture(1).compare(&picture(2)).unwrap();
    assert!(found.structured < 0.01 && found.correlation < 0.45, "{found:?}");
}

#[test]
fn a_long_recording_keeps_few_pictures_and_its_last_frames_count() {
    let (dark, light) = (vec![40_u8; WIDTH * HEIGHT], vec![200_u8; WIDTH * HEIGHT]);
    let mut sampler = SurroundingsSampler::default();
    for index in 0..1000 {
        let luma = if index < 400 { &dark } else { &light };
        with_frame(luma, index, |frame| sampler.sample_frame(frame));
    }
    assert!(sampler.pictures() < 32, "{}", sampler.pictures());
    assert!(sampler.surroundings().unwrap().luma.iter().all(|code| *code == 200), "the later 600 of 1000 frames");
}

#[test]
fn pictures_of_another_shape_are_not_compared_and_forged_ones_are_refused() {
    let own = seen(&Mat::new(1), STRAIGHT);
    assert_eq!(own.shape(), (128, 72));
    let square = Surroundings::new(96, 96, vec![7; 96 * 96]).unwrap();
    assert_eq!(own.compare(&square), None);
    assert_eq!(Surroundings::from_bytes(&own.to_bytes()), Some(own.clone()));
    assert_eq!(Surroundings::from_bytes(&own.to_bytes()[1..]), None);
    assert!(!Surroundings { columns: 200, ..own.clone() }.is_possible());
    assert!(!Surroundings { luma: vec![1; 9], ..own }.is_possible());
}

#[test]
fn the_picture_that_resembles_most_speaks_for_a_box_with_several_mats() {
    let (own, other) = (seen(&Mat::new(1), STRAIGHT), seen(&Mat::new(2), STRAIGHT));
    let now = seen(&Mat::new(2), Shot { gain: 0.9, ..STRAIGHT });
    assert!(best_resemblance(std::slice::from_ref(&own), &now).unwrap().correlation < 0.45);
    assert!(best_resemblance(&[own, other], &now).unwrap().correlation > 0.8);
    assert_eq!(best_resemblance(&[], &now), None);
}
