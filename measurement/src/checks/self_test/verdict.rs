//! The traffic light of a box: each part is compared with its limits; the worst part decides.

use super::advice::SelfTestAdvice;
use super::limits::{self, MAX_FOCAL_SIGMA, MIN_TOUCHES};
use super::{SelfTestFindings, Touch, TouchAccuracy, UnusableReason};
use crate::motion::quality::limits::QualityLimits;
use crate::motion::quality::{QualityCause, Severity};
use crate::vision::segmentation::palette::Margin;
use crate::vision::segmentation::palette::verdict::MIN_SHOWN_STEPS;

/// The result of a part or of the whole test, from best to worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Signal {
    /// All figures are within their limits.
    Green,
    /// A figure needs attention.
    Yellow,
    /// It could not be measured, so it is never green.
    NotMeasured,
    /// The box must be repaired before the next session.
    Red,
}

/// One part of the self-test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SelfTestPart {
    /// The tracker's error while a rod touches a corner.
    Accuracy,
    /// Whether camera and lens still match the calibration.
    Calibration,
    /// Whether the rod's trocar is where it was in the box's sessions. Reported only if both positions are known.
    Place,
    /// Whether the tapes' colours differ enough from everything else.
    Colours,
    /// Whether brightness and white stay constant.
    Lighting,
}

/// The result of one part, and the figure that decided it.
#[derive(Clone, Debug, PartialEq)]
pub struct PartVerdict {
    /// The part.
    pub part: SelfTestPart,
    /// Its signal.
    pub signal: Signal,
    /// The figure that decided; `None` if nothing was measured.
    pub figure: Option<f64>,
    /// The limit that the figure exceeded; for green, the limit that it kept.
    pub limit: Option<f64>,
    /// Unit of figure and limit.
    pub unit: &'static str,
    /// The finding, in one sentence.
    pub finding: String,
    /// What to do; `None` if there is nothing to do.
    pub advice: Option<SelfTestAdvice>,
}

/// A box's traffic light.
#[derive(Clone, Debug, PartialEq)]
pub struct SelfTestVerdict {
    /// The worst signal of all parts.
    pub signal: Signal,
    /// Every part that has a result, in the order of [`SelfTestPart`].
    pub parts: Vec<PartVerdict>,
}

/// Compares the findings with the limits; `calibration_rms_px` is the RMS error of the stored calibration's own photos,
/// if known.
pub fn judge(findings: &SelfTestFindings, calibration_rms_px: Option<f64>) -> SelfTestVerdict {
    let parts: Vec<PartVerdict> = [
        Some(accuracy(findings)),
        Some(calibration(findings, calibration_rms_px)),
        place(findings),
        (!findings.has_only_bare_tools).then(|| colours(findings)),
        Some(lighting(findings)),
    ]
    .into_iter()
    .flatten()
    .collect();
    let signal = parts.iter().map(|part| part.signal).max().unwrap_or(Signal::NotMeasured);
    SelfTestVerdict { signal, parts }
}

/// One figure with its limits.
struct LimitCheck {
    figure: f64,
    limits: QualityLimits,
    unit: &'static str,
    finding: String,
    advice: SelfTestAdvice,
}

impl LimitCheck {
    fn signal(&self) -> Signal {
        match self.limits.breach(self.figure) {
            None => Signal::Green,
            Some((Severity::Care, _)) => Signal::Yellow,
            Some((Severity::Refuse, _)) => Signal::Red,
        }
    }
}

/// The verdict of the worst check; without checks the part is not measured, with the given finding and advice.
fn worst(
    part: SelfTestPart,
    checks: Vec<LimitCheck>,
    unmeasured: impl FnOnce() -> (String, Option<SelfTestAdvice>),
) -> PartVerdict {
    let nothing = |(finding, advice)| PartVerdict {
        part,
        signal: Signal::NotMeasured,
        figure: None,
        limit: None,
        unit: "",
        finding,
        advice,
    };
    // The checks are ordered by importance, so among equally bad checks the first one decides.
    let deciding = checks.into_iter().rev().max_by_key(LimitCheck::signal);
    deciding.map_or_else(
        || nothing(unmeasured()),
        |check| {
            let signal = check.signal();
            PartVerdict {
                part,
                signal,
                figure: Some(check.figure),
                limit: check.limits.breach(check.figure).map(|(_, limit)| limit).or(check.limits.care),
                unit: check.unit,
                finding: check.finding,
                advice: (signal != Signal::Green).then_some(check.advice),
            }
        },
    )
}

