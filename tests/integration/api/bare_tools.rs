//! A box whose tools have no tape: their colours, their sizes, the picture of the empty box, and a recording of them.

use image::{ImageFormat, Rgb, RgbImage};
use reqwest::multipart::{Form, Part};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::centre::{Centre, session};
use crate::feed::scene::{Folder, set_up_box};
use crate::support::{Client, Service, problem, read};

const PALETTES: &str = "/api/v1/boxes/box-1/palettes";
const PREVIEW: &str = "/api/v1/boxes/box-1/palettes/preview";

/// A grey box, with or without a black tube across it.
fn picture(size: [u32; 2], has_tube: bool) -> Vec<u8> {
    let colour = |x: u32, y: u32| {
        if has_tube && (100..120).contains(&y) { Rgb([22, 22, 24]) } else { Rgb([100, 104, 102 + (x % 7) as u8]) }
    };
    let mut file = std::io::Cursor::new(Vec::new());
    RgbImage::from_fn(size[0], size[1], colour).write_to(&mut file, ImageFormat::Png).unwrap();
    file.into_inner()
}

fn annotations(entry: Value) -> Value {
    let mark = |label: &str, x: u32, y: u32| json!({"frame": 0, "label": label, "x": x, "y": y, "w": 10, "h": 10});
    let labels = [mark("shaft", 42, 104), mark("shaft", 200, 106), mark("background", 10, 10)];
    json!({"needs": 2, "tool_diameter_mm": 5, "empty_box": "empty.jpg", "tools": [entry], "labels": labels})
}

fn bare_left() -> Value {
    json!({"tool": "left", "marker": {"kind": "shaft", "jaw_mm": 28.3}})
}

fn form(annotations: &Value, empty_box: Option<Vec<u8>>) -> Form {
    let form = Form::new().text("annotations", annotations.to_string());
    let form = form.part("frame_0", Part::bytes(picture([320, 240], true)).file_name("frame_0.png"));
    match empty_box {
        Some(photo) => form.part("empty_box", Part::bytes(photo).file_name("empty.png")),
        None => form,
    }
}

/// Sends a form and returns its job, once the job has ended.
async fn learn(by: &Client, form: Form) -> Value {
    let answer = by.request(Method::POST, PALETTES).multipart(form).send().await.unwrap();
    let job = read(answer, StatusCode::ACCEPTED).await["job"].as_str().unwrap().to_owned();
    by.read_until(&format!("/api/v1/jobs/{job}"), |job| job["state"] == "done" || job["state"] == "failed").await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_learns_a_tool_without_tape_and_keeps_the_picture_of_the_empty_box() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    let ines = &centre.instructor;
    let job = learn(ines, form(&annotations(bare_left()), Some(picture([320, 240], false)))).await;
    assert_eq!(job["state"], "done", "{job}");
    let tool = json!({"name": "left", "colour": "shaft", "side": "left", "diameter_mm": 5.0, "band_length_mm": null,
        "marker": {"kind": "shaft", "jaw_mm": 28.3}});
    assert_eq!(ines.read("/api/v1/boxes/box-1").await["tools"], json!([tool.clone()]));
    let palette = ines.read(PALETTES).await["items"][0].clone();
    assert_eq!((&palette["tools"], &palette["verdicts"]), (&json!([tool]), &json!([])), "no tape is judged");
    assert_eq!(palette["warnings"], json!([]));
    assert_eq!(palette["annotations"]["empty_box"].as_str().unwrap().len(), 64, "the hash of the picture: {palette}");
    assert!(palette["counts"].as_array().unwrap().iter().any(|count| count["label"] == "shaft"), "{palette}");

    let job = learn(ines, form(&annotations(bare_left()), Some(picture([160, 120], false)))).await;
    assert_eq!((&job["state"], &job["error"]["type"]), (&json!("failed"), &json!("/problems/empty-box-size")), "{job}");
    let detail = job["error"]["detail"].as_str().unwrap();
    assert!(detail.contains("160×120") && detail.contains("320×240"), "{detail}");
}

