//! `truth.json`: the true position of each tool in a simulated or rendered scene.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::checks::evaluation::{Truth, TruthFrame, TruthTool};

/// A truth file as stored on disk, including the keys of other programs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthFile {
    /// Nominal frames per second; evaluations use the frames' own times.
    pub fps: f64,
    /// Every frame of the clip.
    pub frames: Vec<TruthFrameEntry>,
    /// Keys of other programs, such as the sizes of tubes and bands.
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

/// One frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthFrameEntry {
    /// Decoded frames before this one.
    pub frame: u64,
    /// Time of the picture, s.
    pub time_s: f64,
    /// The tools on the frame.
    pub tools: Vec<TruthToolEntry>,
}

/// One tool on one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthToolEntry {
    /// The marker's name.
    pub tool: String,
    /// Tip in the camera frame, mm.
    pub tip_mm: [f64; 3],
    /// Unit vector along the tube from the hand to the tip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// Tip in the recorded frame, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tip_px: Option<[f64; 2]>,
    /// Visible share of the band or of the end of a bare shaft, 0 to 1.
    pub visible: f64,
}

/// Why a truth file cannot be used.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum TruthFileError {
    /// Not JSON, or a key is missing or of the wrong type.
    #[error("not a truth file: {0}")]
    Syntax(String),
    /// Frames out of order: numbers and times must both increase.
    #[error("frame {frame} at {time_s} s does not come after frame {before} at {before_s} s")]
    Order {
        /// The frame.
        frame: u64,
        /// Its time, s.
        time_s: f64,
        /// The frame written before it.
        before: u64,
        /// That frame's time, s.
        before_s: f64,
    },
    /// A tool listed twice on one frame.
    #[error("frame {frame} lists tool `{tool}` twice")]
    RepeatedTool {
        /// The frame.
        frame: u64,
        /// The tool.
        tool: String,
    },
    /// A share outside 0 to 1.
    #[error("frame {frame}, tool `{tool}`: visible is {value}; expected 0 to 1")]
    Visible {
        /// The frame.
        frame: u64,
        /// The tool.
        tool: String,
        /// The value in the file.
        value: f64,
    },
}

impl TruthFile {
    /// Reads and checks a truth file.
    pub fn parse(text: &str) -> Result<Self, TruthFileError> {
        let file: Self = serde_json::from_str(text).map_err(|e| TruthFileError::Syntax(e.to_string()))?;
        file.check_order()?;
        file.frames.iter().try_for_each(TruthFrameEntry::check)?;
        Ok(file)
    }

    /// The file for this truth.
    pub fn new(fps: f64, truth: &Truth) -> Self {
        Self { fps, frames: truth.frames.iter().map(TruthFrameEntry::from).collect(), more: Map::new() }
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default() + "\n" // numbers and strings always serialise
    }

    /// The truth that the file describes.
    pub fn truth(&self) -> Truth {
        Truth { frames: self.frames.iter().map(TruthFrame::from).collect() }
    }

    /// The truth in a trajectory's names. A file may name its tools in its own way and say, in a list `tools`, which
    /// `marker` each carries; a trajectory names them by their markers.
    pub fn truth_named_as(&self, tools: &[String]) -> Truth {
        let mut truth = self.truth();
        let listed = self.more.get("tools").and_then(Value::as_array).into_iter().flatten();
        for one in listed {
            let [name, marker] = ["tool", "marker"].map(|key| one.get(key).and_then(Value::as_str));
            let (Some(name), Some(marker)) = (name, marker) else { continue };
            let is_known = |of: &str| tools.iter().any(|tool| tool == of);
            if is_known(name) || !is_known(marker) {
                continue;
            }
            for tool in truth.frames.iter_mut().flat_map(|frame| &mut frame.tools).filter(|tool| tool.tool == name) {
                tool.tool = marker.to_owned();
            }
        }
        truth
    }

