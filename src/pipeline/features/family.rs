//! Families of features: what a long list is read by.

/// What a feature tells about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Family {
    /// How long, and how much of it at rest.
    Time,
    /// How fast, and how unsteadily so.
    Speed,
    /// How far, through how much room, by which way.
    Path,
    /// How smoothly.
    Smoothness,
    /// In how many movements, and how straight each.
    Movements,
    /// How both hands work together.
    TwoHands,
    /// How much was not seen, and why.
    View,
}

impl Family {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Family::Time => "time",
            Family::Speed => "speed",
            Family::Path => "path",
            Family::Smoothness => "smoothness",
            Family::Movements => "movements",
            Family::TwoHands => "two_hands",
            Family::View => "view",
        }
    }
    /// So much of a value, as a standard deviation, may hang on what no replicate of the path brings back: quick motions that
    /// the smoother flattened, and counts at a threshold. Set so that the bars held on six simulated people.
    pub(super) fn beyond_replicates(self) -> f64 {
        match self {
            Family::Path | Family::TwoHands | Family::View => 0.02,
            Family::Time | Family::Speed => 0.05,
            Family::Smoothness => 0.08,
            Family::Movements => 0.2,
        }
    }
}
