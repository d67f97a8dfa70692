//! Results of a box's self-test, as stored, sent and shown.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::calibration::BoardSize;
use super::named;
use crate::checks::self_test::{
    BoardPlacement, PartVerdict, SelfTestAdvice, SelfTestFindings, SelfTestPart, SelfTestVerdict, Signal, Touch,
    TouchAccuracy, UnusableReason,
};
use crate::ids::{CalibrationId, PaletteId, PersonId};

named! {
    /// A traffic light.
    TrafficLight: "light" {
        /// In order.
        Green = "green",
        /// Needs watching.
        Yellow = "yellow",
        /// Must be repaired before trainees are measured.
        Red = "red",
        /// Could not be determined; never counts as green.
        NotMeasured = "not_measured",
    }
}

named! {
    /// A part of a self-test.
    TestedPart: "part" {
        /// Whether the tracker measures the right position for a rod that touches a corner.
        Accuracy = "accuracy",
        /// Whether camera and lens are unchanged since the calibration.
        Calibration = "calibration",
        /// Whether the rod's trocar is at the same place as in the box's sessions; only where both are known.
        Place = "place",
        /// Whether the tapes' colours differ enough from everything else.
        Colours = "colours",
        /// Whether brightness and white stay constant.
        Lighting = "lighting",
    }
}

named! {
    /// Why a rest of a tool does not count.
    NotCountedReason: "reason" {
        /// The whole board was not seen both before and after it.
        BoardNotSeen = "board_not_seen",
        /// The board was moved between before and after it.
        BoardMoved = "board_moved",
        /// The rod seems to come from below the board: the hand's end of the tape was taken for the tip.
        WrongWay = "wrong_way",
        /// No corner is near.
        NoCornerNear = "no_corner_near",
        /// The tool rested above the board.
        AboveBoard = "above_board",
    }
}

/// The report of a self-test. `null` where something was not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SelfTestReport {
    /// The worst of the parts.
    pub light: TrafficLight,
    /// Each part, with the figure that decided.
    pub parts: Vec<PartReport>,
    /// Inner corners of the board, COLUMNSxROWS.
    #[schema(value_type = String)]
    pub board: BoardSize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// The positions where the board lay still, in order of time.
    pub placements: Vec<PlacementReport>,
    /// Apparent difference of the focal length from the stored camera's, percent.
    pub focal_change_percent: Option<f64>,
    /// Standard deviation of this difference, percent.
    pub focal_sigma_percent: Option<f64>,
    /// Accuracy over all touches that count; `null` with fewer than four touches.
    pub accuracy: Option<AccuracyReport>,
    /// Every rest of a tool, in order of time.
    pub holds: Vec<HoldReport>,
    /// Largest change of brightness, as a share.
    pub exposure_drift: Option<f64>,
    /// Largest change of white, codes.
    pub white_drift_codes: Option<f64>,
}

/// The result of one part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PartReport {
    /// The part.
    pub part: TestedPart,
    /// Its result.
    pub light: TrafficLight,
    /// The figure that decided.
    pub figure: Option<f64>,
    /// The limit that the figure broke; for a green part, the limit that it met.
    pub limit: Option<f64>,
    /// Unit of both; `1` for shares, empty if the part was not measured.
    pub unit: String,
    /// The finding, for people.
    pub finding: String,
    /// What to do about it; empty where there is nothing to do.
    pub advice: String,
    /// Stable name of the advice; `null` where there is nothing to do, and in tests from before the names existed.
    #[serde(default)]
    pub advice_name: Option<String>,
}

/// A board that lay still.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlacementReport {
    /// Time of the first frame that shows it there, s.
    pub from_s: f64,
    /// Time of the last one, s.
    pub to_s: f64,
    /// Number of frames that agree.
    pub looks: u64,
    /// RMS distance of its corners from where the stored camera expects them, pixels.
    pub rms_px: f64,
    /// Depth of its middle, mm.
    pub depth_mm: f64,
}

