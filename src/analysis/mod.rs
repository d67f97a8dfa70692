//! The job: claim it, run a confined child on its files, assess what the child says, save the result.
//!
//! ```text
//! worker ──claim──▶ job ──▶ orders ──▶ sandbox::run ══▶ child: open → Tracker → rows
//!    ▲                                     │ records
//!    └── save (one transaction) ◀── assess ◀── receipt (checks every record)
//! ```
//! Pixels are touched in the child alone; the parent sees numbers, and believes none of them unchecked. A path that lies here already, or
//! that another tracker sent, has no pixels: `again.rs` assesses it without a child. A photo or a few frames for which somebody
//! waits are no job: `glance.rs` looks at them in a child of their own, at once.

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
