//! The settings of the features: every threshold, with its unit and its source.

use super::attempt::MIN_TRAVEL_MM;

/// Settings of the features. A score is stored with [`Default`] unless a box overrides it. Two scores are comparable
/// only under the same settings.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureSettings {
    /// Spacing of the time grid that every path is measured on, s, for every camera frame rate. A smaller step costs
    /// time and gains nothing: hands move below 5 Hz. Usual 0.02.
    pub step_s: f64,
    /// Half width of the local fit that gives position, velocity and acceleration, s. A wider fit suppresses more noise
    /// and flattens fast motion (0.15 s passes 99 % of 1 Hz and 90 % of 3 Hz). Usual 0.1 to 0.2.
    pub fit_half_window_s: f64,
    /// Maximum stretch without an observation that is bridged, s. A longer one splits the path and counts as not seen.
    pub max_gap_s: f64,
    /// Minimum time that a tool must be seen within the task, or within a window, for a value, s.
    pub min_observed_s: f64,
    /// Minimum share of the task, or of a window, that a tool must be seen for a value. Below one half, sums such as
    /// the path length would describe the camera's view more than the hand's motion.
    pub min_seen_share: f64,
    /// Speed that a movement must reach, mm/s. The movement lasts while the speed stays above [`MOVEMENT_END_RATIO`] of
    /// it. A higher value ignores more of the tracker's noise and of slow work. Mean speeds of experts and novices in
    /// boxes are 9 to 23 mm/s.
    pub movement_speed_mm_s: f64,
    /// Minimum duration of a movement, s (PerkTutor: 0.2).
    pub movement_min_s: f64,
    /// Speed below this counts as thinking, mm/s (T 4.36; EndoViS: 5).
    pub thinking_speed_mm_s: f64,
    /// Minimum rest between movements that counts as idle, s. Shorter rests are turning points, not pauses.
    pub pause_min_s: f64,
    /// Minimum rest that counts as lost time rather than a look, s (AIMotion's tiers: 1 and 3).
    pub long_pause_s: f64,
    /// Spacing of the points along the path for the smoothness of T 4.38, mm. It is fixed because the value depends on
    /// it strongly: a smaller step picks up more noise.
    pub smoothness_step_mm: f64,
    /// Maximum duration of a movement for jerk and spectrum, s: both are defined for discrete movements.
    pub longest_movement_s: f64,
    /// Minimum share of the moving time in movements no longer than that, for their median to represent the whole.
    pub min_short_share: f64,
}

/// A movement ends where the speed falls below this share of [`FeatureSettings::movement_speed_mm_s`].
pub const MOVEMENT_END_RATIO: f64 = 0.7;

impl Default for FeatureSettings {
    fn default() -> Self {
        Self {
            step_s: 0.02,
            fit_half_window_s: 0.15,
            max_gap_s: 0.25,
            min_observed_s: 1.0,
            min_seen_share: 0.5,
            movement_speed_mm_s: 10.0,
            movement_min_s: 0.2,
            thinking_speed_mm_s: 5.0,
            pause_min_s: 1.0,
            long_pause_s: 3.0,
            smoothness_step_mm: 1.0,
            longest_movement_s: 10.0,
            min_short_share: 0.5,
        }
    }
}

impl FeatureSettings {
    /// The settings that descriptions of features quote, by the names that they use.
    pub(super) fn for_descriptions(&self) -> [(&'static str, f64); 10] {
        [
            ("movement_speed", self.movement_speed_mm_s),
            ("movement_end", MOVEMENT_END_RATIO * self.movement_speed_mm_s),
            ("movement_min", self.movement_min_s),
            ("min_travel", MIN_TRAVEL_MM),
            ("thinking_speed", self.thinking_speed_mm_s),
            ("pause_min", self.pause_min_s),
            ("long_pause", self.long_pause_s),
            ("max_gap", self.max_gap_s),
            ("smoothness_step", self.smoothness_step_mm),
            ("longest_movement", self.longest_movement_s),
        ]
    }

    /// The name of the first setting with an unusable value.
    pub fn unusable_setting(&self) -> Option<&'static str> {
        let positive = [
            ("fit_half_window_s", self.fit_half_window_s),
            ("min_observed_s", self.min_observed_s),
            ("movement_speed_mm_s", self.movement_speed_mm_s),
            ("movement_min_s", self.movement_min_s),
            ("thinking_speed_mm_s", self.thinking_speed_mm_s),
            ("pause_min_s", self.pause_min_s),
            ("long_pause_s", self.long_pause_s),
            ("longest_movement_s", self.longest_movement_s),
        ];
        let bad = positive.into_iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)).map(|(name, _)| name);
        bad.or((!(0.001..=0.1).contains(&self.step_s)).then_some("step_s"))
            .or((!(0.0..=1.0).contains(&self.min_seen_share)).then_some("min_seen_share"))
            .or((!(0.0..=1.0).contains(&self.min_short_share)).then_some("min_short_share"))
            .or((!(0.01..=100.0).contains(&self.smoothness_step_mm)).then_some("smoothness_step_mm"))
    }
}
