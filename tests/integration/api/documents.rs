//! The API description, its viewer, the pages, and the endpoints for operators.

use std::collections::BTreeSet;
use std::io::Read;

use reqwest::{StatusCode, header};
use serde_json::Value;

use super::centre::Centre;
use crate::support::{Service, problem};

/// Path, method in lower case, and description of each operation.
pub fn operations(document: &Value) -> Vec<(String, String, &Value)> {
    let paths = document["paths"].as_object().unwrap();
    paths
        .iter()
        .flat_map(|(path, item)| {
            item.as_object().unwrap().iter().map(move |(method, op)| (path.clone(), method.clone(), op))
        })
        .collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_description_names_every_route_of_the_contract() {
    let service = Service::start().await;
    let document = service.stranger().read("/api/v1/openapi.json").await;
    assert!(document["openapi"].as_str().unwrap().starts_with("3.1"));
    let described: BTreeSet<_> = operations(&document)
        .into_iter()
        .map(|(path, method, _)| format!("{} {path}", method.to_uppercase()))
        .collect();
    let contract: BTreeSet<_> = include_str!("routes.txt").lines().map(str::to_owned).collect();
    let (gone, unlisted) = (contract.difference(&described), described.difference(&contract));
    let (gone, unlisted): (Vec<_>, Vec<_>) = (gone.collect(), unlisted.collect());
    assert!(gone.is_empty(), "the contract has them, and they may not disappear: {gone:#?}");
    assert!(unlisted.is_empty(), "add them to tests/integration/api/routes.txt: {unlisted:#?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn every_operation_describes_its_problems_and_who_may_ask() {
    let service = Service::start().await;
    let document = service.stranger().read("/api/v1/openapi.json").await;
    let mut ids = BTreeSet::new();
    for (path, method, operation) in operations(&document) {
        let what = format!("{method} {path}");
        let id = operation["operationId"].as_str().unwrap_or_else(|| panic!("{what} has no id"));
        assert!(ids.insert(id.to_owned()), "{what}: another operation has the id {id}");
        assert!(operation["summary"].as_str().is_some_and(|s| !s.is_empty()), "{what} has no summary");
        let responses = operation["responses"].as_object().unwrap();
        assert!(responses.keys().any(|status| status.starts_with('2') || status == "101"), "{what} has no success");
        let public = matches!(
            path.as_str(),
            "/healthz"
                | "/readyz"
                | "/metrics"
                | "/api/v1/openapi.json"
                | "/api/v1/sign-in"
                | "/api/v1/single-sign-on"
                | "/api/v1/single-sign-on/start"
                | "/api/v1/single-sign-on/finish"
                | "/api/v1/password-links/open"
                | "/api/v1/password-links/use"
                | "/api/v1/certificate-checks"
                | "/api/v1/certificate-checks/{code}"
                | "/api/v1/certificate-keys/{id}"
        ) || (method == "get"
            && matches!(path.as_str(), "/api/v1/centre" | "/api/v1/centre/logo" | "/api/v1/certificate-keys"));
        if !public {
            let refused = &responses.get("401").unwrap_or_else(|| panic!("{what} without 401"))["content"];
            assert!(refused["application/problem+json"].is_object(), "{what}: {refused}");
            assert!(operation["security"].is_array(), "{what} does not say how to sign in");
        }
        assert_eq!(path.contains('{'), responses.contains_key("404"), "{what}: only a path with an id answers 404");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_described_route_exists_and_none_answers_with_a_server_error() {
    let centre = Centre::open().await;
    let document = centre.administrator.read("/api/v1/openapi.json").await;
    for (path, method, operation) in operations(&document) {
        if path.ends_with("/events") || path.ends_with("/sign-out") {
            continue; // the first never ends; the second ends the sign-in of this client
        }
        let address = path.replace("{id}", "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44");
        let method = reqwest::Method::from_bytes(method.to_uppercase().as_bytes()).unwrap();
        let answer = centre.administrator.request(method.clone(), &address).send().await.unwrap();
        let status = answer.status();
        assert!(!status.is_server_error() && status != StatusCode::METHOD_NOT_ALLOWED, "{method} {path}: {status}");
        let described = operation["responses"].as_object().unwrap();
        assert!(described.contains_key(status.as_str()), "{method} {path} answers {status}, not described");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn described_values_are_written_as_answers_write_them() {
    let centre = Centre::open().await;
    let document = centre.administrator.read("/api/v1/openapi.json").await;
    let role = centre.administrator.read("/api/v1/me").await["role"].clone();
    let roles = document["components"]["schemas"]["Role"]["enum"].as_array().unwrap();
    assert!(roles.contains(&role), "{role} is not in {roles:?}");
    let values = described_values(&document);
    assert!(values.len() > 100, "{values:?}");
    let names: Vec<_> = values.iter().filter(|value| value.chars().any(char::is_uppercase)).collect();
    assert!(names.is_empty(), "names of variants, not values of the API: {names:?}");
}

/// The values of all enumerations below `part`.
fn described_values(part: &Value) -> Vec<String> {
    match part {
        Value::Object(members) => members
            .iter()
            .flat_map(|(name, member)| match (name.as_str(), member) {
                ("enum", Value::Array(values)) => values.iter().filter_map(|v| Some(v.as_str()?.to_owned())).collect(),
                _ => described_values(member),
            })
            .collect(),
        Value::Array(items) => items.iter().flat_map(described_values).collect(),
        _ => Vec::new(),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_viewer_loads_nothing_from_other_hosts() {
    let service = Service::start().await;
    let stranger = service.stranger();
    assert_eq!(stranger.get("/docs").await.headers()[header::LOCATION], "/docs/");
    let page = stranger.get("/docs/").await.text().await.unwrap();
    assert!(page.contains("swagger-ui") && !page.contains("http://") && !page.contains("https://"), "{page}");
    for file in ["swagger-ui-bundle.js", "swagger-ui.css", "swagger-initializer.js"] {
        assert_eq!(stranger.get(&format!("/docs/{file}")).await.status(), StatusCode::OK, "{file}");
    }
    let start = stranger.get("/docs/swagger-initializer.js").await.text().await.unwrap();
    assert!(start.contains("/api/v1/openapi.json"), "{start}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_pages_come_from_the_program_and_are_not_sent_twice() {
    let service = Service::start().await;
    let stranger = service.stranger();
    let page = stranger.get("/").await;
    assert_eq!(page.status(), StatusCode::OK);
    assert!(page.headers()[header::CONTENT_TYPE].to_str().unwrap().starts_with("text/html"));
    let etag = page.headers()[header::ETAG].to_str().unwrap().to_owned();
    let again = stranger.clone().with("if-none-match", &etag).get("/").await;
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    assert_eq!(stranger.get("/sessions/some-id").await.text().await.unwrap(), page.text().await.unwrap());
    problem(stranger.get("/missing.js").await, 404, "not-found").await;
    problem(stranger.get("/api/v1/nothing").await, 404, "not-found").await;
    problem(stranger.post("/api/v1/me", Value::Null).await, 405, "method-not-allowed").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_keeps_the_files_of_a_version_and_asks_again_for_all_others() {
    let service = Service::start().await;
    let stranger = service.stranger();
    let page = stranger.get("/").await.text().await.unwrap();
    let kept: Vec<_> = page.split('"').filter(|word| word.starts_with("/kept/")).collect();
    assert!(kept.len() > 20 && !page.contains("VERSION"), "{page}");
    let version = kept[0].split('/').nth(2).unwrap();
    for path in &kept {
        let file = stranger.get(path).await;
        assert_eq!(file.status(), StatusCode::OK, "{path}");
        assert_eq!(file.headers()[header::CACHE_CONTROL], "public, max-age=31536000, immutable", "{path}");
    }
    let script = stranger.get("/app.js").await;
    assert_eq!(script.headers()[header::CACHE_CONTROL], "no-cache");
    let script = script.text().await.unwrap();
    let other_version = stranger.get("/kept/another/app.js").await;
    assert_eq!(
        other_version.headers()[header::CACHE_CONTROL],
        "no-cache",
        "a client of an earlier version gets this one, without caching"
    );
    assert_eq!(other_version.text().await.unwrap(), script);
    assert_eq!(stranger.get(&format!("/kept/{version}/app.js")).await.text().await.unwrap(), script);
    problem(stranger.get(&format!("/kept/{version}/missing.js")).await, 404, "not-found").await;
    problem(stranger.get(&format!("/kept/{version}/sessions")).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn files_that_are_read_often_are_compressed_if_the_client_accepts_it() {
    let service = Service::start().await;
    let stranger = service.stranger();
    for path in ["/", "/app.js", "/texts/en.js", "/api/v1/openapi.json"] {
        let plain = stranger.get(path).await;
        assert!(!plain.headers().contains_key(header::CONTENT_ENCODING), "{path}");
        let plain = plain.bytes().await.unwrap();
        let compressed = stranger.clone().with("accept-encoding", "gzip, deflate, br").get(path).await;
        assert_eq!(compressed.headers()[header::CONTENT_ENCODING], "gzip", "{path}");
        assert!(compressed.headers()[header::VARY].to_str().unwrap().contains("accept-encoding"), "{path}");
        let compressed = compressed.bytes().await.unwrap();
        assert!(compressed.len() < plain.len() * 2 / 3, "{path}: {} of {} bytes", compressed.len(), plain.len());
        let mut decompressed = Vec::new();
        flate2::read::GzDecoder::new(&compressed[..]).read_to_end(&mut decompressed).unwrap();
        assert_eq!(decompressed, plain, "{path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn health_readiness_and_metrics_answer_without_a_sign_in() {
    let service = Service::start().await;
    let stranger = service.stranger();
    assert_eq!(stranger.get("/healthz").await.status(), StatusCode::OK);
    assert_eq!(stranger.get("/readyz").await.status(), StatusCode::OK);
    let metrics = stranger.get("/metrics").await.text().await.unwrap();
    let jobs = ["trocar_jobs{state=\"queued\"}", "trocar_jobs{state=\"quarantined\"}", "trocar_jobs_failed_total"];
    for name in ["trocar_http_requests_total"].iter().chain(&jobs) {
        assert!(metrics.contains(name), "{name} in\n{metrics}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn through_a_proxy_only_staff_read_the_metrics() {
    let centre = Centre::open().await;
    for (header, value) in [
        ("x-forwarded-for", "203.0.113.7"),
        ("forwarded", "for=203.0.113.7"),
        ("x-real-ip", "203.0.113.7"),
        ("via", "1.1 p"),
    ] {
        problem(centre.service.stranger().with(header, value).get("/metrics").await, 401, "not-signed-in").await;
        problem(centre.trainee.clone().with(header, value).get("/metrics").await, 403, "forbidden").await;
        problem(centre.agent.clone().with(header, value).get("/metrics").await, 403, "forbidden").await;
        assert_eq!(centre.instructor.clone().with(header, value).get("/metrics").await.status(), StatusCode::OK);
    }
}
