//! Exchange formats that other programs rely on. Text in, values out, and back; where the text lies is not their matter.

pub mod annotations;
pub mod calibration;
pub mod camera;
pub mod features;
pub mod quality;
pub mod trajectory;
pub mod truth;
