//! Submovements: the single pushes that a movement consists of.

use super::motion::{Motion, Span};
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource};

/// Number of pushes.
pub static SUBMOVEMENTS: Feature = Feature {
    name: "submovements",
    title: "Number of submovements",
    family: Family::Movements,
    unit: "1",
    direction: Direction::Lower,
    description: "How often the speed has a maximum that stands out by at least {movement_speed} mm/s from the dips \
                  on both its sides. A hand that knows its way needs one or two a movement.",
    source: "speed peaks by their prominence (Rohrer 2004); the threshold is the movement speed, well above the noise",
    range: (0.0, 1e6),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::CorrectedMovements,
    habit: Some(Habit::FewerCorrections),
    measures: &[MeasureFn::Tool(submovements)],
};

fn submovements(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let of_span = |span: &Span| peaks(span.nodes.iter().map(|node| node.velocity.norm()), settings.movement_speed_mm_s);
    Ok(motion.spans.iter().map(|span| of_span(span).len()).sum::<usize>() as f64)
}

/// The indices of the maxima that stand out from the dips on both sides by at least `prominence`. Before and after the
/// values the tool counts as at rest.
pub(in crate::motion) fn peaks(values: impl Iterator<Item = f64>, prominence: f64) -> Vec<usize> {
    let (mut peaks, mut lowest, mut highest) = (Vec::new(), 0.0_f64, None::<(usize, f64)>);
    for (index, value) in values.chain([0.0]).enumerate() {
        match highest {
            Some((at, peak)) if value <= peak - prominence => {
                peaks.push(at);
                (lowest, highest) = (value, None);
            }
            Some((_, peak)) if value > peak => highest = Some((index, value)),
            Some(_) => {}
            None if value >= lowest + prominence => highest = Some((index, value)),
            None => lowest = lowest.min(value),
        }
    }
    peaks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stands_out_is_a_peak() {
        let count = |values: &[f64]| peaks(values.iter().copied(), 10.0).len();
        assert_eq!(count(&[0.0, 5.0, 12.0, 5.0, 0.0]), 1);
        assert_eq!(count(&[0.0, 30.0, 25.0, 31.0, 0.0]), 1, "a dip of 5");
        assert_eq!(count(&[0.0, 30.0, 19.0, 31.0, 0.0]), 2, "a dip of 11");
        assert_eq!(count(&[0.0, 9.0, 0.0, 9.0, 3.0]), 0);
        assert_eq!((count(&[40.0, 20.0]), count(&[])), (1, 0), "it was seen from the midst of a movement on");
        let (ahead, back) = ([3.0, 18.0, 9.0, 25.0, 14.0, 26.0, 2.0], [2.0, 26.0, 14.0, 25.0, 9.0, 18.0, 3.0]);
        assert_eq!((count(&ahead), count(&back)), (2, 2));
    }
}
