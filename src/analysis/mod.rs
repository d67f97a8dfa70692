//! Runs a job: a worker claims it, runs a confined child process on its files, assesses the child's output and saves
//! the result.
//!
//! ```text
//! worker ──claim──▶ job ──▶ JobPlan ──▶ sandbox::run ══▶ child: open → Tracker → rows
//!    ▲                                       │ records
//!    └── save (one transaction) ◀── assess ◀── OutputValidator (checks every record)
//! ```
//! The worker's loop is in `worker.rs`, the claim in `queue`, `assess` in `results.rs`, the save in
//! `store::jobs::finish`.
//!
//! Only the child touches pixels. The parent receives numbers and checks every one of them. A stored path, or a path
//! that another tracker sent, has no pixels: `rescore.rs` assesses it without a child. Photos and frames for a user who
//! is waiting are not a job: `quick.rs` analyses them at once in a separate child.

pub mod calibration;
pub mod child;
pub mod clock;
pub mod edits;
pub mod marked;
pub mod paths;
pub mod protocol;
pub mod self_test;

mod attempt;
mod box_pictures;
pub mod diagnostics;
mod job_kinds;
mod job_plan;
mod output_validator;
mod quick;
mod rescore;
mod results;
mod settings;
pub mod stored_palette;
pub mod stored_rows;
mod worker;

pub use attempt::{AttemptFailure, ChildAttempt, run_attempt};
pub use child::{ChildEvent, ChildOutput};
pub use job_plan::{LivePlan, live_plan};
pub use quick::{QuickAnalysis, QuickAnalysisError};
pub use settings::AnalysisSettings;
pub use worker::WorkerPool;
