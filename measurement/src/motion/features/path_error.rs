//! How far off a session's lengths are, in space and in the picture, and which of the two comes first.
//!
//! **In:** the error bars of the tools' path lengths in both spaces. **Out:** [`PathError`]: by what share of itself
//! the length of all paths together may be off. One camera sees depth from size alone. Its errors change along the path
//! and lengthen it, so a poor depth shows here first. Across the line of sight a path is known better, and lengths in
//! the picture suffer only from the scale of the depth. **Gives up** (`None`) on paths that state no errors, and on
//! tools that hardly moved.

use super::{FeatureValue, Space, path};

/// In space, lengths that may be off by more than this share are no basis of a comparison: two sessions would have to
/// differ by 28 % (√2 times as much) before the difference exceeds their errors. On the eight recordings of the golden
/// files with a moving tool, tape of known length gave 8 to 15 %, and tape of unknown length 24 to 58 %.
const MAX_PATH_ERROR: f64 = 0.2;

/// The picture comes first only if it is better by this factor: shares of the same size are one error seen twice.
const MIN_GAIN: f64 = 1.5;

/// Length that all paths together need in the picture, mm: a shorter one is mostly errors.
const MIN_LENGTH_MM: f64 = 10.0;

/// By what share of itself the length of all paths of a session may be off: half the width of the error bar, divided by
/// the value, and 1 where the error is as large as the value or larger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathError {
    /// In three dimensions.
    pub three_d: f64,
    /// In the picture.
    pub image: f64,
}

/// The error bar of one tool's path length, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathBar {
    /// The space it was measured in.
    pub space: Space,
    /// The length.
    pub length: f64,
    /// Half the width of its error bar.
    pub half: f64,
}

impl PathError {
    /// From the error bars of all tools. The errors of two tools are added as if they had the same sign: both come from
    /// one camera.
    pub fn of_bars(bars: &[PathBar]) -> Option<Self> {
        let total = |space: Space| {
            let of_space = bars.iter().filter(|bar| bar.space == space);
            of_space.fold(None, |sum, bar| {
                let (length, half) = sum.unwrap_or((0.0, 0.0));
                Some((length + bar.length, half + bar.half))
            })
        };
        // In space, errors that were removed from the value may have left nothing of it.
        let share = |(length, half): (f64, f64)| if half < length { half / length } else { 1.0 };
        let (three_d, image) = (total(Space::ThreeD)?, total(Space::Image)?);
        (image.0 >= MIN_LENGTH_MM).then(|| Self { three_d: share(three_d), image: share(image) })
    }

    /// From a session's values.
    pub fn of_values(values: &[FeatureValue]) -> Option<Self> {
        let bar = |value: &FeatureValue| {
            let error = value.error.ok().filter(|_| *value.feature == path::PATH_LENGTH)?;
            Some(PathBar { space: value.space, length: value.value.ok()?, half: 0.5 * (error.high - error.low) })
        };
        Self::of_bars(&values.iter().filter_map(bar).collect::<Vec<_>>())
    }

    /// The space to compare the session in: the picture where depth is poor.
    pub fn better_space(self) -> Space {
        if self.three_d > MAX_PATH_ERROR && self.three_d > MIN_GAIN * self.image { Space::Image } else { Space::ThreeD }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bars(of_tools: &[[f64; 4]]) -> Vec<PathBar> {
        let of_tool = |[length, half, in_image, half_in_image]: &[f64; 4]| {
            [
                PathBar { space: Space::ThreeD, length: *length, half: *half },
                PathBar { space: Space::Image, length: *in_image, half: *half_in_image },
            ]
        };
        of_tools.iter().flat_map(of_tool).collect()
    }

    #[test]
    fn the_picture_comes_first_where_depth_is_poor_and_the_picture_is_better() {
        let first = |bar: [f64; 4]| PathError::of_bars(&bars(&[bar])).unwrap().better_space();
        assert_eq!(first([300.0, 45.0, 250.0, 12.0]), Space::ThreeD, "15 % in space");
        assert_eq!(first([300.0, 75.0, 250.0, 12.0]), Space::Image, "25 % in space, 5 % in the picture");
        assert_eq!(first([300.0, 75.0, 250.0, 50.0]), Space::ThreeD, "the picture is hardly better");
        assert_eq!(first([0.0, 90.0, 80.0, 12.0]), Space::Image, "errors alone explain the length in space");
    }

    #[test]
    fn a_resting_tool_beside_a_moving_one_does_not_decide() {
        let error = PathError::of_bars(&bars(&[[300.0, 30.0, 250.0, 12.0], [1.0, 6.0, 0.5, 2.0]])).unwrap();
        assert!((error.three_d - 36.0 / 301.0).abs() < 1e-12 && error.better_space() == Space::ThreeD, "{error:?}");
    }

    #[test]
    fn tools_that_hardly_moved_and_values_of_one_space_say_nothing() {
        assert_eq!(PathError::of_bars(&bars(&[[3.0, 3.0, 2.0, 1.0]])), None);
        assert_eq!(PathError::of_bars(&bars(&[[300.0, 75.0, 250.0, 12.0]])[..1]), None, "a result without the picture");
        assert_eq!(PathError::of_bars(&[]), None);
    }
}
