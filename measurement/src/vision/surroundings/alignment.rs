//! The change of a camera between two pictures of the same scene: shift, turn about the line of sight, scale, and tilt.
//! It is found by a search, because the pictures may share no point that could be named.
//!
//! **Method:** exhaustive over shift, turn and scale within the range of a nudge, then coordinate descent from the best
//! few, which adds the tilt. The steps are as fine as the finest structure (grain of wood, four cells from line to
//! line) needs: at half the resolution, or without the tilt, a nudge on such a mat was not found.

use super::contrast::ContrastPicture;

/// Largest shift of a nudge, share of the picture's longer side: a camera turned by 4° with the field of view of a box
/// camera (60°), or moved by 16 mm at 250 mm.
pub(super) const NUDGE_SHIFT: f32 = 0.07;

/// Largest shift of a camera that was moved, share of the picture's longer side: by about 40 mm at 250 mm.
pub(super) const MOVED_SHIFT: f32 = 0.14;

/// Largest turn about the line of sight, degrees.
const MAX_TURN_DEG: f32 = 6.0;

/// Largest change of scale, as a logarithm: a camera that moved by 8 % of its distance.
const MAX_ZOOM: f32 = 0.08;

/// Largest tilt: the scale at one edge of the picture relative to its centre. A camera with a field of view of 60° that
/// turns by 6° changes it by 6 %.
const MAX_TILT: f32 = 0.06;

/// Steps of the exhaustive search: the corners move by one or two cells.
const TURN_STEP_DEG: f32 = 1.5;
const ZOOM_STEP: f32 = 0.03;

/// Number of candidates that are refined.
const CANDIDATES: usize = 4;

/// Steps of the refinement, in turn: shift, cells; turn, degrees; zoom and tilt.
const REFINEMENTS: [[f32; 3]; 3] = [[1.0, 1.0, 0.02], [0.5, 0.5, 0.01], [0.25, 0.25, 0.005]];

/// Rounds of coordinate descent at each step.
const MAX_ROUNDS: usize = 6;

/// How one picture lies on another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alignment {
    /// Shift to the right and down, cells.
    pub shift_cells: [f32; 2],
    /// Turn clockwise, degrees.
    pub turn_deg: f32,
    /// Logarithm of the scale.
    pub zoom: f32,
    /// Growth of the scale from the centre to the right and to the lower edge.
    pub tilt: [f32; 2],
}

/// Number of parameters of an [`Alignment`].
const PARAMETERS: usize = 6;

impl Alignment {
    /// The place in the first picture that shows at a place of the second.
    pub(super) fn inverse(&self, columns: usize, rows: usize) -> impl Fn([f32; 2]) -> [f32; 2] + use<> {
        let [x0, y0] = [(columns - 1) as f32 / 2.0, (rows - 1) as f32 / 2.0];
        let (sin, cos) = self.turn_deg.to_radians().sin_cos();
        let shrink = (-self.zoom).exp();
        let [right, down] = self.shift_cells;
        let [tilt_x, tilt_y] = self.tilt.map(|tilt| 2.0 * tilt / columns.max(rows) as f32);
        move |[x, y]| {
            let [x, y] = [x - x0 - right, y - y0 - down];
            let scale = shrink / (1.0 + tilt_x * x + tilt_y * y);
            [x0 + scale * (cos * x + sin * y), y0 + scale * (cos * y - sin * x)]
        }
    }

    /// The alignment that differs in one parameter by one of these steps.
    fn stepped(mut self, parameter: usize, [shift, turn, zoom]: [f32; 3], sign: f32) -> Self {
        match parameter {
            0 | 1 => self.shift_cells[parameter] += sign * shift,
            2 => self.turn_deg += sign * turn,
            3 => self.zoom += sign * zoom,
            _ => self.tilt[parameter - 4] += sign * zoom,
        }
        self
    }

    /// Is it within the search, if the largest shift is so many cells? One step beyond the exhaustive search is
    /// allowed.
    fn is_possible(&self, max_shift_cells: f32) -> bool {
        self.shift_cells.iter().all(|shift| shift.abs() <= max_shift_cells + 1.0)
            && self.turn_deg.abs() <= MAX_TURN_DEG
            && self.zoom.abs() <= MAX_ZOOM
            && self.tilt.iter().all(|tilt| tilt.abs() <= MAX_TILT)
    }
}

