//! What can be wrong with a session: a closed set, so that every cause has a sentence and advice.

use crate::vision::segmentation::palette::verdict::MIN_SHOWN_STEPS;

/// A reason to refuse a session or to use it with care.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum QualityCause {
    /// A person said that the recording shows another box.
    OtherBox,
    /// The surroundings do not look like the box's own pictures.
    BoxSurroundings,
    /// All trocars are far from those of the box.
    BoxTrocars,
    /// No tool was ever measured.
    NothingSeen,
    /// The camera moved during the recording.
    CameraMovedDuring,
    /// A tool has no tape, and the view differs from that of the box's own pictures.
    ViewShifted,
    /// The picture's brightness changes.
    Exposure,
    /// A tool was never in the picture.
    NeverInPicture,
    /// A tool's colour is too close to something that is not a tool.
    ColourBackground,
    /// A tool's colour is too close to another tool's.
    ColourPair,
    /// A tool was measured on too few frames.
    Coverage,
    /// A tool was out of view for too long.
    LeftView,
    /// A tool was in view but not followed for too long.
    Lost,
    /// A tool's axes do not show its trocar.
    NoTrocar,
    /// A tool's stated band is longer than its diameter and the picture allow.
    BandTooLong,
    /// A tool's stated band is shorter than its diameter and the picture allow.
    BandTooShort,
    /// Too many of a tool's positions are bridged.
    Predicted,
    /// A tool was not measured for too long without interruption.
    LongGap,
    /// Too many measurements contradict a tool's motion.
    Rejected,
    /// A tool's path has a step that is faster than any hand.
    Jump,
    /// A tool's path goes out to a few rows and back more sharply than a hand can turn.
    Spike,
    /// A band's borders do not fit a straight tube.
    BorderResidual,
    /// A tool has no tape, so its depth is less certain.
    BareTool,
    /// A resting tool would appear to move.
    NoiseFloor,
    /// Positions are too uncertain: the median of their stated standard deviations is too large. The name does not mean
    /// the error bars of features.
    ErrorBar,
    /// The camera's calibration does not fit its own photos.
    Calibration,
    /// The file ends before the recording.
    CutFile,
    /// Frames that show two moments in alternating lines.
    Interlaced,
    /// Too few frames a second.
    FrameRate,
    /// Too many frames were dropped.
    DroppedFrames,
    /// The recording is interrupted, or its clock jumps.
    Break,
    /// The recording begins after the start of the task.
    BeginsInMotion,
    /// The recording ends before the end of the task.
    EndsInMotion,
    /// The picture's white balance changes.
    WhiteBalance,
    /// All trocars are displaced, as if the camera had moved since earlier sessions.
    CameraMoved,
    /// One trocar is displaced from its position in earlier sessions.
    PortMoved,
}

/// What to do about rows that no hand reaches.
const WRONG_ROWS: &str = "one wrong row makes lengths and speeds wrong: delete it and all others like it from the \
                          table, and import the table again. In a recording, check whether the overlay follows the \
                          tool there: exchange the tools' names from there on, or trim the recording";

/// What to do about a camera that has moved since earlier sessions.
const CAMERA_MOVED: &str = "positions, depth and paths cannot be compared with earlier ones: put the camera back, or \
                            upload the calibration of the box again to start a new comparison. Lengths and speeds are \
                            right only if it is the same camera with the same zoom and focus; if not, calibrate it";

/// What to do about a trocar that was moved.
const PORT_MOVED: &str = "put the trocar back; if it stays there or the camera was moved, upload the calibration of \
                          the box again. Positions and paths cannot be compared with earlier ones; lengths and speeds \
                          are right only if it is the same camera with the same zoom and focus";

/// What to do about large error bars of a tool with tape.
const ERROR_BAR: &str = "move the camera closer, record a larger picture, and enter the length of its tape";

/// What to do about a tool without tape.
const BARE_TOOL: &str = "compare features whose errors are small. Most of the error is along the camera's line of \
                         sight; with tape it is smaller";

