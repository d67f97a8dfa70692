//! Poses on real time stamps in, causal and smoothed states out (METHOD 5).

pub mod adaptive_noise;
pub mod kalman;
pub mod motion_model;
pub mod smoother;
pub mod track;
