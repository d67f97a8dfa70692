//! Calibration and colours in a child, from photos and pictures as users send them.

use trocar::analysis::protocol::{CalibrateWork, ColourMark, PaletteWork, RequestedBoard};
use trocar::domain::files::camera::CameraFile;
use trocar::domain::palette::ColourGrade;
use trocar::vision::segmentation::samples::{ColourSamples, MarkedRectangle};

use super::clips::ffmpeg;
use super::tracking::SharedScene;
use super::*;
use crate::resources::shared;

fn ask(work: ChildWork, inputs: &[PathBuf]) -> Result<ChildOutput, AttemptFailure> {
    let attempt = ChildAttempt {
        program: &program(),
        request: ChildRequest { threads: 2, work },
        inputs: inputs.iter().map(|path| File::open(path).unwrap()).collect(),
        budget: &Budget { wall: Duration::from_secs(300), ..budget() },
        stop: &StopSwitch::new().unwrap(),
    };
    run_attempt(attempt, |_| {}).0
}

fn calibrate(columns: u32, rows: u32, photos: &[PathBuf]) -> ChildWork {
    ChildWork::Calibrate(CalibrateWork {
        board: RequestedBoard { columns, rows, square_mm: 21.0 },
        photos: Some(photos.iter().map(|path| path.display().to_string()).collect()),
        calibrated_at: "2026-11-21T20:14:00Z".into(),
    })
}

fn problem(result: Result<ChildOutput, AttemptFailure>) -> String {
    match result {
        Err(AttemptFailure::Impossible(problem)) => problem.slug,
        other => panic!("expected a problem, got {other:?}"),
    }
}

#[test]
fn photos_of_a_board_become_a_camera() {
    let Some(folder) = shared("scenes/calib/V") else { return };
    let folder = std::fs::read_dir(folder).unwrap();
    let mut photos: Vec<PathBuf> = folder.map(|entry| entry.unwrap().path()).collect();
    photos.retain(|path| path.extension().is_some_and(|e| e == "jpg" || e == "png"));
    photos.sort();
    photos.truncate(12);
    let output = ask(calibrate(9, 6, &photos), &photos).unwrap();
    let camera = CameraFile::parse(&output.camera_json.unwrap()).unwrap();
    assert!(camera.more["rms_px"].as_f64().unwrap() < 0.5, "{camera:?}");
    assert_eq!(camera.more["photos"].as_array().unwrap().len(), photos.len());
    assert_eq!(camera.more["calibrated_at"], "2026-11-21T20:14:00Z");
}

#[test]
fn files_that_are_no_photos_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("board.jpg");
    std::fs::write(&path, "not a photo").unwrap();
    let photos = vec![path; 3];
    assert_eq!(problem(ask(calibrate(9, 6, &photos), &photos)), "not-a-photo");
    assert_eq!(problem(ask(calibrate(1, 1, &photos), &photos)), "board-not-supported");
    assert_eq!(problem(ask(calibrate(9, 6, &[]), &[])), "photo-count");
}

#[test]
fn pictures_of_frames_give_the_colours_that_the_clip_gives() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let marks = scene.marks();
    let mut frames: Vec<u64> = marks.iter().map(|mark| mark.frame).collect();
    frames.sort_unstable();
    frames.dedup();
    let folder = tempfile::tempdir().unwrap();
    let mut pictures = Vec::new();
    for frame in &frames {
        let select = format!("-i {} -vf select=eq(n\\,{frame}) -frames:v 1", scene.video().display());
        let Some(picture) = ffmpeg(&select, &folder.path().join(format!("frame_{frame}.png"))) else { return };
        pictures.push(picture);
    }
    let colours = |frames, inputs: &[PathBuf]| {
        let work = ChildWork::Palette(PaletteWork {
            marks: marks.clone(),
            tools: scene.tools(),
            frames,
            has_empty_box: false,
        });
        ask(work, inputs).unwrap().palette.samples.unwrap()
    };
    let of_pictures = colours(Some(frames.clone()), &pictures);
    let of_clip = colours(None, &[scene.video()]);
    assert_eq!(of_pictures.counts(), of_clip.counts());
    let mean = |samples: &ColourSamples, label: &str| {
        let index = samples.labels.iter().position(|l| l == label).unwrap();
        let of_label: Vec<_> = samples.samples.iter().filter(|s| s.label == index).collect();
        let rgb = of_label.iter().map(|s| samples.encoding.rgb_of_codes(s.yuv.map(f64::from)));
        rgb.sum::<nalgebra::Vector3<f64>>() / of_label.len() as f64
    };
    for (label, _) in of_clip.counts() {
        let difference = (mean(&of_pictures, &label) - mean(&of_clip, &label)).abs().max();
        assert!(difference < 0.04, "{label}: {difference}");
    }
}

#[test]
fn the_colours_of_the_given_scenes_are_good() {
    for name in ["V1", "V2", "V3", "V4", "V5"] {
        let Some(scene) = SharedScene::find(name) else { return };
        let work = ChildWork::Palette(PaletteWork {
            marks: scene.marks(),
            tools: scene.tools(),
            frames: None,
            has_empty_box: false,
        });
        let report = ask(work, &[scene.video()]).unwrap().palette.report.unwrap();
        assert_eq!(report.warnings, [""; 0], "{name}");
        assert_eq!(report.verdicts.len(), scene.tools().len());
        for verdict in report.verdicts {
            assert_eq!(verdict.grade, ColourGrade::Good, "{name}: {verdict:?}");
            assert!(verdict.false_area.is_some_and(|area| area.largest_of_band < 0.2), "{name}");
        }
    }
}

#[test]
fn a_mark_on_a_frame_that_was_not_sent_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("frame_3.png");
    image::RgbImage::new(20, 20).save(&picture).unwrap();
    let rectangle = MarkedRectangle { label: "orange".into(), x: 1, y: 1, w: 2, h: 2 };
    let mark = ColourMark { frame: 4, rectangle, stroke: None };
    let work = ChildWork::Palette(PaletteWork {
        marks: vec![mark],
        tools: vec![],
        frames: Some(vec![3]),
        has_empty_box: false,
    });
    assert_eq!(problem(ask(work, &[picture])), "mark-without-picture");
}
