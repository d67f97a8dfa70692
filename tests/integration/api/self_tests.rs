//! A box's self-test through the real service: a simulated box is set up and tested, then tested with a wrong diameter.

use reqwest::multipart::{Form, Part};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::centre::Centre;
use crate::process::program;
use crate::support::{Client, Service, problem, read};

const TESTS: &str = "/api/v1/boxes/box-1/self-tests";

/// The scene up to the end of its first board position (26 s), in small pictures at a low frame rate.
struct Scene(TempDir);

impl Scene {
    fn simulated() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let order =
            "simulate --quiet --scene self-test --seed 5 --seconds 27.5 --fps 10 --size 640x360 --boards 6 --out";
        assert!(program().args(order.split(' ')).arg(folder.path()).status().unwrap().success());
        Self(folder)
    }

    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.0.path().join(name)).unwrap()
    }

    fn file(&self, name: &str) -> Part {
        Part::bytes(self.read(name)).file_name(name.rsplit('/').next().unwrap().to_owned())
    }

    fn calibration(&self) -> Form {
        let form = Form::new().text("board", "9x6").text("square_mm", "21");
        (1..=6).fold(form, |form, n| form.part("photo", self.file(&format!("boards/board_0{n}.jpg"))))
    }

    /// The colours, with tools of this diameter, mm.
    fn palette(&self, diameter_mm: f64) -> Form {
        let mut annotations: Value = serde_json::from_slice(&self.read("annotations.json")).unwrap();
        annotations["tools"][0]["diameter_mm"] = json!(diameter_mm);
        Form::new().text("annotations", annotations.to_string()).part("video", self.file("clip.mp4"))
    }

    fn recording(&self) -> Form {
        Form::new().part("video", self.file("clip.mp4"))
    }
}

/// Sends a form and waits for its job.
async fn send_and_wait(by: &Client, method: Method, path: &str, form: Form) -> Value {
    let answer = by.request(method, path).multipart(form).send().await.unwrap();
    let queued = read(answer, StatusCode::ACCEPTED).await;
    let job = format!("/api/v1/jobs/{}", queued["job"].as_str().unwrap());
    by.read_until(&job, |job| job["state"] != "queued" && job["state"] != "running").await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_is_tested_and_its_light_is_red_once_its_tool_is_described_wrongly() {
    let scene = Scene::simulated();
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    let (ines, ada) = (&centre.instructor, &centre.trainee);
    let send = |by: &Client, form: Form| by.request(Method::POST, TESTS).multipart(form).send();
    // The service refuses before it reads the body: a large form would meet a closed connection.
    let small = || Form::new().text("reach_mm", "0");
    problem(send(ada, small()).await.unwrap(), 403, "forbidden").await;
    problem(send(ines, small()).await.unwrap(), 409, "conflict").await;
    assert_eq!(ada.read("/api/v1/boxes/box-1").await["self_test"], Value::Null);

    send_and_wait(ines, Method::POST, "/api/v1/boxes/box-1/calibrations", scene.calibration()).await;
    send_and_wait(ines, Method::POST, "/api/v1/boxes/box-1/palettes", scene.palette(5.0)).await;
    let without_video = Form::new().text("reach_mm", "0");
    for form in [without_video, scene.recording().text("board", "9x6"), scene.recording().text("reach_mm", "-1")] {
        problem(send(ines, form).await.unwrap(), 422, "invalid").await;
    }
    let job = send_and_wait(ines, Method::POST, TESTS, scene.recording()).await;
    assert_eq!((&job["kind"], &job["state"]), (&json!("self_test"), &json!("done")), "{job}");
    let first = ines.read(TESTS).await["items"][0].clone();
    let light = first["light"].clone();
    // Pictures this small are not always sharp enough for green.
    assert!(["green", "yellow"].contains(&light.as_str().unwrap()), "{first:#}");
    assert_eq!(first["who"], "ines");
    let accuracy = &first["accuracy"];
    assert_eq!(
        (accuracy["touches"].as_u64(), first["holds"].as_array().map(Vec::len)),
        (Some(6), Some(6)),
        "{first:#}"
    );
    // The tape is 10 px wide: the depth of a resting tool is stated to about 5 mm.
    assert!(accuracy["rms_mm"].as_f64().unwrap() < 5.0, "{accuracy}");
    assert_eq!((&first["board"], &first["square_mm"]), (&json!("9x6"), &json!(21.0)), "the calibration's own board");
    let seen_by_ada = ada.read(&format!("{TESTS}?limit=1")).await["items"][0].clone();
    assert_eq!((&seen_by_ada["light"], &seen_by_ada["who"]), (&light, &Value::Null));
    let today = ada.read("/api/v1/boxes/box-1").await["self_test"].clone();
    assert_eq!((&today["light"], &today["id"]), (&light, &first["id"]));
    assert_eq!(
        send_and_wait(ines, Method::POST, TESTS, scene.recording()).await["id"],
        job["id"],
        "the same test again is not repeated"
    );

    send_and_wait(ines, Method::POST, "/api/v1/boxes/box-1/palettes", scene.palette(6.0)).await;
    send_and_wait(ines, Method::POST, TESTS, scene.recording()).await;
    let tests = ines.read(TESTS).await["items"].clone();
    let lights: Vec<&Value> = tests.as_array().unwrap().iter().map(|test| &test["light"]).collect();
    assert_eq!(lights, [&json!("red"), &light], "{:#}", tests[0]);
    let part = |part: &str| tests[0]["parts"].as_array().unwrap().iter().find(|p| p["part"] == part).cloned().unwrap();
    assert_eq!((&part("accuracy")["light"], &part("calibration")["light"]), (&json!("red"), &json!("green")));
    assert!(part("accuracy")["advice"].as_str().unwrap().contains("diameter"), "{}", part("accuracy"));
    assert_eq!(ada.read("/api/v1/boxes/box-1").await["self_test"]["light"], "red");
}
