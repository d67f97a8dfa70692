//! The science of Trocar: it measures motion in pictures of a box trainer, and judges it.
//!
//! It is pure: no I/O, no clock, no formats. The crate `trocar` is its only user and re-exports its modules. `src/lib.rs`
//! of that crate shows what each module is for, and what it may use.

pub mod random;

pub mod checks;
pub mod motion;
pub mod numbers;
pub mod simulation;
pub mod statistics;
pub mod vision;
