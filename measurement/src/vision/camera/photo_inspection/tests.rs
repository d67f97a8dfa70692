use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

use super::*;
use crate::vision::camera::testing::wide;
use crate::vision::space::CameraPoint;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;

fn board() -> Board {
    Board::new(9, 6, 21.0).unwrap()
}

/// A board that faces the camera: its first square's corner, its squares' side, and the codes of dark and bright.
struct Drawn {
    left: i64,
    top: i64,
    square: i64,
    codes: [u8; 2],
}

impl Drawn {
    fn at(left: i64, top: i64, square: i64) -> Self {
        Self { left, top, square, codes: [30, 210] }
    }

    fn glance(&self, soft: usize) -> PhotoInspection {
        self.inspect_for(board(), soft, None)
    }

    /// The check for a stated board, with a white spot over a place of the picture.
    fn inspect_for(&self, stated: Board, soft: usize, spot: Option<[i64; 2]>) -> PhotoInspection {
        let [dark, bright] = self.codes;
        let code = |x: i64, y: i64| {
            let (column, row) = ((x - self.left).div_euclid(self.square), (y - self.top).div_euclid(self.square));
            let on_board = (0..10).contains(&column) && (0..7).contains(&row);
            let is_spot =
                spot.is_some_and(|[left, top]| (x - left).abs() < self.square / 2 && (y - top).abs() < self.square / 2);
            if on_board && !is_spot && (column + row) % 2 == 0 { dark } else { bright }
        };
        let mean = |x: i64, y: i64| {
            let reach = soft as i64;
            let around = || (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
            let sum: u32 = around().map(|(dx, dy)| u32::from(code(x + dx, y + dy))).sum();
            (sum / around().count() as u32) as u8
        };
        let data: Vec<u8> =
            (0..HEIGHT as i64).flat_map(|y| (0..WIDTH as i64).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
        inspect_photo(&Plane { data: &data, stride: WIDTH, width: WIDTH, height: HEIGHT }, stated)
    }
}

#[test]
fn a_whole_board_has_all_its_corners_and_fills_their_cells() {
    let seen = Drawn::at(120, 100, 40).glance(1);
    assert_eq!((seen.reason, seen.corners.len(), &seen.hints[..], seen.near), (None, 54, &[][..], None));
    assert_eq!(seen.coverage.corners.iter().sum::<usize>(), 54);
    assert_eq!(seen.coverage.corners[0], 0, "nothing at the picture's corner");
}

#[test]
fn a_board_that_leaves_the_picture_is_reported_with_the_side() {
    for (drawn, edges) in [
        (Drawn::at(-80, 100, 40), vec![PictureSide::Left]),
        (Drawn::at(330, 100, 40), vec![PictureSide::Right]),
        (Drawn::at(120, -90, 40), vec![PictureSide::Top]),
        (Drawn::at(330, 290, 40), vec![PictureSide::Right, PictureSide::Bottom]),
    ] {
        let seen = drawn.glance(1);
        assert!(matches!(seen.reason, Some(BoardReason::Incomplete { .. })), "{:?}", seen.reason);
        assert!(!seen.corners.is_empty(), "what is there is shown");
        assert_eq!(seen.hints, edges.into_iter().map(Hint::CutOff).collect::<Vec<_>>());
    }
}

#[test]
fn squares_that_were_counted_for_inner_corners_are_named_as_the_cause() {
    for (columns, rows) in [(10, 7), (7, 10), (10, 6), (8, 5)] {
        let seen = Drawn::at(120, 100, 40).inspect_for(Board::new(columns, rows, 21.0).unwrap(), 1, None);
        assert_eq!(seen.hints, [Hint::Count], "{columns}x{rows}: {:?}", seen.reason);
    }
}

#[test]
fn a_corner_under_a_highlight_is_marked_at_its_place() {
    let seen = Drawn::at(120, 100, 40).inspect_for(board(), 1, Some([120 + 3 * 40, 100 + 2 * 40]));
    let Some(BoardReason::Hidden(hidden)) = seen.reason else { panic!("{:?}", seen.reason) };
    assert_eq!((hidden.named(), seen.corners.len(), seen.missing.len()), (&[(2, 3)][..], 53, 1));
    let off = (seen.missing[0].0 - Point2::new(239.5, 179.5)).norm();
    assert!(off < 1.0, "{off}");
    assert_eq!(seen.hints, [], "nothing else is wrong");
}

#[test]
fn no_light_and_nothing_sharp_are_named_as_the_cause() {
    let black = Drawn { codes: [2, 3], ..Drawn::at(120, 100, 40) }.glance(0);
    assert_eq!((black.reason, black.hints), (Some(BoardReason::NoBoard), vec![Hint::Dark]));
    let blurred = Drawn::at(200, 150, 20).glance(12);
    assert!(matches!(blurred.reason, Some(BoardReason::Blurred { .. })), "{:?}", blurred.reason);
    assert_eq!(blurred.hints, [Hint::Soft]);
    let soft = Drawn::at(200, 150, 20).glance(24);
    assert_eq!((soft.reason, soft.hints), (Some(BoardReason::NoBoard), vec![Hint::Soft]));
    let burnt = Drawn { codes: [255, 255], ..Drawn::at(120, 100, 40) }.glance(0);
    assert!(burnt.hints.contains(&Hint::Glare), "{:?}", burnt.hints);
    let elsewhere = Drawn::at(2000, 2000, 40).glance(0);
    assert!(!elsewhere.hints.contains(&Hint::Dark), "an empty bright picture is not dark: {:?}", elsewhere.hints);
}

/// The corners of a board that leans by `degrees` about an axis, as seen by a lens with strong distortion.
fn seen_leaning(degrees: f64, about: [f64; 2], spin: f64, at: [f64; 3]) -> Vec<Pixel> {
    let axis = nalgebra::Vector3::new(about[0], about[1], 0.0);
    let lean = UnitQuaternion::from_scaled_axis(axis * degrees.to_radians());
    let spin = UnitQuaternion::from_scaled_axis(nalgebra::Vector3::z() * spin.to_radians());
    let pose = Isometry3::from_parts(Translation3::new(at[0], at[1], at[2]), lean * spin);
    let see = |p: &Point2<f64>| wide().project(CameraPoint(pose * Point3::new(p.x, p.y, 0.0))).unwrap();
    board().points_mm().iter().map(see).collect()
}

#[test]
fn the_nearer_side_is_found_under_distortion_anywhere_in_the_picture_at_any_rotation() {
    let size = Vector2::new(1280.0, 720.0);
    for spin in [0.0, 90.0, 180.0, 200.0] {
        for at in [[0.0, 0.0, 300.0], [70.0, 20.0, 320.0], [-60.0, -30.0, 340.0]] {
            let near = |degrees, about| near_side(&seen_leaning(degrees, about, spin, at), board(), size);
            assert_eq!(near(20.0, [1.0, 0.0]), Some(PictureSide::Top), "spin {spin}, at {at:?}");
            assert_eq!(near(-20.0, [1.0, 0.0]), Some(PictureSide::Bottom), "spin {spin}, at {at:?}");
            assert_eq!(near(20.0, [0.0, 1.0]), Some(PictureSide::Right), "spin {spin}, at {at:?}");
            assert_eq!(near(-20.0, [0.0, 1.0]), Some(PictureSide::Left), "spin {spin}, at {at:?}");
            assert_eq!(near(0.0, [0.0, 1.0]), None, "spin {spin}, at {at:?}");
        }
    }
}
