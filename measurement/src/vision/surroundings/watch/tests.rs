//! Laws of the watch, on drawn mats: cameras that move, and everything else that changes a picture.

use super::super::tests::{HEIGHT, Mat, STRAIGHT, Shot, WIDTH, shoot, with_frame};
use super::*;

const FOCAL_PX: f64 = 500.0;

/// Pixels of a cell.
const CELL_PX: f64 = 5.0;

/// Frames from one moment to the next: a little more than a second.
const FRAMES: u64 = 26;

/// Luma codes of one moment.
type Shown = Vec<u8>;

/// What the watch says of these moments. Displacements in cells.
fn watched<'p>(moments: impl IntoIterator<Item = &'p Shown>) -> Vec<ViewShift> {
    let mut watch = ViewWatch::new(FOCAL_PX);
    for (moment, luma) in (0..).zip(moments) {
        with_frame(luma, FRAMES * moment, |frame| watch.sample_frame(frame));
    }
    let in_cells = |shift: ViewShift| ViewShift { parts: shift.parts.map(|part| part * FOCAL_PX / CELL_PX), ..shift };
    watch.into_shifts().into_iter().map(in_cells).collect()
}

/// Two shots that differ in their noise.
fn shots(mat: &Mat, shot: Shot, paint: impl Fn(usize, usize, f64) -> f64) -> [Shown; 2] {
    [1, 2].map(|seed| shoot(mat, shot, seed, &paint))
}

/// Four moments before and four after.
fn before_and_after<'p>(before: &'p [Shown; 2], after: &'p [Shown; 2]) -> impl Iterator<Item = &'p Shown> {
    before.iter().cycle().take(4).chain(after.iter().cycle().take(4))
}

fn as_it_is(_: usize, _: usize, luma: f64) -> f64 {
    luma
}

fn length(shift: &ViewShift) -> f64 {
    shift.parts.iter().map(|part| part * part).sum::<f64>().sqrt()
}

#[test]
fn shifts_from_a_third_of_a_cell_to_thirty_cells_are_found() {
    let mat = Mat::new(11);
    let before = shots(&mat, STRAIGHT, as_it_is);
    for cells in [0.3, 1.0, 2.4, 7.7, 16.0, 30.0] {
        let expected = [0.8 * cells, -0.6 * cells];
        let shot = Shot { shift_px: expected.map(|of| of * CELL_PX), ..STRAIGHT };
        let shifts = watched(before_and_after(&before, &shots(&mat, shot, as_it_is)));
        assert_eq!(shifts.len(), 8, "{cells} cells: {shifts:?}");
        for shift in &shifts[..4] {
            assert!(length(shift) < 0.1, "at rest before {cells} cells: {shift:?}");
        }
        for shift in &shifts[4..] {
            let off = [0, 1].map(|axis| shift.parts[axis] - expected[axis]);
            assert!(off[0].hypot(off[1]) < 0.1 && shift.parts[2].hypot(shift.parts[3]) < 0.2, "{cells}: {shift:?}");
        }
    }
}

#[test]
fn a_turn_and_a_change_of_scale_are_found() {
    let mat = Mat::new(12);
    let turned = Shot { turn_deg: 2.0, zoom: 1.02, shift_px: [10.0, 5.0], ..STRAIGHT };
    let shots = [STRAIGHT, turned].map(|shot| shots(&mat, shot, as_it_is));
    let shifts = watched(before_and_after(&shots[0], &shots[1]));
    let radius = ((128.0 * 128.0 + 72.0 * 72.0) / 12.0_f64).sqrt();
    let expected = [2.0, 1.0, radius * 2.0_f64.to_radians(), radius * 0.02];
    let last = shifts.last().unwrap();
    assert!(last.time_s > 7.0, "{shifts:?}");
    for (part, expected) in last.parts.iter().zip(expected) {
        assert!((part - expected).abs() < 0.2, "{last:?}, expected {expected}");
    }
}

