//! The rules: a closed list. Each rule names its features, the better side of the limit, the required kind of stretch,
//! and the advice. The page has its own texts, found by the rule's id (`static/texts/en.js`).

use crate::domain::evidence::{AbsenceCause, StretchRow};
use crate::domain::standard::Better;

/// A rule of advice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Stable id.
    pub id: &'static str,
    /// Features where lower values are better.
    pub lower: &'static [&'static str],
    /// Features where higher values are better.
    pub higher: &'static [&'static str],
    /// The kind of stretch that the rule needs, besides a missed limit.
    pub support: Support,
    /// The advice, in one sentence.
    pub words: &'static str,
}

/// The kind of stretch that a rule can point at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// Any stretch with the tool in view.
    Seen,
    /// An absence that the hand caused: the tool left the picture. Losses by the tracker are not the trainee's fault.
    LeftView,
}

/// All rules. No feature is in two rules.
pub const RULES: &[Rule] = &[
    Rule {
        id: "rest_less",
        lower: &[
            "duration",
            "idle_share",
            "thinking_time",
            "medium_pauses",
            "long_pauses",
            "medium_pause_share",
            "long_pause_share",
            "neither_share",
        ],
        higher: &[],
        support: Support::Seen,
        words: "Decide on the next step before the last one ends, so that the tools rest for less time.",
    },
    Rule {
        id: "stop_less_often",
        lower: &["short_pauses", "short_pause_share"],
        higher: &[],
        support: Support::Seen,
        words: "Link one movement to the next instead of stopping for a moment between them.",
    },
    Rule {
        id: "shorter_way",
        lower: &["path_length", "angular_path", "path_ratio", "fulcrum_path_ratio"],
        higher: &["economy_of_area", "economy_of_volume"],
        support: Support::Seen,
        words: "Go to the target by a shorter way.",
    },
    Rule {
        id: "judge_depth",
        lower: &["depth_travelled", "insertion_travelled"],
        higher: &[],
        support: Support::Seen,
        words: "Judge the depth before you reach, so that the tool is not pushed in and pulled back on the way.",
    },
    Rule {
        id: "stay_close",
        lower: &["working_area", "working_volume", "spread"],
        higher: &[],
        support: Support::Seen,
        words: "Keep the tip near the work.",
    },
    Rule {
        id: "steady_hand",
        lower: &["jitter", "relative_jitter", "tremor_share", "motion_frequency"],
        higher: &[],
        support: Support::Seen,
        words: "Steady the hand: support the wrist and loosen the grip.",
    },
    Rule {
        id: "flowing_movements",
        lower: &["smoothness", "median_curvature", "peak_curvature", "normalised_jerk"],
        higher: &["log_dimensionless_jerk", "spectral_arc_length"],
        support: Support::Seen,
        words: "Let each movement speed up once and slow down once.",
    },
    Rule {
        id: "fewer_corrections",
        lower: &["movements", "submovements"],
        higher: &[],
        support: Support::Seen,
        words: "Reach the target in one movement instead of several small ones.",
    },
    Rule {
        id: "both_hands",
        lower: &["one_hand_share"],
        higher: &["synchrony", "speed_balance", "together_share"],
        support: Support::Seen,
        words: "Let the other hand prepare the next step while this one works.",
    },
    Rule {
        id: "stay_in_view",
        lower: &["left_view_share"], // the tracker may have caused a part of the other absences
        higher: &[],
        support: Support::LeftView,
        words: "Keep the tip in the picture.",
    },
];

impl Rule {
    /// True if the rule covers this feature with this side better.
    pub fn speaks_of(&self, feature: &str, better: Better) -> bool {
        let features = if better == Better::Lower { self.lower } else { self.higher };
        features.contains(&feature)
    }

    /// True if the rule may point at this stretch.
    pub fn rests_on(&self, stretch: &StretchRow) -> bool {
        match self.support {
            Support::Seen => stretch.cause.is_none(),
            Support::LeftView => stretch.cause == Some(AbsenceCause::LeftView),
        }
    }
}
