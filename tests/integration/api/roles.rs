//! Scopes: what each role sees. Hidden data and missing data give the same answer. `rights/` tries each route.

use reqwest::{Method, StatusCode};
use serde_json::json;

use super::centre::{Centre, recording, session};
use crate::support::{Client, problem};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

/// Status, headers and body: everything that a client can distinguish, except the request id and the date.
async fn full_answer(client: &Client, method: Method, path: &str) -> (StatusCode, String, String) {
    let answer = client.request(method, path).send().await.unwrap();
    let mut headers: Vec<_> = answer
        .headers()
        .iter()
        .filter(|(name, _)| *name != "x-request-id" && *name != "date")
        .map(|(name, value)| format!("{name}: {}", value.to_str().unwrap()))
        .collect();
    headers.sort();
    (answer.status(), headers.join("\n"), answer.text().await.unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn hidden_data_and_missing_data_give_the_same_bytes() {
    let centre = Centre::open().await;
    let foreign = session(&centre.administrator, "bob", recording(100, 1)).await["id"].as_str().unwrap().to_owned();
    let sessions = ["", "/video", "/trajectory", "/preview.jpg", "/diagnostics"];
    for client in [&centre.instructor, &centre.trainee] {
        for part in sessions {
            let hidden = full_answer(client, Method::GET, &format!("/api/v1/sessions/{foreign}{part}")).await;
            let missing = full_answer(client, Method::GET, &format!("/api/v1/sessions/{MISSING}{part}")).await;
            assert_eq!(hidden.0, StatusCode::NOT_FOUND, "{part}");
            assert_eq!(hidden, missing, "{part}");
        }
        for path in ["/api/v1/trainees/", "/api/v1/trainees/"] {
            let hidden = full_answer(client, Method::GET, &format!("{path}bob")).await;
            assert_eq!(hidden.0, StatusCode::NOT_FOUND);
            assert_eq!(hidden, full_answer(client, Method::GET, &format!("{path}missing")).await);
        }
    }
    for method in [Method::DELETE, Method::PATCH] {
        let body = json!({"name": "taken over"});
        let ask =
            |id: &str| centre.instructor.request(method.clone(), &format!("/api/v1/trainees/{id}")).json(&body).send();
        let (hidden, missing) = (ask("bob").await.unwrap(), ask("missing").await.unwrap());
        assert_eq!(hidden.status(), StatusCode::NOT_FOUND, "{method}");
        assert_eq!(hidden.text().await.unwrap(), missing.text().await.unwrap(), "{method}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn each_role_sees_its_own_people_and_recordings() {
    let centre = Centre::open().await;
    let ada = session(&centre.trainee, "ada", recording(100, 1)).await["id"].clone();
    let bob = session(&centre.other_instructor, "bob", recording(100, 1)).await["id"].clone();
    let expected: [(&Client, &[&str], Vec<_>); 5] = [
        (&centre.administrator, &["ada", "bob"], vec![&ada, &bob]),
        (&centre.instructor, &["ada"], vec![&ada]),
        (&centre.other_instructor, &["bob"], vec![&bob]),
        (&centre.trainee, &["ada"], vec![&ada]),
        (&centre.other_trainee, &["bob"], vec![&bob]),
    ];
    for (client, trainees, sessions) in expected {
        let list = client.read("/api/v1/trainees").await;
        let mut codes: Vec<_> = list["items"].as_array().unwrap().iter().map(|t| t["code"].as_str().unwrap()).collect();
        codes.sort();
        assert_eq!(codes, trainees);
        let list = client.read("/api/v1/sessions").await;
        let mut ids: Vec<_> = list["items"].as_array().unwrap().iter().map(|s| &s["id"]).collect();
        ids.sort_by_key(|id| id.to_string());
        assert_eq!(ids, sessions);
        let jobs = client.read("/api/v1/jobs").await;
        assert!(jobs["items"].as_array().unwrap().len() <= sessions.len());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_agent_has_no_access_beyond_its_box() {
    let centre = Centre::open().await;
    assert_eq!(centre.agent.read("/api/v1/me").await["role"], "agent");
    for path in ["people", "groups", "tokens", "trainees", "sessions", "jobs", "events"] {
        problem(centre.agent.get(&format!("/api/v1/{path}")).await, 403, "forbidden").await;
    }
    problem(centre.agent.post("/api/v1/sessions?trainee=ada&task=peg&box=box-1", json!({})).await, 403, "forbidden")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_sign_in_every_route_answers_only_that_one_is_needed() {
    let centre = Centre::open().await;
    let stranger = centre.service.stranger();
    for path in [
        "me",
        "people",
        "password-links",
        "groups",
        "tokens",
        "boxes",
        "trainees",
        "tasks",
        "sessions",
        "jobs",
        "events",
        "uploads/x",
    ] {
        let answer = stranger.get(&format!("/api/v1/{path}")).await;
        assert!(answer.headers().contains_key("www-authenticate") || path == "uploads/x", "{path}");
        if path != "uploads/x" {
            problem(answer, 401, "not-signed-in").await;
        }
    }
    for token in ["trc_", "trc_AAAA", "nonsense"] {
        let wrong = centre.service.stranger().with_token(token);
        problem(wrong.get("/api/v1/me").await, 401, "not-signed-in").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_is_accepted_only_for_a_trainee_in_the_senders_scope() {
    let centre = Centre::open().await;
    for (client, trainee) in [(&centre.trainee, "bob"), (&centre.instructor, "bob"), (&centre.administrator, "missing")]
    {
        let answer = super::centre::send(client, trainee, recording(100, 3)).await;
        let refused = problem(answer, 422, "unknown-reference").await;
        assert_eq!(refused["field"], "trainee");
    }
}
