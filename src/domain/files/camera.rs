//! `camera.json`: intrinsics and distortion in OpenCV's convention.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::domain::calibration::BoardSize;
use crate::domain::camera_limits::{ImpossibleCamera, check_camera};
use crate::vision::camera::Camera;

/// A camera file as stored on disk: the camera, the calibration's own figures, and keys of other programs (written
/// back unchanged).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraFile {
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Focal length in x, pixels.
    pub fx: f64,
    /// Focal length in y, pixels.
    pub fy: f64,
    /// Principal point, column, pixels.
    pub cx: f64,
    /// Principal point, row, pixels.
    pub cy: f64,
    /// Radial distortion, r².
    #[serde(default)]
    pub k1: f64,
    /// Radial distortion, r⁴.
    #[serde(default)]
    pub k2: f64,
    /// Tangential distortion.
    #[serde(default)]
    pub p1: f64,
    /// Tangential distortion.
    #[serde(default)]
    pub p2: f64,
    /// Radial distortion, r⁶.
    #[serde(default)]
    pub k3: f64,
    /// Everything else: `rms_px`, `photos`, `sigma`, `calibrated_at`, and keys of other programs.
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

/// Why a camera file cannot be used.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CameraFileError {
    /// Not JSON, or a key is missing or of the wrong type.
    #[error("not a camera file: {0}; expected a JSON object with width, height, fx, fy, cx, cy and k1 k2 p1 p2 k3")]
    Syntax(String),
    /// An impossible number.
    #[error("{key} is {value}, which no camera can have")]
    ImpossibleValue {
        /// The key.
        key: &'static str,
        /// The value in the file.
        value: f64,
    },
    /// Numbers that are possible one by one, but not for one camera.
    #[error(transparent)]
    ImpossibleCamera(#[from] ImpossibleCamera),
}

/// Longest side of a picture, pixels: more than any camera has.
const MAX_SIDE_PX: f64 = 65_535.0;

impl CameraFile {
    /// Reads and checks a camera file.
    pub fn parse(text: &str) -> Result<Self, CameraFileError> {
        let file: Self = serde_json::from_str(text).map_err(|e| CameraFileError::Syntax(e.to_string()))?;
        file.check()?;
        Ok(file)
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default(); // numbers and strings always serialise
        text.push('\n');
        text
    }

    /// The camera that the file describes.
    pub fn camera(&self) -> Camera {
        Camera {
            width: self.width,
            height: self.height,
            fx: self.fx,
            fy: self.fy,
            cx: self.cx,
            cy: self.cy,
            k1: self.k1,
            k2: self.k2,
            p1: self.p1,
            p2: self.p2,
            k3: self.k3,
            focal_sigma: self.focal_sigma().unwrap_or(0.0),
        }
    }

    /// Standard deviation of the focal lengths as a share of them, the larger of both, if stated.
    pub fn focal_sigma(&self) -> Option<f64> {
        let sigma = self.more.get("sigma")?;
        let share = |key: &str, focal_px: f64| Some(sigma.get(key)?.as_f64()? / focal_px);
        Some(share("fx", self.fx)?.max(share("fy", self.fy)?)).filter(|share| *share >= 0.0)
    }

    /// RMS reprojection error of its calibration, pixels, if stated.
    pub fn rms_px(&self) -> Option<f64> {
        self.more.get("rms_px").and_then(Value::as_f64).filter(|rms| *rms >= 0.0)
    }

    /// The board that the calibration was made with and the side of a square, mm, if stated.
    pub fn board(&self) -> Option<(BoardSize, f64)> {
        let size = self.more.get("board").and_then(Value::as_str)?.parse().ok()?;
        let square_mm = self.more.get("square_mm").and_then(Value::as_f64)?;
        (square_mm > 0.0 && square_mm <= 1000.0).then_some((size, square_mm))
    }

