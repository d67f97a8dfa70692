//! Quick analysis of pictures while the user waits: photos of the board one by one, and the tape that marks find.

use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
use reqwest::multipart::{Form, Part};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::centre::Centre;
use crate::process::program;
use crate::support::{Client, problem, read};

const CHECK: &str = "/api/v1/boxes/box-1/calibrations/check";
const PREVIEW: &str = "/api/v1/boxes/box-1/palettes/preview";

fn board_photo() -> DynamicImage {
    let folder = tempfile::tempdir().unwrap();
    let order = "simulate --quiet --scene pegs --seed 3 --frames 2 --size 640x360 --boards 6 --out";
    assert!(program().args(order.split(' ')).arg(folder.path()).status().unwrap().success());
    image::open(folder.path().join("boards/board_01.jpg")).unwrap()
}

fn png(picture: &DynamicImage) -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, ImageFormat::Png).unwrap();
    file.into_inner()
}

fn photo(bytes: Vec<u8>) -> Form {
    Form::new().text("board", "9x6").part("photo", Part::bytes(bytes).file_name("board.png"))
}

async fn check_photo(by: &Client, picture: &DynamicImage) -> Value {
    let answer = by.request(Method::POST, CHECK).multipart(photo(png(picture))).send().await.unwrap();
    read(answer, StatusCode::OK).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_photo_check_reports_a_good_photo_or_the_cause_and_place_of_a_problem() {
    let centre = Centre::open().await;
    let ines = &centre.instructor;
    let whole = board_photo();
    let good = check_photo(ines, &whole).await;
    assert_eq!((&good["found"], &good["reason"], &good["hints"]), (&json!(true), &Value::Null, &json!([])), "{good}");
    assert_eq!((&good["width"], &good["height"]), (&json!(640), &json!(360)));
    let corners: Vec<[f64; 2]> = serde_json::from_value(good["corners"].clone()).unwrap();
    let counted: u64 = good["coverage"]["corners"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!((corners.len(), counted), (54, 54));

    // Cut through the middle of the board: the remaining part is cut off at that side.
    let middle = corners.iter().map(|[u, _]| u).sum::<f64>() / 54.0;
    let left = check_photo(ines, &whole.crop_imm(0, 0, middle as u32, 360)).await;
    assert_eq!((&left["found"], &left["hints"]), (&json!(false), &json!(["cut_off"])), "{left}");
    assert_eq!(left["cut_off"], json!(["right"]), "{left}");
    assert!(left["corners"].as_array().unwrap().len() > 8, "the corners that were found are reported: {left}");

    let black = check_photo(ines, &RgbImage::from_pixel(640, 360, Rgb([6, 5, 5])).into()).await;
    assert_eq!((&black["hints"], &black["corners"]), (&json!(["dark"]), &json!([])), "{black}");
    let soft = check_photo(ines, &whole.blur(14.0)).await;
    assert_eq!((&soft["found"], &soft["hints"]), (&json!(false), &json!(["soft"])), "{soft}");

    assert_eq!(ines.read("/api/v1/jobs").await["items"], json!([]), "no job is made");
    assert_eq!(ines.read("/api/v1/boxes/box-1/calibrations").await["items"], json!([]), "nothing is stored");
}

#[tokio::test(flavor = "multi_thread")]
async fn broken_photos_are_refused_with_an_explanation_and_only_staff_may_check_photos() {
    let centre = Centre::open().await;
    let ask = |by: &Client, path: &str, form: Form| by.request(Method::POST, path).multipart(form).send();
    for broken in [b"no picture".to_vec(), png(&RgbImage::new(64, 64).into())[..60].to_vec()] {
        let refusal = problem(ask(&centre.instructor, CHECK, photo(broken)).await.unwrap(), 422, "invalid").await;
        assert!(refusal["detail"].as_str().unwrap().contains("photo"), "{refusal}");
    }
    let small = || png(&RgbImage::new(64, 64).into());
    problem(ask(&centre.trainee, CHECK, photo(small())).await.unwrap(), 403, "forbidden").await;
    problem(ask(&centre.agent, CHECK, photo(small())).await.unwrap(), 403, "forbidden").await;
    let nowhere = CHECK.replace("box-1", "box-2");
    problem(ask(&centre.instructor, &nowhere, photo(small())).await.unwrap(), 404, "not-found").await;
    let no_board = Form::new().part("photo", Part::bytes(small()));
    let twice = photo(small()).part("photo", Part::bytes(small()));
    for wrong in [no_board, twice, Form::new().text("board", "9x6"), photo(small()).text("square_mm", "21")] {
        problem(ask(&centre.instructor, CHECK, wrong).await.unwrap(), 422, "invalid").await;
    }
}

/// A grey floor with an orange band that begins at column `left`.
fn frame(left: u32) -> Vec<u8> {
    let colour = |x: u32, y: u32| {
        let is_band = (left..left + 40).contains(&x) && (100..120).contains(&y);
        if is_band { Rgb([230, 110, 20]) } else { Rgb([100, 104, 102 + (x % 7) as u8]) }
    };
    png(&RgbImage::from_fn(320, 240, colour).into())
}

fn marks(stroke: Option<u32>) -> Value {
    let mark = |label: &str, x: u32, y: u32| {
        let mut mark = json!({"frame": 0, "label": label, "x": x, "y": y, "w": 10, "h": 10});
        if let Some(stroke) = stroke {
            mark["stroke"] = json!(stroke);
        }
        mark
    };
    let labels =
        [mark("orange", 42, 104), mark("orange", 54, 106), mark("background", 10, 10), mark("background", 200, 200)];
    json!({"tool_diameter_mm": 5, "labels": labels})
}

fn preview(annotations: &Value, frames: &[(u64, u32)]) -> Form {
    let form = Form::new().text("annotations", annotations.to_string());
    frames.iter().fold(form, |form, (number, left)| {
        form.part(format!("frame_{number}"), Part::bytes(frame(*left)).file_name("frame.png"))
    })
}

/// The cells of a mask's first colour: their number, and their first and last column.
fn first_colour_cells(mask: &Value) -> (u64, u64, u64) {
    let number = |value: &Value| value.as_u64().unwrap();
    let columns = number(&mask["columns"]);
    let (mut at, mut cells, mut first, mut last) = (0, 0, u64::MAX, 0);
    for run in mask["runs"].as_array().unwrap() {
        let (class, length) = (number(&run[0]), number(&run[1]));
        if class == 1 {
            cells += length;
            first = first.min(at % columns);
            last = last.max((at + length - 1) % columns);
        }
        at += length;
    }
    assert_eq!(at, columns * number(&mask["rows"]), "the mask covers every cell");
    (cells, first, last)
}

#[tokio::test(flavor = "multi_thread")]
async fn marks_on_one_frame_show_the_tape_on_another_and_nothing_is_stored() {
    let centre = Centre::open().await;
    let ines = &centre.instructor;
    let ask = async |annotations: &Value, frames: &[(u64, u32)]| {
        let form = preview(annotations, frames);
        read(ines.request(Method::POST, PREVIEW).multipart(form).send().await.unwrap(), StatusCode::OK).await
    };
    let mask = ask(&marks(None), &[(0, 40), (7, 200)]).await;
    assert_eq!((&mask["colours"], &mask["frames"][1]["frame"]), (&json!(["orange"]), &json!(7)), "{mask}");
    let cell_px = mask["frames"][1]["cell_px"].as_u64().unwrap();
    let (cells, first, last) = first_colour_cells(&mask["frames"][1]);
    assert_eq!((first * cell_px, (last + 1) * cell_px), (200, 240), "the band on the frame without marks");
    assert_eq!(cells, 40 * 20 / (cell_px * cell_px), "and nothing else");
    assert_eq!(mask["verdicts"][0]["tool"], "orange");
    let rectangles = |mask: &Value| {
        mask["confusion"].as_array().unwrap().iter().map(|row| row["rectangles"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(rectangles(&mask), [json!(2), json!(2)]);
    let painted = ask(&marks(Some(1)), &[(0, 40)]).await;
    assert_eq!(rectangles(&painted), [json!(1), json!(1)], "marks of one stroke count as one rectangle");
    assert_eq!(ines.read("/api/v1/boxes/box-1/palettes").await["items"], json!([]));

    let refused = async |form: Form| {
        problem(ines.request(Method::POST, PREVIEW).multipart(form).send().await.unwrap(), 422, "invalid").await
    };
    let many: Vec<(u64, u32)> = (0..9).map(|n| (n, 40)).collect();
    let refusal = refused(preview(&marks(None), &many)).await;
    assert!(refusal["detail"].as_str().unwrap().contains("more than 8"), "{refusal}");
    refused(preview(&marks(None), &[(7, 40)])).await; // the marked frame is missing
    refused(preview(&json!({"labels": []}), &[(0, 40)])).await;
    let clip = Form::new().text("annotations", marks(None).to_string()).part("video", Part::bytes(vec![1, 2, 3]));
    refused(clip).await;
    let outside =
        json!({"tool_diameter_mm": 5, "labels": [{"frame": 0, "label": "orange", "x": 310, "y": 0, "w": 40, "h": 9}]});
    let refusal = refused(preview(&outside, &[(0, 40)])).await;
    assert!(refusal["detail"].as_str().unwrap().contains("outside the picture"), "{refusal}");
    let by_trainee = centre.trainee.request(Method::POST, PREVIEW).multipart(preview(&marks(None), &[(0, 40)]));
    problem(by_trainee.send().await.unwrap(), 403, "forbidden").await;
}
