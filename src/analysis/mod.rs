//! Runs a job: a worker claims it, runs a confined child process on its files, assesses the child's output and saves
//! the result.
//!
//! ```text
//! worker ──claim──▶ job ──▶ JobPlan ──▶ sandbox::run ══▶ child: open → Tracker → rows
//!    ▲                                       │ records
//!    └── save (one transaction) ◀── assess ◀── OutputValidator (checks every record)
//! ```
//! Only the child touches pixels. The parent receives numbers and checks every one of them. A stored path, or a path
//! that another tracker sent, has no pixels: `rescore.rs` assesses it without a child. Photos and frames for a user who
//! is waiting are not a job: `quick.rs` analyses them at once in a separate child.

pub mod calibration;
pub mod child;
pub mod edits;
pub mod marked;
pub mod paths;
pub mod protocol;
pub mod self_test;

mod again;
mod attempt;
pub mod diagnostics;
mod glance;
mod orders;
mod product;
mod receipt;
mod settings;
mod worker;

pub use attempt::{Attempt, Failure, attempt};
pub use glance::{Glances, Unseen};
pub use orders::{LiveOrders, track_in};
pub use receipt::{Heard, News};
pub use settings::AnalysisSettings;
pub use worker::Workshop;
