//! The time of a recording's frames, and how it is corrected. A file's time stamps can be wrong: a recorder states
//! another rate than it kept, or slow motion plays for longer than it was recorded. All times are then multiplied by one
//! factor before tracking, so that speeds and durations are right.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::named;
use super::text::Invalid;

/// Frame rates that may be given, Hz: time lapse below, high-speed cameras above are no recordings of training.
pub const FRAME_RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// Durations that may be given, s: no recording is longer than a day.
pub const DURATIONS_S: std::ops::RangeInclusive<f64> = 0.1..=86_400.0;

/// Largest factor between stamped and true times, and the inverse of the smallest. Slow motion of phones plays at up to
/// 32 times the true duration (960 frames a second at 30).
const MAX_FACTOR: f64 = 50.0;

/// Smallest ratio of capture rate to stamped rate (or its inverse) that is certainly slow motion or time lapse: slow motion
/// is 120 or 240 frames a second, played at 30 or less. A camera set to 60 that falls to 30 in the dark has the same tag,
/// true stamps, and a ratio of 2.
const MIN_CAPTURE_RATIO: f64 = 3.0;

/// Smallest ratio of capture rate to stamped rate that may be slow motion. A person has to decide.
const MIN_DOUBTFUL_RATIO: f64 = 1.8;

/// Largest difference of the mean interval of frames from the usual one, as a share, if a frame rate is to correct the
/// times. Where frames are dropped, or the rate changes, no single rate is true.
const MAX_UNEVENNESS: f64 = 0.02;

/// Intervals from the median by at most this factor are usual. Stamps in whole milliseconds vary by less, and a dropped
/// frame doubles the interval.
const USUAL_INTERVAL: f64 = 1.5;

/// A change of all times by a smaller factor than this changes no value that is shown.
const MIN_CHANGE: f64 = 1e-6;

named! {
    /// Where the time of a recording's frames comes from.
    ClockBasis: "basis" {
        /// The time stamps of the file, unchanged.
        Stamps = "stamps",
        /// The rate at which the recorder says that it captured: the stamps are those of slow motion or time lapse.
        CaptureRate = "capture_rate",
        /// The true frame rate, given by a person.
        FrameRate = "frame_rate",
        /// The true duration, given by a person.
        Duration = "duration",
    }
}

/// What a person knows about the true time of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeCorrection {
    /// The true frame rate, Hz.
    FrameRate(f64),
    /// The true time from the first frame to the last, s.
    Duration(f64),
}

/// The stamps of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StampFacts {
    /// Mean frame rate, Hz; `None` with fewer than two frames. The median interval would be 1 % off where 30 frames a second
    /// are stamped in whole milliseconds.
    pub rate_hz: Option<f64>,
    /// From the first frame to the last, s.
    pub duration_s: f64,
    /// True if frames are missing or the frame rate changes.
    pub is_uneven: bool,
}

/// How the times of a recording's frames were computed from its stamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RecordingClock {
    /// Where the times come from.
    pub basis: ClockBasis,
    /// Every time is the file's time, multiplied by this factor.
    pub factor: f64,
    /// The rate at which the recorder says that it captured, Hz; `null` if the file does not say it.
    pub capture_rate_hz: Option<f64>,
}

impl Default for RecordingClock {
    fn default() -> Self {
        Self { basis: ClockBasis::Stamps, factor: 1.0, capture_rate_hz: None }
    }
}

