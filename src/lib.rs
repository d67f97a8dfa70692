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
//! | 0 base | [`time`] [`ids`] [`shutdown`] [`heap`] [`random`] | any other module |
//! | 1 pure | [`numbers`] ← [`vision`] ← [`motion`] ← [`statistics`]; [`simulation`]; [`checks`] | tokio, axum, sqlx, ffmpeg, `std::{fs, net, env, thread}`, the clock, `serde_json` and other formats |
//! | 2 domain | [`domain`] | tokio, axum, sqlx, ffmpeg, files, network |
//! | 3 adapters | [`media`] [`store`] [`vault`] [`sandbox`] [`identity_provider`] | axum, each other; sqlx only in `store`, ffmpeg only in `media` |
//! | 4 services | [`queue`] [`analysis`] [`intake`] [`live`] [`capture`] [`certificates`] [`cohorts`] [`rescoring`] [`events`] [`access_log`] [`box_agents`] [`upkeep`] | axum, sqlx, ffmpeg |
//! | 5 outside | [`http`] [`commands`] [`settings`] | `http` names neither sqlx nor the science |
//!
//! An arrow reads *is used by*. `simulation` uses only `vision`'s camera, space, frame and sample types, and `checks`
//! may use all pure modules.
//!
//! The pure layer and [`random`] are a crate of their own, [`measurement`], for two reasons: it cannot name the rest, and
//! development builds optimise its loops without optimising the rest. This crate re-exports its modules.
//!
//! # Invariants
//! docs/architecture.md explains them, under the same numbers.
//!
//! 1. The pure layer does no I/O and does not fail on its input: it returns what it measured, and a reason for what is
//!    missing.
//! 2. Pixels are never processed on an async thread, and never in the process that serves HTTP.
//! 3. No database transaction spans a frame, a file or a network call.
//! 4. Every stored result names its versions of pipeline, calibration, colours and model.
//! 5. Service, command line, tests and benches drive the same [`vision::tracker::Tracker`] and the same assessment.
//! 6. A byte is acknowledged only when it is durable: sync the file, write the row, then answer.
//! 7. Every queue, buffer, upload, retry and loop has a limit with a name. Limits that people may want to change are
//!    [`settings`].
//! 8. Time comes from [`time::Clock`] or from the frame. Tests poll with a deadline; only tests of faults and loads
//!    wait, through one helper.
//! 9. No copy, colour conversion or remap of a whole frame on the way of a frame: points are undistorted, pixels are
//!    looked up.
//! 10. Personal data need a [`domain::scope::Scope`].
//! 11. A released migration never changes.

pub mod heap;
pub mod ids;
pub mod shutdown;
pub mod time;

pub use measurement::{checks, motion, numbers, random, simulation, statistics, vision};

pub mod domain;

pub mod identity_provider;
pub mod media;
pub mod sandbox;
pub mod store;
pub mod vault;

pub mod access_log;
pub mod analysis;
pub mod box_agents;
pub mod capture;
pub mod certificates;
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
#[cfg(test)]
#[path = "../measurement/src/vision/tracker/testing.rs"]
mod small_box;
#[cfg(test)]
#[path = "../measurement/src/vision/camera/testing.rs"]
mod test_cameras;