fn accuracy(findings: &SelfTestFindings) -> PartVerdict {
    let check = findings.accuracy.as_ref().map(|a| LimitCheck {
        figure: a.rms_mm,
        limits: if a.is_as_stated() { limits::STATED_TOUCH_RMS_MM } else { limits::TOUCH_RMS_MM },
        unit: "mm",
        finding: format!(
            "{} touches: the measured tip is {:.2} mm off (RMS; {:.2} in depth, {:.2} sideways; at most {:.2}){}",
            a.touches,
            a.rms_mm,
            a.along_rms_mm,
            a.across_rms_mm,
            a.largest_mm,
            left_out(&findings.touches)
        ),
        advice: accuracy_advice(a),
    });
    worst(SelfTestPart::Accuracy, check.into_iter().collect(), || {
        let counted = findings.touches.iter().filter(|touch| touch.outcome.is_ok()).count();
        let finding = format!("{counted} touches can be used, {MIN_TOUCHES} are needed{}", left_out(&findings.touches));
        (finding, Some(SelfTestAdvice::HoldStill))
    })
}

fn accuracy_advice(a: &TouchAccuracy) -> SelfTestAdvice {
    const SHARED: f64 = 0.7;
    if a.along_mean_mm.abs() > SHARED * a.rms_mm { SelfTestAdvice::CheckRod } else { SelfTestAdvice::RepeatTouches }
}

/// Lists the rests that do not count, with the reasons.
fn left_out(touches: &[Touch]) -> String {
    let count = |why: UnusableReason| touches.iter().filter(|touch| touch.outcome.err() == Some(why)).count();
    let words = [
        (UnusableReason::BoardMoved, "the board was moved during the touch"),
        (UnusableReason::BoardNotSeen, "the whole board was not visible before and after the touch"),
        (
            UnusableReason::WrongWay,
            "the other end of the tape was taken for the tip; move the rod in over white squares",
        ),
        (UnusableReason::NoCornerNear, "the rod was not on a corner"),
        (UnusableReason::AboveBoard, "the rod was held above the board"),
    ];
    let each = words.into_iter().map(|(why, words)| (count(why), words)).filter(|(count, _)| *count > 0);
    each.map(|(count, words)| format!("; {count} not counted: {words}")).collect()
}

fn calibration(findings: &SelfTestFindings, own_rms_px: Option<f64>) -> PartVerdict {
    let rms_px = findings.placements.iter().map(|placement| placement.rms_px).reduce(f64::max);
    let board = rms_px.map(|figure| LimitCheck {
        figure,
        limits: limits::board_rms_px(own_rms_px),
        unit: "px",
        finding: format!("the board's corners are {figure:.2} px from where the stored calibration expects them (RMS)"),
        advice: SelfTestAdvice::Recalibrate,
    });
    let known = findings.focal_change.filter(|change| change.sigma <= MAX_FOCAL_SIGMA);
    let focal = known.map(|change| LimitCheck {
        figure: change.share.abs(),
        limits: limits::FOCAL_CHANGE,
        unit: "1",
        finding: format!(
            "the focal length differs from the stored calibration by {:+.2} ± {:.2} %, and so do all measured depths",
            100.0 * change.share,
            100.0 * change.sigma
        ),
        advice: SelfTestAdvice::Recalibrate,
    });
    worst(SelfTestPart::Calibration, board.into_iter().chain(focal).collect(), || {
        let reason =
            findings.board_reason.map_or_else(|| "no frame was searched".to_owned(), |reason| reason.to_string());
        let finding = format!("the whole board was never seen lying still ({reason})");
        (finding, Some(SelfTestAdvice::ShowBoard))
    })
}

