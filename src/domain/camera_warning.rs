//! What makes a camera doubtful, by named limits: how it was calibrated, and what its numbers say. A warning stops no
//! session; it says what to do before the box is used.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::files::camera::CameraFile;
use super::named;
use crate::vision::camera::Camera;
use crate::vision::space::Pixel;

named! {
    /// Kind of warning about a camera.
    CameraWarningKind: "camera warning" {
        /// The corners are far from where the camera expects them.
        Residual = "residual",
        /// Many photos with a board were left out.
        PhotosLeftOut = "photos_left_out",
        /// Photos that show the board at the edge of the picture were left out more often than others.
        EdgeLeftOut = "edge_left_out",
        /// Corners cover too little of the picture.
        Coverage = "coverage",
        /// The focal length is uncertain.
        FocalSigma = "focal_sigma",
        /// There are too few photos to check the stated uncertainty against parts of the set.
        FewPhotos = "few_photos",
        /// The two focal lengths differ.
        FocalRatio = "focal_ratio",
        /// The principal point is far from the centre of the picture.
        Centre = "centre",
        /// The lens model folds back inside the picture.
        Fold = "fold",
    }
}

/// Above this residual every session of the box is to be used with care, px: the limit of the quality gate.
const MAX_RMS_PX: f64 = 1.0;
/// Share of photos with a board that may be left out. One spoiled photo in five happens; beyond it, the photos that are
/// left were selected for agreeing with each other.
const MAX_LEFT_OUT: f64 = 0.2;
/// Photos at the edge may be left out this much more often than others, as a difference of shares.
const MAX_EDGE_EXCESS: f64 = 0.2;
/// Photos at the edge that are left out before they count: a single one may be spoiled by chance.
const MIN_EDGE_LEFT_OUT: usize = 2;
/// Photos that are not at the edge, without which there is no share to compare with.
const MIN_NOT_AT_EDGE: usize = 4;
/// Share of the picture's cells that must hold a corner. In the others the distortion is extrapolated.
const MIN_COVERAGE: f64 = 0.55;
/// Standard deviation of the focal length, as a share. Depth is proportional to the focal length: at a box's 150 to 200
/// mm, 1 % is 1.5 to 2 mm, as much as the error bar of a good position.
const MAX_FOCAL_SIGMA: f64 = 0.01;
/// Photos below which parts of the set cannot give a camera of their own.
pub const MIN_CHECKED_PHOTOS: usize = 5;
/// Difference of the two focal lengths, as a share. Pixels of box cameras and phones are square to 0.3 %; a wrong lens
/// model, or photos in another shape than the recordings, gives several percent.
const MAX_FOCAL_DIFFERENCE: f64 = 0.015;
/// Distance of the principal point from the centre, as a share of the picture's diagonal. Real lenses, also of
/// laparoscopes, are within 4 %. Further off, the photos were cropped, or the camera is not determined.
const MAX_OFF_CENTRE: f64 = 0.08;
/// Cells across and down where the lens model is tried.
const FOLD_GRID: [u32; 2] = [32, 24];

/// A warning about a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CameraWarning {
    /// What is doubtful.
    pub name: CameraWarningKind,
    /// The figure that breaks its limit: pixels (`residual`), a number (`few_photos`), else a share.
    pub figure: f64,
    /// The limit.
    pub limit: f64,
    /// What was found and what to do, in English.
    pub text: String,
}

/// The warnings about a camera, by its numbers and by what its file says about the calibration. A file of another
/// program has only its numbers.
pub fn camera_warnings(file: &CameraFile) -> Vec<CameraWarning> {
    let figures = CameraFigures::of(file);
    CameraWarningKind::ALL.iter().filter_map(|kind| figures.warning(*kind)).collect()
}

/// What is known about a camera, as figures that have limits.
struct CameraFigures {
    rms_px: Option<f64>,
    photos: Option<PhotoCounts>,
    coverage: Option<f64>,
    focal_sigma: Option<f64>,
    focal_difference: f64,
    off_centre: f64,
    folded: f64,
}

/// Photos with a board, in all and at the edge of the picture: `[left out, in all]`.
#[derive(Default)]
struct PhotoCounts {
    all: [usize; 2],
    at_edge: [usize; 2],
}

impl PhotoCounts {
    fn of(photos: &[Value]) -> Self {
        let mut counts = Self::default();
        // Files from before `has_board` have only the residual. An infinite one, of a photo that the camera cannot explain at
        // all, is `null` in the file, as for a photo without a board.
        let has_board = |photo: &&Value| photo["has_board"].as_bool().unwrap_or(photo["rms_px"].is_number());
        for photo in photos.iter().filter(has_board) {
            let left_out = usize::from(photo["used"] == false);
            let add = |count: &mut [usize; 2]| *count = [count[0] + left_out, count[1] + 1];
            add(&mut counts.all);
            if photo["at_edge"] == true {
                add(&mut counts.at_edge);
            }
        }
        counts
    }

