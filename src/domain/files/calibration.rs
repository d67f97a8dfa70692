//! A calibration as `camera.json` keeps it: the camera, and beside it how far to trust it.

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::camera::CameraFile;
use crate::pipeline::camera::{Calibration, Coverage, PhotoReport};

/// One entry of `photos`.
#[derive(Serialize)]
struct PhotoEntry<'a> {
    file: &'a str,
    used: bool,
    rms_px: Option<f64>,
    reason: Option<String>,
}

impl<'a> From<&'a PhotoReport> for PhotoEntry<'a> {
    fn from(photo: &'a PhotoReport) -> Self {
        let reason = photo.reason.map(|r| r.to_string());
        Self { file: &photo.name, used: photo.used(), rms_px: photo.rms_px.map(to_micro), reason }
    }
}

/// The camera file of a calibration made at a time (RFC 3339).
pub fn camera_file(calibration: &Calibration, calibrated_at: &str) -> CameraFile {
    let photos: Vec<PhotoEntry<'_>> = calibration.photos.iter().map(PhotoEntry::from).collect();
    let s = calibration.sigma;
    let sigma = json!({
        "fx": s.fx, "fy": s.fy, "cx": s.cx, "cy": s.cy, "k1": s.k1, "k2": s.k2, "p1": s.p1, "p2": s.p2, "k3": s.k3,
    });
    let coverage = json!({
        "columns": Coverage::COLUMNS, "rows": Coverage::ROWS,
        "share": to_micro(calibration.coverage.share()), "corners": calibration.coverage.corners,
    });
    let more = [
        ("rms_px", json!(to_micro(calibration.rms_px))),
        ("photos", json!(photos)),
        ("sigma", sigma),
        ("coverage", coverage),
        ("calibrated_at", Value::from(calibrated_at)),
    ];
    let more: Map<String, Value> = more.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    CameraFile { more, ..CameraFile::from(calibration.camera) }
}

/// Rounded to a millionth: figures for people; the camera's own numbers are kept in full.
fn to_micro(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}
