//! Measures one inner corner to a few hundredths of a pixel: a blurred crossing is fitted to the pixels around it.
//!
//! In: the full picture, a rough position (within 0.3 squares) and the directions of the two edges. Out: the corner,
//! with its blur and contrast. Method: `level = a + b·s₁·s₂ + c·s₁ + d·s₂ + e·(s₁·s₂)²` with `sᵢ = erf(distance to edge
//! i / √2σ)`; all ten unknowns by Levenberg–Marquardt over a disc whose weights taper to its rim. a to d give each
//! square its own brightness, so uneven light does not shift the corner. e bends the tone curve; without it, the
//! shrunken dark squares of a blurred and gamma-coded picture pull the fit to one of them.
//!
//! A checkerboard's crossing is point-symmetric, and stays so under any symmetric blur, sharpening and tone curve. A
//! symmetric window is therefore unbiased by all of them, while gradient orthogonality (OpenCV's `cornerSubPix`) is
//! pulled towards anything that enters one side of its square window. Assumes that the window meets no other edge. A
//! fit that is no crossing is rejected: [`Corner::is_crossing`].

use nalgebra::{Point2, SMatrix, SVector, Vector2};

use super::grey::Grey;

const UNKNOWNS: usize = 10;

/// Maximum steps of one fit, and maximum windows for one corner.
const MAX_STEPS: usize = 25;
const MAX_WINDOWS: usize = 20;

/// The fit has converged when window centre and corner are this close, px.
const CONVERGED_PX: f64 = 0.01;

/// Minimum blur of the model, px: a pixel's own area blurs by 0.29.
const MIN_BLUR_PX: f64 = 0.35;

/// A fitted corner.
#[derive(Clone, Debug)]
pub(super) struct Corner {
    /// Position, px.
    pub at: Point2<f64>,
    /// Standard deviation of the blur, px.
    pub blur_px: f64,
    /// Half the step between dark and bright squares, grey levels; its sign says which two squares are dark.
    amplitude: f64,
    /// Largest difference between opposite squares, halved, grey levels.
    shading: f64,
    /// Distance of the level between dark and bright from their mean, grey levels.
    bend: f64,
    /// Root mean square of the model's residuals, grey levels.
    residual: f64,
    /// Sine of the angle between the edges.
    openness: f64,
}

/// Rough position and steps of a corner, to start the fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct CornerGuess {
    /// Rough position, px.
    pub at: Point2<f64>,
    /// Steps to the next corner along the row and along the column, px.
    pub steps: [Vector2<f64>; 2],
}

impl CornerGuess {
    /// Distance to the nearest edge that does not pass through the corner, px.
    pub fn square_px(&self) -> f64 {
        let [a, b] = self.steps;
        a.perp(&b).abs() / a.norm().max(b.norm()).max(f64::MIN_POSITIVE)
    }
}

impl Corner {
    /// Fits a corner; `None` if the fit diverges or leaves the picture.
    pub fn fit(picture: &Grey, place: &CornerGuess) -> Option<Self> {
        let square = place.square_px();
        let radius = (WINDOW_IN_SQUARES * square).clamp(MIN_WINDOW_PX, MAX_WINDOW_PX);
        let mut model = CornerModel::start(place);
        let mut centre = place.at;
        let mut last: Option<(Vector2<f64>, Vector2<f64>)> = None;
        for _ in 0..MAX_WINDOWS {
            let window = FitWindow::around(picture, centre, radius)?;
            model.start_levels(&window);
            model = model.fitted(&window)?;
            if (model.at() - place.at).norm() > 0.3 * square.max(6.0) {
                return None;
            }
            let step = model.at() - centre;
            if step.norm() < CONVERGED_PX {
                return Some(model.corner(&window));
            }
            let shift = step * last.map_or(1.0, |(shift, before)| stride(shift, before, step));
            centre += shift;
            last = Some((shift, step));
        }
        None
    }