    fn used(&self) -> usize {
        self.all[1] - self.all[0]
    }

    /// How much more often photos at the edge were left out than the others.
    fn edge_excess(&self) -> f64 {
        let others = [self.all[0] - self.at_edge[0], self.all[1] - self.at_edge[1]];
        if self.at_edge[0] < MIN_EDGE_LEFT_OUT || others[1] < MIN_NOT_AT_EDGE {
            0.0
        } else {
            share(self.at_edge) - share(others)
        }
    }
}

fn share([part, whole]: [usize; 2]) -> f64 {
    part as f64 / whole.max(1) as f64
}

impl CameraFigures {
    fn of(file: &CameraFile) -> Self {
        let camera = file.camera();
        let number = |of: &str, key: &str| file.more.get(of).and_then(|of| of[key].as_f64());
        Self {
            rms_px: file.rms_px(),
            photos: file.more.get("photos").and_then(Value::as_array).map(|photos| PhotoCounts::of(photos)),
            coverage: number("coverage", "share"),
            focal_sigma: file.focal_sigma(),
            focal_difference: (camera.fx / camera.fy - 1.0).abs(),
            off_centre: off_centre(&camera),
            folded: folded_share(&camera),
        }
    }

    fn warning(&self, name: CameraWarningKind) -> Option<CameraWarning> {
        let above =
            |figure: Option<f64>, limit: f64| figure.filter(|figure| *figure > limit).map(|figure| (figure, limit));
        let photos = self.photos.as_ref();
        let (figure, limit) = match name {
            CameraWarningKind::Residual => above(self.rms_px, MAX_RMS_PX),
            CameraWarningKind::PhotosLeftOut => above(photos.map(|photos| share(photos.all)), MAX_LEFT_OUT),
            CameraWarningKind::EdgeLeftOut => above(photos.map(PhotoCounts::edge_excess), MAX_EDGE_EXCESS),
            CameraWarningKind::Coverage => {
                self.coverage.filter(|share| *share < MIN_COVERAGE).map(|share| (share, MIN_COVERAGE))
            }
            CameraWarningKind::FocalSigma => above(self.focal_sigma, MAX_FOCAL_SIGMA),
            CameraWarningKind::FewPhotos => photos
                .map(PhotoCounts::used)
                .filter(|used| *used < MIN_CHECKED_PHOTOS)
                .map(|used| (used as f64, MIN_CHECKED_PHOTOS as f64)),
            CameraWarningKind::FocalRatio => above(Some(self.focal_difference), MAX_FOCAL_DIFFERENCE),
            CameraWarningKind::Centre => above(Some(self.off_centre), MAX_OFF_CENTRE),
            CameraWarningKind::Fold => above(Some(self.folded), 0.0),
        }?;
        Some(CameraWarning { name, figure, limit, text: text(name, figure, limit) })
    }
}

/// Distance of the principal point from the centre of the picture, as a share of its diagonal.
fn off_centre(camera: &Camera) -> f64 {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    (camera.cx - (width - 1.0) / 2.0).hypot(camera.cy - (height - 1.0) / 2.0) / width.hypot(height)
}

/// Share of the picture's pixels that no direction in space belongs to.
fn folded_share(camera: &Camera) -> f64 {
    let [across, down] = FOLD_GRID;
    let at = |index: u32, of: u32, size: u32| f64::from(index) / f64::from(of) * f64::from(size - 1);
    let pixels = (0..=down).flat_map(|row| (0..=across).map(move |column| (column, row)));
    let folds = |&(column, row): &(u32, u32)| {
        let pixel = Pixel::new(at(column, across, camera.width), at(row, down, camera.height));
        camera.normalised_of(pixel).is_none()
    };
    pixels.filter(folds).count() as f64 / f64::from((across + 1) * (down + 1))
}

