use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};

use super::*;
use crate::vision::camera::Camera;
use crate::vision::space::CameraPoint;

const WIDTH: usize = 480;
const HEIGHT: usize = 360;

/// A photo to draw.
struct DrawnPhoto {
    camera: Camera,
    pose: Isometry3<f64>,
    board: Board,
    /// Passes of a binomial filter; each adds 1 px² to the blur's variance.
    blur: usize,
    /// Share of a blurred copy that is subtracted, as in a camera's sharpening.
    sharpen: f32,
    /// Darkest place of the picture, as a share of the brightest.
    darkest: f64,
    /// Exponent of the tone curve: 1 is linear, 1/2.2 is usual for cameras.
    gamma: f32,
    noise: f32,
}

impl DrawnPhoto {
    fn new(pose: Isometry3<f64>) -> Self {
        let camera = Camera {
            width: WIDTH as u32,
            height: HEIGHT as u32,
            fx: 420.0,
            fy: 418.0,
            cx: 236.0,
            cy: 183.0,
            k1: -0.28,
            k2: 0.08,
            p1: 0.0005,
            p2: -0.0004,
            k3: 0.0,
            focal_sigma: 0.0,
        };
        let board = Board::new(9, 6, 21.0).unwrap();
        Self { camera, pose, board, blur: 1, sharpen: 0.0, darkest: 0.6, gamma: 1.0 / 2.2, noise: 1.5 }
    }

    /// The light from a direction: a board with a white margin of one square on a grey wall.
    fn light(&self, pixel: Pixel) -> f64 {
        let to_board = self.pose.inverse();
        let Some(ray) = self.camera.normalised_of(pixel).map(|n| to_board.rotation * n.ray()) else { return 0.2 };
        let from = to_board.translation.vector;
        let at = from - ray * (from.z / ray.z);
        let square = |x: f64, corners: usize| x / self.board.square_mm() + (corners as f64 + 1.0) / 2.0;
        let (column, row) = (square(at.x, self.board.columns()), square(at.y, self.board.rows()));
        let inside = |x: f64, corners: usize, margin: f64| x > -margin && x < corners as f64 + 1.0 + margin;
        let on = |margin: f64| inside(column, self.board.columns(), margin) && inside(row, self.board.rows(), margin);
        let dark = (column.floor() + row.floor()).rem_euclid(2.0) == 0.0;
        match (on(0.0), on(1.0)) {
            (true, _) if dark => 0.05,
            (_, true) => 0.85,
            _ => 0.2,
        }
    }

    fn draw(&self) -> Vec<u8> {
        const SAMPLES: u32 = 16;
        let mut data = Vec::with_capacity(WIDTH * HEIGHT);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                // Hammersley points: no two samples share a row or column, so slanted and upright edges look alike.
                let offset = |i: u32| (f64::from(i) + 0.5) / f64::from(SAMPLES) - 0.5;
                let sample = |i: u32| Pixel::new(x as f64 + offset(i), y as f64 + offset(i.reverse_bits() >> 28));
                let light = (0..SAMPLES).map(|i| self.light(sample(i))).sum::<f64>() / f64::from(SAMPLES);
                let across = x as f64 / WIDTH as f64;
                data.push((light * (self.darkest + (1.0 - self.darkest) * across)) as f32);
            }
        }
        let mut picture = Grey { data, width: WIDTH, height: HEIGHT };
        for _ in 0..self.blur {
            picture = picture.binomial();
        }
        let soft = picture.binomial().binomial();
        let mut random = SmallRng::seed_from_u64(11);
        let code = |(&value, &soft): (&f32, &f32)| {
            let sharp = (value + self.sharpen * (value - soft)).max(0.0).powf(self.gamma);
            let noise = self.noise * (random.random::<f32>() - 0.5) * 12.0_f32.sqrt();
            (sharp * 255.0 + noise).round().clamp(0.0, 255.0) as u8
        };
        picture.data.iter().zip(&soft.data).map(code).collect()
    }

    fn truth(&self) -> Vec<Pixel> {
        let seen = |x: f64, y: f64| self.camera.project(CameraPoint(self.pose * Point3::new(x, y, 0.0))).unwrap();
        self.board.points_mm().iter().map(|p| seen(p.x, p.y)).collect()
    }

    fn find(&self) -> Result<Vec<Pixel>, BoardReason> {
        find(&plane(&self.draw()), self.board)
    }

    /// Distances of the corners found from the true ones, in the better of the two equivalent orders.
    fn misses(&self) -> Vec<f64> {
        let found = self.find().unwrap_or_else(|reason| panic!("{reason}"));
        let misses = |found: Vec<Pixel>| -> Vec<f64> {
            found.iter().zip(self.truth()).map(|(a, b)| (a.0 - b.0).norm()).collect()
        };
        let (one, other) = (misses(found.clone()), misses(found.into_iter().rev().collect()));
        if rms(&one) < rms(&other) { one } else { other }
    }
}

