//! How features are measured: every threshold, with its unit and its source.

/// Settings of the features. [`Default`] is what is stored with a score unless a box says otherwise; two scores are
/// comparable only under the same settings.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureSettings {
    /// Spacing of the time grid on which every path is measured, s, whatever the camera's frame rate. Smaller costs
    /// time and gains nothing: hands move below 5 Hz. Usual 0.02.
    pub step_s: f64,
    /// Half width of the local fit that gives position, velocity and acceleration, s. Wider suppresses more noise and
    /// flattens fast motion (0.15 s passes 99 % of 1 Hz and 90 % of 3 Hz). Usual 0.1 to 0.2.
    pub fit_half_window_s: f64,
    /// Longest stretch without an observation that is bridged, s; a longer one splits the path and counts as not seen.
    pub max_gap_s: f64,
    /// Least time a tool must be seen within the task, or within a window, before a value is given, s.
    pub min_observed_s: f64,
    /// Least share of the task, or of a window, in which a tool must be seen before a value is given. Below one half,
    /// sums such as the path's length would describe what the camera saw more than what the hand did.
    pub min_seen_share: f64,
    /// Speed that a movement must reach, mm/s. It lasts while the speed stays above [`MOVEMENT_END_RATIO`] of it.
    /// More ignores more of the tracker's noise and of slow work. Expert and novice means are 9 to 23 mm/s in boxes.
    pub movement_speed_mm_s: f64,
    /// Shortest movement, s (PerkTutor: 0.2).
    pub movement_min_s: f64,
    /// Speed below which a hand is thinking, mm/s (T 4.36; EndoViS: 5).
    pub thinking_speed_mm_s: f64,
    /// Shortest rest between movements that counts as idle, s. Shorter ones are turning points, not pauses.
    pub pause_min_s: f64,
    /// Shortest rest that is time lost rather than a look, s (AIMotion's tiers: 1 and 3).
    pub long_pause_s: f64,
    /// Spacing of the points along the path from which T 4.38's smoothness is taken, mm. The value depends on it
    /// strongly, so it is fixed: a smaller step sees more of the noise.
    pub smoothness_step_mm: f64,
    /// Longest movement whose jerk and spectrum mean anything, s: both are defined for discrete movements.
    pub longest_movement_s: f64,
    /// Least share of the moving time that must lie in movements no longer than that, before their median speaks for
    /// the whole.
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
    /// The first setting that nothing can be measured with, by name.
    pub fn unusable(&self) -> Option<&'static str> {
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