#[tokio::test(flavor = "multi_thread")]
async fn learning_again_keeps_the_picture_of_the_empty_box_until_it_is_replaced_or_removed() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    let ines = &centre.instructor;
    let unnamed = |entry: Value| {
        let mut marks = annotations(entry);
        marks.as_object_mut().unwrap().remove("empty_box");
        marks
    };
    // Each version differs from the one before, as the tools' lengths do.
    let bare = |jaw_mm: f64| json!({"tool": "left", "marker": {"kind": "shaft", "jaw_mm": jaw_mm}});
    let photo_after = async |form: Form| {
        let job = learn(ines, form).await;
        assert_eq!(job["state"], "done", "{job}");
        ines.read(PALETTES).await["items"][0]["annotations"]["empty_box"].clone()
    };
    let first = photo_after(form(&annotations(bare(28.0)), Some(picture([320, 240], false)))).await;
    assert!(first.is_string(), "{first}");
    assert_eq!(photo_after(form(&unnamed(bare(28.1)), None)).await, first, "the second version keeps it");
    let mut named = annotations(bare(28.2));
    named["empty_box"] = first.clone();
    assert_eq!(photo_after(form(&named, None)).await, first, "annotations as the service returned them");

    let mut taped = unnamed(json!({"tool": "orange"}));
    taped["labels"].as_array_mut().unwrap()[0]["label"] = json!("orange");
    assert_eq!(photo_after(form(&taped, None)).await, Value::Null, "a tool with tape needs none");
    assert_eq!(photo_after(form(&unnamed(bare(28.3)), None)).await, first, "the last one of bare tools is kept");

    let second = photo_after(form(&unnamed(bare(28.4)), Some(picture([320, 240], true)))).await;
    assert!(second.is_string() && second != first, "{second}");
    let removing = form(&unnamed(bare(28.5)), None).text("keep_empty_box", "false");
    assert_eq!(photo_after(removing).await, Value::Null);
    assert_eq!(photo_after(form(&unnamed(bare(28.6)), None)).await, Value::Null, "what was removed stays away");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_form_with_a_tool_without_tape_that_lacks_something_is_refused() {
    let centre = Centre::open().await;
    let refused = async |form: Form| {
        let answer = centre.instructor.request(Method::POST, PALETTES).multipart(form).send().await.unwrap();
        problem(answer, 422, "invalid").await["detail"].as_str().unwrap().to_owned()
    };
    let empty = || picture([320, 240], false);
    let without_side = json!({"tool": "grasper", "marker": {"kind": "shaft"}});
    let detail = refused(form(&annotations(without_side), Some(empty()))).await;
    assert!(detail.contains("its side is not known"), "{detail}");
    let detail = refused(form(&annotations(bare_left()), None)).await;
    assert!(detail.contains("named in the annotations, but was not sent"), "{detail}");
    let twice = form(&annotations(bare_left()), Some(empty())).part("empty_box", Part::bytes(empty()));
    assert!(refused(twice).await.contains("sent twice"));
    let undecided = form(&annotations(bare_left()), Some(empty())).text("keep_empty_box", "perhaps");
    assert!(refused(undecided).await.contains("`true` or `false`"));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_masks_of_a_preview_show_the_shaft_and_no_tape_is_judged() {
    let centre = Centre::open().await;
    let form = form(&annotations(bare_left()), None);
    let answer = centre.instructor.request(Method::POST, PREVIEW).multipart(form).send().await.unwrap();
    let preview = read(answer, StatusCode::OK).await;
    assert_eq!((&preview["colours"], &preview["verdicts"]), (&json!(["shaft"]), &json!([])), "{preview}");
    let mask = &preview["frames"][0];
    assert_eq!((&mask["cell_px"], &mask["columns"], &mask["rows"]), (&json!(2), &json!(160), &json!(120)), "{mask}");
    let runs: Vec<(u8, usize)> = serde_json::from_value(mask["runs"].clone()).unwrap();
    let classes: Vec<u8> = runs.into_iter().flat_map(|(class, cells)| vec![class; cells]).collect();
    let share = |rows: std::ops::Range<usize>| {
        let cells = &classes[160 * rows.start..160 * rows.end];
        cells.iter().filter(|class| **class == 1).count() as f64 / cells.len() as f64
    };
    assert!(share(51..59) > 0.95, "of the tube: {}", share(51..59));
    assert!(share(0..48) < 0.05 && share(62..120) < 0.05, "of the box: {}, {}", share(0..48), share(62..120));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_of_tools_without_tape_is_tracked() {
    let scene = Folder::of("--marker bare --seed 5 --seconds 3 --size 960x540");
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    set_up_box(&centre.administrator, "box-1", &scene).await;
    let clip = std::fs::read(scene.file("clip.mp4")).unwrap();
    let sent = session(&centre.administrator, "ada", clip).await;
    let is_over = |session: &Value| session["status"] == "done" || session["status"] == "failed";
    let path = format!("/api/v1/sessions/{}", sent["id"].as_str().unwrap());
    let tracked = centre.administrator.read_until(&path, is_over).await;
    assert_eq!((&tracked["status"], &tracked["tools"]), (&json!("done"), &json!(["left", "right"])), "{tracked}");
    let quality = &tracked["quality"];
    for tool in quality["tools"].as_array().unwrap() {
        assert!(tool["coverage"].as_f64().unwrap() >= 0.2, "{tool}");
    }
    let of_bare = quality["reasons"].as_array().unwrap().iter().filter(|of| of["name"] == "bare_tool");
    let severities: Vec<&Value> = of_bare.map(|of| &of["severity"]).collect();
    assert_eq!(severities, [&json!("care"); 2], "{quality}");
}
