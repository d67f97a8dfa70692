//! The JSON messages between an agent that stands by and the server, each sent as one text message.

use serde::{Deserialize, Serialize};

use super::state::AgentState;
use crate::ids::{FeedId, SessionId, TaskId, TraineeId};

/// A message from the agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum AgentMessage {
    /// The first message of every connection.
    Hello {
        /// [`super::PROTOCOL`].
        protocol: u32,
        /// The agent's program and version, for people.
        program: String,
    },
    /// The state of the box, every two seconds and after each change.
    State {
        /// The computer's time, epoch ms. The answer repeats it.
        sent_at_ms: i64,
        /// The state.
        state: Box<AgentState>,
    },
    /// The answer to a command.
    Done {
        /// The command.
        command: u64,
        /// Why it was refused, for people; absent if it was carried out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        refused: Option<String>,
    },
    /// A trainee typed their code and PIN at the box.
    CheckIn {
        /// The trainee's code.
        trainee: String,
        /// The PIN.
        pin: String,
    },
    /// The trainee leaves the box.
    CheckOut,
    /// A person chose the task of the next recording at the box.
    Task {
        /// The task.
        task: TaskId,
    },
}

/// A message from the server. Agents ignore unknown fields and types.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum ToAgent {
    /// The answer to a hello.
    Welcome {
        /// Name of the box.
        box_name: String,
        /// What the brightness of the picture is compared with: another value when the box is calibrated or tested again.
        light_reference: String,
        /// Longest file that the server takes, bytes: a recording without a name is sent as one. Older servers do not say it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        max_file_bytes: Option<u64>,
        /// When the token expires, RFC 3339, if that is soon.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        token_expires_at: Option<String>,
    },
    /// The answer to a state.
    Time {
        /// As in the state.
        sent_at_ms: i64,
        /// The server's time, epoch ms.
        server_ms: i64,
    },
    /// What the brightness of the picture is compared with from now on.
    LightReference {
        /// As in the welcome.
        light_reference: String,
    },
    /// Start a recording.
    Start(StartCommand),
    /// End the recording, or the wait for the first movement.
    Stop {
        /// Repeated in the answer.
        command: u64,
        /// What is ended: the box may have begun something else meanwhile. Older servers do not say it, and older agents
        /// end what they do.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        target: Option<StopTarget>,
    },
    /// Who is checked in at the box.
    CheckedIn {
        /// `None`: no trainee.
        by: Option<Box<CheckedIn>>,
        /// Why the check-in before has ended, if neither the trainee nor time ended it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        ended: Option<CheckInEnd>,
    },
    /// A check-in with a PIN was refused.
    CheckInRefused {
        /// Why, as a name that the box's screen has a text for.
        why: CheckInRefusal,
        /// How long to wait before the next attempt, s; 0: not at all.
        wait_s: u64,
    },
    /// A check-in with the code on the screen was refused, because the trainee does not consent to recordings. Repeated at
    /// each connection for as long as a check-in lasts without a recording.
    PhoneCheckInRefused {
        /// When, by the server's clock, epoch ms: a refusal that is repeated is the same one.
        refused_at_ms: i64,
    },
    /// The address that a trainee opens on a phone to check in. It replaces the one before.
    CheckInAddress {
        /// The address.
        address: String,
    },
    /// A phone could not open the address: the server knows itself only by one of its own computer.
    NoCheckInAddress {
        /// The server's address, as it knows it.
        server: String,
    },
}

/// Starts a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartCommand {
    /// Repeated in the answer.
    pub command: u64,
    /// Id of the recording.
    pub recording: FeedId,
    /// The trainee; `None`: the recording waits for a name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trainee: Option<NamedTrainee>,
    /// The task; `None` only without a trainee.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<NamedTask>,
    /// True: begin with the first movement in the picture, not at once. Only with a trainee, and only to an agent that can
    /// ([`AgentState::can_start_on_movement`]).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub on_movement: bool,
}

/// What a stop ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopTarget {
    /// This recording.
    Recording(FeedId),
    /// The wait for the first movement of this trainee.
    AwaitedStart(TraineeId),
}

/// A trainee.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NamedTrainee {
    /// The id.
    pub id: TraineeId,
    /// The name.
    pub name: String,
}

/// A task.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NamedTask {
    /// The id.
    pub id: TaskId,
    /// The name.
    pub name: String,
}

/// The trainee who is checked in at a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckedIn {
    /// The trainee.
    pub trainee: NamedTrainee,
    /// The task of the next recording; `None`: not chosen yet.
    pub task: Option<NamedTask>,
    /// The tasks to choose from.
    pub tasks: Vec<NamedTask>,
    /// The trainee's last recording in this box, if it was made since the check-in.
    pub last: Option<LastRecording>,
    /// Time without a recording after which the check-in ends, s.
    pub idle_s: u64,
}

/// A recording, and what is known of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LastRecording {
    /// Its session.
    pub session: SessionId,
    /// The task.
    pub task: String,
    /// `receiving`, `queued`, `tracking`, `done` or `failed`.
    pub status: String,
    /// Whether it met the task's standard: `pass`, `fail` or `unknown`; `None` without a standard or a result.
    pub judgement: Option<String>,
    /// The verdict on its quality, such as `refused`; `None` without a result.
    pub quality: Option<String>,
}

/// Why a check-in with a PIN was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CheckInRefusal {
    /// The code or the PIN is wrong, or the trainee has set no PIN.
    Wrong,
    /// Too many wrong attempts.
    TooMany,
    /// The trainee does not consent to recordings.
    NoConsent,
    /// The server could not check it now.
    Busy,
    /// The box is recording.
    Recording,
}

/// Why a check-in has ended, if neither the trainee nor time ended it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CheckInEnd {
    /// The trainee does not consent to recordings any more.
    NoConsent,
    /// The trainee's record was erased, merged with another one, or is not seen by the person who checked in.
    NoRecord,
}
