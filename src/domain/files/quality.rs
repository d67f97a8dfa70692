//! A session's tracking quality and whether its numbers can be trusted, as JSON: written by `trocar track --quality`,
//! and sent with a session over REST.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::motion::quality::{
    BoxMatch, Concern, Displacement, Figures, JumpRows, LostStretch, MovedDuring, NoiseFloor, QualityVerdict,
    SessionFigures, ToolFigures,
};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::reason::MissReason;
use crate::vision::tracker::{EffectiveDiameter, Quality, ToolQuality};

/// A session's tracking quality. Shares are 0 to 1; `null` where unknown.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct QualityDocument {
    /// `valid`, `usable_with_care` or `refused`; a refused session's features are withheld.
    pub verdict: &'static str,
    /// Why: first what may explain the others, then the worst.
    pub reasons: Vec<ConcernDocument>,
    /// Decoded frames.
    pub frames: u64,
    /// Figures of the recording as a whole.
    pub recording: RecordingDocument,
    /// One entry per tool.
    pub tools: Vec<ToolDocument>,
}

/// Why a session needs care, or is refused.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ConcernDocument {
    /// Stable name of the problem, such as `coverage`.
    pub name: &'static str,
    /// Its effect: `care` or `refuse`.
    pub severity: &'static str,
    /// The tool; `null` for the session as a whole.
    pub tool: Option<String>,
    /// True if the tool was followed by its bare shaft, so that the advice does not speak of tape; absent if not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_bare: bool,
    /// The marked label that a colour is too similar to; `null` for other problems.
    pub label: Option<String>,
    /// The longest stretch without a position, if tracking was lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longest: Option<LostDocument>,
    /// The wrong rows of the path, if it jumps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<JumpDocument>,
    /// When it occurred, s, if it is about a moment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_s: Option<f64>,
    /// The measured figure.
    pub figure: f64,
    /// The limit that the figure broke.
    pub limit: f64,
    /// Unit of both; `1` for shares and counts.
    pub unit: &'static str,
    /// What was found, for people.
    pub finding: String,
    /// What to do about it.
    pub advice: &'static str,
}

/// A stretch of the recording during which a tool in view was not tracked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct LostDocument {
    /// Time of its first frame, s.
    pub from_s: f64,
    /// Time of its last frame, s.
    pub to_s: f64,
    /// True if the recording ends with it.
    pub to_end: bool,
}

/// The two rows of a path that jumps from one to the other, or the first and the last of the adjacent rows that the path
/// goes out to and back from: the same row twice, if it is one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct JumpDocument {
    /// Frame of the first row.
    pub from_frame: u64,
    /// Its time, s.
    pub from_s: f64,
    /// Frame of the last row.
    pub to_frame: u64,
    /// Its time, s.
    pub to_s: f64,
}

/// Figures of the recording as a whole.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct RecordingDocument {
    /// Frames per second.
    pub frame_rate_hz: Option<f64>,
    /// Share of the frames that are missing in intervals of up to a second.
    pub dropped_share: Option<f64>,
    /// Longest time between two frames, s.
    pub longest_interval_s: Option<f64>,
    /// Share of the frames stated by the container that could not be decoded.
    pub cut_share: Option<f64>,
    /// Share of the frames that are interlaced.
    pub interlaced_share: Option<f64>,
    /// Speed of the fastest tool when the recording begins, mm/s.
    pub first_speed_mm_s: Option<f64>,
    /// Speed of the fastest tool when the recording ends, mm/s.
    pub last_speed_mm_s: Option<f64>,
    /// Largest change of brightness, as a share.
    pub exposure_drift: Option<f64>,
    /// Largest change of white, codes.
    pub white_drift_codes: Option<f64>,
    /// RMS reprojection error of the camera's calibration, pixels.
    pub calibration_rms_px: Option<f64>,
    /// How far the camera has moved since earlier sessions; `null` where it has not moved or this is unknown.
    pub camera_shift: Option<ShiftDocument>,
    /// How far the camera moved during the recording; `null` where the picture does not show this, or for too little of
    /// the recording.
    pub moved_during: Option<MovedDuringDocument>,
    /// Whether the recording shows the box that it is filed under; absent for a recording that belongs to no box.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub box_match: Option<BoxMatchDocument>,
}

/// Whether a recording shows the box that it is filed under.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct BoxMatchDocument {
    /// `same`: it does. `moved`: it does, and the camera has moved a little. `doubtful`: it may show another box, and a
    /// person has to say. `unknown`: the box has no pictures of its own, or they have too little structure, and too few
    /// trocars are known.
    pub finding: &'static str,
    /// Correlation of its surroundings with the box's own pictures; `null` where there are none.
    pub correlation: Option<f64>,
    /// The correlation that mirrored pictures reach; `null` where the correlation leaves no doubt.
    pub chance: Option<f64>,
    /// Share of the picture with structure.
    pub structured: Option<f64>,
    /// Shift of the picture, share of its longer side.
    pub shift: Option<f64>,
    /// Displacement of all trocars from those of earlier sessions; `null` where they are in place or unknown.
    pub trocars: Option<ShiftDocument>,
}