    fn check(&self) -> Result<(), CameraFileError> {
        let positive =
            [("width", f64::from(self.width)), ("height", f64::from(self.height)), ("fx", self.fx), ("fy", self.fy)];
        let finite = [
            ("cx", self.cx),
            ("cy", self.cy),
            ("k1", self.k1),
            ("k2", self.k2),
            ("p1", self.p1),
            ("p2", self.p2),
            ("k3", self.k3),
        ];
        let sizes = positive.into_iter().take(2).find(|(_, px)| *px > MAX_SIDE_PX);
        let bad_size = positive.into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0));
        let bad_number = finite.into_iter().find(|(_, v)| !v.is_finite());
        match bad_size.or(sizes).or(bad_number) {
            Some((key, value)) => Err(CameraFileError::ImpossibleValue { key, value }),
            None => Ok(check_camera(&self.camera())?),
        }
    }
}

impl From<Camera> for CameraFile {
    fn from(c: Camera) -> Self {
        Self {
            width: c.width,
            height: c.height,
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
            k1: c.k1,
            k2: c.k2,
            p1: c.p1,
            p2: c.p2,
            k3: c.k3,
            more: Map::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resources::shared;

    #[test]
    fn keys_of_other_programs_survive_a_round_trip() {
        let text =
            r#"{"width":640,"height":480,"fx":500.1,"fy":500.2,"cx":320,"cy":240,"k1":-0.1,"maker":{"lens":"x"}}"#;
        let file = CameraFile::parse(text).unwrap();
        assert_eq!(file.k3, 0.0);
        assert_eq!(CameraFile::parse(&file.to_json()).unwrap(), file);
        assert_eq!(file.more["maker"]["lens"], "x");
    }

    #[test]
    fn the_larger_error_of_both_focal_lengths_counts() {
        let camera = |more: &str| {
            let text = format!(r#"{{"width":640,"height":480,"fx":500,"fy":400,"cx":320,"cy":240{more}}}"#);
            CameraFile::parse(&text).unwrap().camera()
        };
        assert_eq!(camera(r#","sigma":{"fx":1,"fy":2}"#).focal_sigma, 0.005);
        for unknown in ["", r#","sigma":{"fx":1}"#, r#","sigma":"small""#, r#","sigma":{"fx":-1,"fy":-1}"#] {
            assert_eq!(camera(unknown).focal_sigma, 0.0, "{unknown}");
        }
    }

    #[test]
    fn numbers_that_no_camera_has_are_refused_by_name() {
        let of = |more: &str| {
            let text = format!(r#"{{"width":1280,"height":720,"fx":938,"fy":936,"cx":633,"cy":366,{more}}}"#);
            CameraFile::parse(&text).map(|_| ()).map_err(|error| error.to_string())
        };
        assert_eq!(of(r#""k1":-0.298,"k2":0.103"#), Ok(()));
        assert!(of(r#""k1":-1.5"#).unwrap_err().contains("k1"));
        let far = r#"{"width":1280,"height":720,"fx":938,"fy":936,"cx":6400,"cy":366}"#;
        let refused = CameraFile::parse(far).unwrap_err();
        assert!(
            matches!(refused, CameraFileError::ImpossibleCamera(ImpossibleCamera::Centre { key: "cx", .. })),
            "{refused}"
        );
    }

    #[test]
    fn the_cameras_of_all_shared_recordings_are_accepted() {
        let Some(worlds) = shared("worlds/dev") else { return };
        let cameras = worlds.read_dir().unwrap().map(|entry| entry.unwrap().path().join("contract/camera_true.json"));
        let texts: Vec<String> = cameras.filter_map(|path| std::fs::read_to_string(path).ok()).collect();
        assert!(texts.len() > 20, "{}", texts.len());
        for text in texts {
            CameraFile::parse(&text).unwrap_or_else(|refused| panic!("{refused}: {text}"));
        }
    }

    #[test]
    fn a_focal_length_of_zero_is_refused_by_name() {
        let text = r#"{"width":640,"height":480,"fx":0,"fy":500,"cx":320,"cy":240}"#;
        assert_eq!(CameraFile::parse(text), Err(CameraFileError::ImpossibleValue { key: "fx", value: 0.0 }));
    }
}
