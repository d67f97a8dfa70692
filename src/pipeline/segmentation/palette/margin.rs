//! How far a tape's colour is from the others: by how much may colours shift before the classifier's vote turns?
//!
//! Before the recording its own pixels may not vouch for each other ([`super::confusion`]): will the tape be known on a frame
//! that nobody marked? Of a session that was tracked the question is another ([`apart`]): its coverage tells how well the
//! tape was known, but not whether it was the tape.

use super::confusion::{Asked, ask, group_of_samples};
use super::{distance_steps, quantile};
use crate::pipeline::segmentation::knn::metric_of;
use crate::pipeline::segmentation::samples::ColourSamples;

/// Labels of parts that join the band: where they meet it, blur and coarse chroma mix both, on every tool and with every tape.
const JOINED_TO_THE_BAND: [&str; 2] = ["shaft", "jaw"];

/// The neighbour that decides a vote of five: once the third of another label is nearer, the colour is another's.
const DECIDING: usize = 3;

/// Share of a tape's pixels that may lie nearer to another colour than the stated margin.
const MARGIN_QUANTILE: f64 = 0.05;

/// How far a tape's colour is from all else that was marked, but for the tool's own parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Margin {
    /// By how much nearer its own third neighbour is than the third of another label, for all but 5 % of its pixels, halved:
    /// the shift that they stand before the vote turns. Negative where it has turned already. Steps.
    pub margin_steps: f64,
    /// RMS distance of its pixels from their mean, steps.
    pub spread_steps: f64,
    /// The label that is nearest.
    pub nearest: String,
}

/// How far a tool's colour stands apart in the recordings that are tracked with it. `None` where nothing of the kind was
/// marked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Apart {
    /// From the other tools' tapes.
    pub from_tools: Option<Margin>,
    /// From all that is no tool.
    pub from_background: Option<Margin>,
}

/// Which of a label's pixels speak for one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Vouching {
    /// Those of other rectangles.
    OtherRectangles,
    /// All others, as they do while a recording is tracked.
    All,
}

/// How far each tool's colour stands apart in a recording that is tracked with these samples; in the tools' order. About
/// 5 ms.
pub fn apart(samples: &ColourSamples, tools: &[String]) -> Vec<Apart> {
    let asked = ask(samples, &group_of_samples(samples));
    let of_tool = |tool: &String| {
        let from = |is_tool: bool| {
            margin(samples, &asked, tool, Vouching::All, |label| tools.contains(&samples.labels[label]) == is_tool)
        };
        Apart { from_tools: from(true), from_background: from(false) }
    };
    tools.iter().map(of_tool).collect()
}

/// How far a label's pixels are from the others that count, but for the tool's own parts; `None` where either side has too few.
pub(super) fn margin(
    samples: &ColourSamples,
    asked: &[Asked],
    label: &str,
    vouching: Vouching,
    counts: impl Fn(usize) -> bool,
) -> Option<Margin> {
    let label = samples.labels.iter().position(|l| l == label)?;
    let points: Vec<(&Asked, [f32; 3])> = asked.iter().map(|a| (a, metric_of(a.colour))).collect();
    let own: Vec<(&Asked, [f32; 3])> = points.iter().filter(|(a, _)| a.label == label).copied().collect();
    let is_joined = |label: usize| JOINED_TO_THE_BAND.contains(&samples.labels[label].as_str());
    let is_foreign = |other: &Asked| other.label != label && !is_joined(other.label) && counts(other.label);
    let foreign: Vec<(&Asked, [f32; 3])> = points.iter().filter(|(a, _)| is_foreign(a)).copied().collect();
    let mut times_nearest = vec![0; samples.labels.len()];
    let mut margins = Vec::new();
    for (pixel, at) in &own {
        let vouches = |other: &Asked| match vouching {
            Vouching::OtherRectangles => other.group != pixel.group,
            Vouching::All => !std::ptr::eq(other, *pixel),
        };
        let (own_steps, _) = deciding(&own, *at, vouches)?;
        let (foreign_steps, whose) = deciding(&foreign, *at, |_| true)?;
        times_nearest[whose] += 1;
        margins.push(0.5 * (foreign_steps - own_steps));
    }
    let (whose, _) = times_nearest.iter().enumerate().max_by_key(|(_, n)| **n)?;
    Some(Margin {
        margin_steps: quantile(&mut margins, MARGIN_QUANTILE)?,
        spread_steps: spread_steps(&own),
        nearest: samples.labels[whose].clone(),
    })
}

/// Distance and label of the neighbour that decides, among those that count.
fn deciding(points: &[(&Asked, [f32; 3])], at: [f32; 3], counts: impl Fn(&Asked) -> bool) -> Option<(f64, usize)> {
    let mut nearest = [(f64::INFINITY, usize::MAX); DECIDING];
    for (other, place) in points.iter().filter(|(other, _)| counts(other)) {
        let steps = distance_steps(at, *place);
        if steps < nearest[DECIDING - 1].0 {
            nearest[DECIDING - 1] = (steps, other.label);
            nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
    }
    nearest.last().copied().filter(|(steps, _)| steps.is_finite())
}

/// RMS distance from the mean, steps.
fn spread_steps(points: &[(&Asked, [f32; 3])]) -> f64 {
    let n = points.len().max(1) as f32;
    let mean = [0, 1, 2].map(|i| points.iter().map(|(_, p)| p[i]).sum::<f32>() / n);
    (points.iter().map(|(_, p)| distance_steps(*p, mean).powi(2)).sum::<f64>() / f64::from(n)).sqrt()
}
