//! What can be wrong with a session: a closed set, so that each has its sentence and says what to do.

/// What can be wrong with a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Cause {
    /// No tool was ever measured.
    NothingSeen,
    /// A tool was never in the picture.
    NeverInPicture,
    /// A tool's colour is hardly apart from what is no tool.
    ColourBackground,
    /// A tool's colour is hardly apart from another tool's.
    ColourPair,
    /// A tool was measured on too few frames.
    Coverage,
    /// A tool was out of view for too long.
    LeftView,
    /// A tool was in view, and not followed, for too long.
    Lost,
    /// Too many of a tool's positions are bridged.
    Predicted,
    /// A tool was not measured for too long at a stretch.
    LongGap,
    /// Too many measurements contradict a tool's motion.
    Rejected,
    /// A band's borders are not where its tube would have them.
    BorderResidual,
    /// A resting tool would seem to move.
    NoiseFloor,
    /// Positions are too unsure.
    ErrorBar,
    /// The camera's calibration does not fit its own photos.
    Calibration,
    /// The file ends before the recording does.
    CutFile,
    /// Frames that hold two moments, line by line.
    Interlaced,
    /// Too few frames a second.
    FrameRate,
    /// Too many frames were dropped.
    DroppedFrames,
    /// The recording breaks off and goes on later, or its clock jumps.
    Break,
    /// The recording begins after the task did.
    BeginsInMotion,
    /// The recording ends before the task does.
    EndsInMotion,
    /// The picture's brightness changes.
    Exposure,
    /// The picture's white changes.
    WhiteBalance,
    /// All trocars lie elsewhere, as if the camera had moved since earlier sessions.
    CameraMoved,
    /// One trocar lies elsewhere than in earlier sessions.
    PortMoved,
}

impl Cause {
    /// Every cause, in the order in which people should mend them.
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

    /// Unit of its figure; `1` for shares and counts.
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

