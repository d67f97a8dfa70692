//! The end of the shaft as a step of colour along the strip: where black turns to the steel of the jaws, or to the box.

use nalgebra::{Point2, Vector2};

use super::Strip;
use super::grid::UndistortedGrid;
use crate::vision::segmentation::cells::CellPicture;
use crate::vision::space::Normalised;

/// Least step of colour, codes: three times the spread along a lit tube.
const MIN_STEP_CODES: f64 = 18.0;
/// How far before and behind the end of the evidence the step may lie, widths. Shaded steel looks like the shaft, so
/// that the evidence may end with the jaws' collar, two widths ahead.
const BEFORE_WIDTHS: f64 = 2.5;
const BEHIND_WIDTHS: f64 = 0.7;
/// Part of the width that is compared, in the middle: its borders are mixed with the background.
const MIDDLE: f64 = 0.5;
/// Length of each of the two pieces that are compared, widths.
const PIECE_WIDTHS: f64 = 0.6;

/// The strip with its end moved to the greatest step of colour near it, and the step, codes; the end stays where it is
/// without a clear step.
pub fn with_end_at_step(grid: &UndistortedGrid, cells: &CellPicture, strip: Strip) -> Strip {
    const ACROSS: usize = 5;
    let (end, entry) = (grid.place(strip.end), grid.place(strip.entry));
    let Some(along) = (end - entry).try_normalize(1e-9) else { return strip };
    let across = Vector2::new(-along.y, along.x);
    let width = strip.width / grid.pitch;
    let piece = (PIECE_WIDTHS * width).round().max(2.0) as isize;
    let first = (-BEFORE_WIDTHS * width) as isize;
    let last = (BEHIND_WIDTHS * width) as isize;
    let row = |place: isize| {
        let codes = (0..ACROSS).filter_map(|i| {
            let aside = MIDDLE * width * (i as f64 / (ACROSS - 1) as f64 - 0.5);
            grid.codes(cells, end + along * place as f64 + across * aside)
        });
        let (count, sum) = codes.fold((0.0, [0.0; 3]), |(count, sum), codes| {
            (count + 1.0, std::array::from_fn(|part| sum[part] + codes[part]))
        });
        (count > 0.0).then(|| sum.map(|sum| sum / count))
    };
    let rows: Vec<Option<[f64; 3]>> = (first - piece..last + piece).map(row).collect();
    let mean = |from: usize| -> Option<[f64; 3]> {
        let rows: Vec<[f64; 3]> = rows[from..from + piece as usize].iter().copied().collect::<Option<_>>()?;
        Some(std::array::from_fn(|part| rows.iter().map(|row| row[part]).sum::<f64>() / rows.len() as f64))
    };
    let step = |place: usize| -> Option<f64> {
        let [before, behind] = [mean(place)?, mean(place + piece as usize)?];
        Some((0..3).map(|part| (behind[part] - before[part]).powi(2)).sum::<f64>().sqrt())
    };
    let places = (0..(last - first) as usize).filter_map(|place| Some((place, step(place)?)));
    let Some((place, codes)) = places.max_by(|one, other| one.1.total_cmp(&other.1)) else { return strip };
    if codes < MIN_STEP_CODES {
        return strip;
    }
    let moved = (first + place as isize) as f64 - 0.5;
    let to = |at: Point2<f64>| grid.normalised(grid.place(Normalised(at)) + along * moved).0;
    let borders = strip.borders.map(|[entry, end]| [entry, to(end)]);
    Strip { end: grid.normalised(end + along * moved), borders, end_step_codes: Some(codes), ..strip }
}