#[test]
fn a_hand_over_a_third_of_the_picture_is_no_movement() {
    let (mat, hand) = (Mat::new(13), Mat::new(14));
    let shown = [0.0, 35.0].map(|left_px| {
        let is_hand = |x: usize| x < WIDTH / 3;
        shots(&mat, STRAIGHT, |x, y, luma| if is_hand(x) { hand.luma(x as f64 - left_px, y as f64) } else { luma })
    });
    let shifts = watched(before_and_after(&shown[0], &shown[1]));
    assert_eq!(shifts.len(), 8);
    assert!(shifts.iter().all(|shift| length(shift) < 0.1), "{shifts:?}");
}

#[test]
fn half_the_light_is_no_movement() {
    let mat = Mat::new(15);
    let dim = Shot { gain: 0.5, offset: 5.0, ..STRAIGHT };
    let shown = [STRAIGHT, dim].map(|shot| shots(&mat, shot, as_it_is));
    let shifts = watched(before_and_after(&shown[0], &shown[1]));
    assert_eq!(shifts.len(), 8);
    assert!(shifts.iter().all(|shift| length(shift) < 0.1), "{shifts:?}");
}

#[test]
fn a_plain_mat_says_nothing() {
    let plain = shots(&Mat::new(16), STRAIGHT, |_, _, _| 90.0);
    assert_eq!(watched(before_and_after(&plain, &plain)), []);
}

#[test]
fn a_tool_alone_on_a_plain_mat_says_nothing() {
    let tool = Mat::new(17);
    let at = |left_px: usize| {
        let is_tool = move |x: usize, y: usize| (left_px..left_px + 220).contains(&x) && y > HEIGHT / 2;
        shots(
            &tool,
            Shot { shift_px: [left_px as f64, 0.0], ..STRAIGHT },
            move |x, y, luma| {
                if is_tool(x, y) { luma } else { 90.0 }
            },
        )
    };
    assert_eq!(watched(before_and_after(&at(40), &at(80))), []);
}

#[test]
fn a_shake_is_over_when_the_view_is_back() {
    let mat = Mat::new(18);
    let shaken = Shot { shift_px: [0.0, 25.0], ..STRAIGHT };
    let [rest, shaken] = [STRAIGHT, shaken].map(|shot| shots(&mat, shot, as_it_is));
    let shifts = watched(rest.iter().chain(&rest).chain(&shaken[..1]).chain(&rest));
    let lengths: Vec<f64> = shifts.iter().map(length).collect();
    assert!((lengths[4] - 5.0).abs() < 0.1, "{lengths:?}");
    assert!(lengths[..4].iter().chain(&lengths[5..]).all(|length| *length < 0.1) && lengths.len() == 7, "{lengths:?}");
}

#[test]
fn a_board_that_is_pushed_before_still_walls_is_no_movement() {
    let (mat, walls) = (Mat::new(19), Mat::new(20));
    let pushed = |right_px: f64| {
        let is_board = |x: usize, y: usize| x.abs_diff(WIDTH / 2) < 250 && y.abs_diff(HEIGHT / 2) < 140;
        let paint = |x: usize, y: usize, wall: f64| {
            if is_board(x, y) { mat.luma(x as f64 - right_px, y as f64) } else { wall }
        };
        shots(&walls, STRAIGHT, paint)
    };
    let shifts = watched(before_and_after(&pushed(0.0), &pushed(30.0)));
    assert!(shifts.len() >= 4 && shifts.iter().all(|shift| length(shift) < 0.1), "{shifts:?}");
}

#[test]
fn a_recording_that_begins_with_something_else_is_watched_from_its_box_on() {
    let [lens_cap, mat] = [Mat::new(21), Mat::new(22)];
    let moved = Shot { shift_px: [20.0, 0.0], ..STRAIGHT };
    let [first, rest] = [&lens_cap, &mat].map(|mat| shots(mat, STRAIGHT, as_it_is));
    let moved = shots(&mat, moved, as_it_is);
    let shifts = watched(first.iter().chain(rest.iter().cycle().take(30)).chain(&moved));
    assert!(shifts[0].time_s > 20.0 && length(&shifts[0]) < 0.1, "{shifts:?}");
    assert!((length(shifts.last().unwrap()) - 4.0).abs() < 0.1, "{shifts:?}");
}