/// Accuracy over all touches that count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AccuracyReport {
    /// Number of touches.
    pub touches: u64,
    /// Root mean square error in space, mm.
    pub rms_mm: f64,
    /// Root mean square error along the line of sight, mm.
    pub along_rms_mm: f64,
    /// Root mean square error across the line of sight, mm.
    pub across_rms_mm: f64,
    /// Mean error along the line of sight, mm: the systematic part; positive where tools seem farther away than they
    /// are.
    pub along_mean_mm: f64,
    /// Largest error, mm.
    pub largest_mm: f64,
    /// Least depth of a touched corner, mm.
    pub nearest_mm: f64,
    /// Greatest depth of a touched corner, mm.
    pub farthest_mm: f64,
    /// Share of the picture between the touched corners.
    pub picture_share: f64,
    /// Touches whose error lies within the tracker's stated 95 % region.
    pub inside: u64,
    /// Touches with a stated 95 % region.
    pub stated: u64,
}

/// A rest of a tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HoldReport {
    /// The tool.
    pub tool: String,
    /// Start of the rest, s.
    pub from_s: f64,
    /// End of the rest, s.
    pub to_s: f64,
    /// Number of the board's placement, from 1.
    pub placement: Option<u64>,
    /// Column of the corner, from 1.
    pub column: Option<u64>,
    /// Row of the corner, from 1.
    pub row: Option<u64>,
    /// Error in space, mm.
    pub error_mm: Option<f64>,
    /// Error along the line of sight, mm; positive where the tool seems farther away than it is.
    pub along_mm: Option<f64>,
    /// Error across it, mm.
    pub across_mm: Option<f64>,
    /// Whether the error lies within the tracker's stated 95 % region.
    pub inside: Option<bool>,
    /// Why it does not count; `null` where it does.
    pub not_counted: Option<NotCountedReason>,
}

/// A self-test to be stored.
#[derive(Clone, Debug, PartialEq)]
pub struct NewSelfTest {
    /// The tested calibration.
    pub calibration: CalibrationId,
    /// The tested colour samples.
    pub palette: PaletteId,
    /// The person who requested it.
    pub person: Option<PersonId>,
    /// The results.
    pub report: SelfTestReport,
}

impl SelfTestReport {
    /// From the pipeline's findings; `tools` are the tools' names in the tracker's order.
    pub fn new(findings: &SelfTestFindings, verdict: &SelfTestVerdict, tools: &[String]) -> Self {
        let (columns, rows) = (findings.board.columns() as u32, findings.board.rows() as u32);
        let percent = |share: f64| 100.0 * share;
        Self {
            light: verdict.signal.into(),
            parts: verdict.parts.iter().map(PartReport::from).collect(),
            board: BoardSize { columns, rows },
            square_mm: findings.board.square_mm(),
            placements: findings.placements.iter().map(PlacementReport::from).collect(),
            focal_change_percent: findings.focal_change.map(|change| percent(change.share)),
            focal_sigma_percent: findings.focal_change.map(|change| percent(change.sigma)),
            accuracy: findings.accuracy.as_ref().map(AccuracyReport::from),
            holds: findings.touches.iter().map(|touch| hold_report(touch, tools)).collect(),
            exposure_drift: findings.exposure_drift,
            white_drift_codes: findings.white_drift_codes,
        }
    }

    /// All numbers apart from counts.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let of_part = |part: &PartReport| [part.figure, part.limit];
        let of_placement = |p: &PlacementReport| [p.from_s, p.to_s, p.rms_px, p.depth_mm];
        let of_accuracy = |a: &AccuracyReport| {
            [a.rms_mm, a.along_rms_mm, a.across_rms_mm, a.along_mean_mm, a.largest_mm, a.nearest_mm, a.farthest_mm]
                .into_iter()
                .chain([a.picture_share])
        };
        let of_hold = |h: &HoldReport| [Some(h.from_s), Some(h.to_s), h.error_mm, h.along_mm, h.across_mm];
        let own = [self.focal_change_percent, self.focal_sigma_percent, self.exposure_drift, self.white_drift_codes];
        let optional = self.parts.iter().flat_map(of_part).chain(self.holds.iter().flat_map(of_hold)).chain(own);
        let always = self.placements.iter().flat_map(of_placement).chain(self.accuracy.iter().flat_map(of_accuracy));
        optional.flatten().chain(always).chain([self.square_mm])
    }

    /// All texts.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        let parts = self.parts.iter();
        let of_parts =
            parts.flat_map(|part| [&part.unit, &part.finding, &part.advice].into_iter().chain(&part.advice_name));
        of_parts.chain(self.holds.iter().map(|hold| &hold.tool)).map(String::as_str)
    }
}

