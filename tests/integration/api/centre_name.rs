//! The centre's name and logo, and the guide through the first steps.

use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};

use super::centre::{Centre, recording, session};
use crate::support::{Client, Service, problem, read};

const CENTRE: &str = "/api/v1/centre";
const LOGO: &str = "/api/v1/centre/logo";

/// The beginning of a PNG file with this size: all that the service reads of it.
fn png(width: u32, height: u32) -> Vec<u8> {
    [b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".as_slice(), &width.to_be_bytes(), &height.to_be_bytes(), b"\x08\x06\0\0\0"]
        .concat()
}

async fn set_logo(by: &Client, kind: &str, file: Vec<u8>) -> Response {
    by.request(Method::PUT, LOGO).header(header::CONTENT_TYPE, kind).body(file).send().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_see_the_name_and_the_logo_that_an_administrator_set() {
    let centre = Centre::open().await;
    let (stranger, administrator) = (centre.service.stranger(), &centre.administrator);
    assert_eq!(stranger.read(CENTRE).await, json!({"name": null, "logo_version": null}));
    assert_eq!(stranger.get(LOGO).await.status(), StatusCode::NO_CONTENT);
    let named = administrator.put(CENTRE, json!({"name": " Skills lab, St. Mary’s "})).await;
    assert_eq!(read(named, StatusCode::OK).await["name"], "Skills lab, St. Mary’s");
    let sent = png(320, 80);
    let made = read(set_logo(administrator, "image/png", sent.clone()).await, StatusCode::OK).await;
    let seen = stranger.read(CENTRE).await;
    assert_eq!((&seen, seen.as_object().unwrap().len()), (&made, 2), "name and logo only");

    let address = format!("{LOGO}?version={}", seen["logo_version"].as_str().unwrap());
    let answer = stranger.get(&address).await;
    let header = |name: &str| answer.headers()[name].to_str().unwrap().to_owned();
    assert_eq!(header("content-type"), "image/png");
    assert_eq!(header("content-security-policy"), "default-src 'none'; sandbox");
    assert_eq!(header("x-content-type-options"), "nosniff");
    assert_eq!(header("cache-control"), "public, max-age=31536000, immutable");
    let etag = header("etag");
    assert_eq!(answer.bytes().await.unwrap(), sent);
    let again = stranger.clone().with("if-none-match", &etag).get(LOGO).await;
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    assert_eq!(stranger.get(LOGO).await.headers()["cache-control"], "no-cache");

    read(set_logo(administrator, "image/png", png(80, 80)).await, StatusCode::OK).await;
    let changed = stranger.read(CENTRE).await["logo_version"].clone();
    assert_ne!(changed, seen["logo_version"]);
    assert_eq!(administrator.delete(LOGO).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(read(administrator.put(CENTRE, json!({"name": null})).await, StatusCode::OK).await["name"], Value::Null);
    assert_eq!(stranger.read(CENTRE).await, json!({"name": null, "logo_version": null}));
    let audit = administrator.read("/api/v1/audit-entries").await;
    let entries = audit["items"].as_array().unwrap().iter().filter(|entry| entry["noun"] == "centre");
    let actions: Vec<&str> = entries.map(|entry| entry["action"].as_str().unwrap()).collect();
    assert_eq!(actions, ["set name", "set logo", "set logo", "set logo", "set name"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_pages_should_not_show_is_refused() {
    let centre = Centre::open().await;
    let administrator = &centre.administrator;
    let svg = b"<svg xmlns='http://www.w3.org/2000/svg'><script>alert(1)</script></svg>".to_vec();
    for (kind, file, status, slug) in [
        ("image/svg+xml", svg.clone(), 415, "unsupported-media-type"),
        ("text/html", png(8, 8), 415, "unsupported-media-type"),
        ("image/png", svg, 422, "invalid"),
        ("image/png", Vec::new(), 422, "invalid"),
        ("image/png", png(40_000, 40_000), 422, "invalid"),
        ("image/jpeg", vec![0; 513 * 1024], 413, "too-large"),
    ] {
        let refused = problem(set_logo(administrator, kind, file).await, status, slug).await;
        assert!(!refused["detail"].as_str().unwrap().is_empty());
    }
    // The bytes say what the file is, not the sender.
    read(set_logo(administrator, "image/jpeg", png(8, 8)).await, StatusCode::OK).await;
    assert_eq!(centre.service.stranger().get(LOGO).await.headers()["content-type"], "image/png");
    for name in ["", "   ", &"x".repeat(121), "two\nlines"] {
        let refused = problem(administrator.put(CENTRE, json!({"name": name})).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "name");
    }
    for by in [&centre.instructor, &centre.trainee] {
        problem(by.put(CENTRE, json!({"name": "Mine"})).await, 403, "forbidden").await;
        problem(set_logo(by, "image/png", png(8, 8)).await, 403, "forbidden").await;
    }
}

/// The steps that are done, in their order.
async fn done(by: &Client) -> Vec<String> {
    let guide = by.read("/api/v1/first-steps").await;
    let steps = guide["steps"].as_array().unwrap().iter().filter(|step| step["is_done"] == true);
    steps.map(|step| step["step"].as_str().unwrap().to_owned()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_first_step_is_done_when_the_data_show_it() {
    let service = Service::start().await;
    let administrator = service.administrator().await;
    let guide = administrator.read("/api/v1/first-steps").await;
    let steps: Vec<&str> = guide["steps"].as_array().unwrap().iter().map(|one| one["step"].as_str().unwrap()).collect();
    assert_eq!(steps, ["password", "centre", "task", "box", "box_setup", "people", "recording"]);
    assert_eq!((&guide["is_empty"], &guide["box_to_set_up"]), (&json!(true), &Value::Null));
    assert!(done(&administrator).await.is_empty(), "the program made the password");
    read(administrator.put(CENTRE, json!({"name": "Skills lab"})).await, StatusCode::OK).await;
    administrator.make("/api/v1/tasks", json!({"name": "Peg transfer"})).await;
    let made = administrator.make("/api/v1/boxes", json!({"name": "Box 1"})).await;
    assert_eq!(done(&administrator).await, ["centre", "task", "box"]);
    assert_eq!(administrator.read("/api/v1/first-steps").await["box_to_set_up"], made["id"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_steps_of_an_instructor_are_those_of_their_groups() {
    let centre = Centre::open().await;
    assert_eq!(done(&centre.instructor).await, ["password", "group", "task", "box", "people"]);
    let person = json!({"login": "nora", "name": "Nora", "role": "instructor", "password": super::centre::PASSWORD});
    centre.administrator.make("/api/v1/people", person).await;
    let nora = centre.service.sign_in("nora", super::centre::PASSWORD).await;
    assert_eq!(done(&nora).await, ["password", "task", "box"], "tasks and boxes are for all");
    session(&centre.administrator, "bob", recording(100, 1)).await;
    assert!(done(&centre.administrator).await.contains(&"recording".to_owned()));
    assert!(!done(&centre.instructor).await.contains(&"recording".to_owned()), "Bob is of group two");
    assert_eq!(centre.instructor.read("/api/v1/first-steps").await["is_empty"], json!(true));
    problem(centre.trainee.get("/api/v1/first-steps").await, 403, "forbidden").await;
}