/// One tool's tracking quality.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ToolDocument {
    /// Its marker's name.
    pub tool: String,
    /// Frames with a measurement of the tool.
    pub observed: u64,
    /// Frames with a predicted position, which bridges a gap.
    pub predicted: u64,
    /// Frames without a position.
    pub missing: u64,
    /// How often each reason prevented a measurement.
    pub reasons: BTreeMap<&'static str, u64>,
    /// Share of the session's frames with a measurement of the tool.
    pub coverage: Option<f64>,
    /// The same between its own first and last measurement.
    pub coverage_while_there: Option<f64>,
    /// The same over all frames of the recording.
    pub coverage_of_recording: Option<f64>,
    /// Share of its positions that are predicted.
    pub predicted_share: Option<f64>,
    /// Share of the session's frames with the tool out of view.
    pub left_view_share: Option<f64>,
    /// Share of the frames of the whole recording with the tool not tracked, among those with it in view.
    pub lost_share: Option<f64>,
    /// Frames with the tool in view but not tracked, by reason.
    pub lost_frames: BTreeMap<&'static str, u64>,
    /// Longest time without a measurement, s.
    pub longest_gap_s: Option<f64>,
    /// RMS distance of border points from the fitted outline, pixels.
    pub border_residual_px: Option<f64>,
    /// Effective diameter of its tape, used to compute depth from width.
    pub effective_diameter: Option<DiameterDocument>,
    /// By how much the picture contradicts its sizes, in standard deviations: positive if its band is shorter than
    /// stated, relative to its diameter; `null` where too few of its poses lean.
    pub size_mismatch_sigmas: Option<f64>,
    /// Share of measurements that contradict its motion.
    pub rejected_share: Option<f64>,
    /// Apparent speed at rest.
    pub noise_floor: Option<NoiseDocument>,
    /// Median of the positions' stated standard deviations, mm.
    pub error_median_mm: Option<f64>,
    /// 95th percentile of them, mm.
    pub error_p95_mm: Option<f64>,
    /// Where its tube passes through the box's wall: its trocar; `null` where not known well enough, and if a recording
    /// during which the camera moved was trimmed.
    pub fulcrum: Option<FulcrumDocument>,
    /// Distance from the nearest trocar of earlier sessions; `null` where there are too few of them.
    pub port_shift: Option<ShiftDocument>,
    /// Colour shift, in steps of 1/255, before its tape is taken for something that is not a tool.
    pub colour_to_background_steps: Option<f64>,
    /// The same before its tape is taken for another tool's.
    pub colour_to_tools_steps: Option<f64>,
}

/// The effective diameter of a tape: blur, light and compression move its borders.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct DiameterDocument {
    /// Diameter, mm.
    pub mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
    /// `session`: estimated from the session's own poses; `usual`: they were too few or too alike, so that the nominal
    /// diameter is used.
    pub basis: &'static str,
}

/// The point that a tool pivots about: its trocar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FulcrumDocument {
    /// Position in the camera's frame, mm.
    pub at_mm: [f64; 3],
    /// Covariance, mm²: xx, xy, xz, yy, yz, zz.
    pub covariance_mm2: [f64; 6],
}

/// How far something has moved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct ShiftDocument {
    /// Distance, mm.
    pub mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
}

/// How far the camera moved during a recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct MovedDuringDocument {
    /// Largest lasting displacement of the picture since the beginning, mm at the median depth of the tips.
    pub mm: f64,
    /// When the camera had moved half as far for the first time, s.
    pub at_s: f64,
}

/// Apparent speed of a resting tool.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct NoiseDocument {
    /// In the smoothed path, RMS, mm/s.
    pub smoothed_mm_s: f64,
    /// In the causal path, RMS, mm/s.
    pub causal_mm_s: Option<f64>,
    /// `rest`: measured while the tool rested; `measurements`: from the differences between frames.
    pub basis: &'static str,
}

impl QualityDocument {
    /// The quality of a recording tracked by Trocar.
    pub fn new(tracker: &Quality, figures: &Figures, verdict: &QualityVerdict) -> Self {
        Self {
            verdict: verdict.name(),
            reasons: verdict.concerns().iter().map(ConcernDocument::from).collect(),
            frames: tracker.frames,
            recording: RecordingDocument::from(&figures.session),
            tools: tracker.tools.iter().zip(&figures.tools).map(|(counts, tool)| tool_document(counts, tool)).collect(),
        }
    }
}

impl From<&Concern> for ConcernDocument {
    fn from(concern: &Concern) -> Self {
        Self {
            name: concern.cause.name(),
            severity: concern.severity.name(),
            tool: concern.tool.clone(),
            is_bare: concern.is_bare,
            label: concern.label.clone(),
            longest: concern.longest.map(LostDocument::from),
            rows: concern.rows.map(JumpDocument::from),
            at_s: concern.at_s,
            figure: concern.figure,
            limit: concern.limit,
            unit: concern.cause.unit(),
            finding: concern.finding(),
            advice: concern.advice(),
        }
    }
}