/// Sums of a correlation about zero, since local contrast has no mean.
#[derive(Default)]
struct CorrelationSums {
    product: f32,
    squares: [f32; 2],
}

impl CorrelationSums {
    /// Adds cells; those that the first picture does not show are left out.
    fn add(&mut self, own: &[f32], now: &[f32]) {
        for (own, now) in own.iter().zip(now).filter(|(own, _)| !own.is_nan()) {
            self.product += own * now;
            self.squares[0] += own * own;
            self.squares[1] += now * now;
        }
    }

    /// −1 to 1; 0 where there is nothing to correlate.
    fn correlation(&self) -> f32 {
        self.product / (self.squares[0] * self.squares[1]).sqrt().max(f32::MIN_POSITIVE)
    }
}

/// The alignment that lays the first picture best on the second, and their correlation then. `max_shift` is the largest
/// shift, share of the picture's longer side.
pub(super) fn align(own: &ContrastPicture, now: &ContrastPicture, max_shift: f32) -> (f32, Alignment) {
    let refined = candidates(own, now, max_shift).into_iter().map(|start| refine(own, now, start, max_shift));
    refined.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, Alignment::default()))
}

/// The best alignments of the exhaustive search.
fn candidates(own: &ContrastPicture, now: &ContrastPicture, max_shift: f32) -> Vec<Alignment> {
    let reach = (max_shift * own.columns.max(own.rows) as f32).round() as i32;
    let mut found: Vec<(f32, Alignment)> = Vec::new();
    for turn_deg in steps(MAX_TURN_DEG, TURN_STEP_DEG) {
        for zoom in steps(MAX_ZOOM, ZOOM_STEP) {
            let turned = own.aligned(&Alignment { turn_deg, zoom, ..Alignment::default() });
            let shifts = (-reach..=reach).flat_map(|down| (-reach..=reach).map(move |right| [right, down]));
            let scored = shifts.map(|shift| (shifted_correlation(&turned, now, shift), shift));
            let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
            found.extend(best.map(|(score, shift)| {
                let shift_cells = shift.map(|cells| cells as f32);
                (score, Alignment { shift_cells, turn_deg, zoom, ..Alignment::default() })
            }));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().take(CANDIDATES).map(|(_, alignment)| alignment).collect()
}

/// The multiples of a step up to a limit, with both signs.
fn steps(limit: f32, step: f32) -> impl Iterator<Item = f32> {
    let count = (limit / step).floor() as i32;
    (-count..=count).map(move |index| index as f32 * step)
}

/// Correlation after a shift by whole cells.
fn shifted_correlation(own: &ContrastPicture, now: &ContrastPicture, [right, down]: [i32; 2]) -> f32 {
    let (columns, rows) = (own.columns as i32, own.rows as i32);
    let (from, to) = (0.max(right), columns.min(columns + right));
    let row = |y: i32, x: i32| (y * columns + x) as usize;
    let mut sums = CorrelationSums::default();
    for y in 0.max(down)..rows.min(rows + down) {
        let ours = &own.values[row(y - down, from - right)..row(y - down, to - right)];
        sums.add(ours, &now.values[row(y, from)..row(y, to)]);
    }
    sums.correlation()
}

/// Coordinate descent.
pub(super) fn refine(
    own: &ContrastPicture,
    now: &ContrastPicture,
    start: Alignment,
    max_shift: f32,
) -> (f32, Alignment) {
    let max_shift_cells = max_shift * own.columns.max(own.rows) as f32;
    let score = |alignment: &Alignment| {
        let mut sums = CorrelationSums::default();
        sums.add(&own.aligned(alignment).values, &now.values);
        sums.correlation()
    };
    let mut best = (score(&start), start);
    for steps in REFINEMENTS {
        for _ in 0..MAX_ROUNDS {
            let before = best.0;
            for (parameter, sign) in (0..PARAMETERS).flat_map(|parameter| [(parameter, -1.0), (parameter, 1.0)]) {
                let tried = best.1.stepped(parameter, steps, sign);
                let found = if tried.is_possible(max_shift_cells) { score(&tried) } else { f32::MIN };
                if found > best.0 {
                    best = (found, tried);
                }
            }
            if best.0 <= before {
                break;
            }
        }
    }
    best
}