    /// What was found, with the limit that it broke; after the tool's name, where it is about one.
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
                    "its colour is told from the rest of the box by {steps:.tenth$} of 255 steps only; needs {limit:.tenth$}"
                )
            }
            Cause::ColourPair => {
                let steps = figure.max(0.0);
                format!(
                    "its colour is told from another tool's by {steps:.tenth$} of 255 steps only; needs {limit:.tenth$}"
                )
            }
            Cause::Coverage => {
                format!("measured on {percent:.percent_whole$} % of the frames; needs {percents:.percent_whole$} %")
            }
            Cause::LeftView => format!(
                "out of view for {percent:.percent_whole$} % of the session; at most {percents:.percent_whole$} %"
            ),
            Cause::Lost => format!(
                "in view but not followed on {percent:.percent_whole$} % of the frames; at most {percents:.percent_whole$} %"
            ),
            Cause::Predicted => {
                format!(
                    "{percent:.percent_whole$} % of the positions are bridged, not measured; at most {percents:.percent_whole$} %"
                )
            }
            Cause::LongGap => format!("not measured for {figure:.tenth$} s at a stretch; at most {limit:.tenth$} s"),
            Cause::Rejected => {
                format!(
                    "{percent:.percent_tenth$} % of the measurements contradict the motion; at most {percents:.percent_tenth$} %"
                )
            }
            Cause::BorderResidual => {
                format!(
                    "its borders lie {figure:.hundredth$} px off those of a straight tube; at most {limit:.hundredth$} px"
                )
            }
            Cause::NoiseFloor => {
                format!("at rest it would seem to move at {figure:.tenth$} mm/s; at most {limit:.tenth$} mm/s")
            }
            Cause::ErrorBar => {
                format!("half of its positions are less sure than {figure:.tenth$} mm; at most {limit:.tenth$} mm")
            }
            Cause::Calibration => {
                format!(
                    "the calibration misses its own photos by {figure:.hundredth$} px; at most {limit:.hundredth$} px"
                )
            }
            Cause::CutFile => {
                format!(
                    "{percent:.percent_whole$} % of the recording's frames are not in the file; at most {percents:.percent_whole$} %"
                )
            }
            Cause::Interlaced => {
                format!(
                    "{percent:.percent_whole$} % of the frames are interlaced: only every second of their lines was used"
                )
            }
            Cause::FrameRate => format!("{figure:.tenth$} frames a second; needs {limit:.whole$}"),
            Cause::DroppedFrames => {
                format!("{percent:.percent_whole$} % of the frames were dropped; at most {percents:.percent_whole$} %")
            }
            Cause::Break => format!("no frame for {figure:.tenth$} s; at most {limit:.tenth$} s"),
            Cause::BeginsInMotion => {
                format!("a tool moves at {figure:.whole$} mm/s as the recording begins; at most {limit:.whole$} mm/s")
            }
            Cause::EndsInMotion => {
                format!("a tool moves at {figure:.whole$} mm/s as the recording ends; at most {limit:.whole$} mm/s")
            }
            Cause::Exposure => format!(
                "the picture's brightness changes by {percent:.percent_whole$} %; at most {percents:.percent_whole$} %"
            ),
            Cause::WhiteBalance => {
                format!("the picture's white changes by {figure:.tenth$} codes; at most {limit:.tenth$}")
            }
            Cause::CameraMoved => format!(
                "the camera has moved since earlier recordings with this calibration: all trocars lie {figure:.tenth$} mm \
                 from where they were; at most {limit:.tenth$} mm"
            ),
            Cause::PortMoved => format!(
                "its trocar lies {figure:.tenth$} mm from where one was in earlier recordings; at most {limit:.tenth$} mm"
            ),
        }
    }

    /// What to do about it.
    pub fn advice(self) -> &'static str {
        match self {
            Cause::NothingSeen => "mark the tape again on a frame of this recording, in this light",
            Cause::NeverInPicture => {
                "if the task needs this tool, mark its tape again in this light; if not, nothing is lost"
            }
            Cause::ColourBackground => "wind a tape of a colour that nothing else in the box has, and mark it again",
            Cause::ColourPair => "wind a tape of another colour on one of the two tools, and mark both again",
            Cause::Coverage => "keep the tape in sight of the camera; what hid it is listed with what was seen",
            Cause::LeftView => "keep the tip in the picture, or move the camera so that the whole task is in view",
            Cause::Lost => {
                "look in the recording at what hides or dazzles the tape there; mark its colour in that light"
            }
            Cause::Predicted | Cause::LongGap => {
                "sums such as the path's length miss what happened there; look at the gaps"
            }
            Cause::Rejected => "look for something else of the tape's colour in the picture, and mark it as background",
            Cause::BorderResidual => "focus the camera, avoid glare on the tape, and renew tape that is creased",
            Cause::NoiseFloor => {
                "use more light, a larger picture or a camera nearer to the tools, and give the tape's length"
            }
            Cause::ErrorBar => "bring the camera nearer, record a larger picture, and give the tape's length",
            Cause::Calibration => "calibrate again with a flat board, sharp photos and tilted views",
            Cause::CutFile => "send the recording again, whole; it was cut or damaged on the way",
            Cause::Interlaced => {
                "record progressively (25p, not 50i), or send it deinterlaced: ffmpeg -i IN -vf bwdif=mode=send_field OUT.mp4"
            }
            Cause::FrameRate => "record at 25 frames a second or more",
            Cause::DroppedFrames => "record to a faster disk or over a better line, or in a smaller picture",
            Cause::Break => "record the task in one piece",
            Cause::BeginsInMotion => "start the recording before the tools move; duration and sums miss the beginning",
            Cause::EndsInMotion => "end the recording after the tools rest; duration and sums miss the end",
            Cause::Exposure => "switch off the camera's automatic exposure, and keep the light as it is",
            Cause::WhiteBalance => "switch off the camera's automatic white balance, and keep the light as it is",
            Cause::CameraMoved => {
                "lengths and speeds stay right, but positions, depth and paths do not compare with earlier ones: put the \
                 camera back, or send the box its calibration again, and the comparison begins anew"
            }
            Cause::PortMoved => {
                "put the trocar back, or, if it stays there or the camera was moved, send the box its calibration again: \
                 positions and paths do not compare with earlier ones; lengths and speeds stay right"
            }
        }
    }
}

/// Digits behind the point, at least so many, with which a figure does not read as the limit that it broke.
fn digits_apart(figure: f64, limit: f64, least: usize) -> usize {
    const MOST_MORE: usize = 2;
    let differ = |digits: &usize| format!("{figure:.digits$}") != format!("{limit:.digits$}");
    (least..=least + MOST_MORE).find(differ).unwrap_or(least)
}
