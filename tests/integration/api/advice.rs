//! Which tapes suit a box: advice from a picture of the box, before a tape is on a tool.

use image::{ImageFormat, Rgb, RgbImage};
use reqwest::multipart::{Form, Part};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::centre::Centre;
use crate::feed::scene::Folder;
use crate::support::{Client, Service, problem, read};

const ADVICE: &str = "/api/v1/boxes/box-1/palettes/advice";

fn form(picture: Vec<u8>) -> Form {
    Form::new().part("picture", Part::bytes(picture).file_name("box.jpg"))
}

/// Sends a picture and returns its job, once the job has ended.
async fn advice_job(client: &Client, picture: Vec<u8>) -> Value {
    let answer = client.request(Method::POST, ADVICE).multipart(form(picture)).send().await.unwrap();
    let job = read(answer, StatusCode::ACCEPTED).await["job"].as_str().unwrap().to_owned();
    client.read_until(&format!("/api/v1/jobs/{job}"), |job| job["state"] == "done" || job["state"] == "failed").await
}

/// A grey box with a red mat on a quarter of it.
fn red_mat() -> Vec<u8> {
    let colour = |x: u32| if x < 80 { Rgb([0xcc, 0x06, 0x05]) } else { Rgb([120, 120, 118]) };
    let picture = RgbImage::from_fn(320, 240, |x, _| colour(x));
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, ImageFormat::Png).unwrap();
    file.into_inner()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_picture_of_the_box_ranks_tapes_and_pairs_and_warns_of_its_own_colours() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    let job = advice_job(&centre.instructor, red_mat()).await;
    assert_eq!((&job["kind"], &job["state"]), (&json!("advise"), &json!("done")), "{job}");
    let advice = &job["advice"];
    let [tapes, pairs, warnings] = ["tapes", "pairs", "warnings"].map(|part| advice[part].as_array().unwrap());
    let worst = tapes.last().unwrap();
    assert_eq!((&worst["tape"], &worst["grade"], &worst["srgb"]), (&json!("red"), &json!("bad"), &json!("#cc0605")));
    assert!((worst["in_box"].as_f64().unwrap() - 0.25).abs() < 0.01, "{worst}");
    assert!(
        warnings.iter().any(|warning| warning.as_str().unwrap().starts_with("Do not take red: 25.")),
        "{warnings:?}"
    );
    assert_eq!((tapes.len(), pairs.len()), (10, 45));
    assert_eq!(pairs[0]["grade"], "good");
    assert!(!pairs[0]["tapes"].as_array().unwrap().contains(&json!("red")), "{}", pairs[0]);
    let listed = centre.instructor.read("/api/v1/jobs").await;
    assert_eq!(listed["items"][0]["advice"], Value::Null, "lists stay short");
    assert_eq!(
        centre.instructor.read("/api/v1/boxes/box-1/palettes").await["items"],
        json!([]),
        "no palette is stored"
    );

    let recording = Folder::of("--seed 1 --frames 2 --size 320x180");
    let job = advice_job(&centre.instructor, std::fs::read(recording.file("clip.mp4")).unwrap()).await;
    assert_eq!(job["advice"]["tapes"].as_array().unwrap().len(), 10, "{job}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broken_picture_fails_with_an_explanation_and_trainees_get_no_advice() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    for broken in [b"no picture".to_vec(), red_mat()[..200].to_vec()] {
        let job = advice_job(&centre.instructor, broken).await;
        assert_eq!((&job["state"], &job["advice"]), (&json!("failed"), &Value::Null), "{job}");
        assert!(job["error"]["detail"].as_str().unwrap().len() > 10, "{job}");
    }
    let ask = |client: &Client, form| client.request(Method::POST, ADVICE).multipart(form).send();
    problem(ask(&centre.trainee, form(red_mat())).await.unwrap(), 403, "forbidden").await;
    let twice = form(red_mat()).part("picture", Part::bytes(red_mat()));
    for wrong in [twice, Form::new().text("photo", "x")] {
        problem(ask(&centre.instructor, wrong).await.unwrap(), 422, "invalid").await;
    }
}
