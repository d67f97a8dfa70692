//! The science: pixels in, score out. Pure: no files, no network, no clock, no threads of its own.
//!
//! Conventions everywhere: camera frame x right, y down, z forward; millimetres, seconds. Pixel (0, 0) is the
//! *centre* of the top-left pixel. Distortion in OpenCV order `k1 k2 p1 p2 k3`. A *normalised* point is `(x/z, y/z)`
//! after undistortion. A tool's **tip** is the centre of the tube's cross-section at the distal end of the tape band.
//!
//! | stage | input | output | file | METHOD |
//! |---|---|---|---|---|
//! | camera | photos of a checkerboard | [`camera::Camera`] | `camera/` | 1 |
//! | segmentation | [`frame::Frame`] | cells with a class | `segmentation/` | 2 |
//! | blob | cells with a class | one band candidate per tool | `blob/` | 3.1 |
//! | edges | band candidate, luma and chroma | borders, midline, band ends (sub-pixel) | `edges/` | 3.2–3.5 |
//! | pose | borders, ends, tube diameter | tip, axis, covariance | `pose/` | 4 |
//! | filter | poses on real time stamps | causal and smoothed states | `filter/` | 5 |
//! | trajectory | states | [`trajectory::Trajectory`] | `trajectory.rs` | 5 |
//! | features | trajectory | [`features::Feature`] values with units | `features/` | 6 |
//! | evidence | features and their motion | the stretches of time that determined each | `evidence/` | 6 |
//! | quality | trajectories, frame counts, reasons | figures and a [`quality::QualityVerdict`] | `quality/` | 6, 8 |
//! | self-test | frames of a known board, trajectory | traffic light of the box | `self_test/` | 1, 8 |
//! | score | features | cohort ranks, judgements, learning curves, alarms, levels of skill | `score/` | 7 |

pub mod assessment;
pub mod blob;
pub mod camera;
pub mod edges;
pub mod evaluation;
pub mod features;
pub mod filter;
pub mod frame;
pub mod pose;
pub mod quality;
pub mod reason;
pub mod score;
pub mod segmentation;
pub mod self_test;
pub mod space;
pub mod stretches;
pub mod tracker;
pub mod trajectory;
pub mod tube;

/// Version of the whole chain from pixels to features. Raised whenever the same input gives other numbers. Stored with
/// every result, so that results of different versions are never compared by mistake.
pub const PIPELINE_VERSION: &str = "11";