fn plane(data: &[u8]) -> Plane<'_> {
    Plane { data, stride: WIDTH, width: WIDTH, height: HEIGHT }
}

fn rms(misses: &[f64]) -> f64 {
    (misses.iter().map(|m| m * m).sum::<f64>() / misses.len() as f64).sqrt()
}

fn worst(misses: &[f64]) -> f64 {
    misses.iter().copied().fold(0.0, f64::max)
}

/// A board in front of the camera: spun in its plane, then leaning about an axis in it, degrees.
fn pose(spin: f64, lean: f64, about: f64, at: (f64, f64, f64)) -> Isometry3<f64> {
    let [spin, lean, about] = [spin, lean, about].map(f64::to_radians);
    let spin = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spin);
    let lean = UnitQuaternion::from_scaled_axis(Vector3::new(about.cos(), about.sin(), 0.0) * lean);
    Isometry3::from_parts(Translation3::new(at.0, at.1, at.2), lean * spin)
}

#[test]
fn corners_are_found_at_any_rotation_to_a_tenth_of_a_pixel() {
    for step in 0..12 {
        let spin = 30.0 * f64::from(step) + 7.0;
        let shot = DrawnPhoto::new(pose(spin, 25.0, 3.0 * spin, (10.0, -5.0, 330.0)));
        let misses = shot.misses();
        assert!(worst(&misses) < 0.15 && rms(&misses) < 0.06, "spin {spin}: {} {}", worst(&misses), rms(&misses));
    }
}

#[test]
fn upright_boards_are_no_harder_than_slanted_ones() {
    let misses = DrawnPhoto::new(pose(0.0, 0.0, 0.0, (3.0, 2.0, 320.0))).misses();
    assert!(worst(&misses) < 0.15 && rms(&misses) < 0.06, "{} {}", worst(&misses), rms(&misses));
}

#[test]
fn blur_sharpening_and_tone_curve_do_not_shift_corners() {
    for (blur, sharpen, gamma, darkest) in
        [(0, 0.0, 1.0, 1.0), (0, 0.8, 0.45, 0.5), (4, 0.0, 0.45, 0.3), (9, 0.0, 0.45, 0.5), (9, 1.0, 1.0, 0.5)]
    {
        let straight = DrawnPhoto::new(pose(15.0, 30.0, 40.0, (0.0, 0.0, 320.0)));
        let shot = DrawnPhoto { blur, sharpen, gamma, darkest, ..straight };
        let misses = shot.misses();
        assert!(rms(&misses) < 0.1, "blur {blur}, sharpen {sharpen}, gamma {gamma}: {}", rms(&misses));
    }
}

#[test]
fn a_steeply_tilted_board_is_found() {
    for about in [0.0, 45.0, 90.0, 200.0] {
        let misses = DrawnPhoto::new(pose(20.0, 55.0, about, (0.0, 0.0, 330.0))).misses();
        assert!(worst(&misses) < 0.3 && rms(&misses) < 0.1, "about {about}: {} {}", worst(&misses), rms(&misses));
    }
}

#[test]
fn a_small_board_far_away_is_found() {
    let misses = DrawnPhoto::new(pose(33.0, 20.0, 70.0, (50.0, 40.0, 850.0))).misses(); // squares of 10 px
    assert!(worst(&misses) < 0.3 && rms(&misses) < 0.12, "{} {}", worst(&misses), rms(&misses));
}

#[test]
fn a_board_partly_outside_is_incomplete() {
    for at in [(130.0, 0.0, 300.0), (0.0, -110.0, 300.0), (-120.0, 90.0, 300.0)] {
        let reason = DrawnPhoto::new(pose(10.0, 10.0, 0.0, at)).find();
        let Err(BoardReason::Incomplete { may_be_whole: false, .. }) = reason else { panic!("{at:?}: {reason:?}") };
    }
}

/// Paints a spot of one brightness over a place of a picture.
fn cover(data: &mut [u8], at: Pixel, radius: f64, code: u8) {
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            if (at.u() - x as f64).hypot(at.v() - y as f64) < radius {
                data[y * WIDTH + x] = code;
            }
        }
    }
}

#[test]
fn a_hidden_corner_is_not_guessed_but_named_by_its_place_in_the_picture() {
    // The board's corner in column 5 of row 3, as it lies in the picture after each quarter turn.
    for (spin, place) in [(10.0, (3, 5)), (100.0, (5, 4)), (190.0, (4, 5)), (280.0, (5, 3))] {
        let shot = DrawnPhoto::new(pose(spin, 20.0, 30.0, (0.0, 0.0, 320.0)));
        for code in [120, 255] {
            let mut data = shot.draw();
            let hidden = shot.truth()[2 * 9 + 4];
            cover(&mut data, hidden, 10.0, code);
            let missed = find_or_partial(&plane(&data), shot.board).unwrap_err();
            let BoardReason::Hidden(corners) = missed.reason else { panic!("spin {spin}: {:?}", missed.reason) };
            assert_eq!((corners.count, corners.of, corners.named()), (1, 54, &[place][..]), "spin {spin}");
            assert_eq!((missed.seen.len(), missed.missing.len()), (53, 1));
            let off = (missed.missing[0].0 - hidden.0).norm();
            assert!(off < 2.0, "spin {spin}: marked {off} px beside it");
        }
    }
}

