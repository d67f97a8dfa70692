//! Why a feature has no value: said in words, never as a zero.

use std::fmt;

/// Why there was too little to measure a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotEnough {
    /// The tool was never seen, or never for long enough to follow its motion.
    NeverSeen,
    /// Seen for too short a time.
    TooShort {
        /// How long it was seen, s.
        observed_s: f64,
        /// How long it must be, s.
        needed_s: f64,
    },
    /// Seen for too small a share of the task.
    TooLittleSeen {
        /// Share in which it was seen, 0 to 1.
        share: f64,
        /// Share in which it must be.
        needed: f64,
    },
    /// Nothing moved.
    NoMovement,
    /// The feature is defined for discrete movements, and most of the motion is not made of such.
    MovementsTooLong {
        /// Share of the moving time that lies in short enough movements, 0 to 1.
        share: f64,
        /// Share that must.
        needed: f64,
    },
    /// The movements end where they began, so that there is no way to hold theirs against.
    ReturnsToStart,
    /// The path does not tell where the tool passes through the box's wall.
    NoFulcrum,
    /// Nobody knows why the tool was not seen: the path comes without the tracker's reasons.
    NoReasons,
    /// Too little was seen in one piece.
    NoStretch {
        /// How long a piece must be, s.
        needed_s: f64,
    },
    /// A feature of two hands, but not two tools.
    NotTwoTools {
        /// How many tools the trajectory has.
        found: usize,
    },
    /// A comparison with another tool, of which the same could not be measured.
    OtherTool,
    /// A position or time that is not a usable number, or rows that are not in time order.
    UnusableSamples,
    /// A setting that nothing can be measured with.
    UnusableSetting(&'static str),
    /// The whole session is refused: its quality says why.
    Refused,
    /// What came out lies outside the feature's valid range, so the path cannot have been a hand's.
    OutOfRange,
}

impl NotEnough {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            NotEnough::NeverSeen => "never_seen",
            NotEnough::TooShort { .. } => "too_short",
            NotEnough::TooLittleSeen { .. } => "too_little_seen",
            NotEnough::NoMovement => "no_movement",
            NotEnough::MovementsTooLong { .. } => "movements_too_long",
            NotEnough::ReturnsToStart => "returns_to_start",
            NotEnough::NoFulcrum => "no_fulcrum",
            NotEnough::NoReasons => "no_reasons",
            NotEnough::NoStretch { .. } => "no_stretch",
            NotEnough::NotTwoTools { .. } => "not_two_tools",
            NotEnough::OtherTool => "other_tool",
            NotEnough::UnusableSamples => "unusable_samples",
            NotEnough::UnusableSetting(_) => "unusable_setting",
            NotEnough::Refused => "refused",
            NotEnough::OutOfRange => "out_of_range",
        }
    }
}

impl fmt::Display for NotEnough {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NotEnough::NeverSeen => f.write_str("the tool was never seen for long enough to follow its motion"),
            NotEnough::TooShort { observed_s, needed_s } => {
                write!(f, "seen for {observed_s:.2} s; needs {needed_s} s")
            }
            NotEnough::TooLittleSeen { share, needed } => {
                write!(f, "seen for {:.0} % of the time; needs {:.0} %", 100.0 * share, 100.0 * needed)
            }
            NotEnough::NoMovement => f.write_str("nothing moved"),
            NotEnough::MovementsTooLong { share, needed } => write!(
                f,
                "{:.0} % of the motion is in short enough movements; needs {:.0} %",
                100.0 * share,
                100.0 * needed
            ),
            NotEnough::ReturnsToStart => f.write_str("the movements end where they began"),
            NotEnough::NoFulcrum => f.write_str("the path does not tell where its trocar is"),
            NotEnough::NoReasons => f.write_str("the path does not say why a tool was not seen"),
            NotEnough::NoStretch { needed_s } => {
                write!(f, "needs most of the seen time in stretches of {needed_s:.1} s without a gap")
            }
            NotEnough::NotTwoTools { found } => write!(f, "compares two tools; the trajectory has {found}"),
            NotEnough::OtherTool => f.write_str("the other tool's path could not be measured"),
            NotEnough::UnusableSamples => f.write_str("the samples are not finite numbers in time order"),
            NotEnough::UnusableSetting(name) => write!(f, "the setting {name} cannot be used"),
            NotEnough::Refused => f.write_str("the session is refused; its quality says why"),
            NotEnough::OutOfRange => f.write_str("the path is not one that a hand can make"),
        }
    }
}
