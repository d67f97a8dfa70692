//! Habits: what a trainee can change about a feature.

/// What a trainee can change about a feature whose value is on the worse side of a limit. The worse side is that of
/// [`super::Feature::direction`]; for a feature without a direction it is the high side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Habit {
    /// The tools rest for too long.
    RestLess,
    /// The tools stop briefly between movements.
    StopLessOften,
    /// The tip takes a detour.
    ShorterWay,
    /// The tool is pushed in and pulled back on the way.
    JudgeDepth,
    /// The tip moves far from the work.
    StayClose,
    /// The hand trembles.
    SteadyHand,
    /// The speed changes more than a movement needs.
    FlowingMovements,
    /// The target is reached in several movements.
    FewerCorrections,
    /// One hand waits for the other.
    BothHands,
    /// The tool leaves the picture.
    StayInView,
}

impl Habit {
    /// Stable name for the API and the pages.
    pub fn name(self) -> &'static str {
        match self {
            Habit::RestLess => "rest_less",
            Habit::StopLessOften => "stop_less_often",
            Habit::ShorterWay => "shorter_way",
            Habit::JudgeDepth => "judge_depth",
            Habit::StayClose => "stay_close",
            Habit::SteadyHand => "steady_hand",
            Habit::FlowingMovements => "flowing_movements",
            Habit::FewerCorrections => "fewer_corrections",
            Habit::BothHands => "both_hands",
            Habit::StayInView => "stay_in_view",
        }
    }
}
