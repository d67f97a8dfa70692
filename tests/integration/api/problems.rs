//! Every refusal is a problem document with `errors`, the list of the fields that cannot be used.

use std::collections::BTreeSet;

use reqwest::{Method, RequestBuilder, Response, header};
use serde_json::{Value, json};

use super::centre::{Centre, recording, session};
use super::documents::operations;
use crate::support::{Client, problem};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

/// The path with this text as each of its variable parts.
fn filled(path: &str, value: &str) -> String {
    path.split('/').map(|part| if part.starts_with('{') { value } else { part }).collect::<Vec<_>>().join("/")
}

/// Requests of this route that are wrong in one way each.
fn bad_requests(centre: &Centre, method: &Method, path: &str) -> Vec<(&'static str, RequestBuilder)> {
    let [stranger, trainee, administrator] = [&centre.service.stranger(), &centre.trainee, &centre.administrator]
        .map(|c| c.clone().with("tus-resumable", "1.0.0"));
    let foreign = administrator.clone().with("origin", "http://evil.example");
    let missing = filled(path, MISSING);
    let request = |client: &Client, address: &str| client.request(method.clone(), address);
    let json = |address: &str, body: &'static str| {
        request(&administrator, address).header(header::CONTENT_TYPE, "application/json").body(body)
    };
    vec![
        ("without a sign-in", request(&stranger, &missing)),
        ("as a trainee", request(&trainee, &missing)),
        ("from another site", request(&foreign, &missing)),
        ("without tus", request(&centre.administrator, &missing)),
        ("with an unknown id", request(&administrator, &missing)),
        ("with an id that is not UTF-8", request(&administrator, &filled(path, "%FF"))),
        ("with a broken body", json(&missing, "{")),
        ("with an unknown field", json(&missing, "{\"no_such_field\":1}")),
        ("with a body of the wrong type", json(&missing, "[1]")),
        ("with an unknown parameter", json(&format!("{missing}?no_such_parameter=1"), "{}")),
        ("with an unknown method", administrator.request(Method::from_bytes(b"PROPFIND").unwrap(), &missing)),
    ]
}

/// The status of a refusal, after a check of its document; `None` for any other answer.
async fn checked_refusal(what: &str, answer: Response) -> Option<u16> {
    let status = answer.status();
    if !status.is_client_error() {
        assert!(!status.is_server_error(), "{what}: {status}");
        return None;
    }
    let kind = answer.headers().get(header::CONTENT_TYPE).cloned();
    let text = answer.text().await.unwrap();
    assert_eq!(kind.unwrap_or_else(|| panic!("{what}: {status} without a type")), "application/problem+json", "{text}");
    let document: Value = serde_json::from_str(&text).unwrap();
    let errors = document["errors"].as_array().unwrap_or_else(|| panic!("{what}: no errors in {document}"));
    for error in errors {
        let is_text = |key: &str| error[key].as_str().is_some_and(|text| !text.is_empty());
        assert!(is_text("field") && is_text("message"), "{what}: {error}");
    }
    let about_a_field = document["type"] == "/problems/invalid" || document["type"] == "/problems/unknown-reference";
    assert!(!(about_a_field && errors.is_empty()), "{what}: no field in {document}");
    Some(status.as_u16())
}

