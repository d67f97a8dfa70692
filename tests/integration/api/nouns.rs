//! Boxes, tasks, trainees, groups and people: made, read by id or code, changed, listed in pages, deleted.

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::centre::{Centre, PASSWORD, recording, session};
use crate::support::{problem, read};

#[tokio::test(flavor = "multi_thread")]
async fn a_thing_is_found_by_id_and_by_code_and_changes_keep_the_rest() {
    let centre = Centre::open().await;
    let administrator = &centre.administrator;
    for (noun, body) in [
        ("boxes", json!({"name": "Side view", "view": "side", "notes": "by the window"})),
        ("tasks", json!({"name": "Side view", "description": "Tie a knot."})),
        ("trainees", json!({"name": "Side view", "level": "novice", "handedness": "left"})),
    ] {
        let made = administrator.make(&format!("/api/v1/{noun}"), body.clone()).await;
        assert_eq!(made["code"], "side-view", "{noun}: the code is made from the name");
        let by_code = administrator.read(&format!("/api/v1/{noun}/side-view")).await;
        let by_id = administrator.read(&format!("/api/v1/{noun}/{}", made["id"].as_str().unwrap())).await;
        assert_eq!((&by_code, &by_id), (&made, &made));
        let changed = administrator.patch(&format!("/api/v1/{noun}/side-view"), json!({"name": "Renamed"})).await;
        let changed = read(changed, StatusCode::OK).await;
        assert_eq!((&changed["name"], &changed["code"]), (&json!("Renamed"), &json!("side-view")));
        for (key, value) in body.as_object().unwrap().iter().filter(|(key, _)| *key != "name") {
            assert_eq!(&changed[key], value, "{noun}: {key} stays");
        }
        let taken = json!({"name": "Other", "code": "side-view"});
        problem(administrator.post(&format!("/api/v1/{noun}"), taken).await, 409, "taken").await;
        let gone = administrator.delete(&format!("/api/v1/{noun}/side-view")).await;
        assert_eq!(gone.status(), StatusCode::NO_CONTENT);
        problem(administrator.get(&format!("/api/v1/{noun}/side-view")).await, 404, "not-found").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_list_is_read_in_pages_without_gaps_or_repeats() {
    let centre = Centre::open().await;
    for number in 0..7 {
        centre.administrator.make("/api/v1/tasks", json!({"name": format!("Task {number}")})).await;
    }
    let mut names: Vec<String> = Vec::new();
    let mut address = "/api/v1/tasks?limit=3".to_owned();
    loop {
        let page = centre.administrator.read(&address).await;
        let items = page["items"].as_array().unwrap();
        assert!(items.len() <= 3);
        names.extend(items.iter().map(|task| task["name"].as_str().unwrap().to_owned()));
        let Value::String(next) = &page["next"] else { break };
        address = format!("/api/v1/tasks?limit=3&cursor={next}");
    }
    names.sort();
    names.dedup();
    assert_eq!(names.len(), 8);
    for query in ["limit=0", "limit=100000", "limit=x", "page=2"] {
        let status = centre.administrator.get(&format!("/api/v1/tasks?{query}")).await.status();
        assert!([400, 422].contains(&status.as_u16()), "{query}: {status}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_camera_comes_back_as_it_was_put() {
    let centre = Centre::open().await;
    problem(centre.instructor.get("/api/v1/boxes/box-1/camera").await, 404, "not-found").await;
    let camera = json!({"width": 640, "height": 480, "fx": 500.1, "fy": 500.2, "cx": 320.0, "cy": 240.0, "k1": -0.1,
        "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0, "maker": {"lens": "f/2"}});
    let put = centre.instructor.put("/api/v1/boxes/box-1/camera", camera.clone()).await;
    assert!(put.status().is_success(), "{}", put.text().await.unwrap());
    assert_eq!(centre.trainee.read("/api/v1/boxes/box-1/camera").await, camera);
    let versions = centre.trainee.read("/api/v1/boxes/box-1/calibrations").await;
    assert_eq!(versions["items"].as_array().unwrap().len(), 1);
    assert_eq!(versions["items"][0]["warnings"], json!([]));
    let stretched = json!({"width": 640, "height": 480, "fx": 500.0, "fy": 516.0, "cx": 320.0, "cy": 240.0});
    let put = read(centre.instructor.put("/api/v1/boxes/box-1/camera", stretched).await, StatusCode::OK).await;
    let warning = &put["warnings"][0];
    assert_eq!((&warning["name"], &warning["limit"]), (&json!("focal_ratio"), &json!(0.015)), "{put}");
    let broken = centre.instructor.put("/api/v1/boxes/box-1/camera", json!({"width": 640})).await;
    problem(broken, 422, "invalid").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn photos_and_annotations_become_jobs() {
    let centre = Centre::open().await;
    let part = |name: &str| reqwest::multipart::Part::bytes(vec![0xFF, 0xD8, 0xFF, 0xE0]).file_name(name.to_owned());
    let form = reqwest::multipart::Form::new()
        .text("board", "9x6")
        .text("square_mm", "21")
        .part("photo", part("a.jpg"))
        .part("photo", part("b.jpg"));
    let answer = centre.instructor.request(Method::POST, "/api/v1/boxes/box-1/calibrations").multipart(form);
    let accepted = read(answer.send().await.unwrap(), StatusCode::ACCEPTED).await;
    let job = centre.instructor.read(&format!("/api/v1/jobs/{}", accepted["job"].as_str().unwrap())).await;
    assert_eq!((&job["kind"], &job["state"]), (&json!("calibrate"), &json!("queued")));

    let annotations =
        r#"{"tool_diameter_mm":8.0,"view":"top","labels":[{"frame":1,"label":"orange","x":1,"y":2,"w":3,"h":4}]}"#;
    let form = reqwest::multipart::Form::new().text("annotations", annotations).part("video", part("clip.mp4"));
    let answer = centre.instructor.request(Method::POST, "/api/v1/boxes/box-1/palettes").multipart(form);
    let accepted = read(answer.send().await.unwrap(), StatusCode::ACCEPTED).await;
    let job = centre.instructor.read(&format!("/api/v1/jobs/{}", accepted["job"].as_str().unwrap())).await;
    assert_eq!(job["kind"], "palette");
    problem(centre.trainee.get(&format!("/api/v1/jobs/{}", accepted["job"].as_str().unwrap())).await, 404, "not-found")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_incomplete_or_invalid_form_is_refused() {
    let centre = Centre::open().await;
    let send =
        |path: &'static str, method: Method, form| centre.instructor.request(method, path).multipart(form).send();
    let form = reqwest::multipart::Form::new;
    let calibrations = "/api/v1/boxes/box-1/calibrations";
    for form in [
        form().text("board", "9x6").text("square_mm", "21"),
        form().text("board", "9").text("square_mm", "21").text("photo", "x"),
        form().text("board", "9x6").text("square_mm", "-1").text("photo", "x"),
        form().text("board", "9x6").text("square_mm", "21").text("surprise", "x"),
    ] {
        problem(send(calibrations, Method::POST, form).await.unwrap(), 422, "invalid").await;
    }
    let palettes = "/api/v1/boxes/box-1/palettes";
    for form in [form().text("annotations", "{}"), form().text("annotations", "{").text("video", "x")] {
        problem(send(palettes, Method::POST, form).await.unwrap(), 422, "invalid").await;
    }
    problem(centre.instructor.post(palettes, json!({})).await, 415, "unsupported-media-type").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_task_or_box_with_recordings_cannot_be_deleted() {
    let centre = Centre::open().await;
    session(&centre.trainee, "ada", recording(100, 1)).await;
    for path in ["/api/v1/tasks/peg", "/api/v1/boxes/box-1"] {
        problem(centre.administrator.delete(path).await, 409, "in-use").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_erased_trainee_takes_account_and_recordings_along() {
    let centre = Centre::open().await;
    let made = session(&centre.trainee, "ada", recording(100, 1)).await;
    assert_eq!(centre.administrator.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    problem(centre.trainee.get("/api/v1/me").await, 401, "not-signed-in").await;
    let path = format!("/api/v1/sessions/{}", made["id"].as_str().unwrap());
    problem(centre.administrator.get(&path).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn groups_decide_which_trainees_an_instructor_sees() {
    let centre = Centre::open().await;
    let groups = centre.administrator.read("/api/v1/groups").await;
    let one = groups["items"].as_array().unwrap().iter().find(|g| g["name"] == "One").unwrap();
    let path = format!("/api/v1/groups/{}/members", one["id"].as_str().unwrap());
    let bob = centre.administrator.read("/api/v1/trainees/bob").await["id"].clone();
    let people = centre.administrator.read("/api/v1/people").await;
    let ines = people["items"].as_array().unwrap().iter().find(|p| p["login"] == "ines").unwrap()["id"].clone();
    let put = centre.administrator.put(&path, json!({"instructors": [ines], "trainees": [bob]})).await;
    assert!(put.status().is_success(), "{}", put.text().await.unwrap());
    centre.instructor.read("/api/v1/trainees/bob").await;
    problem(centre.instructor.get("/api/v1/trainees/ada").await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn progress_lists_a_trainees_sessions_of_a_task() {
    let centre = Centre::open().await;
    session(&centre.trainee, "ada", recording(100, 1)).await;
    let progress = centre.trainee.read("/api/v1/trainees/ada/progress?task=peg").await;
    assert_eq!(progress["sessions"].as_array().unwrap().len(), 1);
    assert_eq!((&progress["trainee"]["code"], &progress["task"]["code"]), (&json!("ada"), &json!("peg")));
    problem(centre.trainee.get("/api/v1/trainees/ada/progress?task=knots").await, 422, "unknown-reference").await;
    problem(centre.trainee.get("/api/v1/trainees/bob/progress?task=peg").await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn people_are_changed_and_their_rights_with_them() {
    let centre = Centre::open().await;
    let people = centre.administrator.read("/api/v1/people").await;
    assert!(!people.to_string().contains("argon2"), "no hash leaves the store");
    let omar = people["items"].as_array().unwrap().iter().find(|p| p["login"] == "omar").unwrap();
    let path = format!("/api/v1/people/{}", omar["id"].as_str().unwrap());
    let changed = centre.administrator.patch(&path, json!({"name": "Omar O.", "password": "a fresh password"})).await;
    assert_eq!(read(changed, StatusCode::OK).await["name"], "Omar O.");
    problem(centre.other_instructor.get("/api/v1/me").await, 401, "not-signed-in").await;
    centre.service.sign_in("omar", "a fresh password").await;
    let double = json!({"login": "ada", "name": "x", "role": "instructor", "password": PASSWORD});
    problem(centre.administrator.post("/api/v1/people", double).await, 409, "taken").await;
    let agent = json!({"login": "robot", "name": "x", "role": "agent", "password": PASSWORD});
    problem(centre.administrator.post("/api/v1/people", agent).await, 422, "invalid").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn no_account_of_a_trainee_becomes_one_of_the_staff_nor_the_other_way_round() {
    let centre = Centre::open().await;
    let people = centre.administrator.read("/api/v1/people").await;
    let path_of = |login: &str| {
        let person = people["items"].as_array().unwrap().iter().find(|person| person["login"] == login).unwrap();
        format!("/api/v1/people/{}", person["id"].as_str().unwrap())
    };
    for (login, role) in [("ada", "administrator"), ("ada", "instructor"), ("ines", "trainee"), ("ines", "agent")] {
        let change = json!({"name": "Other", "role": role});
        let refused = problem(centre.administrator.patch(&path_of(login), change).await, 409, "conflict").await;
        assert!(refused["detail"].as_str().unwrap().contains("make another account"), "{refused}");
    }
    assert_eq!(centre.trainee.read("/api/v1/me").await["name"], "ada", "a refused change changes nothing");
    let renamed = centre.administrator.patch(&path_of("ada"), json!({"name": "Ada"})).await;
    assert_eq!(read(renamed, StatusCode::OK).await["role"], "trainee");
}

#[tokio::test(flavor = "multi_thread")]
async fn names_that_mislead_a_reader_are_refused_everywhere() {
    let centre = Centre::open().await;
    let by = &centre.administrator;
    let box_token = json!({"name": "\u{202e}nekot", "role": "agent", "box": "box-1"});
    for (noun, body) in [
        ("people", json!({"login": "eve", "name": "\u{200b}\u{200b}", "role": "instructor", "password": PASSWORD})),
        ("groups", json!({"name": "x\u{2028}y"})),
        ("trainees", json!({"name": "\u{feff}x"})),
        ("courses", json!({"name": "\u{2066}Plan", "steps": [{"task": "peg"}]})),
        ("tokens", box_token),
    ] {
        problem(by.post(&format!("/api/v1/{noun}"), body).await, 422, "invalid").await;
    }
    let path = "/api/v1/sessions?trainee=ada&task=peg&box=box-1&filename=%E2%80%AEgpm.mp4";
    let sent = centre.trainee.request(Method::POST, path).body(recording(100, 1)).send().await.unwrap();
    assert_eq!(read(sent, StatusCode::CREATED).await["filename"], "_gpm.mp4");
}
