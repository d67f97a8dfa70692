//! Classifies a colour by its k nearest neighbours among the marked samples (METHOD 2, T 6.2). A colour too far from
//! all samples is unknown.

use std::collections::HashMap;
use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::Classify;
use super::samples::{ColourSample, ColourSamples};

/// Number of neighbours that vote; the thesis's choice.
const K: NonZero<usize> = NonZero::new(5).unwrap(); // checked at compile time

/// Weight of luma relative to the two differences: light varies across a box and over a tube's curve, so brightness
/// identifies a tape less well than hue.
const LUMA_WEIGHT: f64 = 0.4;

/// A colour is unknown if it is farther from every sample of its label than this many times the label's spread.
const SPREADS_TO_UNKNOWN: f64 = 3.0;

/// Minimum spread of a label, as a share of the full code range: noise and compression of any camera.
const MIN_SPREAD: f64 = 0.012;

/// Factors on an unknown colour's brightness, to classify it again as if under other light.
const OTHER_LIGHT: [f64; 6] = [0.85, 1.18, 0.72, 1.38, 0.6, 1.6];

/// Exact classifier over gamma-coded `[Y', Pb, Pr]`.
pub struct Knn {
    tree: ImmutableKdTree<f32, 3>,
    label_of_sample: Vec<u8>,
    limit_of_label: Vec<f32>,
    reach: [(f64, f64); 3],
}

impl Knn {
    /// Builds the tree. `class_of_label` holds the class of each label of the samples, 0 for labels that are no tool.
    /// `None` if there are no samples.
    pub fn new(samples: &ColourSamples, class_of_label: &[u8]) -> Option<Self> {
        let class = |sample: &ColourSample| class_of_label.get(sample.label).copied().unwrap_or(0);
        let colours: Vec<[f64; 3]> = samples.samples.iter().map(|s| samples.encoding.colour_of(s.yuv)).collect();
        let points: Vec<[f32; 3]> = colours.iter().map(|c| metric_of(*c)).collect();
        let label_of_sample: Vec<u8> = samples.samples.iter().map(class).collect();
        if points.is_empty() {
            return None;
        }
        let classes = class_of_label.iter().copied().max().map_or(1, |c| usize::from(c) + 1);
        let limit_of_label: Vec<f32> = (0..classes)
            .map(|class| {
                let own = points.iter().zip(&label_of_sample).filter(|(_, l)| usize::from(**l) == class);
                let own: Vec<[f32; 3]> = own.map(|(p, _)| *p).collect();
                (SPREADS_TO_UNKNOWN * spread(&own).max(MIN_SPREAD)) as f32
            })
            .collect();
        let reach = reach_of_tools(&colours, &label_of_sample, &limit_of_label);
        let (points, label_of_sample) = without_duplicates(points, label_of_sample);
        let tree = ImmutableKdTree::new_from_slice(&points).ok()?;
        Some(Self { tree, label_of_sample, limit_of_label, reach })
    }

    /// The tool with this colour under unchanged light.
    fn known_tool_of(&self, colour: [f64; 3]) -> Option<u8> {
        self.is_near_a_tool(colour).then(|| self.known_class_of(colour))?.filter(|class| *class != 0)
    }

    /// Does a colour lie in the box around all tools' samples, widened by their limits?
    fn is_near_a_tool(&self, colour: [f64; 3]) -> bool {
        colour.iter().zip(&self.reach).all(|(c, (low, high))| (*low..=*high).contains(c))
    }

    /// The class of a colour under unchanged light; `None` if unknown.
    fn known_class_of(&self, colour: [f64; 3]) -> Option<u8> {
        let nearest = self.tree.query(&metric_of(colour)).nearest_n::<SquaredEuclidean<f32>>(K).execute();
        let votes: Vec<u8> = nearest.iter().map(|n| self.label_of_sample[n.item as usize]).collect();
        let winner = majority(&votes)?;
        let distance = nearest.iter().zip(&votes).find(|(_, v)| **v == winner).map_or(f32::MAX, |(n, _)| n.distance);
        let limit = self.limit_of_label[usize::from(winner)];
        (winner == 0 || distance <= limit * limit).then_some(winner)
    }
}

