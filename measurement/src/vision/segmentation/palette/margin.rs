//! Margin of a tape's colour: by how much may colours shift before the classifier's vote changes?
//!
//! There are two questions. Before the recording: will the tape be recognised on a frame that was not marked? Then
//! pixels of one rectangle may not support each other ([`super::confusion`]). After a session was tracked
//! ([`colour_separations`]): its coverage shows how well the tape was recognised, but not whether it was the tape.

use serde::{Deserialize, Serialize};

use super::confusion::{TestPixel, group_of_samples, select_test_pixels};
use super::{distance_steps, quantile};
use crate::vision::segmentation::knn::metric_of;
use crate::vision::segmentation::samples::ColourSamples;

/// Labels of parts that adjoin the band. Where they meet it, blur and coarse chroma mix both, on every tool and with
/// every tape.
const JOINED_TO_THE_BAND: [&str; 2] = ["shaft", "jaw"];

/// The neighbour that decides a vote of five: once the third of another label is nearer, the other label wins.
const DECIDING_NEIGHBOUR: usize = 3;

/// Share of a tape's pixels that may be nearer to another colour than the stated margin.
const MARGIN_QUANTILE: f64 = 0.05;

/// Distance of a tape's colour from everything else that was marked, except the tool's own parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Margin {
    /// The shift of colour that its pixels tolerate before the vote changes: half the difference between the distances
    /// to the third neighbour of another label and to its own third neighbour, valid for all but 5 % of its pixels.
    /// Negative if the vote is wrong already. Steps.
    pub margin_steps: f64,
    /// RMS distance of its pixels from their mean, steps.
    pub spread_steps: f64,
    /// The nearest other label.
    pub nearest: String,
}

/// Separation of a tool's colour in recordings that are tracked with it. `None` if no such colours were marked.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ColourSeparation {
    /// From the other tools' tapes.
    pub from_tools: Option<Margin>,
    /// From everything that is no tool.
    pub from_background: Option<Margin>,
}

/// The pixels of its own label that support a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SupportingPixels {
    /// Only those of other rectangles.
    OtherRectangles,
    /// All others, as when a recording is tracked.
    All,
}

/// Separation of each tool's colour in a recording that is tracked with these samples; in the tools' order. Takes
/// about 5 ms.
pub fn colour_separations(samples: &ColourSamples, tools: &[String]) -> Vec<ColourSeparation> {
    let test_pixels = select_test_pixels(samples, &group_of_samples(samples));
    let of_tool = |tool: &String| {
        let from = |is_tool: bool| {
            margin(samples, &test_pixels, tool, SupportingPixels::All, |label| {
                tools.contains(&samples.labels[label]) == is_tool
            })
        };
        ColourSeparation { from_tools: from(true), from_background: from(false) }
    };
    tools.iter().map(of_tool).collect()
}

/// Margin of a label's pixels from the other labels that count, except the tool's own parts; `None` if either side has
/// too few pixels.
pub(super) fn margin(
    samples: &ColourSamples,
    test_pixels: &[TestPixel],
    label: &str,
    vouching: SupportingPixels,
    counts: impl Fn(usize) -> bool,
) -> Option<Margin> {
    let label = samples.labels.iter().position(|l| l == label)?;
    let points: Vec<(&TestPixel, [f32; 3])> = test_pixels.iter().map(|a| (a, metric_of(a.colour))).collect();
    let own: Vec<(&TestPixel, [f32; 3])> = points.iter().filter(|(a, _)| a.label == label).copied().collect();
    let is_joined = |label: usize| JOINED_TO_THE_BAND.contains(&samples.labels[label].as_str());
    let is_foreign = |other: &TestPixel| other.label != label && !is_joined(other.label) && counts(other.label);
    let foreign: Vec<(&TestPixel, [f32; 3])> = points.iter().filter(|(a, _)| is_foreign(a)).copied().collect();
    let mut times_nearest = vec![0; samples.labels.len()];
    let mut margins = Vec::new();
    for (pixel, at) in &own {
        let vouches = |other: &TestPixel| match vouching {
            SupportingPixels::OtherRectangles => other.group != pixel.group,
            SupportingPixels::All => !std::ptr::eq(other, *pixel),
        };
        let (own_steps, _) = deciding_neighbour(&own, *at, vouches)?;
        let (foreign_steps, nearest_label) = deciding_neighbour(&foreign, *at, |_| true)?;
        times_nearest[nearest_label] += 1;
        margins.push(0.5 * (foreign_steps - own_steps));
    }
    let (nearest_label, _) = times_nearest.iter().enumerate().max_by_key(|(_, n)| **n)?;
    Some(Margin {
        margin_steps: quantile(&mut margins, MARGIN_QUANTILE)?,
        spread_steps: spread_steps(&own),
        nearest: samples.labels[nearest_label].clone(),
    })
}

/// Distance and label of the deciding neighbour, among those that count.
fn deciding_neighbour(
    points: &[(&TestPixel, [f32; 3])],
    at: [f32; 3],
    counts: impl Fn(&TestPixel) -> bool,
) -> Option<(f64, usize)> {
    let mut nearest = [(f64::INFINITY, usize::MAX); DECIDING_NEIGHBOUR];
    for (other, place) in points.iter().filter(|(other, _)| counts(other)) {
        let steps = distance_steps(at, *place);
        if steps < nearest[DECIDING_NEIGHBOUR - 1].0 {
            nearest[DECIDING_NEIGHBOUR - 1] = (steps, other.label);
            nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
    }
    nearest.last().copied().filter(|(steps, _)| steps.is_finite())
}

/// RMS distance from the mean, steps.
fn spread_steps(points: &[(&TestPixel, [f32; 3])]) -> f64 {
    let n = points.len().max(1) as f32;
    let mean = [0, 1, 2].map(|i| points.iter().map(|(_, p)| p[i]).sum::<f32>() / n);
    (points.iter().map(|(_, p)| distance_steps(*p, mean).powi(2)).sum::<f64>() / f64::from(n)).sqrt()
}