fn hold_report(touch: &Touch, tools: &[String]) -> HoldReport {
    let measured = touch.outcome.ok();
    let from_one = |place: usize| place as u64 + 1;
    HoldReport {
        tool: tools.get(touch.hold.tool).cloned().unwrap_or_default(),
        from_s: touch.hold.from_s,
        to_s: touch.hold.to_s,
        placement: measured.map(|m| from_one(m.placement)),
        column: measured.map(|m| from_one(m.column)),
        row: measured.map(|m| from_one(m.row)),
        error_mm: measured.map(|m| m.error_mm.norm()),
        along_mm: measured.map(|m| m.along_mm),
        across_mm: measured.map(|m| m.across_mm),
        inside: measured.and_then(|m| m.is_inside),
        not_counted: touch.outcome.err().map(NotCountedReason::from),
    }
}

impl From<Signal> for TrafficLight {
    fn from(signal: Signal) -> Self {
        match signal {
            Signal::Green => TrafficLight::Green,
            Signal::Yellow => TrafficLight::Yellow,
            Signal::Red => TrafficLight::Red,
            Signal::NotMeasured => TrafficLight::NotMeasured,
        }
    }
}

impl From<SelfTestPart> for TestedPart {
    fn from(part: SelfTestPart) -> Self {
        match part {
            SelfTestPart::Accuracy => TestedPart::Accuracy,
            SelfTestPart::Calibration => TestedPart::Calibration,
            SelfTestPart::Place => TestedPart::Place,
            SelfTestPart::Colours => TestedPart::Colours,
            SelfTestPart::Lighting => TestedPart::Lighting,
        }
    }
}

impl From<UnusableReason> for NotCountedReason {
    fn from(why: UnusableReason) -> Self {
        match why {
            UnusableReason::BoardNotSeen => NotCountedReason::BoardNotSeen,
            UnusableReason::BoardMoved => NotCountedReason::BoardMoved,
            UnusableReason::WrongWay => NotCountedReason::WrongWay,
            UnusableReason::NoCornerNear => NotCountedReason::NoCornerNear,
            UnusableReason::AboveBoard => NotCountedReason::AboveBoard,
        }
    }
}

impl From<&PartVerdict> for PartReport {
    fn from(PartVerdict { part, signal, figure, limit, unit, finding, advice }: &PartVerdict) -> Self {
        Self {
            part: (*part).into(),
            light: (*signal).into(),
            figure: *figure,
            limit: *limit,
            unit: (*unit).to_owned(),
            finding: finding.clone(),
            advice: advice.map_or("", SelfTestAdvice::words).to_owned(),
            advice_name: advice.map(|advice| advice.name().to_owned()),
        }
    }
}

impl From<&BoardPlacement> for PlacementReport {
    fn from(placement: &BoardPlacement) -> Self {
        Self {
            from_s: placement.from_s,
            to_s: placement.to_s,
            looks: placement.sightings as u64,
            rms_px: placement.rms_px,
            depth_mm: placement.camera_from_board.translation.z,
        }
    }
}

impl From<&TouchAccuracy> for AccuracyReport {
    fn from(a: &TouchAccuracy) -> Self {
        let [nearest_mm, farthest_mm] = a.depth_mm;
        Self {
            touches: a.touches as u64,
            rms_mm: a.rms_mm,
            along_rms_mm: a.along_rms_mm,
            across_rms_mm: a.across_rms_mm,
            along_mean_mm: a.along_mean_mm,
            largest_mm: a.largest_mm,
            nearest_mm,
            farthest_mm,
            picture_share: a.picture_share,
            inside: a.inside as u64,
            stated: a.stated as u64,
        }
    }
}
