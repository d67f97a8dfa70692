//! What can be wrong with a session: a closed set, so that every cause has a sentence and advice.

/// A reason to refuse a session or to use it with care.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Cause {
    /// No tool was ever measured.
    NothingSeen,
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
    /// Too many of a tool's positions are bridged.
    Predicted,
    /// A tool was not measured for too long without interruption.
    LongGap,
    /// Too many measurements contradict a tool's motion.
    Rejected,
    /// A band's borders do not fit a straight tube.
    BorderResidual,
    /// A resting tool would appear to move.
    NoiseFloor,
    /// Positions are too uncertain.
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
    /// The picture's brightness changes.
    Exposure,
    /// The picture's white balance changes.
    WhiteBalance,
    /// All trocars are displaced, as if the camera had moved since earlier sessions.
    CameraMoved,
    /// One trocar is displaced from its position in earlier sessions.
    PortMoved,
}

impl Cause {
    /// Every cause, in the order to fix them.
    pub const ALL: [Cause; 25] = [
        Cause::NothingSeen,
        Cause::NeverInPicture,
        Cause::ColourBackground,
        Cause::ColourPair,
        Cause::Coverage,
        Cause::LeftView,
        Cause::Lost,
        Cause::Predicted,
        Cause::LongGap,
        Cause::Rejected,
        Cause::BorderResidual,
        Cause::NoiseFloor,
        Cause::ErrorBar,
        Cause::Calibration,
        Cause::CutFile,
        Cause::Interlaced,
        Cause::FrameRate,
        Cause::DroppedFrames,
        Cause::Break,
        Cause::BeginsInMotion,
        Cause::EndsInMotion,
        Cause::Exposure,
        Cause::WhiteBalance,
        Cause::CameraMoved,
        Cause::PortMoved,
    ];

    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Cause::NothingSeen => "nothing_seen",
            Cause::NeverInPicture => "never_in_picture",
            Cause::ColourBackground => "colour_background",
            Cause::ColourPair => "colour_pair",
            Cause::Coverage => "coverage",
            Cause::LeftView => "left_view",
            Cause::Lost => "lost",
            Cause::Predicted => "predicted",
            Cause::LongGap => "long_gap",
            Cause::Rejected => "rejected",
            Cause::BorderResidual => "border_residual",
            Cause::NoiseFloor => "noise_floor",
            Cause::ErrorBar => "error_bar",
            Cause::Calibration => "calibration",
            Cause::CutFile => "cut_file",
            Cause::Interlaced => "interlaced",
            Cause::FrameRate => "frame_rate",
            Cause::DroppedFrames => "dropped_frames",
            Cause::Break => "break",
            Cause::BeginsInMotion => "begins_in_motion",
            Cause::EndsInMotion => "ends_in_motion",
            Cause::Exposure => "exposure",
            Cause::WhiteBalance => "white_balance",
            Cause::CameraMoved => "camera_moved",
            Cause::PortMoved => "port_moved",
        }
    }

    /// Unit of the cause's figure; `1` for shares and counts.
    pub fn unit(self) -> &'static str {
        match self {
            Cause::LongGap | Cause::Break => "s",
            Cause::BorderResidual | Cause::Calibration => "px",
            Cause::NoiseFloor | Cause::BeginsInMotion | Cause::EndsInMotion => "mm/s",
            Cause::ErrorBar | Cause::CameraMoved | Cause::PortMoved => "mm",
            Cause::FrameRate => "Hz",
            Cause::WhiteBalance => "codes",
            Cause::ColourBackground | Cause::ColourPair => "steps",
            _ => "1",
        }
    }

    /// What was found, with the limit that it broke. The sentence follows the tool's name if it is about one.
    pub fn finding(self, figure: f64, limit: f64) -> String {
        let (percent, percents) = (100.0 * figure, 100.0 * limit);
        let [whole, tenth, hundredth] = [0, 1, 2].map(|digits| digits_apart(figure, limit, digits));
        let [percent_whole, percent_tenth] = [0, 1].map(|digits| digits_apart(percent, percents, digits));
        match self {
            Cause::NothingSeen => "no tool was measured on any frame".to_owned(),
            Cause::NeverInPicture => "it was never in the picture".to_owned(),
            Cause::ColourBackground => {
                let steps = figure.max(0.0);
                format!(
                    "its colour differs from the rest of the box by only {steps:.tenth$} of 255 steps; needs {limit:.tenth$}"
                )
            }
            Cause::ColourPair => {
                let steps = figure.max(0.0);
                format!(
                    "its colour differs from another tool's by only {steps:.tenth$} of 255 steps; needs {limit:.tenth$}"
                )
            }
            Cause::Coverage => {
                format!("measured on {percent:.percent_whole$} % of the frames; needs {percents:.percent_whole$} %")
            }
            Cause::LeftView => format!(
                "out of view for {percent:.percent_whole$} % of the session (limit {percents:.percent_whole$} %)"
            ),
            Cause::Lost => format!(
                "in view but not followed on {percent:.percent_whole$} % of the frames (limit {percents:.percent_whole$} %)"
            ),
            Cause::Predicted => {
                format!(
                    "{percent:.percent_whole$} % of the positions are bridged, not measured (limit {percents:.percent_whole$} %)"
                )
            }
            Cause::LongGap => format!("not measured for {figure:.tenth$} s without a break (limit {limit:.tenth$} s)"),
            Cause::Rejected => {
                format!(
                    "{percent:.percent_tenth$} % of the measurements contradict the motion (limit {percents:.percent_tenth$} %)"
                )
            }
            Cause::BorderResidual => {
                format!(
                    "its borders are {figure:.hundredth$} px off those of a straight tube (limit {limit:.hundredth$} px)"
                )
            }
            Cause::NoiseFloor => {
                format!("at rest it would appear to move at {figure:.tenth$} mm/s (limit {limit:.tenth$} mm/s)")
            }
            Cause::ErrorBar => {
                format!("half of its positions may be off by {figure:.tenth$} mm or more (limit {limit:.tenth$} mm)")
            }
            Cause::Calibration => {
                format!(
                    "the calibration does not fit its own photos: {figure:.hundredth$} px off (limit {limit:.hundredth$} px)"
                )
            }
            Cause::CutFile => {
                format!(
                    "{percent:.percent_whole$} % of the recording's frames are missing from the file (limit {percents:.percent_whole$} %)"
                )
            }
            Cause::Interlaced => {
                format!("{percent:.percent_whole$} % of the frames are interlaced: only every second line was used")
            }
            Cause::FrameRate => format!("{figure:.tenth$} frames a second; needs {limit:.whole$}"),
            Cause::DroppedFrames => {
                format!("{percent:.percent_whole$} % of the frames were dropped (limit {percents:.percent_whole$} %)")
            }
            Cause::Break => format!("no frame for {figure:.tenth$} s (limit {limit:.tenth$} s)"),
            Cause::BeginsInMotion => {
                format!("a tool moves at {figure:.whole$} mm/s as the recording begins (limit {limit:.whole$} mm/s)")
            }
            Cause::EndsInMotion => {
                format!("a tool moves at {figure:.whole$} mm/s as the recording ends (limit {limit:.whole$} mm/s)")
            }
            Cause::Exposure => format!(
                "the picture's brightness changes by {percent:.percent_whole$} % (limit {percents:.percent_whole$} %)"
            ),
            Cause::WhiteBalance => {
                format!("the picture's white balance changes by {figure:.tenth$} codes (limit {limit:.tenth$})")
            }
            Cause::CameraMoved => format!(
                "the camera has moved since earlier recordings with this calibration: all trocars are \
                 {figure:.tenth$} mm from where they were (limit {limit:.tenth$} mm)"
            ),
            Cause::PortMoved => format!(
                "its trocar is {figure:.tenth$} mm from its position in earlier recordings (limit {limit:.tenth$} mm)"
            ),
        }
    }

    /// What to do about it.
    pub fn advice(self) -> &'static str {
        match self {
            Cause::NothingSeen => "mark the tape again on a frame of this recording, in this light",
            Cause::NeverInPicture => {
                "if the task needs this tool, mark its tape again in this light; if not, there is nothing to do"
            }
            Cause::ColourBackground => "wind a tape of a colour that nothing else in the box has, and mark it again",
            Cause::ColourPair => "wind a tape of another colour on one of the two tools, and mark both again",
            Cause::Coverage => "keep the tape in view of the camera; the quality report lists why it was not seen",
            Cause::LeftView => "keep the tip in the picture, or move the camera so that the whole task is in view",
            Cause::Lost => {
                "watch these moments in the recording: does something cover the tape or does it glare? Mark its colour in that light"
            }
            Cause::Predicted | Cause::LongGap => {
                "sums such as the path length leave out what happened there; watch the gaps in the recording"
            }
            Cause::Rejected => "look for something else of the tape's colour in the picture, and mark it as background",
            Cause::BorderResidual => "focus the camera, avoid glare on the tape, and replace creased tape",
            Cause::NoiseFloor => {
                "use more light, a larger picture or a camera closer to the tools, and enter the tape's length"
            }
            Cause::ErrorBar => "move the camera closer, record a larger picture, and enter the tape's length",
            Cause::Calibration => "calibrate again with a flat board, sharp photos and tilted views",
            Cause::CutFile => "send the whole recording again; the file was cut off or damaged",
            Cause::Interlaced => {
                "record progressive video (25p, not 50i), or deinterlace it first: ffmpeg -i IN -vf bwdif=mode=send_field OUT.mp4"
            }
            Cause::FrameRate => "record at 25 frames a second or more",
            Cause::DroppedFrames => "record to a faster disk, over a better connection, or with a smaller picture",
            Cause::Break => "record the task without interruption",
            Cause::BeginsInMotion => {
                "start the recording before the tools move; duration and sums leave out the beginning"
            }
            Cause::EndsInMotion => {
                "end the recording after the tools have come to rest; duration and sums leave out the end"
            }
            Cause::Exposure => "switch off the camera's automatic exposure, and keep the light constant",
            Cause::WhiteBalance => "switch off the camera's automatic white balance, and keep the light constant",
            Cause::CameraMoved => {
                "lengths and speeds are still right, but positions, depth and paths cannot be compared with earlier ones: put \
                 the camera back, or upload the calibration of the box again to start a new comparison"
            }
            Cause::PortMoved => {
                "put the trocar back; if it stays there or the camera was moved, upload the calibration of the box again. \
                 Positions and paths cannot be compared with earlier ones; lengths and speeds are still right"
            }
        }
    }
}

/// Number of decimals, at least `least`, so that a figure reads differently from the limit that it broke.
fn digits_apart(figure: f64, limit: f64, least: usize) -> usize {
    const MOST_MORE: usize = 2;
    let differ = |digits: &usize| format!("{figure:.digits$}") != format!("{limit:.digits$}");
    (least..=least + MOST_MORE).find(differ).unwrap_or(least)
}