impl TimeCorrection {
    /// A correction as requested; `None` if neither number is given.
    ///
    /// # Errors
    /// Both numbers are given, or one is outside its limits.
    pub fn new(frame_rate_hz: Option<f64>, duration_s: Option<f64>) -> Result<Option<Self>, Invalid> {
        match (frame_rate_hz, duration_s) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) => {
                Err(Invalid::new("true_duration_s", "excludes `true_frame_rate_hz`: give one of them"))
            }
            (Some(rate), None) if FRAME_RATES_HZ.contains(&rate) => Ok(Some(Self::FrameRate(rate))),
            (Some(rate), None) => {
                let (low, high) = (FRAME_RATES_HZ.start(), FRAME_RATES_HZ.end());
                Err(Invalid::new("true_frame_rate_hz", format!("is {rate}; expected {low} to {high} frames a second")))
            }
            (None, Some(duration)) if DURATIONS_S.contains(&duration) => Ok(Some(Self::Duration(duration))),
            (None, Some(duration)) => {
                let (low, high) = (DURATIONS_S.start(), DURATIONS_S.end());
                Err(Invalid::new("true_duration_s", format!("is {duration}; expected {low} to {high} seconds")))
            }
        }
    }

    /// The factor that corrects these stamps.
    ///
    /// # Errors
    /// The factor cannot be computed or is implausible, or a frame rate is given for uneven stamps.
    pub fn factor(self, stamps: StampFacts) -> Result<f64, Invalid> {
        if stamps.is_uneven && matches!(self, Self::FrameRate(_)) {
            let why = "cannot correct this recording: frames are missing, or its frame rate changes. Give the true duration \
                       (`true_duration_s`), from the first frame to the last";
            return Err(Invalid::new("true_frame_rate_hz", why));
        }
        let (field, factor, stamped) = match self {
            Self::FrameRate(true_hz) => {
                let stamped = stamps.rate_hz.unwrap_or(f64::NAN);
                ("true_frame_rate_hz", stamped / true_hz, format!("{stamped:.2} frames a second"))
            }
            Self::Duration(true_s) => {
                let stamped = stamps.duration_s;
                ("true_duration_s", true_s / stamped, format!("{stamped:.2} s"))
            }
        };
        if is_plausible_factor(factor) {
            return Ok(factor);
        }
        let why = format!(
            "cannot be right: the file says {stamped}, and no recorder is wrong by more than {MAX_FACTOR} times"
        );
        Err(Invalid::new(field, why))
    }

    /// Its basis.
    pub fn basis(self) -> ClockBasis {
        match self {
            Self::FrameRate(_) => ClockBasis::FrameRate,
            Self::Duration(_) => ClockBasis::Duration,
        }
    }

    /// The true frame rate, Hz, if that was given.
    pub fn frame_rate_hz(self) -> Option<f64> {
        match self {
            Self::FrameRate(rate) => Some(rate),
            Self::Duration(_) => None,
        }
    }

    /// The true duration, s, if that was given.
    pub fn duration_s(self) -> Option<f64> {
        match self {
            Self::FrameRate(_) => None,
            Self::Duration(duration) => Some(duration),
        }
    }
}

impl RecordingClock {
    /// The clock of a recording without a person's correction: its stamps, or the capture rate if that shows slow motion or time
    /// lapse. `stated_hz` is the frame rate that the container states.
    pub fn of_file(stated_hz: Option<f64>, capture_rate_hz: Option<f64>) -> Self {
        let stamps = Self { capture_rate_hz, ..Self::default() };
        let Some((stated, captured)) = stated_hz.zip(capture_rate_hz) else { return stamps };
        let factor = stated / captured;
        let is_other_pace = factor.max(1.0 / factor) >= MIN_CAPTURE_RATIO && is_plausible_factor(factor);
        if is_other_pace { Self { basis: ClockBasis::CaptureRate, factor, capture_rate_hz } } else { stamps }
    }

    /// The clock by a person's correction of these stamps.
    ///
    /// # Errors
    /// As [`TimeCorrection::factor`].
    pub fn corrected(by: TimeCorrection, stamps: StampFacts, capture_rate_hz: Option<f64>) -> Result<Self, Invalid> {
        Ok(Self { basis: by.basis(), factor: by.factor(stamps)?, capture_rate_hz })
    }

    /// True if the times are the stamps, and the recorder says that it captured at clearly more than this stamped rate: slow
    /// motion, or a camera that fell to a lower rate in the dark.
    pub fn may_be_slow_motion(&self, stamped_hz: Option<f64>) -> bool {
        let ratio = self.capture_rate_hz.zip(stamped_hz).map(|(captured, stamped)| captured / stamped);
        self.basis == ClockBasis::Stamps && ratio.is_some_and(|ratio| ratio >= MIN_DOUBTFUL_RATIO)
    }