    /// Whether the pixels show two edges that cross, rather than a square's outer corner, a T-junction or texture.
    pub fn is_crossing(&self) -> bool {
        let contrast = self.amplitude.abs();
        let even = self.shading < 0.5 * contrast && self.bend < contrast; // a gamma of 2.2 bends by 0.3
        contrast > 4.0 && even && self.residual < 0.3 * contrast && self.openness > 0.25
    }

    /// Whether the square between the two positive steps is bright.
    pub fn is_bright_ahead(&self) -> bool {
        self.amplitude > 0.0
    }
}

/// Factor for the next shift of the window, from the secant of its last shift: below 1 if the last shift overshot,
/// above 1 if the steps hardly shrink.
fn stride(last_shift: Vector2<f64>, last_step: Vector2<f64>, step: Vector2<f64>) -> f64 {
    let shrunk = (last_step - step).dot(&last_shift);
    if shrunk > 0.0 { (last_shift.norm_squared() / shrunk).clamp(0.4, 4.0) } else { 1.0 }
}

/// Radius of the window, in distances to the next edge; beyond half that distance the window would include the next
/// edge, blurred.
const WINDOW_IN_SQUARES: f64 = 0.45;
/// Below this a window holds too few pixels for ten unknowns.
const MIN_WINDOW_PX: f64 = 3.6;
/// Above this the bending of edges under distortion costs more than further pixels gain.
const MAX_WINDOW_PX: f64 = 14.0;

/// Pixels around a point: offsets, levels and weights that fall to nothing at the rim.
struct FitWindow {
    pixels: Vec<(f64, f64, f64, f64)>,
}

impl FitWindow {
    fn around(picture: &Grey, centre: Point2<f64>, radius: f64) -> Option<Self> {
        let last = |size: usize| size as f64 - 1.0;
        let inside = centre.x >= 1.0 && centre.y >= 1.0;
        if !inside || centre.x > last(picture.width) - 1.0 || centre.y > last(picture.height) - 1.0 {
            return None;
        }
        let span = |middle: f64, size: usize| {
            (middle - radius).ceil().max(0.0) as usize..=(middle + radius).floor().min(last(size)) as usize
        };
        let mut pixels = Vec::new();
        for y in span(centre.y, picture.height) {
            for x in span(centre.x, picture.width) {
                let (dx, dy) = (x as f64 - centre.x, y as f64 - centre.y);
                let inside = 1.0 - (dx * dx + dy * dy) / (radius * radius);
                if inside > 0.0 {
                    pixels.push((x as f64, y as f64, f64::from(picture.at(x, y)), inside * inside));
                }
            }
        }
        (pixels.len() > 2 * UNKNOWNS).then_some(Self { pixels })
    }
}

/// u, v, direction 1, direction 2, σ, then the levels a, b, c, d, e.
#[derive(Clone, Debug)]
struct CornerModel(SVector<f64, UNKNOWNS>);

impl CornerModel {
    fn start(place: &CornerGuess) -> Self {
        let [a, b] = place.steps.map(|s| s.y.atan2(s.x));
        Self(SVector::from([place.at.x, place.at.y, a, b, 1.2, 0.0, 0.0, 0.0, 0.0, 0.0]))
    }

    fn at(&self) -> Point2<f64> {
        Point2::new(self.0[0], self.0[1])
    }

    /// Start values of the levels a and b for the present edges; c, d and e start at 0.
    fn start_levels(&mut self, window: &FitWindow) {
        let (mut weights, mut mean) = (0.0, 0.0);
        for &(_, _, level, weight) in &window.pixels {
            weights += weight;
            mean += weight * level;
        }
        mean /= weights;
        let (mut joint, mut own) = (0.0, 1e-9);
        for &(x, y, level, weight) in &window.pixels {
            let [(first, ..), (second, ..)] = [2, 3].map(|edge| self.edge(edge, x, y));
            joint += weight * (level - mean) * first * second;
            own += weight * (first * second).powi(2);
        }
        self.0.fixed_rows_mut::<5>(5).copy_from(&SVector::from([mean, joint / own, 0.0, 0.0, 0.0]));
    }