#[tokio::test(flavor = "multi_thread")]
async fn every_refusal_of_every_route_lists_errors() {
    let centre = Centre::open().await;
    let document = centre.administrator.read("/api/v1/openapi.json").await;
    let mut statuses = BTreeSet::new();
    for (path, method, _) in operations(&document) {
        if method == "head" || path.ends_with("/sign-out") || path.ends_with("/events") {
            continue; // a HEAD has no body, a sign-out ends the client's sign-in, and events never end
        }
        let method: Method = method.to_uppercase().parse().unwrap();
        for (how, request) in bad_requests(&centre, &method, &path) {
            let what = format!("{method} {path} {how}");
            statuses.extend(checked_refusal(&what, request.send().await.unwrap()).await);
        }
    }
    let expected = BTreeSet::from([400, 401, 403, 404, 405, 412, 415, 422]);
    assert!(statuses.is_superset(&expected), "the requests caused only {statuses:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn addresses_without_a_route_list_errors() {
    let centre = Centre::open().await;
    let stranger = centre.service.stranger();
    for path in ["/api/v1/nothing", "/api/v2/me", "/api/v1/boxes/%FF/nothing", "/docs/%FF", "/problems/x", "/a.js"] {
        let status = checked_refusal(path, stranger.get(path).await).await;
        assert_eq!(status, Some(404), "{path}");
    }
    assert_eq!(checked_refusal("POST /", stranger.post("/", Value::Null).await).await, Some(405));
}

#[tokio::test(flavor = "multi_thread")]
async fn errors_names_the_field_that_cannot_be_used() {
    let centre = Centre::open().await;
    let administrator = &centre.administrator;
    let rows = json!({"rows": [{"name": "Eve"}, {"name": ""}]});
    let steps = json!({"name": "A", "steps": [{"task": "peg", "sessions": 1}, {"task": "peg", "sessions": "two"}]});
    for (answer, status, slug, fields) in [
        (administrator.post("/api/v1/tasks", json!({"name": ""})).await, 422, "invalid", vec!["name"]),
        (administrator.post("/api/v1/tasks", json!({})).await, 422, "invalid", vec!["body"]),
        (administrator.post("/api/v1/courses", steps).await, 422, "invalid", vec!["steps[1].sessions"]),
        (administrator.post("/api/v1/enrolments", rows).await, 422, "invalid", vec!["rows[1].name"]),
        (administrator.get("/api/v1/tasks?limit=0").await, 422, "invalid", vec!["limit"]),
        (administrator.get("/api/v1/tasks?limit=x").await, 400, "bad-request", vec!["query"]),
        (administrator.get("/api/v1/boxes/none").await, 404, "not-found", vec![]),
    ] {
        let document = problem(answer, status, slug).await;
        let named: Vec<&str> =
            document["errors"].as_array().unwrap().iter().map(|error| error["field"].as_str().unwrap()).collect();
        assert_eq!(named, fields, "{document}");
    }
    let upload = administrator.clone().with("tus-resumable", "1.0.0").with("upload-length", "many");
    let refused = problem(upload.post("/api/v1/uploads", Value::Null).await, 400, "bad-request").await;
    assert_eq!(refused["errors"][0]["field"], "upload-length");
}

#[tokio::test(flavor = "multi_thread")]
async fn every_list_refuses_a_text_that_is_no_cursor_and_a_damaged_one() {
    let centre = Centre::open().await;
    let whole = centre.administrator.read("/api/v1/people?limit=1").await["next"].as_str().unwrap().to_owned();
    centre.administrator.read(&format!("/api/v1/people?limit=1&cursor={whole}")).await;
    let document = centre.administrator.read("/api/v1/openapi.json").await;
    let has_cursor = |operation: &Value| {
        operation["parameters"].as_array().is_some_and(|all| all.iter().any(|one| one["name"] == "cursor"))
    };
    session(&centre.administrator, "ada", recording(100, 1)).await;
    session(&centre.administrator, "ada", recording(100, 2)).await;
    let trainees = centre.administrator.read("/api/v1/trainees").await;
    let ids: Vec<&Value> = trainees["items"].as_array().unwrap().iter().map(|trainee| &trainee["id"]).collect();
    let cohort = centre.administrator.make("/api/v1/cohorts", json!({"name": "One", "members": ids})).await;
    centre.administrator.make("/api/v1/cohorts", json!({"name": "Two", "members": ids})).await;
    let (mut checked, mut lists, mut cursors) = (0, Vec::new(), Vec::new());
    for (path, method, operation) in operations(&document) {
        if !has_cursor(operation) {
            continue;
        }
        assert_eq!(method, "get", "{path}");
        let id = match path.split('/').nth(3) {
            Some("boxes") => "box-1",
            Some("trainees") => "ada",
            Some("cohorts") => "one",
            _ => MISSING,
        };
        let path = filled(&path, id);
        let first: Value = centre.administrator.get(&format!("{path}?limit=1")).await.json().await.unwrap();
        let is_replaced = operation["deprecated"] == true; // another address of a list
        if let Some(next) = first["next"].as_str().filter(|_| !is_replaced) {
            centre.administrator.read(&format!("{path}?limit=1&cursor={next}")).await;
            cursors.push((path.clone(), next.to_owned()));
        }
        for cursor in ["", "x", "17", "peg", MISSING, "1.2.3", &whole[1..], &whole[..whole.len() - 1]] {
            assert_cursor_is_refused(&centre, &path, cursor).await;
        }
        checked += 1;
        lists.extend(Some(path).filter(|_| !is_replaced));
    }
    assert!(checked >= 14, "{lists:?}");
    assert!(cursors.len() >= 6, "{cursors:?}");
    let (_, of_members) = cursors.iter().find(|(of, _)| of == "/api/v1/cohorts/one/members").unwrap();
    let by_id = format!("/api/v1/cohorts/{}/members?cursor={of_members}", cohort["id"].as_str().unwrap());
    assert_eq!(centre.administrator.read(&by_id).await["items"].as_array().unwrap().len(), 1);
    lists.push("/api/v1/cohorts/two/members".to_owned());
    for list in &lists {
        for (_, foreign) in cursors.iter().filter(|(of, _)| of != list) {
            assert_cursor_is_refused(&centre, list, foreign).await;
        }
    }
}

async fn assert_cursor_is_refused(centre: &Centre, list: &str, cursor: &str) {
    let answer = centre.administrator.get(&format!("{list}?cursor={cursor}")).await;
    let refused = problem(answer, 422, "invalid").await;
    assert_eq!(refused["errors"][0]["field"], "cursor", "{list}: {refused}");
    let what_to_do = refused["detail"].as_str().unwrap();
    assert!(what_to_do.contains("use `next` of the previous page"), "{list}: {refused}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_value_that_cannot_be_used_is_named_with_its_field_and_no_place_in_the_json() {
    let centre = Centre::open().await;
    let account = json!({"login": "ines maier", "name": "Ines", "role": "instructor"});
    let refused = problem(centre.administrator.post("/api/v1/people", account).await, 422, "invalid").await;
    let error = &refused["errors"][0];
    assert_eq!((error["field"].as_str(), refused["errors"].as_array().unwrap().len()), (Some("login"), 1), "{refused}");
    for text in [&error["message"], &refused["detail"]] {
        let text = text.as_str().unwrap();
        assert!(text.contains("login") && !text.contains("column") && !text.contains("/docs"), "{text}");
    }
}