/// `None` if the shift is unknown, as in a box without sessions, or if it may be just measurement error.
fn place(findings: &SelfTestFindings) -> Option<PartVerdict> {
    let known =
        findings.trocar_shift.filter(|shift| shift.is_significant() || limits::TROCAR_MM.breach(shift.mm).is_none());
    let check = known.map(|shift| LimitCheck {
        figure: shift.mm,
        limits: limits::TROCAR_MM,
        unit: "mm",
        finding: format!("the trocar is {:.0} ± {:.0} mm from its place in earlier sessions", shift.mm, shift.sigma_mm),
        advice: SelfTestAdvice::CheckPort,
    })?;
    Some(worst(SelfTestPart::Place, vec![check], Default::default))
}

/// Checks the colours as they were marked, and in today's picture. Without today's picture the part is not measured,
/// unless the marked colours are red.
fn colours(findings: &SelfTestFindings) -> PartVerdict {
    let today = findings.false_regions.iter().map(|(colour, of_tape)| LimitCheck {
        figure: *of_tape,
        limits: limits::FALSE_TAPE,
        unit: "tapes",
        finding: format!(
            "today a region of the empty box has the colour `{colour}`; it is {of_tape:.2} × as large as the tape"
        ),
        advice: SelfTestAdvice::ClearBox,
    });
    let largest = findings.false_regions.iter().map(|(_, of_tape)| *of_tape).reduce(f64::max);
    let mut part = worst(SelfTestPart::Colours, marked_colours(findings).into_iter().chain(today).collect(), || {
        ("the tapes' colours are not known".to_owned(), Some(SelfTestAdvice::MarkTapes))
    });
    match largest {
        Some(of_tape) if part.unit == "steps" => {
            part.finding += &match format!("{of_tape:.2}").as_str() {
                "0.00" => "; today nothing in the empty box has their colours".to_owned(),
                size => {
                    format!("; today the largest region of the empty box with one of these colours is {size} × a tape")
                }
            };
        }
        None if part.signal < Signal::NotMeasured => {
            part.signal = Signal::NotMeasured;
            part.finding += "; today the box was never seen with the board and without a tool";
            part.advice = Some(SelfTestAdvice::ClearView);
        }
        _ => {}
    }
    part
}

fn colour_finding(tool: &str, Margin { margin_steps, nearest, .. }: &Margin) -> String {
    match margin_steps {
        steps if *steps < MIN_SHOWN_STEPS => {
            format!("{tool}: when it was marked, its colour overlapped with that of `{nearest}`")
        }
        steps => format!("{tool}: when it was marked, its colour was {steps:.1} steps from `{nearest}`"),
    }
}

fn marked_colours(findings: &SelfTestFindings) -> Vec<LimitCheck> {
    let checks = findings.colours.iter().flat_map(|(tool, apart)| {
        let margins =
            [(QualityCause::ColourBackground, &apart.from_background), (QualityCause::ColourPair, &apart.from_tools)];
        margins.into_iter().filter_map(move |(cause, margin)| {
            let margin = margin.as_ref()?;
            Some(LimitCheck {
                figure: margin.margin_steps,
                limits: cause.limits(),
                unit: "steps",
                finding: colour_finding(tool, margin),
                advice: SelfTestAdvice::MarkInLight,
            })
        })
    });
    // The smallest margin comes first, so that it is the one reported among equally bad colours.
    let mut checks: Vec<LimitCheck> = checks.collect();
    checks.sort_by(|a, b| a.figure.total_cmp(&b.figure));
    checks
}

fn lighting(findings: &SelfTestFindings) -> PartVerdict {
    let exposure = findings.exposure_drift.map(|figure| LimitCheck {
        figure,
        limits: limits::exposure(),
        unit: "1",
        finding: format!("the brightness changes by {:.0} % during the test", 100.0 * figure),
        advice: SelfTestAdvice::HoldLight,
    });
    let white = findings.white_drift_codes.map(|figure| LimitCheck {
        figure,
        limits: limits::white(),
        unit: "codes",
        finding: format!("the white balance changes by {figure:.1} codes during the test"),
        advice: SelfTestAdvice::HoldLight,
    });
    worst(SelfTestPart::Lighting, exposure.into_iter().chain(white).collect(), || {
        ("the picture is too dark to compare".to_owned(), Some(SelfTestAdvice::SwitchLightOn))
    })
}