    /// For a pixel and an edge: the soft side `s`, its slope across the edge, and the offsets across and along the
    /// edge.
    fn edge(&self, which: usize, x: f64, y: f64) -> (f64, f64, f64, f64) {
        let (sin, cos) = self.0[which].sin_cos();
        let (dx, dy) = (x - self.0[0], y - self.0[1]);
        let (across, along) = (cos * dy - sin * dx, cos * dx + sin * dy);
        let scaled = across / (std::f64::consts::SQRT_2 * self.0[4]);
        let slope = (2.0 / std::f64::consts::PI).sqrt() / self.0[4] * (-scaled * scaled).exp();
        (libm::erf(scaled), slope, across, along)
    }

    /// The level expected at a pixel, and its derivatives by the unknowns.
    fn level(&self, x: f64, y: f64) -> (f64, SVector<f64, UNKNOWNS>) {
        let [a, b, c, d, e] = [self.0[5], self.0[6], self.0[7], self.0[8], self.0[9]];
        let (first, slope1, across1, along1) = self.edge(2, x, y);
        let (second, slope2, across2, along2) = self.edge(3, x, y);
        // Derivative of the level by each edge's soft side, times that side's slope across the edge.
        let bend = 2.0 * e * first * second;
        let (pull1, pull2) = ((b * second + c + bend * second) * slope1, (b * first + d + bend * first) * slope2);
        let ((sin1, cos1), (sin2, cos2)) = (self.0[2].sin_cos(), self.0[3].sin_cos());
        let slopes = SVector::from([
            pull1 * sin1 + pull2 * sin2,
            -pull1 * cos1 - pull2 * cos2,
            -pull1 * along1,
            -pull2 * along2,
            -(pull1 * across1 + pull2 * across2) / self.0[4],
            1.0,
            first * second,
            first,
            second,
            (first * second).powi(2),
        ]);
        (a + b * first * second + c * first + d * second + e * (first * second).powi(2), slopes)
    }

    fn cost(&self, window: &FitWindow) -> f64 {
        window.pixels.iter().map(|&(x, y, level, weight)| weight * (level - self.level(x, y).0).powi(2)).sum()
    }

    fn fitted(mut self, window: &FitWindow) -> Option<Self> {
        let mut cost = self.cost(window);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let mut square = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
            let mut slope = SVector::<f64, UNKNOWNS>::zeros();
            for &(x, y, level, weight) in &window.pixels {
                let (expected, slopes) = self.level(x, y);
                square.ger(weight, &slopes, &slopes, 1.0);
                slope.axpy(weight * (level - expected), &slopes, 1.0);
            }
            let mut moved = None;
            while damping < 1e6 && moved.is_none() {
                let mut raised = square;
                for i in 0..UNKNOWNS {
                    raised[(i, i)] *= 1.0 + damping;
                }
                let mut trial = Self(self.0 + raised.cholesky()?.solve(&slope));
                trial.0[4] = trial.0[4].max(MIN_BLUR_PX);
                let new_cost = trial.cost(window);
                if new_cost < cost {
                    moved = Some((trial.at() - self.at()).norm());
                    (self, cost) = (trial, new_cost);
                    damping *= 0.1;
                } else {
                    damping *= 10.0;
                }
            }
            if moved.is_none_or(|px| px < 1e-4) {
                break;
            }
        }
        self.0.iter().all(|v| v.is_finite()).then_some(self)
    }

    fn corner(&self, window: &FitWindow) -> Corner {
        let weights: f64 = window.pixels.iter().map(|p| p.3).sum();
        Corner {
            at: self.at(),
            blur_px: self.0[4],
            amplitude: self.0[6],
            shading: self.0[7].abs().max(self.0[8].abs()),
            bend: self.0[9].abs(),
            residual: (self.cost(window) / weights).sqrt(),
            openness: (self.0[2] - self.0[3]).sin().abs(),
        }
    }
}
