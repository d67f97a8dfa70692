//! The traffic light of a box: each part against its limits; the worst of them is the box's.

use super::limits::{self, FEWEST_TOUCHES, FOCAL_SIGMA};
use super::{Accuracy, Findings, Touch, Unusable};
use crate::pipeline::quality::limits::Limits;
use crate::pipeline::quality::{Cause, Severity};

/// How something stands; the worse the later.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Signal {
    /// As it should be.
    Green,
    /// To be watched.
    Yellow,
    /// It could not be told: never green.
    NotMeasured,
    /// To be mended before anybody is measured.
    Red,
}

impl Signal {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Signal::Green => "green",
            Signal::Yellow => "yellow",
            Signal::NotMeasured => "not_measured",
            Signal::Red => "red",
        }
    }
}

/// What is tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Where the tracker sees a rod that touches a corner.
    Accuracy,
    /// Whether camera and lens are still those that were calibrated.
    Calibration,
    /// Whether the rod's trocar is where the box's sessions had it. Told only where both are known.
    Place,
    /// Whether the tapes can be told from all else.
    Colours,
    /// Whether brightness and white stay.
    Lighting,
}

impl Part {
    /// Every part, in the order in which people should read them.
    pub const ALL: [Part; 5] = [Part::Accuracy, Part::Calibration, Part::Place, Part::Colours, Part::Lighting];

    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Part::Accuracy => "accuracy",
            Part::Calibration => "calibration",
            Part::Place => "place",
            Part::Colours => "colours",
            Part::Lighting => "lighting",
        }
    }
}

/// How one part stands, and by which figure.
#[derive(Clone, Debug, PartialEq)]
pub struct PartVerdict {
    /// Which.
    pub part: Part,
    /// How it stands.
    pub signal: Signal,
    /// The figure that decided, if anything was measured.
    pub figure: Option<f64>,
    /// The limit that it broke; of a green one, the limit that it kept.
    pub limit: Option<f64>,
    /// Unit of both.
    pub unit: &'static str,
    /// What was found, in one sentence.
    pub finding: String,
    /// What to do about it; empty where there is nothing to do.
    pub advice: &'static str,
}

/// A box's traffic light.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The worst of its parts.
    pub signal: Signal,
    /// Every part that there is something to say of, in [`Part::ALL`]'s order.
    pub parts: Vec<PartVerdict>,
}

/// Holds findings against the limits; `calibration_rms_px` is what the stored camera's own photos left, where it says so.
pub fn judge(findings: &Findings, calibration_rms_px: Option<f64>) -> Verdict {
    let parts: Vec<PartVerdict> = [
        Some(accuracy(findings)),
        Some(calibration(findings, calibration_rms_px)),
        place(findings),
        Some(colours(findings)),
        Some(lighting(findings)),
    ]
    .into_iter()
    .flatten()
    .collect();
    let signal = parts.iter().map(|part| part.signal).max().unwrap_or(Signal::NotMeasured);
    Verdict { signal, parts }
}

/// One figure against its limits.
struct Check {
    figure: f64,
    limits: Limits,
    unit: &'static str,
    finding: String,
    advice: &'static str,
}

impl Check {
    fn signal(&self) -> Signal {
        match self.limits.breach(self.figure) {
            None => Signal::Green,
            Some((Severity::Care, _)) => Signal::Yellow,
            Some((Severity::Refuse, _)) => Signal::Red,
        }
    }
}

/// The worst of some checks; without any, not measured for this reason.
fn worst(part: Part, checks: Vec<Check>, unmeasured: impl FnOnce() -> (String, &'static str)) -> PartVerdict {
    let nothing = |(finding, advice)| PartVerdict {
        part,
        signal: Signal::NotMeasured,
        figure: None,
        limit: None,
        unit: "",
        finding,
        advice,
    };
    // Of those that stand alike the first counts: they are given in the order in which they matter.
    let deciding = checks.into_iter().rev().max_by_key(Check::signal);
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
                advice: if signal == Signal::Green { "" } else { check.advice },
            }
        },
    )
}

