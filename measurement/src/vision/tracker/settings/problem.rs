//! What can be wrong with the settings of a tracker.

/// Why a tracker cannot be created from its settings.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingsProblem {
    /// The camera was calibrated at another picture size.
    #[error(
        "the camera is calibrated for {}×{} pixels, but the recording is {}×{}{}; calibrate at the recorded size",
        camera.0, camera.1, frame.0, frame.1, shown_text(*shown)
    )]
    OtherSize {
        /// Width and height in the calibration.
        camera: (u32, u32),
        /// Width and height of the frames, as stored.
        frame: (u32, u32),
        /// Width and height at which players show them, if that differs.
        shown: Option<(u32, u32)>,
    },
    /// Nothing to track.
    #[error("no tool is given; mark at least one rectangle on a tool's tape")]
    NoTool,
    /// More than two tools share a colour.
    #[error("{0} tools have tape of the colour `{1}`; at most two can share one; use another colour for the others")]
    CrowdedColour(usize, String),
    /// Two tools of one colour have the same stated side.
    #[error(
        "tools `{0}` and `{1}` have the same colour and the same `side`; correct `side`, or use another colour for one \
         of them"
    )]
    SameSide(String, String),
    /// A tool's colour was not marked.
    #[error("tool `{0}` has no colour samples; mark rectangles on its tape and label them `{0}`")]
    NoSamples(String),
    /// Only tool colours were marked, so every colour would be a tool.
    #[error("nothing but tools was marked; also mark rectangles of the scene and label them `background`")]
    NoBackground,
    /// More tools than the colour table supports.
    #[error("{0} tools are given; at most {1} can be tracked")]
    TooManyLabels(usize, usize),
    /// A tube's size is not a positive number.
    #[error("tool `{tool}`: {what} is given as {value_mm} mm; it must be more than 0")]
    Size {
        /// The tool.
        tool: String,
        /// Diameter or band length.
        what: &'static str,
        /// The value given, mm.
        value_mm: f64,
    },
}

impl SettingsProblem {
    /// The same problem of a recording that players show at this size: pixels need not be square.
    pub fn of_shown(self, size: (u32, u32)) -> Self {
        match self {
            Self::OtherSize { camera, frame, .. } => {
                Self::OtherSize { camera, frame, shown: Some(size).filter(|&size| size != frame) }
            }
            other => other,
        }
    }
}

fn shown_text(shown: Option<(u32, u32)>) -> String {
    shown.map_or(String::new(), |(width, height)| {
        format!(" as stored (its pixels are not square, and players show it as {width}×{height})")
    })
}
