//! Finds where the colour of a bare shaft ends along its axis, all across it: where black turns to steel (METHOD 3.6).
//!
//! **In** the colours in rows across the shaft. **Out** the distance of that place behind the assumed tip. **Method** A
//! lit tube changes little along its axis, so a clear step of the colour in the middle of three stripes is another
//! surface. **Gives up** without borders or with other colours behind the place, and if the shaft continues ahead of it,
//! as it does beyond a thing that lies across it.

use super::shaft_rows::{Codes, ShaftRow, distance, mean_codes, median_distance, stripes};

/// Length of the pieces behind and ahead of a step that are compared, diameters.
const PIECE_DIAMETERS: f64 = 0.5;
/// Least step, codes: five times the spread along a lit tube.
const CLEAR_CODES: f64 = 30.0;
/// The greatest step within this distance is one, diameters.
const NEAR_DIAMETERS: f64 = 0.25;
/// Lengths of the shaft behind the place that must have borders, diameters, and the least share of them that must. One
/// is longer than jaws and one is shorter, so that black jaws do not pass for a shaft.
const LONG_DIAMETERS: [f64; 2] = [2.0, 6.0];
const MIN_LONG_SHARE: f64 = 0.8;
/// Least distance of the colours on both sides of a border, codes.
const MIN_BORDER_CODES: f64 = 12.0;
/// Where the shaft must look as it does next to the place, diameters behind it, and the largest difference, as a share
/// of the step.
const ALIKE_DIAMETERS: [f64; 2] = [2.0, 5.0];
const MAX_UNLIKE_SHARE: f64 = 0.5;
/// Length ahead of the place where the shaft's colour may show again, mm: jaws have it in places.
const MAX_RESUMED_MM: f64 = 10.0;
/// Least number of rows of a piece.
const MIN_ROWS: usize = 3;

/// The distance behind the assumed tip where the shaft's colour ends, mm; negative ahead of it.
pub fn locate(rows: &[ShaftRow], diameter_mm: f64) -> Option<f64> {
    let step_mm = rows.first()?.back_mm - rows.get(1)?.back_mm;
    let finder = ColourEnds { rows, step_mm, diameter_mm };
    let steps: Vec<f64> = (0..rows.len()).map(|row| finder.step_at(row).unwrap_or(0.0)).collect();
    let near = finder.count(NEAR_DIAMETERS);
    let is_greatest = |row: usize| {
        let around = row.saturating_sub(near)..(row + near + 1).min(steps.len());
        around.into_iter().all(|other| steps[other] <= steps[row])
    };
    let clear = (0..rows.len()).filter(|row| steps[*row] > CLEAR_CODES && is_greatest(*row));
    let mut ends = clear.filter(|row| finder.is_end(*row, steps[*row]));
    ends.next().map(|row| rows[row].back_mm)
}

/// Has the shaft the same colour up to a place, this far behind the assumed tip (mm), as farther behind? The end of a
/// steel collar is no end of a black shaft.
pub fn reaches(rows: &[ShaftRow], diameter_mm: f64, back_mm: f64) -> bool {
    let between = |from: f64, to: f64| {
        let is_there = |row: &&ShaftRow| (from * diameter_mm..to * diameter_mm).contains(&(row.back_mm - back_mm));
        stripes(&rows.iter().filter(is_there).copied().collect::<Vec<_>>())
    };
    let [from, to] = ALIKE_DIAMETERS;
    let (last, far) = (between(0.0, PIECE_DIAMETERS), between(from, to));
    last.zip(far).is_none_or(|(last, far)| median_distance(&last, &far) < CLEAR_CODES)
}

/// Does the colour between the borders change clearly at the assumed tip?
pub fn changes(rows: &[ShaftRow], diameter_mm: f64) -> bool {
    /// Rows next to the tip show both sides of it, blurred.
    const BLURRED_DIAMETERS: f64 = 0.1;
    let stripes_of = |sign: f64| {
        let there = BLURRED_DIAMETERS * diameter_mm..PIECE_DIAMETERS * diameter_mm;
        let is_there = |row: &&ShaftRow| there.contains(&(sign * row.back_mm));
        stripes(&rows.iter().filter(is_there).copied().collect::<Vec<_>>())
    };
    let both = stripes_of(1.0).zip(stripes_of(-1.0));
    both.is_some_and(|(behind, ahead)| median_distance(&behind, &ahead) > CLEAR_CODES)
}

/// Is the tool as wide as the tube ahead of a place, this far behind the assumed tip (mm), over most of a collar's length?
/// Then the colour ends with the tube. Ahead of a collar of the same colour, a narrower hinge begins.
pub fn shows_collar(rows: &[ShaftRow], collar_mm: f64, back_mm: f64) -> bool {
    let is_on_collar = |row: &&ShaftRow| (0.1 * collar_mm..0.9 * collar_mm).contains(&(back_mm - row.back_mm));
    let on_collar: Vec<&ShaftRow> = rows.iter().filter(is_on_collar).collect();
    let is_wide = |row: &&&ShaftRow| {
        let is_border = |[inside, outside]: [Codes; 2]| distance(inside, outside) > MIN_BORDER_CODES;
        row.borders.iter().all(|border| border.is_some_and(is_border))
    };
    let wide = on_collar.iter().filter(is_wide).count() as f64;
    !on_collar.is_empty() && wide >= MIN_LONG_SHARE * on_collar.len() as f64
}

