//! Shows whether the stated errors are true: a histogram of normalised errors beside their expected distribution.

use maud::{Markup, html};
use plotters::style::Color;

use super::plot::{INK, TOOL, UNITS, axes, bar, dashed_line, line, plot};
use super::{DrawnTool, page, tool_card};
use crate::checks::evaluation::{CHI_SQUARE_95, VISIBILITY_LEVELS, chi_square_3_density, normalised_square};

/// Largest value in the histogram, and width of its bars.
const MAX_SHOWN: f64 = 16.0;
const BAR_WIDTH: f64 = 0.5;

/// A histogram for each tool that states its errors.
pub fn histograms(tools: &[DrawnTool]) -> anyhow::Result<Markup> {
    let pictures = tools.iter().filter_map(|tool| histogram(tool).transpose()).collect::<anyhow::Result<Vec<_>>>()?;
    let caption = "Squared 3-D error divided by the stated variance, summed over three axes. Bars: the track. Curve: \
                   the χ² distribution with three degrees of freedom, expected if the stated errors are true. Bars \
                   left of the curve: the track is better than stated. A long tail to the right: it is worse. If the \
                   stated errors are true, 5 % lie beyond the dashed line.";
    let caption = if pictures.is_empty() { "The track states no errors." } else { caption };
    Ok(page::pictures("Stated against true errors", &pictures, caption))
}

fn histogram(tool: &DrawnTool) -> anyhow::Result<Option<Markup>> {
    let seen = tool.rows.iter().filter(|row| row.visible >= VISIBILITY_LEVELS[0]);
    let squares: Vec<f64> = seen.filter_map(normalised_square).collect();
    let Some(bars) = density(&squares) else { return Ok(None) };
    let top = bars.iter().copied().fold(chi_square_3_density(1.0), f64::max);
    let curve: Vec<_> =
        (0..=320).map(|i| MAX_SHOWN * f64::from(i) / 320.0).map(|x| (x, chi_square_3_density(x))).collect();
    let drawn = plot(&format!("histogram of the normalised errors of {}", tool.name), 236, |area| {
        let axes = axes(area, (0.0..MAX_SHOWN, "normalised squared error"), (0.0..1.08 * top, "density"))?;
        for (index, height) in bars.iter().enumerate() {
            let edge = |share: f64| BAR_WIDTH * (index as f64 + share);
            bar(&axes, [(edge(0.04), 0.0), (edge(0.96), *height)], TOOL.mix(0.55))?;
        }
        line(&axes, &curve, INK.stroke_width(2 * UNITS))?;
        dashed_line(&axes, vec![(CHI_SQUARE_95[2], 0.0), (CHI_SQUARE_95[2], top)], INK.stroke_width(UNITS))
    })?;
    let share = |limit: f64| 100.0 * squares.iter().filter(|s| **s > limit).count() as f64 / squares.len() as f64;
    let (beyond, outside) = (share(CHI_SQUARE_95[2]), share(MAX_SHOWN));
    let note = format!("{beyond:.1} % beyond the dashed line (expected: 5 %), {outside:.1} % outside the plot");
    Ok(Some(tool_card(tool, &html! { (drawn) p.caption { (note) } })))
}

/// Density in each bar. Values beyond the last bar count but are not drawn. `None` without values.
fn density(squares: &[f64]) -> Option<Vec<f64>> {
    let mut bars = vec![0.0; (MAX_SHOWN / BAR_WIDTH) as usize];
    let each = 1.0 / (BAR_WIDTH * squares.len() as f64);
    for square in squares {
        bars.get_mut((square / BAR_WIDTH) as usize).into_iter().for_each(|bar| *bar += each);
    }
    (!squares.is_empty()).then_some(bars)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_hold_the_share_of_what_they_span() {
        let bars = density(&[0.1, 0.2, 0.7, 99.0]).unwrap();
        assert_eq!((bars[0], bars[1]), (2.0 / 4.0 / BAR_WIDTH, 1.0 / 4.0 / BAR_WIDTH));
        assert_eq!(bars.iter().sum::<f64>() * BAR_WIDTH, 0.75);
        assert_eq!(density(&[]), None);
    }
}
