//! Score: where a feature's value stands among reference values (METHOD 7.1).

pub mod cohort;
