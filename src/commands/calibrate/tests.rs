//! The command on published photos with published calibrations, on rendered photos, and on unusable input.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, GrayImage, ImageEncoder, RgbImage};
use nalgebra::{Matrix3, Vector2, Vector3};
use tempfile::TempDir;

use super::*;
use crate::domain::files::camera::CameraFile;
use crate::media::testing::exif;
use crate::resources::shared;
use crate::vision::camera::Camera;
use crate::vision::space::Pixel;

fn photos(folder: &Path) -> Vec<PathBuf> {
    let is_photo = |p: &PathBuf| p.extension().is_some_and(|e| e == "jpg" || e == "png");
    let mut found: Vec<_> = folder.read_dir().unwrap().map(|e| e.unwrap().path()).filter(is_photo).collect();
    found.sort();
    found
}

fn calibrated(columns: usize, rows: usize, square_mm: f64, inputs: Vec<PathBuf>) -> Result<CameraFile, CommandFailure> {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("camera.json");
    run(CalibrateArgs { board: CornerCounts { columns, rows }, square_mm, out: out.clone(), quiet: true, inputs })?;
    Ok(CameraFile::parse(&std::fs::read_to_string(out).unwrap()).unwrap())
}

fn left_out(file: &CameraFile) -> Vec<&str> {
    let photos = file.more["photos"].as_array().unwrap().iter();
    photos.filter(|p| p["used"] == false).map(|p| p["file"].as_str().unwrap()).collect()
}

fn rms_px(file: &CameraFile) -> f64 {
    file.more["rms_px"].as_f64().unwrap()
}

/// Largest distance, px, between the directions of two cameras at these pixels, after one common shift and scale is
/// removed. Photos of boards hardly separate the principal point from the boards' tilt, or the focal length from their
/// distance; the remaining difference is distortion.
fn distortion_differs_px(a: &Camera, b: &Camera, at: &[Pixel]) -> f64 {
    let look = |camera: &Camera| at.iter().map(|p| camera.normalised_of(*p).unwrap().0.coords).collect::<Vec<_>>();
    let (from, to) = (look(a), look(b));
    let (mut square, mut slope) = (Matrix3::zeros(), Vector3::zeros());
    for (from, to) in from.iter().zip(&to) {
        for (row, target) in [(Vector3::new(from.x, 1.0, 0.0), to.x), (Vector3::new(from.y, 0.0, 1.0), to.y)] {
            square += row * row.transpose();
            slope += row * target;
        }
    }
    let fit = square.try_inverse().unwrap() * slope;
    let miss = |(from, to): (&Vector2<f64>, &Vector2<f64>)| (from * fit.x + fit.yz() - to).norm() * b.fx;
    from.iter().zip(&to).map(miss).fold(0.0, f64::max)
}

/// Pixels on a grid over the area that corners cover.
fn pixels_inside_hull(camera: &Camera, corners: &[Pixel]) -> Vec<Pixel> {
    let hull = hull(corners);
    let side = |a: &Vector2<f64>, b: &Vector2<f64>, p: &Vector2<f64>| (b - a).perp(&(p - a));
    let inside = |p: &Vector2<f64>| (0..hull.len()).all(|i| side(&hull[i], &hull[(i + 1) % hull.len()], p) >= 0.0);
    let at = |i: u32, of: u32, size: u32| f64::from(i) / f64::from(of) * f64::from(size - 1);
    let grid = (0..=96).flat_map(|i| (0..=60).map(move |j| (i, j)));
    let points = grid.map(|(i, j)| Vector2::new(at(i, 96, camera.width), at(j, 60, camera.height)));
    points.filter(inside).map(|p| Pixel::new(p.x, p.y)).collect()
}

/// The convex hull, by monotone chains.
fn hull(corners: &[Pixel]) -> Vec<Vector2<f64>> {
    let mut points: Vec<_> = corners.iter().map(|p| p.0.coords).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let chain = |points: &mut dyn Iterator<Item = &Vector2<f64>>| {
        let mut chain: Vec<Vector2<f64>> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..] {
                if (b - a).perp(&(p - b)) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(*p);
        }
        chain.pop();
        chain
    };
    let (lower, upper) = (chain(&mut points.iter()), chain(&mut points.iter().rev()));
    [lower, upper].concat()
}

/// Pixels in the middle of the picture: no photo of the rendered scenes shows the board in the picture's corners.
fn middle_pixels(camera: &Camera) -> Vec<Pixel> {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let whole = pixels_inside_hull(
        camera,
        &[(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)].map(|(u, v)| Pixel::new(u, v)),
    );
    let from_middle = |p: &Pixel| (p.u() - width / 2.0).hypot(p.v() - height / 2.0);
    whole.into_iter().filter(|p| from_middle(p) < 0.4 * width.hypot(height)).collect()
}