#[test]
fn a_moved_peg_is_learned_again_and_the_rest_keeps_its_first_look() {
    let mat = Mat::new(23);
    let with_peg = |left: usize| {
        let paint = move |x: usize, y: usize, luma: f64| {
            let is_peg = x.abs_diff(left) < 50 && y.abs_diff(HEIGHT / 2) < 50;
            if is_peg { 40.0 + (x / 9 % 2 + y / 9 % 2) as f64 * 60.0 } else { luma }
        };
        shots(&mat, STRAIGHT, paint)
    };
    let [left, right] = [200, 440].map(with_peg);
    let mut watch = ViewWatch::new(FOCAL_PX);
    let known = |watch: &ViewWatch| watch.view.known().count();
    let mut counts = Vec::new();
    for (moment, luma) in (0..).zip(left.iter().cycle().take(4).chain(right.iter().cycle().take(14))) {
        with_frame(luma, FRAMES * moment, |frame| watch.sample_frame(frame));
        counts.push((known(&watch), watch.view.places.iter().filter(|place| place.misses > 0).count()));
    }
    assert!(counts[5].1 > 5, "patches are missed where the peg was and is: {counts:?}");
    assert_eq!(counts[17].1, 0, "all are learned again: {counts:?}");
    assert!(counts[17].0 > 100, "{counts:?}");
}

#[test]
fn a_view_that_lasted_stays_the_first_one_if_another_mat_follows() {
    let [first, other] = [24, 25].map(|seed| shots(&Mat::new(seed), STRAIGHT, as_it_is));
    for (still, later) in [(30, 30), (10, 40)] {
        let shifts = watched(first.iter().cycle().take(still).chain(other.iter().cycle().take(later)));
        assert_eq!(shifts.len(), still, "the other mat is unknown: {shifts:?}");
        assert!(shifts.iter().all(|shift| length(shift) < 0.1), "{shifts:?}");
    }
}

#[test]
fn a_moved_view_does_not_become_the_first_one_where_hardly_enough_patches_are_known() {
    // 13 pegs, each in the middle of a patch.
    let with_pegs = |right_px: usize| {
        let paint = move |x: usize, y: usize, _: f64| {
            let place = |px: usize| ((px + 20) / 40, (px + 20) % 40);
            let [(column, across), (row, down)] = [x.saturating_sub(right_px), y].map(place);
            let is_in_middle = [across, down].iter().all(|at| (10..30).contains(at));
            let is_patch = (1..=15).contains(&column) && (1..=8).contains(&row);
            if is_in_middle && is_patch && (15 * row + column) % 9 == 2 { 190.0 } else { 90.0 }
        };
        shots(&Mat::new(26), STRAIGHT, paint)
    };
    let [rest, moved] = [0, 10].map(with_pegs);
    let [now, later] = [&rest, &moved].map(|shown| with_frame(&shown[0], 0, LumaCells::of).unwrap());
    let mut watch = ViewWatch::new(FOCAL_PX);
    for (moment, luma) in (0..6).zip(rest.iter().cycle()) {
        with_frame(luma, FRAMES * moment, |frame| watch.sample_frame(frame));
    }
    assert_eq!((watch.view.known().count(), watch.shifts.len()), (13, 6));
    for place in watch.view.places.iter_mut().filter(|place| place.is_known).take(2) {
        (place.patch, place.misses) = (Patch::learn(&later, place.corner), MAX_MISSES - 1);
    }
    watch.view.learn(&now);
    assert_eq!(watch.view.known().count(), MIN_PATCHES, "one of the two is learned again, the other waits");
    for (moment, luma) in (6..30).zip(moved.iter().cycle()) {
        with_frame(luma, FRAMES * moment, |frame| watch.sample_frame(frame));
    }
    assert_eq!(watch.shifts.len(), 6, "{:?}", watch.shifts);
}