#[test]
fn a_highlight_over_several_corners_does_not_hide_the_boards_size() {
    let shot = DrawnPhoto {
        board: Board::new(8, 6, 21.0).unwrap(),
        ..DrawnPhoto::new(pose(8.0, 15.0, 60.0, (0.0, 0.0, 320.0)))
    };
    let mut data = shot.draw();
    cover(&mut data, shot.truth()[8 + 2], 30.0, 255);
    let reason = find(&plane(&data), shot.board).unwrap_err();
    let BoardReason::Hidden(corners) = reason else { panic!("{reason:?}") };
    assert!(corners.count > 1 && corners.named().contains(&(2, 3)), "{corners:?}");
    assert!(!reason.to_string().contains("8x6"), "{reason}");
}

#[test]
fn a_washed_out_board_gives_a_reason_and_no_corners() {
    for blur in [30, 60, 150] {
        let shot = DrawnPhoto { blur, ..DrawnPhoto::new(pose(10.0, 20.0, 30.0, (0.0, 0.0, 400.0))) };
        assert!(shot.find().is_err(), "blur {blur}: corners");
    }
    let shot = DrawnPhoto { blur: 30, noise: 0.5, ..DrawnPhoto::new(pose(10.0, 20.0, 30.0, (0.0, 0.0, 400.0))) };
    assert!(matches!(shot.find(), Err(BoardReason::Blurred { .. })), "{:?}", shot.find());
}

#[test]
fn a_board_of_another_size_is_reported_with_its_size() {
    let mut shot = DrawnPhoto::new(pose(10.0, 20.0, 30.0, (0.0, 0.0, 320.0)));
    let data = shot.draw();
    for (columns, rows) in [(8, 6), (9, 5), (6, 4), (5, 6), (7, 5)] {
        shot.board = Board::new(columns, rows, 21.0).unwrap();
        let Err(BoardReason::OtherBoard { columns: c, rows: r }) = find(&plane(&data), shot.board) else {
            panic!("{columns}x{rows}: {:?}", find(&plane(&data), shot.board))
        };
        assert_eq!((c.max(r), c.min(r)), (9, 6), "asked for {columns}x{rows}");
    }
    for (columns, rows) in [(10, 6), (9, 7), (14, 10)] {
        let reason = find(&plane(&data), Board::new(columns, rows, 21.0).unwrap());
        let whole = BoardReason::Incomplete { columns: 9, rows: 6, is_regular: true, may_be_whole: true };
        assert_eq!(reason, Err(whole), "asked for {columns}x{rows}");
    }
}

#[test]
fn a_quarter_turn_of_the_count_finds_the_same_corners() {
    let shot = DrawnPhoto::new(pose(10.0, 20.0, 30.0, (0.0, 0.0, 320.0)));
    let data = shot.draw();
    let upright = find(&plane(&data), shot.board).unwrap();
    let turned = find(&plane(&data), Board::new(6, 9, 21.0).unwrap()).unwrap();
    assert_eq!(turned.len(), upright.len());
    assert!(turned.iter().all(|p| upright.contains(p)));
    let face = |c: &[Pixel], columns: usize| (c[1].0 - c[0].0).perp(&(c[columns].0 - c[0].0));
    assert!(face(&upright, 9) > 0.0 && face(&turned, 6) > 0.0, "the board is seen from its face");
}

#[test]
fn noise_and_stripes_hold_no_board() {
    let mut random = SmallRng::seed_from_u64(5);
    let board = Board::new(4, 3, 21.0).unwrap();
    let noise: Vec<u8> = (0..WIDTH * HEIGHT).map(|_| random.random()).collect();
    assert!(find(&plane(&noise), board).is_err());
    let stripes: Vec<u8> =
        (0..WIDTH * HEIGHT).map(|i| if ((i % WIDTH) / 12).is_multiple_of(2) { 20 } else { 220 }).collect();
    assert_eq!(find(&plane(&stripes), board), Err(BoardReason::NoBoard));
    assert_eq!(find(&plane(&vec![128; WIDTH * HEIGHT]), board), Err(BoardReason::NoBoard));
}

#[test]
fn pictures_too_small_to_search_are_refused_without_a_panic() {
    let board = Board::new(9, 6, 21.0).unwrap();
    for (width, height) in [(0, 0), (1, 1), (2, 500), (500, 2), (23, 23), (24, 24), (33, 25)] {
        let data = vec![90; width * height];
        assert_eq!(find(&Plane { data: &data, stride: width, width, height }, board), Err(BoardReason::NoBoard));
    }
}