#[test]
fn all_opencv_photos_are_used_and_agree_with_the_known_camera() {
    let Some(folder) = shared("data/checkerboard-opencv-left") else { return };
    let file = calibrated(9, 6, 25.0, photos(&folder)).unwrap();
    assert_eq!(left_out(&file), [""; 0]);
    assert!(rms_px(&file) <= 1.05 * 0.195, "{}", rms_px(&file));
    let corners = std::fs::read_to_string(folder.join("corners_left_opencv_win5.csv")).unwrap();
    let corners: Vec<_> = corners.lines().skip(1).map(|line| pixel_of(line.split(',').skip(3))).collect();
    let known = Camera {
        width: 640,
        height: 480,
        fx: 532.83,
        fy: 532.95,
        cx: 342.49,
        cy: 233.86,
        k1: -0.2809,
        k2: 0.0252,
        p1: 0.0012,
        p2: -0.0001,
        k3: 0.1634,
        focal_sigma: 0.0,
    };
    let off = distortion_differs_px(&file.camera(), &known, &pixels_inside_hull(&known, &corners));
    assert!(off < 0.5, "{off}");
}

#[test]
fn all_laparoscope_photos_are_used_and_agree_with_the_known_camera() {
    let Some(folder) = shared("data/checkerboard-laparoscope-left") else { return };
    let file = calibrated(14, 10, 3.0, photos(&folder)).unwrap();
    assert_eq!(left_out(&file), [""; 0]);
    assert!(rms_px(&file) <= 1.05 * 0.579, "{}", rms_px(&file));
    let points =
        photos(&folder).into_iter().map(|p| std::fs::read_to_string(format!("{}.points.txt", p.display())).unwrap());
    let corners: Vec<_> =
        points.flat_map(|text| text.lines().map(|l| pixel_of(l.split(' '))).collect::<Vec<_>>()).collect();
    let known = Camera {
        width: 1920,
        height: 1080,
        fx: 2007.4,
        fy: 2013.9,
        cx: 945.5,
        cy: 619.1,
        k1: -0.2369,
        k2: -0.2482,
        p1: 0.0030,
        p2: -0.0014,
        k3: 1.371,
        focal_sigma: 0.0,
    };
    let off = distortion_differs_px(&file.camera(), &known, &pixels_inside_hull(&known, &corners));
    assert!(off < 0.5, "{off}");
}

fn pixel_of<'a>(mut numbers: impl Iterator<Item = &'a str>) -> Pixel {
    let mut next = || numbers.next().unwrap().trim().parse().unwrap();
    Pixel::new(next(), next())
}

#[test]
fn bent_boards_of_rendered_scenes_are_left_out_and_the_camera_is_the_true_one() {
    for scene in ["V", "W"] {
        let Some(folder) = shared(&format!("scenes/calib/{scene}")) else { return };
        let truth: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(folder.join("truth.json")).unwrap()).unwrap();
        let file = calibrated(9, 6, 21.0, photos(&folder)).unwrap();
        assert_eq!(serde_json::json!(left_out(&file)), truth["bent_files"]);
        assert!(rms_px(&file) < 0.06, "{scene}: {}", rms_px(&file));
        let true_camera = CameraFile::parse(&truth["camera"].to_string()).unwrap().camera();
        let off = distortion_differs_px(&file.camera(), &true_camera, &middle_pixels(&true_camera));
        assert!(off < 0.3, "{scene}: {off}");
    }
}

#[test]
fn a_wrong_board_size_is_refused_with_the_size_in_the_photos() {
    let Some(folder) = shared("data/checkerboard-opencv-left") else { return };
    for (columns, rows) in [(8, 6), (10, 7), (7, 10)] {
        let inputs = photos(&folder).into_iter().take(4).collect();
        let failure = calibrated(columns, rows, 25.0, inputs).unwrap_err();
        assert_eq!(failure.status(), 2);
        let (text, fits) = (failure.to_string(), if columns > rows { "9x6" } else { "6x9" });
        assert!(text.contains(&format!("the photos show {fits} inner corners")), "{text}");
        assert!(!text.contains("hidden"), "the hint is said once: {text}");
    }
}

