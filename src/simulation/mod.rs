//! A simulated box trainer with known truth: to test the tracker against, and to show the service without a hospital.
//!
//! Pure: a [`World`] is a function of time and seed, a [`render::Renderer`] turns a moment of it into the planes that a
//! camera would deliver, [`truth`] says what is really there. Writing files is the rim's work.
//!
//! | what | file |
//! |---|---|
//! | the scenes, and how hands play them | `scenario/`, [`skill`], [`motion`] |
//! | the box: camera, lens, lamps, trocars | [`rig`] |
//! | the mat, walls and props | [`board`] |
//! | the tools and their tapes | [`tool`] |
//! | all of it at a time | [`world`] |
//! | rays and solids; light and shadow | [`shape`], [`light`] |
//! | pixels | [`render`] |
//! | what is really there; what an instructor would mark | [`truth`], [`marks`] |
//! | photos of a checkerboard | [`checkerboard`] |

pub mod board;
pub mod checkerboard;
pub mod light;
pub mod marks;
pub mod motion;
pub mod render;
pub mod rig;
pub mod scenario;
pub mod schedule;
pub mod shape;
pub mod skill;
pub mod tool;
pub mod truth;
pub mod world;

pub use rig::View;
pub use scenario::Scenario;
pub use skill::Skill;
pub use world::{Setup, World};

#[cfg(test)]
mod tests;
