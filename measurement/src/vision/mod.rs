//! Vision: the pixels of a recording in, a trajectory out. Pure: no files, no network, no clock, no threads of its own.
//!
//! Conventions everywhere: camera frame x right, y down, z forward; millimetres, seconds. Pixel (0, 0) is the
//! *centre* of the top-left pixel. Distortion in OpenCV order `k1 k2 p1 p2 k3`. A *normalised* point is `(x/z, y/z)`
//! after undistortion. A tool's **tip** is the centre of the tube's cross-section at the distal end of the tape band, or
//! of the shaft of a tool without tape.
//!
//! | stage | input | output | file | METHOD |
//! |---|---|---|---|---|
//! | camera | photos of a checkerboard | [`camera::Camera`] | `camera/` | 1 |
//! | segmentation | [`frame::Frame`] | cells with a class | `segmentation/` | 2 |
//! | blob | cells with a class | band candidates of each tool | `blob/` | 3.1 |
//! | strip | [`frame::Frame`], the empty box | bare shafts as straight strips | `strip/` | 3.1 |
//! | edges | band candidate, luma and chroma | borders and band ends (sub-pixel) | `edges/` | 3.2–3.5 |
//! | pose | borders, ends, tube diameter | tip, axis, covariance | `pose/` | 4 |
//! | filter | poses on real time stamps | causal and smoothed states | `filter/` | 5 |
//! | trajectory | states | [`trajectory::Trajectory`] | `trajectory.rs` | 5 |
//!
//! [`tracker`] calls the stages for each frame, and [`still`] those that need no camera. A stage uses the outputs of earlier stages, never those of later ones.
//! [`mod@reference`] has two markerless systems of other authors, which use the same stages and are only compared with it.

pub mod blob;
pub mod camera;
pub mod covariance;
pub mod edges;
pub mod filter;
pub mod frame;
pub mod pose;
pub mod reason;
pub mod reference;
pub mod segmentation;
pub mod space;
pub mod still;
pub mod strip;
pub mod surroundings;
pub mod tracker;
pub mod trajectory;
pub mod tube;