struct ColourEnds<'a> {
    rows: &'a [ShaftRow],
    step_mm: f64,
    diameter_mm: f64,
}

impl ColourEnds<'_> {
    /// Number of rows of a length.
    fn count(&self, diameters: f64) -> usize {
        ((diameters * self.diameter_mm / self.step_mm) as usize).max(MIN_ROWS)
    }

    /// Step of the colour at a row, codes: the median of three stripes.
    fn step_at(&self, row: usize) -> Option<f64> {
        let piece = self.count(PIECE_DIAMETERS);
        let behind = stripes(self.rows.get(row.checked_sub(piece)?..row)?)?;
        let ahead = stripes(self.rows.get(row + 1..row + 1 + piece)?)?;
        Some(median_distance(&behind, &ahead))
    }

    fn is_end(&self, row: usize, step_codes: f64) -> bool {
        self.is_shaft_behind(row, step_codes).unwrap_or(false) && !self.resumes(row).unwrap_or(true)
    }

    /// Does the shaft reach far behind a row, with borders and in one colour?
    fn is_shaft_behind(&self, row: usize, step_codes: f64) -> Option<bool> {
        let has_borders = (0..2).all(|side| self.has_border_behind(side, row));
        let next = stripes(&self.rows[row - self.count(PIECE_DIAMETERS)..row])?;
        let [from, to] = ALIKE_DIAMETERS.map(|diameters| row.saturating_sub(self.count(diameters)));
        let far = stripes(&self.rows[to..from])?;
        Some(has_borders && median_distance(&next, &far) < MAX_UNLIKE_SHARE * step_codes)
    }

    /// Does the border of this side reach far behind a row, darker or brighter than what lies outside, like the shaft?
    fn has_border_behind(&self, side: usize, row: usize) -> bool {
        let [from, to] = ALIKE_DIAMETERS.map(|diameters| row.saturating_sub(self.count(diameters)));
        let codes = |rows: &[ShaftRow]| rows.iter().filter_map(|row| row.borders[side]).collect::<Vec<_>>();
        let far = codes(&self.rows[to..from]);
        let Some(shaft) = mean_codes(far.iter().map(|[inside, _]| *inside)) else { return false };
        let mostly = |diameters: f64, is_edge: &dyn Fn(&[Codes; 2]) -> bool| {
            let seen = codes(&self.rows[row.saturating_sub(self.count(diameters))..row]);
            let edges = seen.iter().filter(|codes| is_edge(codes)).count() as f64;
            !seen.is_empty() && edges >= MIN_LONG_SHARE * seen.len() as f64
        };
        let is_edge = |[inside, outside]: &[Codes; 2]| {
            distance(*inside, *outside) > MIN_BORDER_CODES && distance(*inside, shaft) < distance(*outside, shaft)
        };
        // A hinge is narrower, so that just inside the border lies rather what is outside.
        let is_wide = |[inside, outside]: &[Codes; 2]| distance(*inside, shaft) < distance(*inside, *outside);
        LONG_DIAMETERS.into_iter().all(|diameters| mostly(diameters, &is_edge)) && mostly(PIECE_DIAMETERS, &is_wide)
    }

    /// Is more of the shaft ahead of a row? `None` if too few rows show it.
    fn resumes(&self, row: usize) -> Option<bool> {
        let piece = self.count(PIECE_DIAMETERS);
        let ahead_mm = (self.rows.len() - row - 1) as f64 * self.step_mm;
        if ahead_mm < MAX_RESUMED_MM + PIECE_DIAMETERS * self.diameter_mm {
            return None;
        }
        let behind = stripes(&self.rows[row - piece..row])?;
        let ahead = stripes(&self.rows[row + 1..row + 1 + piece])?;
        let is_shaft = |row: &&ShaftRow| {
            let alike = (0..3).filter(|stripe| {
                row.inside[*stripe].is_some_and(|codes| {
                    let from_shaft = distance(codes, behind[*stripe]);
                    from_shaft < CLEAR_CODES && from_shaft < distance(codes, ahead[*stripe])
                })
            });
            alike.count() >= 2
                && row.borders.iter().flatten().any(|[inside, outside]| distance(*inside, *outside) > MIN_BORDER_CODES)
        };
        let resumed = self.rows[row + 1 + piece..].iter().filter(is_shaft).count();
        Some(resumed as f64 * self.step_mm > MAX_RESUMED_MM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIAMETER_MM: f64 = 5.0;
    const STEP_MM: f64 = 0.4;
    /// Codes of the shaft, of steel and of the board.
    const BLACK: f64 = 60.0;
    const STEEL: f64 = 130.0;
    const BOARD: f64 = 180.0;

    /// Rows of a tool; `luma` is that of both limbs and of the three stripes at a distance ahead of the tube's end, mm.
    fn rows(luma: impl Fn(f64) -> ([f64; 2], [f64; 3])) -> Vec<ShaftRow> {
        let grey = |luma: f64| [luma, 128.0, 128.0];
        let row = |i: i32| {
            let back_mm = 70.0 - STEP_MM * f64::from(i);
            let (limbs, stripes) = luma(-back_mm);
            ShaftRow {
                back_mm,
                borders: limbs.map(|limb| Some([grey(limb), grey(BOARD)])),
                inside: stripes.map(|stripe| Some(grey(stripe))),
            }
        };
        (0..262).map(row).collect()
    }

    /// One luma all across.
    fn even(luma: f64) -> ([f64; 2], [f64; 3]) {
        ([luma; 2], [luma; 3])
    }

    fn is_at(found: Option<f64>, back_mm: f64) -> bool {
        found.is_some_and(|found| (found - back_mm).abs() <= STEP_MM)
    }

    #[test]
    fn a_tube_ends_at_its_steel_collar_whose_limb_may_be_as_dark() {
        let luma = |ahead: f64| match ahead {
            ..0.0 => even(BLACK),
            0.0..8.0 => ([BLACK + 5.0, STEEL], [STEEL - 30.0, 235.0, STEEL]),
            _ => even(BOARD),
        };
        let found = locate(&rows(luma), DIAMETER_MM);
        assert!(is_at(found, 0.0), "{found:?}");
    }

    #[test]
    fn a_black_shaft_does_not_reach_the_end_of_its_steel_collar() {
        let with_collar = |collar_mm: f64| move |ahead: f64| if ahead < -collar_mm { even(BLACK) } else { even(STEEL) };
        assert!(reaches(&rows(with_collar(0.0)), DIAMETER_MM, 0.0));
        let rows = rows(with_collar(5.0));
        assert!(!reaches(&rows, DIAMETER_MM, 0.0) && reaches(&rows, DIAMETER_MM, 5.0));
    }

    #[test]
    fn steel_changes_the_colour_at_the_tip_and_slow_gloss_does_not() {
        let steel = |ahead: f64| if ahead < 0.0 { even(BLACK) } else { even(STEEL) };
        assert!(changes(&rows(steel), DIAMETER_MM));
        assert!(!changes(&rows(|ahead| even(BLACK + 1.2 * (ahead + 70.0))), DIAMETER_MM));
    }

    #[test]
    fn gloss_that_changes_slowly_ends_nothing() {
        let luma = |ahead: f64| even(BLACK + 1.2 * (ahead + 70.0));
        assert_eq!(locate(&rows(luma), DIAMETER_MM), None);
    }

    #[test]
    fn a_shaft_does_not_end_where_a_thing_lies_across_it() {
        for (from, to) in [(-20.0, -12.0), (26.0, 30.0)] {
            let luma = |ahead: f64| if (from..to).contains(&ahead) { even(STEEL) } else { even(BLACK) };
            assert_eq!(locate(&rows(luma), DIAMETER_MM), None, "from {from} to {to} mm");
        }
    }

    #[test]
    fn black_jaws_that_hold_a_ring_are_no_shaft() {
        let luma = |ahead: f64| match ahead {
            ..0.0 => even(BLACK),
            0.0..17.0 => ([BOARD - 3.0; 2], [BLACK; 3]),
            _ => even(STEEL),
        };
        assert_eq!(locate(&rows(luma), DIAMETER_MM), None);
    }

    #[test]
    fn a_board_that_is_darker_than_steel_does_not_continue_the_shaft() {
        let luma = |ahead: f64| match ahead {
            ..0.0 => even(BLACK),
            0.0..8.0 => even(235.0),
            _ => even(0.5 * (BLACK + STEEL)),
        };
        let found = locate(&rows(luma), DIAMETER_MM);
        assert!(is_at(found, 0.0), "{found:?}");
    }

    #[test]
    fn a_tube_is_as_wide_as_ever_next_to_its_end() {
        let luma = |ahead: f64| match ahead {
            ..0.0 => even(BLACK),
            0.0..1.9 => ([BOARD - 3.0; 2], [BLACK; 3]),
            _ => even(STEEL),
        };
        assert_eq!(locate(&rows(luma), DIAMETER_MM), None, "a thing lies across the hinge");
    }

    #[test]
    fn a_collar_is_as_wide_as_the_tube_and_a_hinge_is_not() {
        let with_limbs = |limb: f64| move |ahead: f64| if ahead < 0.0 { even(BLACK) } else { ([limb; 2], [STEEL; 3]) };
        assert!(shows_collar(&rows(with_limbs(STEEL)), 8.0, 0.0));
        assert!(!shows_collar(&rows(with_limbs(BOARD - 3.0)), 8.0, 0.0));
    }
}
