//! Families of features: the headings of the long feature list.

/// What a feature describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Family {
    /// Duration, and how much of it was rest.
    Time,
    /// Speed, and how unsteady it is.
    Speed,
    /// Length of the path and the space that it takes up.
    Path,
    /// Smoothness of the motion.
    Smoothness,
    /// Number of movements, and how straight each is.
    Movements,
    /// How both hands work together.
    TwoHands,
    /// How long a tool was not seen, and why.
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
    /// Additional standard deviation as a share of the value, for errors that no replicate of the path reproduces:
    /// quick motions that the smoother flattened, and counts at a threshold. Set so that the bars held on six simulated
    /// people.
    pub(super) fn extra_sigma_share(self) -> f64 {
        match self {
            Family::Path | Family::TwoHands | Family::View => 0.02,
            Family::Time | Family::Speed => 0.05,
            Family::Smoothness => 0.08,
            Family::Movements => 0.2,
        }
    }
}
