//! Borders drawn exactly, found again.

use super::*;
use crate::pipeline::edges::edge_curves::inside_share;
use crate::pipeline::edges::probe::Shading;
use crate::pipeline::frame::{ColourEncoding, Matrix, Plane, Range};
use crate::pipeline::space::Pixel;

const ENCODING: ColourEncoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
const SIZE: usize = 64;
const TAPE: [f64; 3] = [150.0, 70.0, 190.0];

/// A straight border at `edge` pixels along `normal` from the middle, tape on the near side; codes blurred by
/// `blur` (plane by plane), 4:4:4. Outside, light grows by `shadow` codes per pixel away from the border.
fn frame_of(normal: Vector2<f64>, edge: f64, outside: [f64; 3], blur: f64, shadow: f64) -> [Vec<u8>; 3] {
    [0, 1, 2].map(|plane| {
        (0..SIZE * SIZE)
            .map(|i| {
                let at = Vector2::new((i % SIZE) as f64, (i / SIZE) as f64) - Vector2::repeat(SIZE as f64 / 2.0);
                let beyond = at.dot(&normal) - edge;
                let share = inside_share(beyond / blur);
                let lighter = if plane == 0 { shadow * beyond.clamp(0.0, 8.0) } else { 0.0 };
                (outside[plane] + lighter + share * (TAPE[plane] - outside[plane])).round() as u8
            })
            .collect()
    })
}

fn located(normal: Vector2<f64>, edge: f64, outside: [f64; 3], blur: f64) -> Option<Edge> {
    located_beside_shadow(normal, edge, outside, blur, 0.0)
}

fn located_beside_shadow(normal: Vector2<f64>, edge: f64, outside: [f64; 3], blur: f64, shadow: f64) -> Option<Edge> {
    let planes = frame_of(normal, edge, outside, blur, shadow);
    let plane = |i: usize| Plane { data: &planes[i], stride: SIZE, width: SIZE, height: SIZE };
    let frame = Frame {
        index: 0,
        time_s: 0.0,
        y: plane(0),
        u: plane(1),
        v: plane(2),
        shift_x: 0,
        shift_y: 0,
        encoding: ENCODING,
    };
    let mut model = EdgeModel::new(TAPE, ENCODING);
    model.blur_px = [blur; 3];
    model.habits = Vector3::zeros(); // these codes were blurred, not their light
    let middle = Pixel::new(SIZE as f64 / 2.0, SIZE as f64 / 2.0);
    let probe = Probe {
        middle,
        outward: normal,
        half_length_px: 3.0,
        inwards_px: 5.0,
        outwards_px: 5.0,
        motion_px_s: 0.0,
        shading: Shading::Limb { radius_px: 12.0 },
    };
    model.locate(&frame, &probe, |codes| codes[2] > 170)
}

#[test]
fn a_border_is_found_to_a_fiftieth_of_a_pixel_at_any_angle_and_place() {
    for angle in [0.0, 0.4, 0.785, 1.3, 2.5, -2.0] {
        let normal = Vector2::new(f64::cos(angle), f64::sin(angle));
        for edge in [-1.7, -0.4, 0.0, 0.3, 1.9] {
            let found = located(normal, edge, [90.0, 140.0, 110.0], 0.8).unwrap();
            assert!((found.offset_px - edge).abs() < 0.02, "angle {angle}, edge {edge}: {found:?}");
        }
    }
}

#[test]
fn a_soft_shadow_beside_a_border_does_not_move_it() {
    for shadow in [-5.0, 3.0, 6.0] {
        let found = located_beside_shadow(Vector2::new(0.6, 0.8), 0.3, [190.0, 130.0, 126.0], 0.8, shadow).unwrap();
        assert!((found.offset_px - 0.3).abs() < 0.05, "shadow {shadow}: {found:?}");
    }
}

#[test]
fn equal_luma_is_no_hindrance_while_colours_differ() {
    let found = located(Vector2::new(0.6, 0.8), 0.7, [150.0, 150.0, 90.0], 1.0).unwrap();
    assert!((found.offset_px - 0.7).abs() < 0.02, "{found:?}");
}

#[test]
fn tape_on_both_sides_and_tape_outside_are_no_borders() {
    assert_eq!(located(Vector2::x(), 0.0, [110.0, 80.0, 180.0], 0.8), None, "a crease");
    assert_eq!(located(Vector2::x(), 30.0, [90.0, 140.0, 110.0], 0.8), None, "nothing in the window");
}
