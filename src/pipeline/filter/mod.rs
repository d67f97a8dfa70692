//! Poses on real time stamps in, causal and smoothed states out (METHOD 5).

pub mod identity;
pub mod kalman;
pub mod liveliness;
pub mod motion_model;
pub mod smoother;
