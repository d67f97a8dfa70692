//! The phases of the child of one recording, from the first sender to the end of the recording.
//!
//! ```text
//!         start             attach              close            end_run
//! Absent ───────▶ Starting ────────▶ Running ────────▶ Stopping ─────────▶ Absent
//!                    ▲                  ▲               │    │
//!                    │                  └─── attach ────┘    │
//!                    └── end_run, if a sender connected ─────┘
//!
//! every phase ──take_task──▶ Ending ──end_run──▶ Absent
//!                              └─────start─────▶ Starting
//! ```
//! One task runs the children one after the other: after a crash it attaches the next child. Only a child in `Running`
//! receives records. In `Ending` the caller that ends the recording owns the task and waits for it.

use tokio::task::JoinHandle;

use super::child_input::{ChildInput, SentRecords};

/// The phase of a recording's child.
#[derive(Default)]
pub(super) enum ChildPhase {
    /// No task runs children.
    #[default]
    Absent,
    /// The task is about to start a child.
    Starting {
        /// Runs the children.
        task: JoinHandle<()>,
    },
    /// A child receives records.
    Running {
        /// Runs the children.
        task: JoinHandle<()>,
        /// The child's input.
        input: ChildInput,
    },
    /// The child finishes the records that it has, or has crashed.
    Stopping {
        /// Runs the children.
        task: JoinHandle<()>,
        /// A sender connected meanwhile: another child starts after this one.
        is_requested: bool,
    },
    /// The recording is being ended: a child that starts now stops after its first records.
    Ending {
        /// As in `Stopping`.
        is_requested: bool,
    },
}

impl ChildPhase {
    /// Requests a child for a sender. Returns true if a task runs children; if its child is being stopped, another will
    /// follow it.
    pub(super) fn request_child(&mut self) -> bool {
        let has_task = self.has_task();
        if let Self::Stopping { is_requested, .. } = self {
            *is_requested = has_task;
        }
        has_task
    }

    /// Connects a new child. At the end of the recording it receives only the records that wait in its input.
    pub(super) fn attach(&mut self, mut input: ChildInput, sent: &mut SentRecords) {
        *self = match std::mem::take(self) {
            Self::Starting { task } | Self::Running { task, .. } | Self::Stopping { task, .. } => {
                Self::Running { task, input }
            }
            Self::Absent | Self::Ending { .. } => {
                input.send_next(usize::MAX, false, sent);
                Self::Ending { is_requested: false }
            }
        };
    }

    /// Sends all waiting records and closes the child's input.
    pub(super) fn close(&mut self, sent: &mut SentRecords) {
        *self = match std::mem::take(self) {
            Self::Running { task, mut input } => {
                input.send_next(usize::MAX, false, sent);
                Self::Stopping { task, is_requested: false }
            }
            other => other,
        };
    }

    /// The task has run its last child. Returns true if another one is to start: a sender requested it, and the caller
    /// allows it (`may_restart`).
    pub(super) fn end_run(&mut self, may_restart: bool) -> bool {
        let restarts = may_restart && self.is_requested();
        *self = match std::mem::take(self) {
            Self::Stopping { task, .. } if restarts => Self::Starting { task },
            Self::Ending { .. } if restarts => Self::Ending { is_requested: false },
            _ => Self::Absent,
        };
        restarts
    }

    /// The recording is being ended, and the input is closed: the caller waits for the task.
    pub(super) fn take_task(&mut self) -> Option<JoinHandle<()>> {
        let is_requested = self.is_requested();
        match std::mem::replace(self, Self::Ending { is_requested }) {
            Self::Starting { task } | Self::Running { task, .. } | Self::Stopping { task, .. } => Some(task),
            Self::Absent | Self::Ending { .. } => None,
        }
    }

    /// The input of the child that receives records.
    pub(super) fn input(&self) -> Option<&ChildInput> {
        match self {
            Self::Running { input, .. } => Some(input),
            _ => None,
        }
    }

    /// The same, to change it.
    pub(super) fn input_mut(&mut self) -> Option<&mut ChildInput> {
        match self {
            Self::Running { input, .. } => Some(input),
            _ => None,
        }
    }

    /// True if a child receives records or starts soon.
    pub(super) fn expects_records(&self) -> bool {
        self.input().is_some() || self.has_task()
    }

    /// True if a task runs children. A task that panicked has ended in any phase.
    fn has_task(&self) -> bool {
        match self {
            Self::Starting { task } | Self::Running { task, .. } | Self::Stopping { task, .. } => !task.is_finished(),
            Self::Absent | Self::Ending { .. } => false,
        }
    }

    fn is_requested(&self) -> bool {
        matches!(self, Self::Stopping { is_requested: true, .. } | Self::Ending { is_requested: true })
    }
}
