//! What an agent knows of its box. Durations instead of times of day: the clock of the computer may be wrong.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::{FeedId, SessionId, TaskId, TraineeId};

/// A clock that differs by more than this has to be set, ms: two clocks that are set over a network differ by less.
pub const MAX_CLOCK_OFFSET_MS: i64 = 120_000;

/// Longest text in a state, characters.
const MAX_TEXT_CHARS: usize = 200;

/// The state of a box, as its agent reports it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AgentState {
    /// The camera.
    pub camera: BoxCameraState,
    /// The light; `None` until the first picture was measured.
    pub light: Option<LightState>,
    /// What the server does not have yet.
    pub spool: SpoolState,
    /// The clock of the computer; `None` until it was compared.
    pub clock: Option<ClockState>,
    /// The recording that is being made.
    pub recording: Option<RecordingState>,
    /// The recording that begins with the first movement in the picture.
    #[serde(default)]
    pub awaited_start: Option<AwaitedStartState>,
    /// True if the agent can let a recording begin with the first movement.
    #[serde(default)]
    pub can_start_on_movement: bool,
}

/// A recording that begins with the first movement in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AwaitedStartState {
    /// The trainee.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
    /// True once the picture is still: a movement is seen only then.
    pub is_picture_still: bool,
}

/// The camera of a box.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BoxCameraState {
    /// True while frames arrive.
    pub is_open: bool,
    /// Picture width, pixels; `null` until the camera was open.
    pub width: Option<u32>,
    /// Picture height, pixels.
    pub height: Option<u32>,
    /// Frames per second, over the last seconds; `null` while the camera is missing.
    pub frame_rate_hz: Option<f64>,
    /// How long the camera has been missing, s; `null` while it is there.
    pub missing_s: Option<f64>,
    /// Why it is missing; `null` while it is there.
    pub why: Option<String>,
    /// True if exposure and white balance are held, false if the camera changes them by itself; `null` if that is not
    /// known, such as for a stream.
    pub is_exposure_held: Option<bool>,
}

/// The light in a box: the mean brightness of the whole picture. A mat or a hand changes it as well.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LightState {
    /// Mean luma of the last pictures, 0 to 255.
    pub level: f64,
    /// The same as a multiple of the reference: the first minute after the box's calibration or its last self-test, as
    /// this agent saw it. `null` until that minute is over.
    pub ratio: Option<f64>,
}

/// Recordings that are not complete on the server.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SpoolState {
    /// Number of recordings.
    pub recordings: u64,
    /// Frames that the server has not acknowledged.
    pub frames: u64,
    /// Their size, bytes.
    pub bytes: u64,
    /// Recordings among them that have no name.
    #[serde(default)]
    pub unnamed: u64,
    /// Free space on the disk of the spool, bytes; `null` if it is not known.
    pub disk_free_bytes: Option<u64>,
    /// True if spool or disk have no space for a recording of some seconds.
    #[serde(default)]
    pub is_full: bool,
    /// Why a recording stays in the spool although the server is there: the server refused it, or its file cannot be made
    /// or sent; `null` if there is none.
    pub refused: Option<String>,
}

/// The clock of the computer beside a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ClockState {
    /// The server's time minus that of the computer, ms.
    pub offset_ms: i64,
    /// Half of the time that the exchange took, ms: the offset is right to this.
    pub uncertainty_ms: i64,
}

impl ClockState {
    /// From an exchange: the computer's time when it asked and when the answer came, and the server's time in it, epoch
    /// ms. The answer was written between the two, at their middle give or take half of the time between them.
    pub fn of_exchange(asked_ms: i64, server_ms: i64, answered_ms: i64) -> Self {
        let took_ms = answered_ms.saturating_sub(asked_ms).max(0);
        let middle_ms = asked_ms.saturating_add(took_ms / 2);
        Self { offset_ms: server_ms.saturating_sub(middle_ms), uncertainty_ms: (took_ms + 1) / 2 }
    }

    /// True if a person has to set the clock.
    pub fn is_wrong(self) -> bool {
        self.offset_ms.saturating_abs() > MAX_CLOCK_OFFSET_MS.saturating_add(self.uncertainty_ms)
    }
}

/// The recording that an agent is making.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordingState {
    /// Its id.
    pub recording: FeedId,
    /// The trainee; `None`: the recording has no name.
    pub trainee: Option<TraineeId>,
    /// The task, if it is known.
    pub task: Option<TaskId>,
    /// Its session; `None` until the server has accepted the recording.
    pub session: Option<SessionId>,
    /// Time since it began, s.
    pub recorded_s: f64,
    /// Frames so far.
    pub frames: u64,
}

impl AgentState {
    /// The state with its texts cut to a length that pages can show. It comes from a program that may be wrong.
    pub fn limited(mut self) -> Self {
        for text in [&mut self.camera.why, &mut self.spool.refused].into_iter().flatten() {
            *text = text.chars().filter(|c| !c.is_control()).take(MAX_TEXT_CHARS).collect();
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// However the time of an exchange is split between the two ways, the offset is right to its uncertainty.
        #[test]
        fn the_offset_is_right_to_its_uncertainty(
            offset_ms in -100_000_000_i64..100_000_000, there_ms in 0_i64..20_000, back_ms in 0_i64..20_000,
        ) {
            let asked_ms = 1_800_000_000_000;
            let server_ms = asked_ms + there_ms + offset_ms;
            let clock = ClockState::of_exchange(asked_ms, server_ms, asked_ms + there_ms + back_ms);
            prop_assert!((clock.offset_ms - offset_ms).abs() <= clock.uncertainty_ms);
        }
    }

    #[test]
    fn a_clock_that_is_off_by_a_day_is_wrong_and_a_slow_network_is_no_wrong_clock() {
        let day_ms = 86_400_000;
        assert!(ClockState { offset_ms: day_ms, uncertainty_ms: 5 }.is_wrong());
        assert!(ClockState { offset_ms: -day_ms, uncertainty_ms: 5 }.is_wrong());
        assert!(!ClockState { offset_ms: 130_000, uncertainty_ms: 20_000 }.is_wrong());
        assert!(!ClockState { offset_ms: -1_000, uncertainty_ms: 5 }.is_wrong());
    }

    #[test]
    fn texts_of_an_agent_are_cut_and_hold_no_control_characters() {
        let camera =
            BoxCameraState { why: Some("\u{1b}[2J".to_owned() + &"ü".repeat(300)), ..BoxCameraState::default() };
        let why = AgentState { camera, ..AgentState::default() }.limited().camera.why.unwrap();
        assert!(why.starts_with("[2Jü") && why.chars().count() == MAX_TEXT_CHARS, "{why}");
    }
}
