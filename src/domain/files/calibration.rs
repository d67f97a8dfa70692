//! A calibration as a `camera.json`: the camera and its accuracy.

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::camera::CameraFile;
use crate::domain::camera_warning::camera_warnings;
use crate::vision::camera::report::PhotoReason;
use crate::vision::camera::{Calibration, Coverage, PhotoReport};

/// One entry of `photos`.
#[derive(Serialize)]
struct PhotoEntry<'a> {
    file: &'a str,
    used: bool,
    rms_px: Option<f64>,
    reason: Option<String>,
    at_edge: bool,
    /// True if the board was found at the camera's picture size, also in a photo that was left out.
    has_board: bool,
}

impl<'a> PhotoEntry<'a> {
    fn new(photo: &'a PhotoReport, at_edge: bool) -> Self {
        let reason = photo.reason.as_ref().map(|r| r.to_string());
        let has_board = !matches!(
            photo.reason,
            Some(PhotoReason::NoCorners(_) | PhotoReason::Unreadable(_) | PhotoReason::OtherSize { .. })
        );
        Self {
            file: &photo.name,
            used: photo.is_used(),
            rms_px: photo.rms_px.map(to_micro),
            reason,
            at_edge,
            has_board,
        }
    }
}

/// The camera file of a calibration made at a time (RFC 3339), with its warnings. `at_edge` says of each photo whether
/// it shows the board at the edge of the picture.
pub fn camera_file(calibration: &Calibration, at_edge: &[bool], calibrated_at: &str) -> CameraFile {
    let entry = |(photo, at_edge): (_, &bool)| PhotoEntry::new(photo, *at_edge);
    let photos: Vec<PhotoEntry<'_>> = calibration.photos.iter().zip(at_edge).map(entry).collect();
    let s = calibration.sigma;
    let sigma = json!({
        "fx": s.fx, "fy": s.fy, "cx": s.cx, "cy": s.cy, "k1": s.k1, "k2": s.k2, "p1": s.p1, "p2": s.p2, "k3": s.k3,
    });
    let coverage = json!({
        "columns": Coverage::COLUMNS, "rows": Coverage::ROWS,
        "share": to_micro(calibration.coverage.share()), "corners": calibration.coverage.corners,
    });
    let more = [
        ("board", json!(format!("{}x{}", calibration.board.columns(), calibration.board.rows()))),
        ("square_mm", json!(calibration.board.square_mm())),
        ("rms_px", json!(to_micro(calibration.rms_px))),
        ("photos", json!(photos)),
        ("sigma", sigma),
        ("coverage", coverage),
        ("calibrated_at", Value::from(calibrated_at)),
    ];
    let more: Map<String, Value> = more.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    let mut file = CameraFile { more, ..CameraFile::from(calibration.camera) };
    let warnings = camera_warnings(&file);
    file.more.insert("warnings".to_owned(), json!(warnings));
    file
}

/// Rounds figures for people to a millionth; the camera's own numbers keep full precision.
fn to_micro(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::report::CameraSigma;
    use crate::vision::camera::{Board, Camera, PhotoReason};

    fn calibration() -> Calibration {
        let photo = |name: &str, rms_px, reason| PhotoReport { name: name.to_owned(), rms_px, reason };
        let bent = PhotoReason::Bent { bulge_mm: 4.21 };
        Calibration {
            camera: Camera {
                width: 640,
                height: 480,
                fx: 532.123_456_789_012_3,
                fy: 532.9,
                cx: 342.5,
                cy: 233.9,
                k1: -0.28,
                k2: 0.025,
                p1: 0.0012,
                p2: -0.0001,
                k3: 0.163,
                focal_sigma: 0.0,
            },
            board: Board::new(9, 6, 20.5).unwrap(),
            rms_px: 0.195_000_04,
            photos: vec![photo("a.jpg", Some(0.2), None), photo("b.jpg", Some(3.7), Some(bent))],
            sigma: CameraSigma { fx: 0.4, fy: 0.4, cx: 0.3, cy: 0.3, k1: 1e-3, k2: 1e-2, p1: 1e-4, p2: 1e-4, k3: 1e-1 },
            coverage: Coverage { corners: vec![0; Coverage::COLUMNS * Coverage::ROWS] },
        }
    }

    #[test]
    fn the_camera_survives_the_file_to_the_last_bit() {
        let file = camera_file(&calibration(), &[true, false], "2026-01-02T03:04:05Z");
        let again = CameraFile::parse(&file.to_json()).unwrap();
        let focal_sigma = 0.4 / calibration().camera.fx;
        assert_eq!(again.camera(), Camera { focal_sigma, ..calibration().camera });
        assert_eq!(again.board(), Some(("9x6".parse().unwrap(), 20.5)), "a self-test finds the board in the file");
    }

    #[test]
    fn a_photo_left_out_says_why() {
        let file = camera_file(&calibration(), &[true, false], "2026-01-02T03:04:05Z");
        let more = CameraFile::parse(&file.to_json()).unwrap().more;
        assert_eq!(
            more["photos"][0],
            json!({"file": "a.jpg", "used": true, "rms_px": 0.2, "reason": null, "at_edge": true, "has_board": true})
        );
        assert_eq!((&more["photos"][1]["used"], &more["photos"][1]["rms_px"]), (&json!(false), &json!(3.7)));
        assert!(more["photos"][1]["reason"].as_str().unwrap().contains("bent"));
        assert_eq!((&more["rms_px"], &more["sigma"]["k3"]), (&json!(0.195), &json!(0.1)));
        assert_eq!(more["calibrated_at"], "2026-01-02T03:04:05Z");
        let warnings: Vec<&Value> =
            more["warnings"].as_array().unwrap().iter().map(|warning| &warning["name"]).collect();
        assert_eq!(warnings, ["photos_left_out", "coverage", "few_photos"]);
    }
}
