//! Runs a job: a worker claims it, runs confined child processes on its files, validates their output and saves the
//! result.
//!
//! ```text
//! worker ──claim──▶ job ──▶ JobPlan ──▶ sandbox::run ══▶ child: open → Tracker → rows
//!    ▲                                       │ records
//!    │         files in the vault ◀── OutputValidator (checks every record)
//!    │                 │
//!    │                 └──▶ sandbox::run ══▶ child: path → edits → score
//!    │                           │ records
//!    └── save (one transaction) ◀┴─ OutputValidator
//! ```
//! The worker's loop is in `worker.rs`, the claim in `queue`, the score in `scoring/mod.rs`, the save in
//! `store::jobs::finish`.
//!
//! Only children touch pixels and score paths. The parent receives numbers and checks every one of them. A stored path,
//! or a path that another tracker sent, only needs a score: `rescore.rs` runs the second child alone. Photos, edits and
//! tables of a user who is waiting are not a job: `quick.rs` handles them at once in a separate child.

pub mod calibration;
pub mod child;
pub mod clock;
pub mod edits;
pub mod empty_box;
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
pub mod scene;
pub mod scoring;
mod settings;
pub mod stored_palette;
pub mod stored_rows;
mod worker;

pub use attempt::{AttemptFailure, ChildAttempt, run_attempt};
pub use child::{ChildEvent, ChildOutput};
pub use job_plan::{LivePlan, live_plan, open_empty_box};
pub use quick::{CheckedEdit, QuickAnalysis, QuickAnalysisError};
pub use settings::AnalysisSettings;
pub use worker::WorkerPool;