fn accuracy(findings: &Findings) -> PartVerdict {
    let check = findings.accuracy.as_ref().map(|a| Check {
        figure: a.rms_mm,
        limits: limits::TOUCH_RMS_MM,
        unit: "mm",
        finding: format!(
            "{} touches are {:.2} mm off (RMS; {:.2} along the line of sight, {:.2} across; at most {:.2}){}",
            a.touches,
            a.rms_mm,
            a.along_rms_mm,
            a.across_rms_mm,
            a.largest_mm,
            left_out(&findings.touches)
        ),
        advice: accuracy_advice(a),
    });
    worst(Part::Accuracy, check.into_iter().collect(), || {
        let counted = findings.touches.iter().filter(|touch| touch.outcome.is_ok()).count();
        let finding =
            format!("{counted} touches count, of {FEWEST_TOUCHES} that are needed{}", left_out(&findings.touches));
        (
            finding,
            "hold the rod's end on six corners of the board, still for 2 s each, and do not move the board meanwhile",
        )
    })
}

fn accuracy_advice(a: &Accuracy) -> &'static str {
    const SHARED: f64 = 0.7;
    if a.along_mean_mm.abs() > SHARED * a.rms_mm {
        "all touches are off to the same side in depth: check that the rod has the diameter and the tape the length that \
         the box's colours state, and that the tape ends at the rod's end; then calibrate again"
    } else {
        "repeat the touches with care; if they stay off, calibrate the camera again with about 20 photos"
    }
}

/// The rests that do not count, and why.
fn left_out(touches: &[Touch]) -> String {
    let count = |why: Unusable| touches.iter().filter(|touch| touch.outcome.err() == Some(why)).count();
    let words = [
        (Unusable::BoardMoved, "the board was moved meanwhile"),
        (Unusable::BoardNotSeen, "the board was not seen whole before and after"),
        (Unusable::WrongWay, "the tape's other end was taken for the tip; bring the rod into sight over light squares"),
        (Unusable::NoCornerNear, "no corner is near"),
        (Unusable::AboveBoard, "the tool waited above the board"),
    ];
    let each = words.into_iter().map(|(why, words)| (count(why), words)).filter(|(count, _)| *count > 0);
    each.map(|(count, words)| format!("; {count} not counted: {words}")).collect()
}

fn calibration(findings: &Findings, own_rms_px: Option<f64>) -> PartVerdict {
    const AGAIN: &str = "look whether the lens's zoom or focus was turned or the picture's size changed, and calibrate the camera again";
    let rms_px = findings.placements.iter().map(|placement| placement.rms_px).reduce(f64::max);
    let board = rms_px.map(|figure| Check {
        figure,
        limits: limits::board_rms_px(own_rms_px),
        unit: "px",
        finding: format!("the board's corners are {figure:.2} px from where the stored camera expects them (RMS)"),
        advice: AGAIN,
    });
    let known = findings.focal_change.filter(|change| change.sigma <= FOCAL_SIGMA);
    let focal = known.map(|change| Check {
        figure: change.share.abs(),
        limits: limits::FOCAL_CHANGE,
        unit: "1",
        finding: format!(
            "the focal length seems to be {:+.2} ± {:.2} % off the stored camera's; so are all depths",
            100.0 * change.share,
            100.0 * change.sigma
        ),
        advice: AGAIN,
    });
    worst(Part::Calibration, board.into_iter().chain(focal).collect(), || {
        let reason =
            findings.board_reason.map_or_else(|| "no frame was searched".to_owned(), |reason| reason.to_string());
        let finding = format!("the board was never seen whole and still ({reason})");
        (finding, "lay the board the box was calibrated with into the picture, whole, for 3 s without a tool in sight")
    })
}

