//! A simulated box trainer with known truth: it tests the tracker, and demonstrates the service without a hospital.
//!
//! Pure: a [`World`] is a function of time and seed, a [`render::Renderer`] turns one moment of it into the planes that
//! a camera would deliver, and [`truth`] gives the true poses. The `commands` layer writes the files.
//!
//! | what | file |
//! |---|---|
//! | the scenes, and how the hands perform them | `scenario/`, [`skill`], [`motion`] |
//! | the box: camera, lens, lamps, trocars | [`rig`] |
//! | the mat, walls and props | [`board`] |
//! | the tools, and the tape that they carry | [`tool`] |
//! | everything together, at any time | [`world`] |
//! | rays and solids; light and shadow | [`shape`], [`light`] |
//! | pixels | [`render`] |
//! | the true poses; what an instructor would mark | [`truth`], [`marks`] |
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

pub use rig::RigView;
pub use scenario::Scenario;
pub use skill::Skill;
pub use world::{Setup, World};

#[cfg(test)]
mod tests;
