//! Band candidate in; borders, midline and band ends out, to a fraction of a pixel (METHOD 3.2–3.5).
//!
//! First coarsely, from the colour table: scan lines across the region ([`scan_lines`]) and robust lines through what
//! they meet ([`line_fit`]). Then finely: short chords laid along the outline of the tube that the coarse lines gave
//! ([`outline_probes`]), each moved onto the edge that the pixels show ([`subpixel`], all planes at once in [`edge_fit`]), as
//! edges look in this recording ([`edge_model`]).

mod definite;
mod edge_curves;
mod edge_fit;
pub mod edge_model;
mod equations;
mod lanes;
pub mod line_fit;
pub mod mixing;
pub mod outline_probes;
pub mod probe;
mod profile;
pub mod scan_lines;
pub mod shaft;
pub mod subpixel;
pub mod tone;
