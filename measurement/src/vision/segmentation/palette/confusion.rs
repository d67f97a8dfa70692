//! Tests the marked colours against each other: how would each rectangle be classified if it had not been marked?
//!
//! Every label's rectangles are distributed over [`GROUPS`] groups, and each group is classified by the others (for up
//! to that many rectangles of a label this is leave-one-out). Pixels of one rectangle never vote for each other,
//! because they resemble each other more than the same tape on the next frame: tested by pixel, every colour would
//! look perfect. If a label has only one rectangle, it can only be tested by pixel, and [`LabelConfusion::rectangles`]
//! shows that.
//!
//! The tracker's own classifier is used, so the columns are its results: each tool, or none.

use std::collections::BTreeMap;

use super::light::LightCondition;
use super::margin::{Margin, SupportingPixels, margin};
use crate::vision::segmentation::Classify;
use crate::vision::segmentation::knn::Knn;
use crate::vision::segmentation::samples::{ColourSample, ColourSamples, RectanglePlace};

/// Number of groups of a label's rectangles.
const GROUPS: usize = 8;

/// Maximum number of test pixels of one rectangle, at even steps: enough for shares good to 1 % with six rectangles.
const MAX_PIXELS_PER_RECTANGLE: usize = 32;

/// Number of test pixels of all rectangles together, but at least one of each.
const MAX_TEST_PIXELS: usize = 2000;

/// How the marked pixels of every label are classified.
#[derive(Clone, Debug, PartialEq)]
pub struct Confusion {
    /// Tools: the columns, after the one for "no tool".
    pub tools: Vec<String>,
    /// A row for each label that has samples.
    pub rows: Vec<LabelConfusion>,
    /// Distance of each tool's colour from the others; in the order of the tools.
    pub margins: Vec<Option<Margin>>,
    /// Where each rectangle is, by number; empty if unknown.
    pub places: Vec<RectanglePlace>,
}

/// Result for one label's pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelConfusion {
    /// Label.
    pub label: String,
    /// The tool that it marks, if any.
    pub tool: Option<usize>,
    /// Number of rectangles marked. With only one, its pixels vote for each other, and the row looks too good.
    pub rectangles: usize,
    /// The rectangle whose pixels are recognised least, if there are three or more; by number, with the share of its pixels
    /// that are not classified as the label's tool.
    pub oddest: Option<(u32, f64)>,
    /// Number of test pixels.
    pub test_pixels: usize,
    /// For each of [`LightCondition::ALL`]: share classified as no tool, as the first tool, as the second, …; adds up
    /// to 1.
    pub shares: Vec<Vec<f64>>,
}

/// A pixel used for testing.
pub(super) struct TestPixel {
    pub(super) label: usize,
    pub(super) rectangle: u32,
    pub(super) group: usize,
    pub(super) colour: [f64; 3],
}

impl Confusion {
    /// Tests samples for these tools; all other labels are no tool. Labels without samples have no row.
    pub fn of(samples: &ColourSamples, tools: &[String]) -> Self {
        let groups = group_of_samples(samples);
        let test_pixels = select_test_pixels(samples, &groups);
        let tool_of = |label: &String| tools.iter().position(|tool| tool == label);
        let (counts, rectangles) = count_classes(samples, &samples.classes(tools), &groups, &test_pixels, tools.len());
        let row = |(label, counts): (usize, Vec<Vec<usize>>)| {
            let asked: usize = counts[0].iter().sum();
            let shares = counts.iter().map(|of| of.iter().map(|n| *n as f64 / asked as f64).collect()).collect();
            let of_label: Vec<&RectangleCount> = rectangles.values().filter(|of| of.label == label).collect();
            let name = &samples.labels[label];
            (asked > 0).then(|| LabelConfusion {
                label: name.clone(),
                tool: tool_of(name),
                rectangles: of_label.len(),
                oddest: oddest(&of_label),
                test_pixels: asked,
                shares,
            })
        };
        let margin = |tool: &String| margin(samples, &test_pixels, tool, SupportingPixels::OtherRectangles, |_| true);
        Self {
            tools: tools.to_vec(),
            rows: counts.into_iter().enumerate().filter_map(row).collect(),
            margins: tools.iter().map(margin).collect(),
            places: samples.places.clone(),
        }
    }

    /// The row of a tool, if it has samples.
    pub fn row_of(&self, tool: usize) -> Option<&LabelConfusion> {
        self.rows.iter().find(|row| row.tool == Some(tool))
    }
}

