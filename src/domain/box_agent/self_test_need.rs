//! Whether a box needs a self-test before the next exam: its camera has moved, or its light has changed, since it was
//! calibrated or tested.

use crate::checks::self_test::limits;
use crate::domain::named;

use super::state::LightState;

named! {
    /// Why a box needs a self-test.
    SelfTestReason: "reason for a self-test" {
        /// A recording since the calibration or the last self-test shows that the camera has moved.
        CameraMoved = "camera_moved",
        /// The picture is much brighter or darker than after the calibration or the last self-test.
        LightChanged = "light_changed",
    }
}

/// The reasons for a self-test of a box. `camera_moved`: a recording says so. `light`: the box's light now, if its agent
/// reports it. The light counts beyond the limit at which a self-test would be red, since mats and tools change the
/// brightness of the picture as well; a box whose light is as before needs no test.
pub fn reasons(camera_moved: bool, light: Option<LightState>) -> Vec<SelfTestReason> {
    let has_changed = |ratio: f64| limits::exposure().refuse.is_some_and(|limit| (ratio - 1.0).abs() > limit);
    let light_changed = light.and_then(|light| light.ratio).is_some_and(has_changed);
    let reasons =
        [(camera_moved, SelfTestReason::CameraMoved), (light_changed, SelfTestReason::LightChanged)].into_iter();
    reasons.filter_map(|(holds, reason)| holds.then_some(reason)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_asks_for_a_test_beyond_the_red_limit_of_the_self_test() {
        let light = |ratio| Some(LightState { level: 100.0, ratio });
        for (ratio, expected) in [(Some(1.0), 0), (Some(1.39), 0), (Some(0.61), 0), (Some(1.41), 1), (Some(0.2), 1)] {
            assert_eq!(reasons(false, light(ratio)).len(), expected, "{ratio:?}");
        }
        assert_eq!(reasons(false, light(None)), []);
        assert_eq!(reasons(true, None), [SelfTestReason::CameraMoved]);
        assert_eq!(reasons(true, light(Some(2.0))), [SelfTestReason::CameraMoved, SelfTestReason::LightChanged]);
    }
}