/// `None` where nobody knows, and where the shift may be its own error: a box that has no sessions yet is none the worse.
fn place(findings: &Findings) -> Option<PartVerdict> {
    let told = findings.trocar_shift.filter(|shift| shift.is_sure() || limits::TROCAR_MM.breach(shift.mm).is_none());
    let check = told.map(|shift| Check {
        figure: shift.mm,
        limits: limits::TROCAR_MM,
        unit: "mm",
        finding: format!("the trocar lies {:.0} ± {:.0} mm from where sessions had it", shift.mm, shift.sigma_mm),
        advice: "if the rod came through another port than tools do, all is well; else the camera has moved since it was \
                 calibrated: put it back",
    })?;
    Some(worst(Part::Place, vec![check], Default::default))
}

/// As they were marked, and in today's picture. Without the second the light is not known, unless the first is red.
fn colours(findings: &Findings) -> PartVerdict {
    const CLEAR: &str = "take what has the tape's colour out of the box, and hold the light as it was; if it stays, mark the \
                         tapes again or take other tape (`trocar palette --advise`)";
    let today = findings.false_regions.iter().map(|(colour, of_tape)| Check {
        figure: *of_tape,
        limits: limits::FALSE_TAPE,
        unit: "tapes",
        finding: format!(
            "today a region of the empty box, {of_tape:.2} × as large as the tape, has the colour `{colour}`"
        ),
        advice: CLEAR,
    });
    let largest = findings.false_regions.iter().map(|(_, of_tape)| *of_tape).reduce(f64::max);
    let mut part = worst(Part::Colours, marked_colours(findings).into_iter().chain(today).collect(), || {
        ("nothing is known of the tapes' colours".to_owned(), "mark the tapes again")
    });
    match largest {
        Some(of_tape) if part.unit == "steps" => {
            part.finding += &match format!("{of_tape:.2}").as_str() {
                "0.00" => "; today nothing in the empty box has their colours".to_owned(),
                size => format!("; today the largest region of the empty box that has one of them is {size} × a tape"),
            };
        }
        None if part.signal < Signal::NotMeasured => {
            part.signal = Signal::NotMeasured;
            part.finding += "; today the box was never seen with the board and without a tool";
            part.advice = "lay the board into the picture, and keep tools and hands out of it for 3 s";
        }
        _ => {}
    }
    part
}

fn marked_colours(findings: &Findings) -> Vec<Check> {
    const OTHER_TAPE: &str =
        "mark the tapes again in today's light; if it stays, take other tape (`trocar palette --advise`)";
    let checks = findings.colours.iter().flat_map(|(tool, apart)| {
        let margins = [(Cause::ColourBackground, &apart.from_background), (Cause::ColourPair, &apart.from_tools)];
        margins.into_iter().filter_map(move |(cause, margin)| {
            let margin = margin.as_ref()?;
            Some(Check {
                figure: margin.margin_steps,
                limits: cause.limits(),
                unit: "steps",
                finding: format!(
                    "{tool}: as it was marked, its colour is {:.1} steps from `{}`",
                    margin.margin_steps, margin.nearest
                ),
                advice: OTHER_TAPE,
            })
        })
    });
    // The narrowest first: of colours that stand alike it is the one to be told of.
    let mut checks: Vec<Check> = checks.collect();
    checks.sort_by(|a, b| a.figure.total_cmp(&b.figure));
    checks
}

fn lighting(findings: &Findings) -> PartVerdict {
    const HOLD: &str = "switch the camera's automatic exposure and white balance off, and keep daylight out of the box";
    let exposure = findings.exposure_drift.map(|figure| Check {
        figure,
        limits: limits::exposure(),
        unit: "1",
        finding: format!("brightness changes by {:.0} % within the minute", 100.0 * figure),
        advice: HOLD,
    });
    let white = findings.white_drift_codes.map(|figure| Check {
        figure,
        limits: limits::white(),
        unit: "codes",
        finding: format!("white changes by {figure:.1} codes within the minute"),
        advice: HOLD,
    });
    worst(Part::Lighting, exposure.into_iter().chain(white).collect(), || {
        ("the picture is too dark to compare".to_owned(), "switch the box's light on")
    })
}