    /// True if an honest reader of a file can have found this clock.
    pub fn is_possible(&self) -> bool {
        let is_unchanged = (self.factor - 1.0).abs() < MIN_CHANGE;
        is_plausible_factor(self.factor)
            && self.capture_rate_hz.is_none_or(|rate| FRAME_RATES_HZ.contains(&rate))
            && (self.basis != ClockBasis::Stamps || is_unchanged)
    }
}

impl StampFacts {
    /// The facts of these times, s, which increase.
    pub fn of_times(times_s: &[f64]) -> Self {
        let duration_s = times_s.last().zip(times_s.first()).map_or(0.0, |(last, first)| last - first);
        let intervals = times_s.len().saturating_sub(1);
        let rate_hz = (duration_s > 0.0).then(|| intervals as f64 / duration_s);
        let is_uneven = usual_interval_s(times_s)
            .zip(rate_hz)
            .is_some_and(|(usual_s, rate_hz)| (usual_s * rate_hz - 1.0).abs() > MAX_UNEVENNESS);
        Self { rate_hz, duration_s, is_uneven }
    }

    /// The facts of the stamps behind corrected times.
    pub fn before(self, factor: f64) -> Self {
        Self { rate_hz: self.rate_hz.map(|rate| rate * factor), duration_s: self.duration_s / factor, ..self }
    }
}

/// Mean of the intervals that are near the median, s. The median itself is off where stamps are whole milliseconds.
fn usual_interval_s(times_s: &[f64]) -> Option<f64> {
    let mut intervals: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    intervals.sort_by(f64::total_cmp);
    let median = *intervals.get(intervals.len() / 2)?;
    let usual = median / USUAL_INTERVAL..=median * USUAL_INTERVAL;
    intervals.retain(|interval| usual.contains(interval));
    Some(intervals.iter().sum::<f64>() / intervals.len() as f64)
}

