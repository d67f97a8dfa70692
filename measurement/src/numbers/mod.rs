//! Numbers: quantiles and probability distributions, the leaf of the pure layers.
//!
//! `vision`, `motion`, `statistics` and `checks` use this module; it uses none of them.

pub mod distribution;
pub mod quantile;
