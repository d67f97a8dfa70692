//! The rules: a closed list. Each rule names its features, the better side of the limit, the required kind of stretch,
//! and the advice. The page has its own texts, found by the rule's id (`static/texts/en.js`).

use crate::domain::evidence::{AbsenceCause, StretchRow};
use crate::domain::standard::Better;

/// A rule of advice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdviceRule {
    /// Stable id.
    pub id: &'static str,
    /// Features where lower values are better.
    pub lower: &'static [&'static str],
    /// Features where higher values are better.
    pub higher: &'static [&'static str],
    /// The kind of stretch that the rule needs, besides a missed limit.
    pub support: RequiredStretch,
    /// The advice, in one sentence.
    pub words: &'static str,
}

/// The kind of stretch that a rule can point at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequiredStretch {
    /// Any stretch with the tool in view.
    InView,
    /// An absence that the hand caused: the tool left the picture. Losses by the tracker are not the trainee's fault.
    LeftView,
}

/// All rules. No feature is in two rules.
pub const RULES: &[AdviceRule] = &[
    AdviceRule {
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
        support: RequiredStretch::InView,
        words: "Decide on the next step before the last one ends, so that the tools rest for less time.",
    },
    AdviceRule {
        id: "stop_less_often",
        lower: &["short_pauses", "short_pause_share"],
        higher: &[],
        support: RequiredStretch::InView,
        words: "Link one movement to the next instead of stopping for a moment between them.",
    },
    AdviceRule {
        id: "shorter_way",
        lower: &["path_length", "angular_path", "path_ratio", "fulcrum_path_ratio"],
        higher: &["economy_of_area", "economy_of_volume"],
        support: RequiredStretch::InView,
        words: "Go to the target by a shorter way.",
    },
    AdviceRule {
        id: "judge_depth",
        lower: &["depth_travelled", "insertion_travelled"],
        higher: &[],
        support: RequiredStretch::InView,
        words: "Judge the depth before you reach, so that the tool is not pushed in and pulled back on the way.",
    },
    AdviceRule {
        id: "stay_close",
        lower: &["working_area", "working_volume", "spread"],
        higher: &[],
        support: RequiredStretch::InView,
        words: "Keep the tip near the work.",
    },
    AdviceRule {
        id: "steady_hand",
        lower: &["jitter", "relative_jitter", "tremor_share", "motion_frequency"],
        higher: &[],
        support: RequiredStretch::InView,
        words: "Steady the hand: support the wrist and loosen the grip.",
    },
    AdviceRule {
        id: "flowing_movements",
        lower: &["smoothness", "median_curvature", "peak_curvature", "normalised_jerk"],
        higher: &["log_dimensionless_jerk", "spectral_arc_length"],
        support: RequiredStretch::InView,
        words: "Let each movement speed up once and slow down once.",
    },
    AdviceRule {
        id: "fewer_corrections",
        lower: &["movements", "submovements"],
        higher: &[],
        support: RequiredStretch::InView,
        words: "Reach the target in one movement instead of several small ones.",
    },
    AdviceRule {
        id: "both_hands",
        lower: &["one_hand_share"],
        higher: &["synchrony", "speed_balance", "together_share"],
        support: RequiredStretch::InView,
        words: "Let the other hand prepare the next step while this one works.",
    },
    AdviceRule {
        id: "stay_in_view",
        lower: &["left_view_share"], // the tracker may have caused a part of the other absences
        higher: &[],
        support: RequiredStretch::LeftView,
        words: "Keep the tip in the picture.",
    },
];

impl AdviceRule {
    /// True if the rule covers this feature with this side better.
    pub fn covers(&self, feature: &str, better: Better) -> bool {
        let features = if better == Better::Lower { self.lower } else { self.higher };
        features.contains(&feature)
    }

    /// True if the rule may point at this stretch.
    pub fn accepts_stretch(&self, stretch: &StretchRow) -> bool {
        match self.support {
            RequiredStretch::InView => stretch.cause.is_none(),
            RequiredStretch::LeftView => stretch.cause == Some(AbsenceCause::LeftView),
        }
    }
}
