//! The midline between two borders in Hesse's form: `x·cos θ + y·sin θ = ρ` in normalised coordinates, whose origin is
//! the principal point. `(ρ, θ)` and `(−ρ, θ + π)` are the same line.

use std::f64::consts::PI;

use nalgebra::{Point2, Vector2};

use super::pair_filter::CoordinatePair;
use crate::vision::edges::line_fit::BorderLine;
use crate::vision::space::Normalised;

/// Two borders as their midline and what separates them from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HesseBorders {
    /// `[ρ, θ]` of the midline.
    pub(super) midline: CoordinatePair,
    /// Half the difference of the borders' ρ, the first minus the second.
    half_offset: f64,
    /// Half the difference of their θ.
    half_angle: f64,
}

impl HesseBorders {
    /// The midline bisects the borders: each of its points has the same distance from both.
    pub(super) fn between([first, second]: [BorderLine; 2]) -> Self {
        let is_opposite = first.normal.dot(&second.normal) < 0.0;
        let sign = if is_opposite { -1.0 } else { 1.0 };
        let (normal, offset) = (second.normal * sign, second.offset * sign);
        let half_angle = 0.5 * normal.perp(&first.normal).atan2(normal.dot(&first.normal));
        let theta = normal.y.atan2(normal.x) + half_angle;
        let rho = 0.5 * (first.offset + offset) / half_angle.cos();
        Self { midline: [rho, theta], half_offset: 0.5 * (first.offset - offset), half_angle }
    }

    /// The same borders with their midline elsewhere. Both forms of a midline give the same lines only if the borders
    /// turn with it, so the second form exchanges their differences.
    pub(super) fn moved_to(&self, midline: CoordinatePair) -> Self {
        let is_other_form = (midline[1] - self.midline[1]).cos() < 0.0;
        let half_offset = if is_other_form { -self.half_offset } else { self.half_offset };
        Self { midline, half_offset, half_angle: self.half_angle }
    }

    /// Both borders.
    pub(super) fn lines(&self) -> [BorderLine; 2] {
        let [rho, theta] = self.midline;
        let middle = rho * self.half_angle.cos();
        [1.0, -1.0].map(|side| BorderLine {
            normal: normal(theta + side * self.half_angle),
            offset: middle + side * self.half_offset,
        })
    }
}

/// The form of a line whose angle is nearest to an expected one, so that angles continue beyond π.
pub(super) fn nearest_form([rho, theta]: CoordinatePair, [_, expected]: CoordinatePair) -> CoordinatePair {
    let half_turns = ((expected - theta) / PI).round();
    let is_odd = half_turns.rem_euclid(2.0) == 1.0;
    [if is_odd { -rho } else { rho }, theta + half_turns * PI]
}

/// The point of a line nearest to a point.
pub(super) fn projected(point: Normalised, [rho, theta]: CoordinatePair) -> Normalised {
    let normal = normal(theta);
    let distance = normal.dot(&point.0.coords) - rho;
    Normalised(Point2::from(point.0.coords - normal * distance))
}

fn normal(theta: f64) -> Vector2<f64> {
    Vector2::new(theta.cos(), theta.sin())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    prop_compose! {
        /// Two borders of a shaft: almost parallel, at some distance, with normals of any sign.
        fn any_borders()(
            theta in -3.1..3.1f64, apart in -0.1..0.1f64, rho in -0.5..0.5f64, width in 0.02..0.2f64,
            is_turned in any::<bool>(),
        ) -> [BorderLine; 2] {
            let sign = if is_turned { -1.0 } else { 1.0 };
            [
                BorderLine { normal: normal(theta + apart), offset: rho + width },
                BorderLine { normal: normal(theta - apart) * sign, offset: (rho - width) * sign },
            ]
        }
    }

    /// Do two lines have the same points?
    fn is_same(one: &BorderLine, other: &BorderLine) -> bool {
        let sign = one.normal.dot(&other.normal).signum();
        (one.normal - other.normal * sign).norm() < 1e-9 && (one.offset - other.offset * sign).abs() < 1e-9
    }

    proptest! {
        #[test]
        fn each_point_of_the_midline_is_as_far_from_both_borders(borders in any_borders(), along in -1.0..1.0f64) {
            let [rho, theta] = HesseBorders::between(borders).midline;
            let point = Point2::from(normal(theta) * rho + normal(theta + 0.5 * PI) * along);
            let [first, second] = borders.map(|line| line.distance(point).abs());
            prop_assert!((first - second).abs() < 1e-9, "{first} {second}");
        }

        #[test]
        fn the_borders_come_back_from_either_form_of_their_midline(borders in any_borders(), turns in -3..4i32) {
            let hesse = HesseBorders::between(borders);
            let other = nearest_form(hesse.midline, [0.0, hesse.midline[1] + f64::from(turns) * PI]);
            prop_assert!((other[1] - hesse.midline[1] - f64::from(turns) * PI).abs() < 1e-9);
            for lines in [hesse.lines(), hesse.moved_to(other).lines()] {
                prop_assert!(is_same(&lines[0], &borders[0]) && is_same(&lines[1], &borders[1]), "{lines:?}");
            }
        }

        #[test]
        fn a_projected_point_lies_on_the_line(x in -0.5..0.5f64, y in -0.5..0.5f64, borders in any_borders()) {
            let midline = HesseBorders::between(borders).midline;
            let on = projected(Normalised::new(x, y), midline);
            prop_assert!((normal(midline[1]).dot(&on.0.coords) - midline[0]).abs() < 1e-12);
            prop_assert!((projected(on, midline).0 - on.0).norm() < 1e-12);
        }
    }
}
