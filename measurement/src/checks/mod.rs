//! Checks: does a box still measure correctly, and how accurate is the method? Pure, like [`crate::vision`].
//!
//! | part | input | output | file | METHOD |
//! |---|---|---|---|---|
//! | self-test | frames of a known board, trajectory | traffic light of a box | `self_test/` | 1, 8 |
//! | evaluation | trajectory and truth | errors, repeatability, noise at rest | `evaluation/` | 8 |

pub mod evaluation;
pub mod self_test;
