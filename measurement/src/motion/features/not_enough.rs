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

/// A stored reason, in a form that can be said in any language.
#[derive(Clone, Debug, PartialEq)]
pub struct StatedReason {
    /// Its stable name.
    pub code: &'static str,
    /// Its numbers, in the order of the sentence; shares in per cent.
    pub numbers: Vec<f64>,
}

/// The sentences of [`NotEnough`], with `#` for a number and `*` for a name. Results store the sentence, so that a table or
/// a file can be read without this program; those of earlier versions of the program have no code.
const SENTENCES: [(&str, &str); 15] = [
    ("never_seen", "the tool was never seen for long enough to follow its motion"),
    ("too_short", "seen for # s; needs # s"),
    ("too_little_seen", "seen for # % of the time; needs # %"),
    ("no_movement", "nothing moved"),
    ("movements_too_long", "# % of the moving time is in short enough movements; needs # %"),
    ("returns_to_start", "the movements end where they began"),
    ("no_fulcrum", "the position of the trocar is unknown"),
    ("no_reasons", "the path does not say why a tool was not seen"),
    ("no_stretch", "needs most of the seen time in stretches of # s without a gap"),
    ("not_two_tools", "compares two tools; the trajectory has #"),
    ("other_tool", "the other tool's path could not be measured"),
    ("unusable_samples", "the samples are not finite numbers in time order"),
    ("unusable_setting", "the setting * cannot be used"),
    ("refused", "the session was refused; see its quality"),
    ("out_of_range", "no hand can move like this path"),
];

impl StatedReason {
    /// The reason that a result states in words; `None` if no version of this program has said so.
    pub fn of(sentence: &str) -> Option<Self> {
        SENTENCES.iter().find_map(|(code, form)| Some(Self { code, numbers: numbers_in(form, sentence)? }))
    }
}

/// The numbers of a sentence of this form.
fn numbers_in(form: &str, sentence: &str) -> Option<Vec<f64>> {
    let mut numbers = Vec::new();
    let mut rest = sentence;
    let mut form = form;
    while let Some(at) = form.find(['#', '*']) {
        let (before, after) = (&form[..at], &form[at + 1..]);
        rest = rest.strip_prefix(before)?;
        let next = after.find(['#', '*']).map_or(after, |next| &after[..next]);
        let end = if next.is_empty() { rest.len() } else { rest.find(next)? };
        if form[at..].starts_with('#') {
            numbers.push(rest[..end].parse().ok()?);
        }
        (rest, form) = (&rest[end..], after);
    }
    (rest == form).then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sentence_has_one_code_and_keeps_its_numbers() {
        let all = [
            (NotEnough::NeverSeen, vec![]),
            (NotEnough::TooShort { observed_s: 0.5, needed_s: 2.0 }, vec![0.5, 2.0]),
            (NotEnough::TooLittleSeen { share: 0.42, needed: 0.9 }, vec![42.0, 90.0]),
            (NotEnough::NoMovement, vec![]),
            (NotEnough::MovementsTooLong { share: 0.1, needed: 0.5 }, vec![10.0, 50.0]),
            (NotEnough::ReturnsToStart, vec![]),
            (NotEnough::NoFulcrum, vec![]),
            (NotEnough::NoReasons, vec![]),
            (NotEnough::NoStretch { needed_s: 4.0 }, vec![4.0]),
            (NotEnough::NotTwoTools { found: 3 }, vec![3.0]),
            (NotEnough::OtherTool, vec![]),
            (NotEnough::UnusableSamples, vec![]),
            (NotEnough::UnusableSetting("thinking_speed"), vec![]),
            (NotEnough::Refused, vec![]),
            (NotEnough::OutOfRange, vec![]),
        ];
        for ((reason, numbers), (code, _)) in all.iter().zip(SENTENCES) {
            let stated = StatedReason::of(&reason.to_string());
            assert_eq!(stated, Some(StatedReason { code, numbers: numbers.clone() }), "{reason}");
        }
    }

    #[test]
    fn other_sentences_have_no_code() {
        for sentence in ["", "seen for long", "seen for x s; needs 2 s", "nothing moved at all", "too few"] {
            assert_eq!(StatedReason::of(sentence), None, "{sentence}");
        }
    }
}