impl LabelConfusion {
    /// Share classified as a tool in a light.
    pub fn taken_for(&self, tool: usize, light: LightCondition) -> f64 {
        self.shares[light as usize][tool + 1]
    }
}

/// The group of each sample: by rectangle, or by pixel if a label has only one.
pub(super) fn group_of_samples(samples: &ColourSamples) -> Vec<usize> {
    let rectangles: Vec<Vec<u32>> = (0..samples.labels.len()).map(|label| rectangles_of(samples, label)).collect();
    let group = |(index, sample): (usize, &ColourSample)| match &rectangles[sample.label][..] {
        [_] => index % GROUPS,
        several => several.iter().position(|r| *r == sample.rectangle).unwrap_or(0) % GROUPS,
    };
    samples.samples.iter().enumerate().map(group).collect()
}

/// The rectangles that mark a label, in order.
fn rectangles_of(samples: &ColourSamples, label: usize) -> Vec<u32> {
    let mut found: Vec<u32> = samples.samples.iter().filter(|s| s.label == label).map(|s| s.rectangle).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Selects the test pixels.
pub(super) fn select_test_pixels(samples: &ColourSamples, groups: &[usize]) -> Vec<TestPixel> {
    let with_groups: Vec<(&ColourSample, usize)> = samples.samples.iter().zip(groups.iter().copied()).collect();
    let rectangles = with_groups.chunk_by(|(a, _), (b, _)| (a.rectangle, a.label) == (b.rectangle, b.label));
    let of_each = (MAX_TEST_PIXELS / rectangles.clone().count().max(1)).clamp(1, MAX_PIXELS_PER_RECTANGLE);
    rectangles
        .flat_map(|of| of.iter().step_by(of.len().div_ceil(of_each)))
        .map(|(s, group)| TestPixel {
            label: s.label,
            rectangle: s.rectangle,
            group: *group,
            colour: samples.encoding.colour_of(s.yuv),
        })
        .collect()
}

/// How many test pixels of a rectangle were recognised in the marked light.
#[derive(Clone, Copy, Debug, Default)]
struct RectangleCount {
    number: u32,
    label: usize,
    recognised: usize,
    asked: usize,
}

impl RectangleCount {
    fn lost_share(&self) -> f64 {
        1.0 - self.recognised as f64 / self.asked as f64
    }
}

/// The rectangle that lost the largest share of its pixels. Of two that differ, nothing shows which one is wrong.
fn oddest(rectangles: &[&RectangleCount]) -> Option<(u32, f64)> {
    let several = rectangles.iter().filter(|_| rectangles.len() > 2);
    several.map(|of| (of.number, of.lost_share())).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// How often each label was classified as each class, `[label][light][class]`, and the counts of each rectangle.
fn count_classes(
    samples: &ColourSamples,
    classes: &[u8],
    groups: &[usize],
    test_pixels: &[TestPixel],
    tools: usize,
) -> (Vec<Vec<Vec<usize>>>, BTreeMap<u32, RectangleCount>) {
    let mut rectangles: BTreeMap<u32, RectangleCount> = BTreeMap::new();
    let mut counts = vec![vec![vec![0; tools + 1]; LightCondition::ALL.len()]; samples.labels.len()];
    for group in 0..GROUPS {
        let mut left_out = test_pixels.iter().filter(|a| a.group == group).peekable();
        if left_out.peek().is_none() {
            continue;
        }
        let others = samples.samples.iter().zip(groups).filter(|(_, g)| **g != group).map(|(s, _)| *s).collect();
        let others = ColourSamples {
            encoding: samples.encoding,
            labels: samples.labels.clone(),
            samples: others,
            places: Vec::new(),
        };
        let judge = Knn::new(&others, classes);
        for pixel in left_out {
            for light in LightCondition::ALL {
                let seen = light.apply_to(pixel.colour, samples.encoding);
                let class = judge.as_ref().map_or(0, |judge| judge.class_of(seen));
                counts[pixel.label][light as usize][usize::from(class)] += 1;
                if light == LightCondition::AsMarked {
                    let of = RectangleCount { number: pixel.rectangle, label: pixel.label, ..Default::default() };
                    let of = rectangles.entry(pixel.rectangle).or_insert(of);
                    of.asked += 1;
                    of.recognised += usize::from(class == classes[pixel.label]);
                }
            }
        }
    }
    (counts, rectangles)
}