impl From<LostStretch> for LostDocument {
    fn from(LostStretch { from_s, to_s, to_end }: LostStretch) -> Self {
        Self { from_s, to_s, to_end }
    }
}

impl From<JumpRows> for JumpDocument {
    fn from(JumpRows { from_frame, from_s, to_frame, to_s }: JumpRows) -> Self {
        Self { from_frame, from_s, to_frame, to_s }
    }
}

impl From<&SessionFigures> for RecordingDocument {
    fn from(session: &SessionFigures) -> Self {
        Self {
            frame_rate_hz: session.frame_rate_hz,
            dropped_share: session.dropped_share,
            longest_interval_s: session.longest_interval_s,
            cut_share: session.cut_share,
            interlaced_share: session.interlaced_share,
            first_speed_mm_s: session.first_speed_mm_s,
            last_speed_mm_s: session.last_speed_mm_s,
            exposure_drift: session.exposure_drift,
            white_drift_codes: session.white_drift_codes,
            calibration_rms_px: session.calibration_rms_px,
            camera_shift: session.camera_shift.map(ShiftDocument::from),
            moved_during: session.moved_during.map(MovedDuringDocument::from),
            box_match: session.box_match.map(BoxMatchDocument::from),
        }
    }
}

impl From<BoxMatch> for BoxMatchDocument {
    fn from(BoxMatch { finding, resemblance, ports, .. }: BoxMatch) -> Self {
        Self {
            finding: finding.name(),
            correlation: resemblance.map(|of| of.correlation),
            chance: resemblance.and_then(|of| of.chance),
            structured: resemblance.map(|of| of.structured),
            shift: resemblance.map(|of| of.shift),
            trocars: ports.displacement().map(ShiftDocument::from),
        }
    }
}

impl From<NoiseFloor> for NoiseDocument {
    fn from(noise: NoiseFloor) -> Self {
        let NoiseFloor { smoothed_mm_s, causal_mm_s, basis } = noise;
        Self { smoothed_mm_s, causal_mm_s, basis: basis.name() }
    }
}

impl From<EffectiveDiameter> for DiameterDocument {
    fn from(EffectiveDiameter { mm, sigma_mm, basis }: EffectiveDiameter) -> Self {
        Self { mm, sigma_mm, basis: basis.name() }
    }
}

impl From<Fulcrum> for FulcrumDocument {
    fn from(fulcrum: Fulcrum) -> Self {
        Self { at_mm: fulcrum.at.into(), covariance_mm2: fulcrum.upper() }
    }
}

impl From<MovedDuring> for MovedDuringDocument {
    fn from(MovedDuring { mm, at_s }: MovedDuring) -> Self {
        Self { mm, at_s }
    }
}

impl From<Displacement> for ShiftDocument {
    fn from(Displacement { mm, sigma_mm }: Displacement) -> Self {
        Self { mm, sigma_mm }
    }
}

/// The fulcrums in a stored quality document; none if the value is not such a document.
pub fn stored_fulcrums(document: &serde_json::Value) -> Vec<Fulcrum> {
    let tools = document["tools"].as_array().into_iter().flatten();
    let fulcrum = |tool: &serde_json::Value| FulcrumDocument::deserialize(&tool["fulcrum"]).ok();
    tools.filter_map(fulcrum).map(|f| Fulcrum::from_upper(f.at_mm.into(), f.covariance_mm2)).collect()
}

fn tool_document(counts: &ToolQuality, figures: &ToolFigures) -> ToolDocument {
    ToolDocument {
        tool: figures.tool.clone(),
        observed: counts.observed,
        predicted: counts.predicted,
        missing: counts.missing,
        reasons: by_name(&counts.reasons),
        coverage: figures.coverage,
        coverage_while_there: figures.coverage_while_there,
        coverage_of_recording: figures.coverage_of_recording,
        predicted_share: figures.predicted_share,
        left_view_share: figures.left_view_share,
        lost_share: figures.lost_share,
        lost_frames: by_name(&figures.lost_frames),
        longest_gap_s: figures.longest_gap_s,
        border_residual_px: figures.border_residual_px,
        effective_diameter: figures.effective_diameter.map(DiameterDocument::from),
        size_mismatch_sigmas: figures.size_mismatch.map(|mismatch| mismatch.sigmas()),
        rejected_share: figures.rejected_share,
        noise_floor: figures.noise_floor.map(NoiseDocument::from),
        error_median_mm: figures.error_bar.map(|bar| bar.median_mm),
        error_p95_mm: figures.error_bar.map(|bar| bar.p95_mm),
        fulcrum: figures.fulcrum.map(FulcrumDocument::from),
        port_shift: figures.port_shift.map(ShiftDocument::from),
        colour_to_background_steps: figures.colour.from_background.as_ref().map(|margin| margin.margin_steps),
        colour_to_tools_steps: figures.colour.from_tools.as_ref().map(|margin| margin.margin_steps),
    }
}

fn by_name(counts: &BTreeMap<MissReason, u64>) -> BTreeMap<&'static str, u64> {
    counts.iter().map(|(reason, count)| (reason.name(), *count)).collect()
}