    fn check_order(&self) -> Result<(), TruthFileError> {
        let wrong = self.frames.windows(2).find(|w| w[0].frame >= w[1].frame || w[0].time_s >= w[1].time_s);
        match wrong {
            Some([before, after, ..]) => Err(TruthFileError::Order {
                frame: after.frame,
                time_s: after.time_s,
                before: before.frame,
                before_s: before.time_s,
            }),
            _ => Ok(()),
        }
    }
}

impl TruthFrameEntry {
    fn check(&self) -> Result<(), TruthFileError> {
        let mut names = HashSet::new();
        for entry in &self.tools {
            let (frame, tool) = (self.frame, entry.tool.clone());
            if !names.insert(&entry.tool) {
                return Err(TruthFileError::RepeatedTool { frame, tool });
            }
            if !(0.0..=1.0).contains(&entry.visible) {
                return Err(TruthFileError::Visible { frame, tool, value: entry.visible });
            }
        }
        Ok(())
    }
}

impl From<&TruthFrame> for TruthFrameEntry {
    fn from(frame: &TruthFrame) -> Self {
        let tools = frame.tools.iter().map(TruthToolEntry::from).collect();
        Self { frame: frame.frame, time_s: frame.time_s, tools }
    }
}

impl From<&TruthTool> for TruthToolEntry {
    fn from(tool: &TruthTool) -> Self {
        Self {
            tool: tool.tool.clone(),
            tip_mm: tool.tip_mm.into(),
            axis: tool.axis.map(Into::into),
            tip_px: tool.tip_px.map(Into::into),
            visible: tool.visible,
        }
    }
}

impl From<&TruthFrameEntry> for TruthFrame {
    fn from(entry: &TruthFrameEntry) -> Self {
        let tools = entry.tools.iter().map(TruthTool::from).collect();
        Self { frame: entry.frame, time_s: entry.time_s, tools }
    }
}

impl From<&TruthToolEntry> for TruthTool {
    fn from(entry: &TruthToolEntry) -> Self {
        Self {
            tool: entry.tool.clone(),
            tip_mm: entry.tip_mm.into(),
            axis: entry.axis.map(Into::into),
            tip_px: entry.tip_px.map(Into::into),
            visible: entry.visible,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"{"fps":25,"tool_diameter_mm":8.0,"frames":[
        {"frame":0,"time_s":0.0,"tools":[{"tool":"orange","tip_mm":[-43.04757,-7.74609,189.84106],
         "axis":[0.4,-0.6,0.67],"tip_px":[424.2275,328.5814],"visible":1.0}]},
        {"frame":2,"time_s":0.081,"tools":[]}]}"#;

    #[test]
    fn a_truth_survives_a_round_trip() {
        let file = TruthFile::parse(FILE).unwrap();
        assert_eq!(file.more["tool_diameter_mm"], 8.0);
        assert_eq!(TruthFile::parse(&file.to_json()).unwrap(), file);
        assert_eq!(TruthFile::new(25.0, &file.truth()).frames, file.frames);
    }

    #[test]
    fn a_tool_has_the_name_of_its_marker_if_the_trajectory_calls_it_so() {
        let marked = r#""tools":[{"tool":"orange","marker":"cyan"}],"frames":"#;
        let file = TruthFile::parse(&FILE.replacen("\"frames\":", marked, 1)).unwrap();
        let name = |tools: &[&str]| {
            let tools: Vec<String> = tools.iter().map(|tool| (*tool).to_owned()).collect();
            file.truth_named_as(&tools).frames[0].tools[0].tool.clone()
        };
        assert_eq!(name(&["cyan"]), "cyan");
        assert_eq!(name(&["orange", "cyan"]), "orange");
        assert_eq!(name(&["left"]), "orange");
    }

    #[test]
    fn frames_out_of_order_are_named() {
        let text = FILE.replace("\"frame\":2", "\"frame\":0");
        assert!(matches!(TruthFile::parse(&text), Err(TruthFileError::Order { frame: 0, before: 0, .. })));
    }

    #[test]
    fn a_share_above_one_is_refused() {
        let text = FILE.replace("\"visible\":1.0", "\"visible\":1.5");
        assert!(matches!(TruthFile::parse(&text), Err(TruthFileError::Visible { frame: 0, .. })));
    }
}
