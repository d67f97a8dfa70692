//! Band candidate in; borders and band ends out, to a fraction of a pixel (METHOD 3.2–3.5).
//!
//! First coarsely, with the colour table: scan lines across the region ([`scan_lines`]), or straight pieces of its
//! boundary ([`parallel_borders`]), and robust lines through their border points ([`line_fit`]). Then finely: short
//! chords along the outline of the tube fitted to the coarse lines ([`outline_probes`]), each moved onto the edge in the
//! pixels ([`subpixel`], all planes at once in [`edge_fit`]), using the learned appearance of edges in this recording
//! ([`edge_model`]).

mod cholesky;
pub mod chroma_siting;
mod edge_curves;
mod edge_fit;
pub mod edge_model;
mod equations;
pub mod exposure;
mod lanes;
pub mod line_fit;
pub mod outline_probes;
pub mod parallel_borders;
pub mod probe;
mod profile;
mod scalar_filter;
pub mod scan_lines;
pub mod shaft;
pub mod shaft_colour_end;
pub mod shaft_end;
pub mod shaft_rows;
pub mod subpixel;
pub mod tone;
mod usual_light;
