//! Trocar measures how surgeons move in a laparoscopic box trainer.
//!
//! **The science is pure. All other modules serve it.** It has a folder for each question:
//!
//! | folder | input → output |
//! |---|---|
//! | [`vision`] | pixels → trajectory: segmentation → blob → edges → pose → filter → trajectory |
//! | [`motion`] | trajectory → features with error bars, the stretches that made them, the quality verdict |
//! | [`statistics`] | numbers → judgements: standards, cohorts, learning curves, CUSUM, levels of skill, agreement |
//! | [`checks`] | does a box, and the method, still measure correctly: self-test, evaluation against truth |
//!
//! [`vision::tracker`] shows the way of a frame in a few lines, [`analysis`] the way of an uploaded recording.
//!
//! # Layers
//! Imports point downwards only; `tests/integration/architecture/` enforces it.
//!
//! | layer | modules | must not name |
//! |---|---|---|
//! | 0 base | [`time`] [`ids`] [`shutdown`] [`heap`] [`random`] | any other module of this crate |
//! | 1 pure | [`numbers`] ← [`vision`] ← [`motion`] ← [`statistics`]; [`simulation`]; [`checks`] | tokio, axum, sqlx, ffmpeg, `std::{fs, net, env, thread}`, the clock, `serde_json` and other formats |
//! | 2 domain | [`domain`] | tokio, axum, sqlx, ffmpeg, files, network |
//! | 3 adapters | [`media`] [`store`] [`vault`] [`sandbox`] | axum, each other; sqlx only in `store`, ffmpeg only in `media` |
//! | 4 services | [`queue`] [`analysis`] [`intake`] [`live`] [`capture`] [`cohorts`] [`rescoring`] [`events`] [`upkeep`] | axum, sqlx, ffmpeg |
//! | 5 rim | [`http`] [`commands`] [`settings`] | sqlx in `http`; `http` never calls the science |
//!
//! An arrow reads *is used by*. `simulation` uses only `vision`'s camera, space, frame and sample types, and `checks`
//! may use all pure modules.
//!
//! # Invariants, as absences
//! 1. The science does no I/O and does not fail on input: it returns what it measured, and reasons for what is
//!    missing.
//! 2. Pixels never run on an async thread, and never in the process that serves HTTP.
//! 3. No database transaction spans a frame, a file or a network call.
//! 4. Every stored result names the versions of calibration, palette and pipeline that made it.
//! 5. Server, command line, tests and benches drive the same [`vision::tracker::Tracker`].
//! 6. A byte is acknowledged only when it is durable: first the file is synced, then the row written, then the answer
//!    sent.
//! 7. Every queue, buffer, upload, retry and loop has a limit with a name in [`settings`].
//! 8. Time comes from [`time::Clock`] or from the frame. Tests poll with a deadline; only tests of faults and loads
//!    wait, through one helper.
//! 9. No full-frame copy, colour conversion or remap on the hot path: points are undistorted, pixels are looked up.

pub mod heap;
pub mod ids;
pub mod random;
pub mod shutdown;
pub mod time;

pub mod checks;
pub mod motion;
pub mod numbers;
pub mod simulation;
pub mod statistics;
pub mod vision;

pub mod domain;

pub mod media;
pub mod sandbox;
pub mod store;
pub mod vault;

pub mod analysis;
pub mod capture;
pub mod cohorts;
pub mod events;
pub mod intake;
pub mod live;
pub mod queue;
pub mod rescoring;
pub mod upkeep;

pub mod commands;
pub mod http;
pub mod settings;

#[cfg(test)]
#[path = "../tests/integration/resources.rs"]
mod resources;