fn is_plausible_factor(factor: f64) -> bool {
    (1.0 / MAX_FACTOR..=MAX_FACTOR).contains(&factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAMPS: StampFacts = StampFacts { rate_hz: Some(15.0), duration_s: 82.0, is_uneven: false };

    #[test]
    fn a_true_rate_or_a_true_duration_gives_the_factor_of_all_times() {
        let factor = |by: TimeCorrection| by.factor(STAMPS).unwrap();
        assert!((factor(TimeCorrection::FrameRate(16.4)) - 15.0 / 16.4).abs() < 1e-12);
        assert!((factor(TimeCorrection::Duration(75.0)) - 75.0 / 82.0).abs() < 1e-12);
    }

    #[test]
    fn what_no_recorder_does_is_refused_with_the_field() {
        let field = |given: Result<_, Invalid>| given.map(|_: f64| ()).unwrap_err().what;
        assert_eq!(field(TimeCorrection::FrameRate(1000.0).factor(STAMPS)), "true_frame_rate_hz");
        assert_eq!(field(TimeCorrection::Duration(80_000.0).factor(STAMPS)), "true_duration_s");
        assert_eq!(field(TimeCorrection::FrameRate(30.0).factor(StampFacts::of_times(&[0.0]))), "true_frame_rate_hz");
        let new = |rate, duration| TimeCorrection::new(rate, duration).map_err(|invalid| invalid.what);
        assert_eq!(new(None, None), Ok(None));
        assert_eq!(new(Some(16.4), None), Ok(Some(TimeCorrection::FrameRate(16.4))));
        assert_eq!(new(None, Some(60.0)), Ok(Some(TimeCorrection::Duration(60.0))));
        assert_eq!(new(Some(16.4), Some(60.0)), Err("true_duration_s"));
        for rate in [0.0, -15.0, f64::NAN, f64::INFINITY] {
            assert_eq!(new(Some(rate), None), Err("true_frame_rate_hz"), "{rate}");
            assert_eq!(new(None, Some(rate)), Err("true_duration_s"), "{rate}");
        }
    }

    #[test]
    fn slow_motion_is_known_by_its_capture_rate_and_a_dark_room_is_not_slow_motion() {
        let basis = |stated, captured| RecordingClock::of_file(Some(stated), Some(captured)).basis;
        let slow = RecordingClock::of_file(Some(30.0), Some(240.0));
        assert_eq!((slow.basis, slow.factor), (ClockBasis::CaptureRate, 0.125));
        assert_eq!(basis(30.0, 120.0), ClockBasis::CaptureRate);
        assert_eq!(basis(30.0, 1.0), ClockBasis::CaptureRate, "time lapse");
        for (stated, captured) in [(17.0, 30.0), (24.0, 30.0), (29.97, 30.0), (30.0, 30.0), (30.0, 60.0), (24.0, 60.0)]
        {
            assert_eq!(basis(stated, captured), ClockBasis::Stamps, "{captured} at {stated}");
        }
        let is_doubtful =
            |stated, captured| RecordingClock::of_file(Some(stated), Some(captured)).may_be_slow_motion(Some(stated));
        assert!(is_doubtful(30.0, 60.0) && is_doubtful(24.0, 60.0));
        assert!(!is_doubtful(24.0, 30.0) && !is_doubtful(30.0, 240.0) && !is_doubtful(240.0, 240.0));
        assert_eq!(basis(240.0, 240.0), ClockBasis::Stamps);
        assert_eq!(basis(30.0, 0.001), ClockBasis::Stamps, "no factor that a recorder has");
        assert_eq!(RecordingClock::of_file(None, Some(240.0)).factor, 1.0);
    }

    #[test]
    fn facts_come_from_the_times_and_lead_back_through_the_factor() {
        let times: Vec<f64> = (0..=150).map(|n| f64::from(n) * 0.04).collect();
        let facts = StampFacts::of_times(&times);
        assert!((facts.rate_hz.unwrap() - 25.0).abs() < 1e-9 && (facts.duration_s - 6.0).abs() < 1e-9);
        let before = facts.before(0.5);
        assert!((before.rate_hz.unwrap() - 12.5).abs() < 1e-9 && (before.duration_s - 12.0).abs() < 1e-9);
        assert_eq!(StampFacts::of_times(&[]), StampFacts { rate_hz: None, duration_s: 0.0, is_uneven: false });
    }

    fn in_milliseconds(frames: impl Iterator<Item = u32>, rate_hz: f64) -> Vec<f64> {
        frames.map(|n| (f64::from(n) * 1000.0 / rate_hz).round() / 1000.0).collect()
    }

    #[test]
    fn stamps_in_whole_milliseconds_have_the_rate_of_the_frames() {
        for rate_hz in [15.0, 29.97, 30.0, 60.0, 120.0, 240.0] {
            let facts = StampFacts::of_times(&in_milliseconds(0..600, rate_hz));
            assert!((facts.rate_hz.unwrap() / rate_hz - 1.0).abs() < 1e-3 && !facts.is_uneven, "{facts:?}");
        }
    }

    #[test]
    fn a_frame_rate_is_refused_where_frames_are_missing_and_a_duration_is_not() {
        let dropped = StampFacts::of_times(&in_milliseconds((0..600).filter(|n| n % 20 != 7), 30.0));
        let darkened: Vec<f64> =
            (0..100).map(|n| f64::from(n) / 30.0).chain((0..80).map(|n| 3.4 + f64::from(n) / 15.0)).collect();
        for stamps in [dropped, StampFacts::of_times(&darkened)] {
            let refused = TimeCorrection::FrameRate(30.0).factor(stamps).unwrap_err();
            assert!(refused.what == "true_frame_rate_hz" && refused.why.contains("true_duration_s"), "{refused:?}");
            assert!(TimeCorrection::Duration(20.0).factor(stamps).is_ok());
        }
        let one_lost = StampFacts::of_times(&in_milliseconds((0..600).filter(|n| *n != 7), 30.0));
        assert!(TimeCorrection::FrameRate(30.0).factor(one_lost).is_ok());
    }

    #[test]
    fn a_clock_from_a_child_has_a_plausible_factor() {
        let clock = |basis, factor| RecordingClock { basis, factor, capture_rate_hz: None }.is_possible();
        assert!(clock(ClockBasis::Stamps, 1.0) && clock(ClockBasis::FrameRate, 0.9));
        assert!(!clock(ClockBasis::Stamps, 0.9) && !clock(ClockBasis::Duration, f64::NAN));
        assert!(!clock(ClockBasis::Duration, 1e6) && !clock(ClockBasis::Duration, 0.0));
    }
}