fn text(name: CameraWarningKind, figure: f64, limit: f64) -> String {
    let (percent, limit_percent) = (100.0 * figure, 100.0 * limit);
    match name {
        CameraWarningKind::Residual => format!(
            "the corners are off by {figure:.2} px (limit {limit:.1} px): use a flat board, hold it still, lock zoom and focus"
        ),
        CameraWarningKind::PhotosLeftOut => format!(
            "{percent:.0} % of the photos with a board were left out (limit {limit_percent:.0} %): the photos do not agree \
             with each other; use a flat board, lock zoom and focus, and take them again"
        ),
        CameraWarningKind::EdgeLeftOut => format!(
            "photos at the edge of the picture were left out {percent:.0} percentage points more often than others (limit \
             {limit_percent:.0}): the lens model does not fit there; positions near the edge are unreliable"
        ),
        CameraWarningKind::Coverage => format!(
            "corners cover {percent:.0} % of the picture (needs {limit_percent:.0} %): elsewhere the lens is estimated; take \
             more photos with the board at the edges and in the corners of the picture"
        ),
        CameraWarningKind::FocalSigma => format!(
            "the focal length is uncertain by {percent:.1} % (limit {limit_percent:.0} %), and with it all depths; take more \
             photos with the board tilted by 20° to 40° to different sides"
        ),
        CameraWarningKind::FewPhotos => format!(
            "only {figure:.0} photos were used (needs {limit:.0} or more): the stated uncertainty cannot be checked against \
             parts of the set; take about 20"
        ),
        CameraWarningKind::FocalRatio => format!(
            "the focal lengths across and down differ by {percent:.1} % (limit {limit_percent:.1} %), which no usual camera \
             has: the photos do not determine the camera, or were stretched"
        ),
        CameraWarningKind::Centre => format!(
            "the principal point is {percent:.0} % of the picture's diagonal from its centre (limit {limit_percent:.0} %): the \
             photos were cropped, or do not determine the camera"
        ),
        CameraWarningKind::Fold => format!(
            "the lens model folds back in {percent:.1} % of the picture: tools cannot be measured there; take more photos with \
             the board at the edges of the picture, or use a lens with a smaller angle"
        ),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn file(change: impl FnOnce(&mut Value)) -> CameraFile {
        let photos: Vec<Value> = (0..12)
            .map(|n| json!({"file": format!("{n}.jpg"), "used": true, "rms_px": 0.2, "reason": null, "at_edge": n < 5}))
            .collect();
        let mut value = json!({
            "width": 1280, "height": 720, "fx": 938.0, "fy": 936.1, "cx": 633.5, "cy": 366.2,
            "k1": -0.298, "k2": 0.103, "p1": -0.0006, "p2": 0.0009, "k3": -0.012,
            "rms_px": 0.2, "photos": photos, "sigma": {"fx": 0.5, "fy": 0.5}, "coverage": {"share": 0.7},
        });
        change(&mut value);
        serde_json::from_value(value).unwrap()
    }

    fn names(change: impl FnOnce(&mut Value)) -> Vec<&'static str> {
        camera_warnings(&file(change)).iter().map(|warning| warning.name.name()).collect()
    }

    fn leave_out(value: &mut Value, photos: &[usize]) {
        photos.iter().for_each(|&photo| value["photos"][photo]["used"] = json!(false));
    }

    #[test]
    fn a_good_camera_has_no_warning_and_each_limit_has_its_own() {
        assert_eq!(names(|_| {}), [""; 0]);
        assert_eq!(names(|file| file["rms_px"] = json!(4.8)), ["residual"]);
        assert_eq!(names(|file| leave_out(file, &[0, 5, 6, 7])), ["photos_left_out"]);
        assert_eq!(names(|file| leave_out(file, &[0, 1])), ["edge_left_out"]);
        assert_eq!(names(|file| leave_out(file, &[0, 9])), [""; 0], "one at the edge may be chance");
        let few_others = |file: &mut Value| {
            (0..9).for_each(|photo| file["photos"][photo]["at_edge"] = json!(true));
            leave_out(file, &[0, 1]);
        };
        assert_eq!(names(few_others), [""; 0], "three that are not at the edge are too few to compare with");
        let infinite = |has_board: bool| {
            move |file: &mut Value| {
                leave_out(file, &[0, 5, 6]);
                file["photos"][6] = json!({"used": false, "rms_px": null, "at_edge": false, "has_board": has_board});
            }
        };
        assert_eq!(names(infinite(true)), ["photos_left_out"], "an infinite residual is null");
        assert_eq!(names(infinite(false)), [""; 0], "no board");
        assert_eq!(names(|file| file["coverage"]["share"] = json!(0.5)), ["coverage"]);
        assert_eq!(names(|file| file["sigma"]["fy"] = json!(11.0)), ["focal_sigma"]);
        assert_eq!(names(|file| file["fx"] = json!(965.0)), ["focal_ratio"]);
        assert_eq!(names(|file| file["cx"] = json!(800.0)), ["centre"]);
        assert_eq!(names(|file| file["k1"] = json!(-1.5)), ["fold"]);
        let few = names(|file| file["photos"] = json!([{"file": "a", "used": true, "rms_px": 0.1}]));
        assert_eq!(few, ["few_photos"]);
    }

    #[test]
    fn a_warning_names_figure_and_limit() {
        let warning = camera_warnings(&file(|file| file["sigma"]["fx"] = json!(18.76))).remove(0);
        assert!((warning.figure - 0.02).abs() < 1e-12 && warning.limit == 0.01);
        assert!(warning.text.contains("uncertain by 2.0 % (limit 1 %)"), "{}", warning.text);
    }

    #[test]
    fn a_file_of_another_program_is_judged_by_its_numbers() {
        let text = r#"{"width":640,"height":480,"fx":500,"fy":520,"cx":320,"cy":240,"photos":"none","sigma":[1]}"#;
        let found = camera_warnings(&CameraFile::parse(text).unwrap());
        assert_eq!(found.iter().map(|one| one.name).collect::<Vec<_>>(), [CameraWarningKind::FocalRatio]);
    }
}