impl Classify for Knn {
    /// The same tape nearer to the lamp or in shadow has the same colour, brighter or darker. So an unknown colour is
    /// classified again under other light.
    fn class_of(&self, colour: [f64; 3]) -> u8 {
        let lit = |light: f64| colour.map(|c| c * light);
        let mut lights = std::iter::once(1.0).chain(OTHER_LIGHT);
        if !lights.any(|light| self.is_near_a_tool(lit(light))) {
            return 0; // beyond the limits of all tools: skip the tree
        }
        let as_it_is = self.known_class_of(colour);
        let other_light = || OTHER_LIGHT.iter().find_map(|light| self.known_tool_of(lit(*light)));
        as_it_is.or_else(other_light).unwrap_or(0)
    }
}

pub(super) fn metric_of(colour: [f64; 3]) -> [f32; 3] {
    [(colour[0] * LUMA_WEIGHT) as f32, colour[1] as f32, colour[2] as f32]
}

/// The class with most votes; on a tie, the one whose vote is nearest.
fn majority(votes: &[u8]) -> Option<u8> {
    let count = |class: u8| votes.iter().filter(|v| **v == class).count();
    let most = votes.iter().map(|v| count(*v)).max()?;
    votes.iter().copied().find(|v| count(*v) == most)
}

/// Removes samples of one class at one place beyond the number that can vote: they change no vote.
fn without_duplicates(points: Vec<[f32; 3]>, classes: Vec<u8>) -> (Vec<[f32; 3]>, Vec<u8>) {
    let mut crowds: HashMap<(u8, [u32; 3]), usize> = HashMap::new();
    let has_a_say = |(point, class): &([f32; 3], u8)| {
        let crowd = crowds.entry((*class, point.map(f32::to_bits))).or_default();
        *crowd += 1;
        *crowd <= K.get()
    };
    points.into_iter().zip(classes).filter(has_a_say).unzip()
}

/// RMS distance from the mean.
fn spread(points: &[[f32; 3]]) -> f64 {
    let n = points.len().max(1) as f64;
    let mean = [0, 1, 2].map(|i| points.iter().map(|p| f64::from(p[i])).sum::<f64>() / n);
    let squares: f64 = points.iter().map(|p| (0..3).map(|i| (f64::from(p[i]) - mean[i]).powi(2)).sum::<f64>()).sum();
    (squares / n).sqrt()
}

/// The box around all tools' samples, widened by their limits, in gamma-coded `[Y', Pb, Pr]`.
fn reach_of_tools(colours: &[[f64; 3]], classes: &[u8], limits: &[f32]) -> [(f64, f64); 3] {
    let scale = [LUMA_WEIGHT, 1.0, 1.0];
    [0, 1, 2].map(|axis| {
        colours.iter().zip(classes).filter(|(_, class)| **class != 0).fold(
            (f64::INFINITY, f64::NEG_INFINITY),
            |(low, high), (colour, class)| {
                let margin = f64::from(limits[usize::from(*class)]) / scale[axis];
                (low.min(colour[axis] - margin), high.max(colour[axis] + margin))
            },
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Range};

    fn samples() -> ColourSamples {
        let encoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
        let around = |label, yuv: [u8; 3]| {
            (0..27u8)
                .map(move |i| [yuv[0] + i % 3 * 2, yuv[1] + i / 3 % 3, yuv[2] + i / 9])
                .map(move |yuv| ColourSample { label, rectangle: label as u32, yuv })
        };
        let samples = around(0, [140, 70, 190]).chain(around(1, [90, 128, 128])).collect();
        ColourSamples { encoding, labels: vec!["orange".into(), "background".into()], samples, places: Vec::new() }
    }

    #[test]
    fn marked_colours_are_known_and_far_ones_are_unknown() {
        let samples = samples();
        let knn = Knn::new(&samples, &[1, 0]).unwrap();
        let class = |yuv| knn.class_of(samples.encoding.colour_of(yuv));
        assert_eq!(class([141, 71, 191]), 1);
        assert_eq!(class([91, 129, 129]), 0);
        assert_eq!(class([140, 190, 70]), 0, "never marked: not the nearest label's");
    }

    #[test]
    fn no_samples_make_no_classifier() {
        let none = ColourSamples { samples: Vec::new(), ..samples() };
        assert!(Knn::new(&none, &[1, 0]).is_none());
    }
}
