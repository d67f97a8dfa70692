//! Shows whether the stated errors are true: a histogram of normalised errors beside their expected distribution.

use super::node::Markup;
use super::plot::{AxisRange, MARGIN, Panel, WIDTH, label, picture};
use super::{DrawnTool, page, tool_card};
use crate::checks::evaluation::{CHI_SQUARE_95, VISIBILITY_LEVELS, chi_square_3_density, normalised_square};

/// Largest value in the histogram, and width of its bars.
const MAX_SHOWN: f64 = 16.0;
const BAR_WIDTH: f64 = 0.5;

/// A histogram for each tool that states its errors.
pub fn histograms(tools: &[DrawnTool]) -> Markup {
    let pictures: Vec<Markup> = tools.iter().filter_map(histogram).collect();
    let caption = "Squared 3-D error divided by the stated variance, summed over three axes. Bars: the track. Curve: \
                   the χ² distribution with three degrees of freedom, expected if the stated errors are true. Bars \
                   left of the curve: the track is better than stated. A long tail to the right: it is worse. If the \
                   stated errors are true, 5 % lie beyond the dashed line.";
    let caption = if pictures.is_empty() { "The track states no errors." } else { caption };
    page::section("Stated against true errors", pictures.into_iter().chain([page::caption(caption)]))
}

fn histogram(tool: &DrawnTool) -> Option<Markup> {
    let seen = tool.rows.iter().filter(|row| row.visible >= VISIBILITY_LEVELS[0]);
    let squares: Vec<f64> = seen.filter_map(normalised_square).collect();
    let bars = density(&squares)?;
    let top = bars.iter().copied().fold(chi_square_3_density(1.0), f64::max);
    let panel = Panel {
        left: MARGIN.0,
        top: 24.0,
        width: WIDTH - MARGIN.0 - 10.0,
        height: 190.0,
        x: AxisRange { from: 0.0, to: MAX_SHOWN },
        y: AxisRange { from: 0.0, to: 1.08 * top },
    };
    let mut parts = vec![label("title", (0.0, 14.0), tool.name), panel.axes("normalised squared error", "density")];
    for (index, height) in bars.iter().enumerate() {
        let from = BAR_WIDTH * index as f64;
        parts.push(panel.bar("bars", (from + 0.04 * BAR_WIDTH, from + 0.96 * BAR_WIDTH), (0.0, *height)));
    }
    let curve: Vec<_> =
        (0..=320).map(|i| MAX_SHOWN * f64::from(i) / 320.0).map(|x| (x, chi_square_3_density(x))).collect();
    parts.push(panel.line("curve", &curve));
    parts.push(panel.line("limit", &[(CHI_SQUARE_95[2], 0.0), (CHI_SQUARE_95[2], top)]));
    let share = |part: usize| 100.0 * part as f64 / squares.len() as f64;
    let beyond = share(squares.iter().filter(|s| **s > CHI_SQUARE_95[2]).count());
    let far = share(squares.iter().filter(|s| **s > MAX_SHOWN).count());
    let (u, v) = panel.position((CHI_SQUARE_95[2], top));
    parts.push(label(
        "number",
        (u + 8.0, v + 14.0),
        &format!("{beyond:.1} % beyond (expected: 5 %), {far:.1} % outside the plot"),
    ));
    let name = format!("histogram of the normalised errors of {}", tool.name);
    Some(tool_card(tool, picture(&name, 24.0 + 190.0 + MARGIN.1 + 4.0, parts)))
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