#[test]
fn spoiled_files_among_photos_are_left_out_and_the_camera_stays_the_same() {
    let Some(folder) = shared("scenes/calib/V") else { return };
    let mut inputs = photos(&folder);
    inputs.truncate(14);
    let spoiled = TempDir::new().unwrap();
    let path = |name: &str| spoiled.path().join(name);
    for (place, name, taller_by) in [(2, "same.bmp", 0), (4, "tall_1.png", 1), (9, "tall_2.png", 1)] {
        let picture = image::open(&inputs[place]).unwrap();
        let (width, height) = (picture.width(), picture.height() + taller_by);
        picture.resize_exact(width, height, image::imageops::FilterType::Nearest).save(path(name)).unwrap();
        inputs[place] = path(name);
    }
    let others = inputs.iter().filter(|path| !path.ends_with("tall_1.png") && !path.ends_with("tall_2.png"));
    let alone = calibrated(9, 6, 21.0, others.cloned().collect()).unwrap();
    std::fs::write(path("notes.txt"), "dear diary").unwrap();
    inputs.push(path("notes.txt"));
    let file = calibrated(9, 6, 21.0, inputs).unwrap();
    assert_eq!(file.camera(), alone.camera(), "the other photos decide");
    let reason = |name: &str| {
        let photos = file.more["photos"].as_array().unwrap();
        photos.iter().find(|photo| photo["file"] == name).unwrap()["reason"].as_str().map(str::to_owned)
    };
    for name in ["tall_1.png", "tall_2.png"] {
        assert!(reason(name).unwrap().contains("most photos are"), "{:?}", reason(name));
    }
    assert!(reason("notes.txt").unwrap().contains("not a photo that can be read"));
    assert_eq!(reason("same.bmp"), None);
}

/// Writes the files and returns the command's error message for them.
fn refusal(files: &[(&str, &[u8])]) -> String {
    let folder = TempDir::new().unwrap();
    let write = |(name, bytes): &(&str, &[u8])| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let failure = calibrated(9, 6, 21.0, files.iter().map(write).collect()).unwrap_err();
    assert_eq!(failure.status(), 2, "{failure}");
    let text = failure.to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

fn png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    GrayImage::new(width, height).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn unusable_input_is_refused_in_one_line_with_advice() {
    let (small, large) = (png(320, 240), png(400, 300));
    let sizes = refusal(&[("a.png", &small), ("b.png", &large)]);
    assert!(sizes.contains("400×300 (b.png)") && sizes.contains("320×240 (a.png)"), "{sizes}");
    let text = refusal(&[("notes.txt", b"dear diary"), ("more.txt", b"dear diary")]);
    assert!(text.contains("notes.txt") && text.contains("JPEG, PNG and BMP"), "{text}");
    let one = refusal(&[("a.png", &small)]);
    assert!(one.contains("found in 0 of 1 photos, at least 3"), "{one}");
    let neither = refusal(&[("notes.txt", b"dear diary")]);
    assert!(neither.contains("taken as a video"), "{neither}");
}

/// A grey photo with this orientation tag, 1 to 8.
fn tagged_jpeg(orientation: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
    encoder.set_exif_metadata(exif(orientation)).unwrap();
    encoder.write_image(&[128; 320 * 240], 320, 240, ExtendedColorType::L8).unwrap();
    bytes
}

#[test]
fn photos_that_are_turned_differently_are_refused_by_name() {
    let [upright, upside_down, quarter] = [1, 3, 6].map(tagged_jpeg);
    for (turned, tag) in [(&upside_down, "EXIF 3"), (&quarter, "EXIF 6")] {
        let text = refusal(&[("a.jpg", &upright), ("b.jpg", turned), ("c.jpg", &upright)]);
        assert!(text.contains("b.jpg") && text.contains(tag) && text.contains("the same way"), "{text}");
    }
    let alike = refusal(&[("a.jpg", &upside_down), ("b.jpg", &upside_down), ("c.jpg", &upside_down)]);
    assert!(alike.contains("found in 0 of 3"), "one turn for all photos is right: {alike}");
}

#[test]
fn a_huge_photo_is_refused_with_its_size() {
    let mut bytes = std::io::Cursor::new(Vec::new());
    RgbImage::new(5000, 10).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    let huge = bytes.into_inner();
    let text = refusal(&[("a.png", &huge), ("b.png", &huge), ("c.png", &huge)]);
    assert!(text.contains("5000×10") && text.contains("limit"), "{text}");
}

#[test]
fn a_missing_photo_is_named() {
    let failure = calibrated(9, 6, 21.0, vec!["/nowhere/a.jpg".into()]).unwrap_err();
    assert!(failure.status() == 2 && failure.to_string().contains("/nowhere/a.jpg"), "{failure}");
}

#[test]
fn impossible_boards_are_refused() {
    for (columns, rows, square_mm) in [(1, 6, 21.0), (9, 6, 0.0), (9, 6, f64::NAN)] {
        assert_eq!(calibrated(columns, rows, square_mm, Vec::new()).unwrap_err().status(), 2);
    }
    assert!("9by6".parse::<CornerCounts>().is_err());
    assert_eq!("9x6".parse(), Ok(CornerCounts { columns: 9, rows: 6 }));
}
