//! Why a feature has no value. A missing value is stated as a reason, never as a zero.

use std::fmt;

/// Why there was too little to measure a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotEnough {
    /// The tool was never seen, or never for long enough to follow its motion.
    NeverSeen,
    /// The tool was seen for too short a time.
    TooShort {
        /// How long it was seen, s.
        observed_s: f64,
        /// How long it must be, s.
        needed_s: f64,
    },
    /// The tool was seen for too small a share of the task.
    TooLittleSeen {
        /// Seen share, 0 to 1.
        share: f64,
        /// Share that must be seen.
        needed: f64,
    },
    /// Nothing moved.
    NoMovement,
    /// The feature is defined for discrete movements, and most of the moving time lies in longer ones.
    MovementsTooLong {
        /// Share of the moving time that lies in short enough movements, 0 to 1.
        share: f64,
        /// Share that must lie in them.
        needed: f64,
    },
    /// The movements end where they began, so there is no direct way to compare them with.
    ReturnsToStart,
    /// The path does not determine where the tool passes through the box's wall.
    NoFulcrum,
    /// The reason why the tool was not seen is unknown: the path comes without the tracker's reasons.
    NoReasons,
    /// Too little was seen without a gap.
    NoStretch {
        /// How long a stretch without a gap must be, s.
        needed_s: f64,
    },
    /// The feature needs two tools, and the trajectory has another number.
    NotTwoTools {
        /// How many tools the trajectory has.
        found: usize,
    },
    /// The feature compares two tools, and the other tool could not be measured.
    OtherTool,
    /// A position or time that is not a usable number, or rows that are not in time order.
    UnusableSamples,
    /// The named setting has a value that no measurement can use.
    UnusableSetting(&'static str),
    /// The session was refused; its quality verdict gives the reason.
    Refused,
    /// The result lies outside the feature's valid range, so the path cannot be a hand's.
    OutOfRange,
}

/// The number without the sign of a zero: the sum of no durations is −0.
fn without_negative_zero(number: f64) -> f64 {
    number + 0.0
}

impl fmt::Display for NotEnough {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NotEnough::NeverSeen => f.write_str("the tool was never seen for long enough to follow its motion"),
            NotEnough::TooShort { observed_s, needed_s } => {
                write!(f, "seen for {:.2} s; needs {needed_s} s", without_negative_zero(*observed_s))
            }
            NotEnough::TooLittleSeen { share, needed } => {
                let seen = without_negative_zero(100.0 * share);
                write!(f, "seen for {seen:.0} % of the time; needs {:.0} %", 100.0 * needed)
            }
            NotEnough::NoMovement => f.write_str("nothing moved"),
            NotEnough::MovementsTooLong { share, needed } => write!(
                f,
                "{:.0} % of the moving time is in short enough movements; needs {:.0} %",
                without_negative_zero(100.0 * share),
                100.0 * needed
            ),
            NotEnough::ReturnsToStart => f.write_str("the movements end where they began"),
            NotEnough::NoFulcrum => f.write_str("the position of the trocar is unknown"),
            NotEnough::NoReasons => f.write_str("the path does not say why a tool was not seen"),
            NotEnough::NoStretch { needed_s } => {
                write!(f, "needs most of the seen time in stretches of {needed_s:.1} s without a gap")
            }
            NotEnough::NotTwoTools { found } => write!(f, "compares two tools; the trajectory has {found}"),
            NotEnough::OtherTool => f.write_str("the other tool's path could not be measured"),
            NotEnough::UnusableSamples => f.write_str("the samples are not finite numbers in time order"),
            NotEnough::UnusableSetting(name) => write!(f, "the setting {name} cannot be used"),
            NotEnough::Refused => f.write_str("the session was refused; see its quality"),
            NotEnough::OutOfRange => f.write_str("no hand can move like this path"),
        }
    }
}