/// What to do about a camera that moved during the recording.
const MOVED_DURING: &str = "the path jumps there, and positions before and after do not compare: fix the camera to the \
                            box, and trim the recording to the part before or after that moment. If the camera stood \
                            still and everything else in the picture was moved, such as the whole board, lengths and \
                            speeds are right";

/// What to do about a view that differs from that of the box's own pictures.
const VIEW_SHIFTED: &str = "the picture of the empty box no longer fits, so tools without tape may be lost: put the \
                            camera back, or take a new picture of the empty box and learn the colours again";

/// What to do about sizes that the picture contradicts.
const OTHER_SIZES: &str = "measure both again, the diameter over the tape and the length of the band along the tube, \
                           correct them in the box's set-up, and score the recording again: all its lengths may be \
                           wrong";

impl QualityCause {
    /// Every cause, in the order to fix them.
    pub const ALL: [QualityCause; 36] = [
        QualityCause::OtherBox,
        QualityCause::BoxSurroundings,
        QualityCause::BoxTrocars,
        QualityCause::NothingSeen,
        QualityCause::CameraMovedDuring,
        QualityCause::ViewShifted,
        QualityCause::Exposure,
        QualityCause::NeverInPicture,
        QualityCause::ColourBackground,
        QualityCause::ColourPair,
        QualityCause::Coverage,
        QualityCause::LeftView,
        QualityCause::Lost,
        QualityCause::NoTrocar,
        QualityCause::BandTooLong,
        QualityCause::BandTooShort,
        QualityCause::Predicted,
        QualityCause::LongGap,
        QualityCause::Rejected,
        QualityCause::Jump,
        QualityCause::Spike,
        QualityCause::BorderResidual,
        QualityCause::BareTool,
        QualityCause::NoiseFloor,
        QualityCause::ErrorBar,
        QualityCause::Calibration,
        QualityCause::CutFile,
        QualityCause::Interlaced,
        QualityCause::FrameRate,
        QualityCause::DroppedFrames,
        QualityCause::Break,
        QualityCause::BeginsInMotion,
        QualityCause::EndsInMotion,
        QualityCause::WhiteBalance,
        QualityCause::CameraMoved,
        QualityCause::PortMoved,
    ];

    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            QualityCause::OtherBox => "other_box",
            QualityCause::BoxSurroundings => "box_surroundings",
            QualityCause::BoxTrocars => "box_trocars",
            QualityCause::NothingSeen => "nothing_seen",
            QualityCause::NeverInPicture => "never_in_picture",
            QualityCause::ColourBackground => "colour_background",
            QualityCause::ColourPair => "colour_pair",
            QualityCause::Coverage => "coverage",
            QualityCause::LeftView => "left_view",
            QualityCause::Lost => "lost",
            QualityCause::NoTrocar => "no_trocar",
            QualityCause::BareTool => "bare_tool",
            QualityCause::BandTooLong => "band_too_long",
            QualityCause::BandTooShort => "band_too_short",
            QualityCause::Predicted => "predicted",
            QualityCause::LongGap => "long_gap",
            QualityCause::Rejected => "rejected",
            QualityCause::Jump => "jump",
            QualityCause::Spike => "spike",
            QualityCause::BorderResidual => "border_residual",
            QualityCause::NoiseFloor => "noise_floor",
            QualityCause::ErrorBar => "error_bar",
            QualityCause::Calibration => "calibration",
            QualityCause::CutFile => "cut_file",
            QualityCause::Interlaced => "interlaced",
            QualityCause::FrameRate => "frame_rate",
            QualityCause::DroppedFrames => "dropped_frames",
            QualityCause::Break => "break",
            QualityCause::BeginsInMotion => "begins_in_motion",
            QualityCause::EndsInMotion => "ends_in_motion",
            QualityCause::Exposure => "exposure",
            QualityCause::WhiteBalance => "white_balance",
            QualityCause::CameraMovedDuring => "camera_moved_during",
            QualityCause::ViewShifted => "view_shifted",
            QualityCause::CameraMoved => "camera_moved",
            QualityCause::PortMoved => "port_moved",
        }
    }

    /// Unit of the cause's figure; `1` for shares and counts.
    pub fn unit(self) -> &'static str {
        match self {
            QualityCause::LongGap | QualityCause::Break => "s",
            QualityCause::BorderResidual | QualityCause::Calibration => "px",
            QualityCause::NoiseFloor | QualityCause::BeginsInMotion | QualityCause::EndsInMotion => "mm/s",
            QualityCause::NoTrocar
            | QualityCause::BareTool
            | QualityCause::ErrorBar
            | QualityCause::BoxTrocars
            | QualityCause::CameraMovedDuring
            | QualityCause::CameraMoved
            | QualityCause::PortMoved => "mm",
            QualityCause::Jump => "m/s",
            QualityCause::Spike => "m/s²",
            QualityCause::FrameRate => "Hz",
            QualityCause::WhiteBalance => "codes",
            QualityCause::ColourBackground | QualityCause::ColourPair => "steps",
            QualityCause::BandTooLong | QualityCause::BandTooShort => "standard deviations",
            _ => "1",
        }
    }

    /// What was found, with the limit that it broke. The sentence follows the tool's name if it is about one.
    pub fn finding(self, figure: f64, limit: f64) -> String {
        let is_overlap = figure < MIN_SHOWN_STEPS;
        let [figure, limit] = self.formatted(figure, limit);
        match self {
            QualityCause::ColourBackground if is_overlap => {
                format!("its colour overlaps with the rest of the box; needs {limit} of 255 steps between them")
            }
            QualityCause::ColourPair if is_overlap => {
                format!("its colour overlaps with another tool's; needs {limit} of 255 steps between them")
            }
            _ => self.observation(&figure) + &self.requirement(&limit),
        }
    }

    /// Figure and limit as text: shares in per cent, with enough decimals that the two differ.
    fn formatted(self, figure: f64, limit: f64) -> [String; 2] {
        let (figure, limit) = if self.unit() == "1" { (100.0 * figure, 100.0 * limit) } else { (figure, limit) };
        let decimals = match self {
            QualityCause::BorderResidual | QualityCause::Calibration => [2, 2],
            QualityCause::BeginsInMotion | QualityCause::EndsInMotion => [0, 0],
            QualityCause::FrameRate => [1, 0],
            QualityCause::Rejected => [1, 1],
            _ if self.unit() == "1" => [0, 0],
            _ => [1, 1],
        };
        let [of_figure, of_limit] = decimals.map(|least| digits_apart(figure, limit, least));
        [format!("{figure:.of_figure$}"), format!("{limit:.of_limit$}")]
    }

    /// The first part of the finding: what was found.
    fn observation(self, figure: &str) -> String {
        match self {
            QualityCause::OtherBox => "it was recorded in another box".to_owned(),
            QualityCause::BoxSurroundings => {
                format!(
                    "this does not look like the box: its surroundings agree with the box's own pictures by {figure} %"
                )
            }
            QualityCause::BoxTrocars => format!("its trocars are {figure} mm from those of the box"),
            QualityCause::NothingSeen => "no tool was measured on any frame".to_owned(),
            QualityCause::NeverInPicture => "it was never in the picture".to_owned(),
            QualityCause::ColourBackground => {
                format!("its colour differs from the rest of the box by only {figure} of 255 steps")
            }
            QualityCause::ColourPair => format!("its colour differs from another tool's by only {figure} of 255 steps"),
            QualityCause::Coverage => {
                format!("measured on {figure} % of the frames between the first and the last that show a tool")
            }
            QualityCause::LeftView => format!("out of view for {figure} % of the session"),
            QualityCause::Lost => format!("in view but not followed on {figure} % of the frames"),
            QualityCause::NoTrocar => {
                format!(
                    "its tip moved by {figure} mm across its axis (root mean square), but its axes do not show its trocar"
                )
            }
            QualityCause::BareTool => {
                format!("it has no tape: half of its positions may be off by {figure} mm or more")
            }
            QualityCause::BandTooLong => {
                format!(
                    "the picture contradicts its sizes by {figure} standard deviations: its band is shorter than \
                         stated, or its diameter larger"
                )
            }
            QualityCause::BandTooShort => {
                format!(
                    "the picture contradicts its sizes by {figure} standard deviations: its band is longer than \
                         stated, or its diameter smaller"
                )
            }
            QualityCause::Predicted => format!("{figure} % of the positions are bridged, not measured"),
            QualityCause::LongGap => format!("not measured for {figure} s without a break"),
            QualityCause::Rejected => format!("{figure} % of the measurements contradict the motion"),
            QualityCause::Jump => format!("its path has a step of {figure} m/s, faster than a hand"),
            QualityCause::Spike => format!("its path goes out and back within five steps, with {figure} m/s²"),
            QualityCause::BorderResidual => format!("its borders are {figure} px off those of a straight tube"),
            QualityCause::NoiseFloor => format!("at rest it would appear to move at {figure} mm/s"),
            QualityCause::ErrorBar => format!("half of its positions may be off by {figure} mm or more"),
            QualityCause::Calibration => format!("the calibration does not fit its own photos: {figure} px off"),
            QualityCause::CutFile => format!("{figure} % of the recording's frames are missing from the file"),
            QualityCause::Interlaced => {
                format!("{figure} % of the frames are interlaced: only every second line was used")
            }
            QualityCause::FrameRate => format!("{figure} frames a second"),
            QualityCause::DroppedFrames => format!("{figure} % of the frames were dropped"),
            QualityCause::Break => format!("no frame for {figure} s"),
            QualityCause::BeginsInMotion => format!("a tool moves at {figure} mm/s as the recording begins"),
            QualityCause::EndsInMotion => format!("a tool moves at {figure} mm/s as the recording ends"),
            QualityCause::Exposure => format!("the picture's brightness changes by {figure} %"),
            QualityCause::WhiteBalance => format!("the picture's white balance changes by {figure} codes"),
            QualityCause::CameraMovedDuring => {
                format!("the camera moved during the recording, by {figure} mm at the depth of the tools")
            }
            QualityCause::ViewShifted => {
                format!("the camera's view is shifted by {figure} % of the picture since the box's own pictures")
            }
            QualityCause::CameraMoved => format!(
                "the camera has moved since earlier recordings with this calibration: all trocars are {figure} mm from \
                 where they were"
            ),
            QualityCause::PortMoved => format!("its trocar is {figure} mm from its position in earlier recordings"),
        }
    }

    /// The second part of the finding: the limit, if the first part does not imply it.
    fn requirement(self, limit: &str) -> String {
        match self {
            QualityCause::OtherBox
            | QualityCause::NothingSeen
            | QualityCause::NeverInPicture
            | QualityCause::NoTrocar
            | QualityCause::Interlaced => String::new(),
            QualityCause::BoxSurroundings | QualityCause::Coverage => format!("; needs {limit} %"),
            QualityCause::ColourBackground | QualityCause::ColourPair | QualityCause::FrameRate => {
                format!("; needs {limit}")
            }
            QualityCause::WhiteBalance | QualityCause::BandTooLong | QualityCause::BandTooShort => {
                format!(" (limit {limit})")
            }
            _ if self.unit() == "1" => format!(" (limit {limit} %)"),
            _ => format!(" (limit {limit} {})", self.unit()),
        }
    }

    /// What to do about it; `is_bare`: whether it concerns a tool without tape.
    pub fn advice(self, is_bare: bool) -> &'static str {
        match self {
            QualityCause::OtherBox => "move the session to the box where it was recorded",
            QualityCause::BoxSurroundings | QualityCause::BoxTrocars => {
                "say whether it is this box. Until then the session counts nowhere, and its lengths and speeds may be \
                 wrong: another box has another camera"
            }
            QualityCause::NothingSeen => {
                "switch on the light of the box, and keep the tools in the picture. If both was so, mark the tape or \
                 the bare shaft again on a frame of this recording"
            }
            QualityCause::NeverInPicture => {
                "if the task needs this tool, mark its tape or its bare shaft again in this light; if not, there is \
                 nothing to do"
            }
            QualityCause::ColourBackground => {
                "wind a tape of a colour that nothing else in the box has, and mark it again"
            }
            QualityCause::ColourPair => "wind a tape of another colour on one of the two tools, and mark both again",
            QualityCause::Coverage => {
                "keep the tool in view of the camera; the quality report lists why it was not seen"
            }
            QualityCause::LeftView => {
                "keep the tip in the picture, or move the camera so that the whole task is in view"
            }
            QualityCause::Lost => {
                "watch these moments in the recording: does something cover the tool or does it glare? Mark its colour \
                 in that light"
            }
            QualityCause::NoTrocar => {
                "watch the overlay: does it follow the tool, and does its axis point from the hand to the tip? Check \
                 the tool's sizes, and mark other things of its colour as background"
            }
            QualityCause::BareTool => BARE_TOOL,
            QualityCause::BandTooLong | QualityCause::BandTooShort => OTHER_SIZES,
            QualityCause::Predicted | QualityCause::LongGap => {
                "sums such as the path length leave out what happened there; watch the gaps in the recording"
            }
            QualityCause::Rejected => "look for something else of its colour in the picture, and mark it as background",
            QualityCause::Jump | QualityCause::Spike => WRONG_ROWS,
            QualityCause::BorderResidual if is_bare => "focus the camera, and avoid glare on the tool",
            QualityCause::BorderResidual => "focus the camera, avoid glare on the tool, and replace creased tape",
            QualityCause::NoiseFloor if is_bare => "use more light, a larger picture or a camera closer to the tools",
            QualityCause::NoiseFloor => {
                "use more light, a larger picture or a camera closer to the tools, and enter the length of its tape"
            }
            QualityCause::ErrorBar if is_bare => "move the camera closer, or record a larger picture",
            QualityCause::ErrorBar => ERROR_BAR,
            QualityCause::Calibration => "calibrate again with a flat board, sharp photos and tilted views",
            QualityCause::CutFile => "send the whole recording again; the file was cut off or damaged",
            QualityCause::Interlaced => {
                "record progressive video (25p, not 50i), or deinterlace it first: \
                 ffmpeg -i IN -vf bwdif=mode=send_field OUT.mp4"
            }
            QualityCause::FrameRate => "record at 25 frames a second or more",
            QualityCause::DroppedFrames => {
                "record to a faster disk, over a better connection, or with a smaller picture"
            }
            QualityCause::Break => "record the task without interruption",
            QualityCause::BeginsInMotion => {
                "start the recording before the tools move; duration and sums leave out the beginning"
            }
            QualityCause::EndsInMotion => {
                "end the recording after the tools have come to rest; duration and sums leave out the end"
            }
            QualityCause::Exposure => {
                "keep the light of the box on and constant, and switch off the camera's automatic exposure"
            }
            QualityCause::WhiteBalance => {
                "switch off the camera's automatic white balance, and keep the light constant"
            }
            QualityCause::CameraMovedDuring => MOVED_DURING,
            QualityCause::ViewShifted => VIEW_SHIFTED,
            QualityCause::CameraMoved => CAMERA_MOVED,
            QualityCause::PortMoved => PORT_MOVED,
        }
    }
}

/// Number of decimals, at least `least`, so that a figure reads differently from the limit that it broke.
fn digits_apart(figure: f64, limit: f64, least: usize) -> usize {
    const MAX_EXTRA_DIGITS: usize = 2;
    let differ = |digits: &usize| format!("{figure:.digits$}") != format!("{limit:.digits$}");
    (least..=least + MAX_EXTRA_DIGITS).find(differ).unwrap_or(least)
}
