//! The rules: a closed list, one for each habit. Each rule names the required kind of stretch and the advice. A
//! page translates the advice by the habit's name (`static/texts/de.js`).

use crate::domain::evidence::{AbsenceCause, StretchRow};
use crate::domain::standard::Better;
use crate::motion::features::{Direction, Feature, Habit};

/// A rule of advice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdviceRule {
    /// The habit that it advises on.
    pub habit: Habit,
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

/// All rules.
pub const RULES: &[AdviceRule] = &[
    AdviceRule {
        habit: Habit::RestLess,
        support: RequiredStretch::InView,
        words: "Decide on the next step before the last one ends, so that the tools rest for less time.",
    },
    AdviceRule {
        habit: Habit::StopLessOften,
        support: RequiredStretch::InView,
        words: "Link one movement to the next instead of stopping for a moment between them.",
    },
    AdviceRule {
        habit: Habit::ShorterWay,
        support: RequiredStretch::InView,
        words: "Go to the target by a shorter way.",
    },
    AdviceRule {
        habit: Habit::JudgeDepth,
        support: RequiredStretch::InView,
        words: "Judge the depth before you reach, so that the tool is not pushed in and pulled back on the way.",
    },
    AdviceRule { habit: Habit::StayClose, support: RequiredStretch::InView, words: "Keep the tip near the work." },
    AdviceRule {
        habit: Habit::SteadyHand,
        support: RequiredStretch::InView,
        words: "Steady the hand: support the wrist and loosen the grip.",
    },
    AdviceRule {
        habit: Habit::FlowingMovements,
        support: RequiredStretch::InView,
        words: "Let each movement speed up once and slow down once.",
    },
    AdviceRule {
        habit: Habit::FewerCorrections,
        support: RequiredStretch::InView,
        words: "Reach the target in one movement instead of several small ones.",
    },
    AdviceRule {
        habit: Habit::BothHands,
        support: RequiredStretch::InView,
        words: "Let the other hand prepare the next step while this one works.",
    },
    AdviceRule { habit: Habit::StayInView, support: RequiredStretch::LeftView, words: "Keep the tip in the picture." },
];

impl AdviceRule {
    /// True if the rule covers this feature with this side better.
    pub fn covers(&self, feature: &Feature, better: Better) -> bool {
        let side = if feature.direction == Direction::Higher { Better::Higher } else { Better::Lower };
        feature.habit == Some(self.habit) && side == better
    }

    /// True if the rule may point at this stretch.
    pub fn accepts_stretch(&self, stretch: &StretchRow) -> bool {
        match self.support {
            RequiredStretch::InView => stretch.cause.is_none(),
            RequiredStretch::LeftView => stretch.cause == Some(AbsenceCause::LeftView),
        }
    }
}
